//! Everything outside the chip: the sensor on the drone, the drone on its pivot, the servo, the
//! clamp, the second sensor on the board, and the logic analyser that records what really happens.
//!
//! ```text
//!   I2C          -- BNO055 at the pivot, x forward, z down
//!   first servo  -- servo -> crank -> rudder -> drone's pitch
//!   second servo -- the same of its roll, or a jumper from the first
//!   probe        -- a control step is busy
//! ```
//!
//! [`Wiring`](super::Wiring) says which pins these are.
//!
//! The drone pitches about the body's y axis, to the right; nose up is positive, which is the
//! plant's counter-clockwise `theta0` seen from the right. With [`VehicleConfig::TwoAxes`] it rolls
//! and spins, too, and [`VehicleConfig::Rocket`] puts a rocket in its place. The pivot does not
//! move, so that an accelerometer there feels gravity alone; [`BenchConfig::lever_m`] moves the
//! sensor away from it.

use super::clamp::Clamp;
use super::config::{BenchConfig, hang};
use super::disturbance::Disturbances;
use super::sensor_motion::{HeldSensor, SensorMotion};
use super::vehicle::Vehicle;
use super::{Knock, Magnet, Since, stimulus};
use crate::bno055::{Bno055, Fault};
use crate::inertial::Stimulus;
use crate::lsm6ds3::Lsm6ds3;
use crate::observe::ground_truth::{GroundTruth, Motion};
use crate::observe::logic_analyzer::{LogicAnalyzer, Registers};
use crate::observe::waves::Waves;
use crate::unsent::Unsent;
use nalgebra::{UnitQuaternion, Vector3};
use plant::{Checked, Crank, Servo};
use samd21::board::{Board, I2cCut, I2cEvent, I2cPins, I2cReply, Lines, Pin, Ticks};
use tvc_nano::Axis;
use tvc_nano::sensor::Kind;

/// Pulse width at which the horn is mounted for zero rudder, us.
pub const ZERO_RUDDER_US: f64 = 1523.6;
/// What a count of TCC0 lasts: 1/3 us.
const SERVO_COUNT: Ticks = Ticks(16);

/// Step of the physics.
const STEP: Ticks = Ticks::from_us(500);
/// Steps of the physics to one recorded [`Motion`].
const MOTION_EVERY: u64 = 2;
/// How long it takes to put the sensor back on the drone by hand, s.
const BACK_S: f64 = 1.5;
/// A bus on which nothing has happened.
const SILENT: (I2cEvent, I2cReply) = (I2cEvent::Stop, I2cReply::NAK);

/// The chip's environment. Whatever the chip does at its pins first advances it to that time.
#[derive(Clone, Debug)]
pub struct Environment {
    /// What stands on the bench; its disturbances are those of now.
    bench: BenchConfig,
    vehicle: Vehicle,
    /// Of each axis that the drone has a rudder for.
    servos: Vec<Servo>,
    /// The sensor.
    pub sensor: Bno055,
    /// The sensor on the microcontroller's board, on the same bus.
    pub onboard: Lsm6ds3,
    /// Its transfer is on the bus.
    talks_to_onboard: bool,
    /// The last event on the bus, and its answer.
    answered: (I2cEvent, I2cReply),
    /// What the slave has not sent of it, where the chip has let go of the bus.
    unsent: Unsent,
    /// Rates about the body's axes, rad/s, and their mean change in the last step, rad/s^2.
    turning: (Vector3<f64>, Vector3<f64>),
    /// Rate about its own vertical with which it is released, rad/s.
    pub(crate) spin_rad_s: f64,
    /// A torque that acts on the drone, N m, and when it ends.
    gust: Option<(f64, Ticks)>,
    /// The newest knock on the sensor's board, and when it began.
    knock: Option<(Knock, Ticks)>,
    /// The newest magnet that passes, likewise.
    magnet: Option<(Magnet, Ticks)>,
    /// When the power came on.
    powered: Ticks,
    /// Steps of the physics so far.
    steps: u64,
    clamp: Clamp,
    /// The sensor while it is held off the drone, and whether it is on its way back.
    held_sensor: Option<(HeldSensor, bool)>,
    /// The level at the jumper's end, `None` without one.
    jumper: Option<bool>,
    analyzer: LogicAnalyzer,
    /// What was seen of the vehicle, its bus and its servos.
    pub truth: GroundTruth,
}

impl Environment {
    /// Power-on: the clamp holds the drone at its start, the rudder is at zero.
    ///
    /// # Errors
    /// Impossible parameters of the drone.
    pub fn new(bench: &BenchConfig) -> Checked<Self> {
        let (mut vehicle, tilt_rad, zero_rad) = hang(bench)?;
        let clamp = Clamp::closed(&mut vehicle, tilt_rad);
        let model = bench.servo.fitted(ZERO_RUDDER_US, zero_rad);
        let mut sensor = bench.sensor.clone();
        if let Some(temperature) = &bench.disturbances.temperature {
            sensor.errors = temperature.of(sensor.errors);
        }
        Ok(Self {
            bench: bench.clone(),
            vehicle,
            servos: vec![Servo::new(model, zero_rad, 0.0); bench.axes()],
            onboard: Lsm6ds3::new(sensor.seed, bench.onboard),
            sensor: Bno055::new(sensor),
            talks_to_onboard: false,
            answered: SILENT,
            unsent: Unsent::default(),
            turning: (Vector3::zeros(), Vector3::zeros()),
            spin_rad_s: 0.0,
            gust: None,
            knock: None,
            magnet: None,
            powered: Ticks::ZERO,
            steps: 0,
            clamp,
            held_sensor: None,
            jumper: (bench.jumper && bench.axes() == 1).then_some(false),
            analyzer: LogicAnalyzer::default(),
            truth: GroundTruth {
                waves: bench.waves.then(Waves::default),
                ..GroundTruth::default()
            },
        })
    }

    /// Runs the physics up to `now`.
    pub fn advance(&mut self, now: Ticks) {
        while STEP * (self.steps + 1) <= now {
            self.step();
        }
    }

    /// The vehicle.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Has the clamp bring a held drone to a pitch and a roll, rad.
    pub fn tilt_clamp_to(&mut self, tilt_rad: [f64; Axis::COUNT]) {
        self.clamp.wanted_rad = tilt_rad;
    }

    /// Whether the clamp holds the drone at the tilt that [`Self::tilt_clamp_to`] has asked for.
    pub fn clamp_rests(&self) -> bool {
        self.clamp.rests(&self.vehicle)
    }

    /// Opens the clamp; the drone leaves it with a rate along its tilt, rad/s.
    pub fn release(&mut self, rate_rad_s: f64) {
        self.vehicle.release(rate_rad_s, self.spin_rad_s);
        self.clamp.released.get_or_insert(STEP * self.steps);
    }

    /// Closes the clamp on the drone where it is; the faults of its flight end.
    pub fn catch(&mut self) {
        self.end_faults(Since::Release);
        let tilt_rad = self.vehicle.tilt_rad();
        self.clamp = Clamp::closed(&mut self.vehicle, tilt_rad);
    }

    /// Moves the sensor by hand, off the drone.
    pub fn move_sensor(&mut self, motion: SensorMotion) {
        let on_drone = self.mounted();
        let held = || (HeldSensor::new(on_drone), false);
        let (sensor, back) = self.held_sensor.get_or_insert_with(held);
        sensor.begin(motion);
        *back = false;
    }

    /// Puts the sensor back on the drone, if it is off.
    pub fn put_back(&mut self) {
        let home = self.mounted();
        if let Some((sensor, back)) = &mut self.held_sensor {
            sensor.begin(SensorMotion::To(home, BACK_S));
            *back = true;
        }
    }

    /// Attitude of the sensor on the drone, to north-east-down.
    pub fn mounted(&self) -> UnitQuaternion<f64> {
        self.vehicle.attitude(self.bench.heading_rad)
    }

    /// Switches a fault of the sensor or its cable on.
    pub fn inject(&mut self, now: Ticks, fault: Fault) {
        self.advance(now);
        self.sensor.inject(now, fault);
    }

    /// Switches a fault off.
    pub fn clear(&mut self, now: Ticks, fault: Fault) {
        self.advance(now);
        self.sensor.clear(now, fault);
    }

    /// The power has come on: the faults whose times count from then begin anew.
    pub fn power_on(&mut self) {
        self.end_faults(Since::PowerOn);
        self.powered = STEP * self.steps;
        self.onboard.power_on(self.powered);
        self.answered = SILENT;
        self.unsent = Unsent::default();
    }

    fn end_faults(&mut self, since: Since) {
        let now = STEP * self.steps;
        for timed in self.bench.faults.iter().filter(|timed| timed.since == since) {
            self.sensor.clear(now, timed.fault);
        }
    }

    /// Gives a free drone an angular impulse, N m s.
    pub fn push(&mut self, impulse_n_m_s: f64) {
        self.vehicle.kick(impulse_n_m_s);
    }

    /// Pushes a free drone with a torque, N m, for a time, s.
    pub fn gust(&mut self, torque_n_m: f64, seconds: f64) {
        self.gust = Some((torque_n_m, STEP * self.steps + Ticks::from_secs_f64(seconds)));
    }

    /// Strikes the sensor's board, wherever that is.
    pub fn knock(&mut self, knock: Knock) {
        self.knock = Some((knock, STEP * self.steps));
    }

    /// Leads a magnet past the sensor.
    pub fn pass_magnet(&mut self, magnet: Magnet) {
        self.magnet = Some((magnet, STEP * self.steps));
    }

    /// What disturbs the drone now.
    pub fn disturbances(&self) -> Disturbances {
        self.bench.disturbances
    }

    /// Replaces what disturbs the drone from now on. A temperature counts from the first power-on.
    pub fn set_disturbances(&mut self, disturbances: Disturbances) {
        self.bench.disturbances = disturbances;
        for servo in &mut self.servos {
            servo.set_supply(1.0);
        }
        self.vehicle.set_thrust(self.bench.parameters.thrust_n);
        let temperature = disturbances.temperature;
        let errors = self.bench.sensor.errors;
        self.sensor.set_errors(temperature.map_or(errors, |temperature| temperature.of(errors)));
    }

    /// The chip has been reset: what has begun on the bus and at the probe pin is forgotten. What
    /// its pins do then it says itself.
    pub fn chip_reset(&mut self) {
        self.analyzer = LogicAnalyzer::default();
    }

    fn step(&mut self) {
        self.steps += 1;
        let now = STEP * self.steps;
        let dt_s = STEP.as_secs_f64();
        self.disturb(now);
        for timed in &self.bench.faults {
            let Some(since) = (match timed.since {
                Since::PowerOn => Some(now.saturating_sub(self.powered)),
                Since::Release => self.clamp.open_for(now),
            }) else {
                continue;
            };
            let step = since.saturating_sub(STEP)..since;
            if step.contains(&timed.at) {
                self.sensor.inject(now, timed.fault);
            }
            if step.contains(&timed.until) {
                self.sensor.clear(now, timed.fault);
            }
        }
        let loads = self.vehicle.crank_loads();
        let mut cranks = [Crank::default(); Axis::COUNT];
        for ((servo, load), crank) in self.servos.iter_mut().zip(loads).zip(&mut cranks) {
            *crank = servo.advance(now.as_secs_f64(), load);
        }
        let tilt_rad_s = self.clamp.tilt(&mut self.vehicle, dt_s);
        let targets_rad = self.targets_rad();
        self.vehicle.step(dt_s, cranks, targets_rad);
        if let Vehicle::Rocket(rocket) = &self.vehicle {
            // The shafts of the gimbal's actuators stand for the cranks.
            cranks = rocket.shafts_rad().map(Crank::at_rest);
        }
        let stimulus = self.felt(now, dt_s, tilt_rad_s);
        self.sensor.sense(now, &stimulus);
        self.onboard.sense(now, &stimulus);
        if self.steps.is_multiple_of(MOTION_EVERY) {
            let motion = self.seen(now, cranks, tilt_rad_s);
            self.truth.motion.push(motion);
        }
    }

    /// Where the last finished pulses want the servos, rad.
    fn targets_rad(&self) -> [f64; Axis::COUNT] {
        let mut targets = self.servos.iter().map(Servo::target_rad);
        [(); Axis::COUNT].map(|()| targets.next().unwrap_or_default())
    }

    /// What is seen of drone and servos; the clamp moves a held drone at `tilt_rad_s`.
    fn seen(&self, now: Ticks, cranks: [Crank; 2], tilt_rad_s: [f64; 2]) -> Motion {
        let [roll_rate, pitch_rate, _] = self.vehicle.rates_rad_s();
        let [pitch_tilt, roll_tilt] = tilt_rad_s;
        Motion {
            time: now,
            tilt_rad: self.vehicle.level_tilt_rad(self.bench.heading_rad),
            rates_rad_s: [pitch_rate + pitch_tilt, roll_rate + roll_tilt],
            rudders_rad: self.vehicle.rudders_rad(),
            cranks_rad: cranks.map(|crank| crank.angle_rad),
            targets_rad: self.targets_rad(),
        }
    }

    /// What the sensor feels in a step, at whose end the drone is where it is now.
    fn felt(&mut self, now: Ticks, dt_s: f64, tilt_rad_s: [f64; Axis::COUNT]) -> Stimulus {
        // Accelerations are the mean over the step, so that a jump of the rate, as at the release,
        // is felt once.
        let [roll, pitch, spin] = self.vehicle.sensed_rates_rad_s();
        let rates = Vector3::new(roll + tilt_rad_s[1], pitch + tilt_rad_s[0], spin);
        self.turning = (rates, (rates - self.turning.0) / dt_s);
        let mut felt = match self.felt_in_hand(dt_s) {
            Some(felt) => felt,
            None => self.felt_on_drone(now),
        };
        let since_s = |begun: Ticks| (now - begun).as_secs_f64();
        if let Some((knock, begun)) = &self.knock {
            let (force, rate) = knock.at(since_s(*begun));
            add(&mut felt.specific_force_m_s2, force);
            add(&mut felt.rate_rad_s, rate);
        }
        if let Some((magnet, begun)) = &self.magnet {
            add(&mut felt.field_ut, magnet.at(since_s(*begun)));
        }
        felt
    }

    /// What the sensor feels while it is off the drone.
    fn felt_in_hand(&mut self, dt_s: f64) -> Option<Stimulus> {
        let gravity = self.vehicle.gravity_m_s2();
        let (sensor, back) = self.held_sensor.as_mut()?;
        let rate = sensor.advance(dt_s);
        let mut felt = stimulus::in_hand(&sensor.attitude(), rate, &self.bench.field, gravity);
        add(&mut felt.specific_force_m_s2, sensor.acceleration_m_s2());
        if *back && sensor.has_arrived() {
            self.held_sensor = None;
        }
        Some(felt)
    }

    /// What the sensor feels on the drone, with the propeller's vibration while the drone is free.
    fn felt_on_drone(&self, now: Ticks) -> Stimulus {
        let gravity = self.vehicle.gravity_m_s2();
        let (rates, accelerations) = self.turning;
        let mut felt = match &self.vehicle {
            Vehicle::Pivot(_) => stimulus::on_drone(
                self.vehicle.pitch_rad(),
                (rates.y, accelerations.y),
                self.bench.lever_m,
                self.bench.heading_rad,
                &self.bench.field,
                gravity,
            ),
            Vehicle::Joint(drone) => stimulus::in_joint(
                &drone.attitude(),
                self.turning,
                self.bench.lever_m,
                &self.bench.field,
                gravity,
            ),
            Vehicle::Rocket(rocket) => {
                stimulus::in_ascent(rocket.ascent(), rates, &self.bench.field)
            }
        };
        if let Some(vibration) = self.bench.disturbances.vibration
            && self.clamp.open_for(now).is_some()
        {
            let (force, rate) = vibration.at(now.as_secs_f64());
            add(&mut felt.specific_force_m_s2, force);
            add(&mut felt.rate_rad_s, rate);
        }
        felt
    }

    /// The lines of the bus that others than the chip hold low.
    pub fn held_low(&self, now: Ticks) -> Lines {
        let (sensor, unsent) = (self.sensor.held_low(now), self.unsent.held_low(now));
        Lines { sda: sensor.sda || unsent.sda, scl: sensor.scl || unsent.scl }
    }

    /// Sets the servo's supply and the thrust to what they are now.
    fn disturb(&mut self, now: Ticks) {
        let since_s = self.clamp.open_for(now).map(|since| since.as_secs_f64());
        if let Some(sag) = self.bench.disturbances.servo_supply {
            // One battery for all servos.
            let current = self.servos.iter().map(Servo::current_share).sum();
            let share = since_s.map_or(1.0, |since_s| sag.share(since_s, current));
            for servo in &mut self.servos {
                servo.set_supply(share);
            }
        }
        if let Some(ramp) = self.bench.disturbances.thrust_ramp {
            let share = ramp.share(since_s.unwrap_or(0.0));
            self.vehicle.set_thrust(share * self.bench.parameters.thrust_n);
        }
        self.gust = self.gust.filter(|(_, until)| now <= *until);
        if let Some((torque_n_m, _)) = self.gust {
            self.vehicle.kick(torque_n_m * STEP.as_secs_f64());
        }
    }
}

fn add(to: &mut [f64; 3], more: [f64; 3]) {
    for (to, more) in to.iter_mut().zip(more) {
        *to += more;
    }
}

impl Board for Environment {
    fn i2c_pins(&self) -> Option<I2cPins> {
        Some(self.bench.wiring.i2c)
    }

    fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.advance(now);
        let (sensor, onboard) = (self.sensor.i2c(now, event), self.onboard.i2c(now, event));
        let is_onboard = self.talks_to_onboard || self.onboard.is_selected();
        // The STOP still belongs to the transfer that it ends.
        self.talks_to_onboard = self.onboard.is_selected();
        let (reply, registers) = if is_onboard {
            let Lsm6ds3 { refresh, faultless, .. } = self.onboard;
            (onboard, Registers { sensor: Kind::Lsm6ds3, refresh, faultless })
        } else {
            let Bno055 { refresh, faultless, .. } = self.sensor;
            (sensor, Registers { sensor: Kind::Bno055, refresh, faultless })
        };
        self.analyzer.i2c(now, event, reply, registers, &mut self.truth);
        if let Some(waves) = &mut self.truth.waves {
            waves.i2c(now, event, reply);
        }
        self.answered = (event, reply);
        if matches!(event, I2cEvent::Start { .. } | I2cEvent::Stop) {
            self.unsent = Unsent::default();
        }
        reply
    }

    fn i2c_held_low(&self, now: Ticks) -> Lines {
        self.held_low(now)
    }

    fn i2c_cut(&mut self, now: Ticks, cut: I2cCut) {
        let Self { sensor, onboard, answered, .. } = self;
        self.unsent = Unsent::new(now, *answered, cut, || {
            if onboard.is_selected() {
                onboard.i2c(now, I2cEvent::Read).data
            } else {
                sensor.i2c(now, I2cEvent::Read).data
            }
        });
    }

    fn i2c_glitch(&mut self, now: Ticks) -> bool {
        self.advance(now);
        self.sensor.glitch(now)
    }

    fn pin(&mut self, now: Ticks, pin: Pin, level: bool) {
        let wiring = self.bench.wiring;
        if let Some(waves) = &mut self.truth.waves {
            waves.pin(now, pin, level, &wiring);
        }
        match pin {
            pin if wiring.servos.contains(&pin) => {
                self.advance(now);
                let axis = Axis::ALL[usize::from(pin != wiring.servos[0])];
                if axis == Axis::Pitch {
                    self.jumper = self.jumper.map(|_| level);
                }
                let pulse = self.analyzer.servo(now, axis, level, &mut self.truth);
                if let Some(pulse) = pulse
                    && let Some(servo) = self.servos.get_mut(axis.index())
                {
                    servo.pulse(pulse.rise.as_secs_f64(), pulse.width_us());
                }
            }
            pin if pin == wiring.probe => self.analyzer.probe(now, level, &mut self.truth),
            pin if pin == wiring.i2c.scl => {
                self.unsent.clock(now, level);
                if level {
                    self.sensor.clocked();
                }
            }
            pin if pin == wiring.i2c.sda && level => self.unsent.data_released(now),
            _ => {}
        }
    }

    fn compare(&mut self, _now: Ticks, tcc: u8, channel: u8, count: u32) {
        let axis = self.bench.wiring.channels.iter().position(|servo| *servo == channel);
        if let Some(axis) = axis.filter(|_| tcc == 0) {
            let width = SERVO_COUNT * u64::from(count);
            self.analyzer.asked(Axis::ALL[axis], width);
        }
    }

    fn input(&self, _now: Ticks, pin: Pin) -> Option<bool> {
        self.jumper.filter(|_| pin == self.bench.wiring.servos[1])
    }
}

#[cfg(test)]
mod tests;
