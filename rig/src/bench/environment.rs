//! Everything outside the chip: the sensor on the drone, the drone on its pivot, the servo, the
//! clamp, and the analyser that keeps the truth.
//!
//! ```text
//!   PB08, PB09 (I2C)  -- BNO055 at the pivot, x forward, z down
//!   PB11 (D3)         -- servo -> crank -> rudder -> drone
//!   PA07 (D4)         -- probe: a control step is busy
//! ```
//!
//! The drone pitches about the body's y axis, to the right; nose up is positive, which is the
//! plant's counter-clockwise `theta0` seen from the right. The pivot does not move, so that the
//! accelerometer feels gravity alone.

use super::{EarthField, TimedFault};
use crate::bench::disturbance::Disturbances;
use crate::bench::sensor_motion::{self, HeldSensor, SensorMotion};
use crate::bno055::{self, Bno055, Fault, Stimulus};
use crate::observe::ground_truth::{GroundTruth, Motion};
use crate::observe::logic_analyzer::{LogicAnalyzer, Registers};
use nalgebra::UnitQuaternion;
use plant::{Drone, ParameterError, Parameters, Servo, ServoModel};
use samd21::board::{Board, I2cEvent, I2cPins, I2cReply, Lines, Pin, Ticks};
use std::f64::consts::FRAC_1_SQRT_2;

/// Pulse width at which the horn is mounted for zero rudder, us.
pub const ZERO_RUDDER_US: f64 = 1523.6;
/// The servo's pin, D3.
pub const SERVO_PIN: Pin = Pin::b(11);
/// The probe pin, D4.
pub const PROBE_PIN: Pin = Pin::a(7);
/// The sensor's bus, A4 (SDA) and A5 (SCL): SERCOM4 reaches them with function D.
pub const I2C_PINS: I2cPins = I2cPins {
    sda: Pin::b(8),
    scl: Pin::b(9),
};

/// Step of the physics.
const STEP: Ticks = Ticks::from_us(500);
/// Steps of the physics to one entry of the truth's motion.
const MOTION_EVERY: u64 = 2;
/// Rate at which hands tilt the clamped drone, rad/s.
const TILT_RATE_RAD_S: f64 = 0.5;
/// How long a hand takes to put the sensor back on the drone, s.
const BACK_S: f64 = 1.5;

/// What stands on the bench.
#[derive(Clone, Debug)]
pub struct BenchConfig {
    /// The sensor.
    pub sensor: bno055::Config,
    /// The servo, before its horn is fitted to zero rudder at [`ZERO_RUDDER_US`].
    pub servo: ServoModel,
    /// How far off the horn sits on its spline, rad.
    pub horn_error_rad: f64,
    /// Masses, lengths and loads of the drone.
    pub parameters: Parameters,
    /// Pitch at which the clamp holds the drone at power-on, rad.
    pub start_rad: f64,
    /// Where the drone's nose points, from true north to the east, rad.
    pub heading_rad: f64,
    /// The magnetic field.
    pub field: EarthField,
    /// What disturbs the flight.
    pub disturbances: Disturbances,
    /// Faults of the sensor and its cable after each release.
    pub faults: Vec<TimedFault>,
}

impl Default for BenchConfig {
    fn default() -> Self {
        Self {
            sensor: bno055::Config::default(),
            servo: ServoModel::S3003,
            horn_error_rad: 0.0,
            parameters: Parameters::PHYS,
            start_rad: 0.0,
            heading_rad: 0.5,
            field: EarthField::COPENHAGEN,
            disturbances: Disturbances::default(),
            faults: Vec::new(),
        }
    }
}

/// The environment round the chip. It runs up to the time of whatever the chip does to it.
#[derive(Clone, Debug)]
pub struct Environment {
    drone: Drone,
    servo: Servo,
    sensor: Bno055,
    heading_rad: f64,
    field: EarthField,
    disturbances: Disturbances,
    faults: Vec<TimedFault>,
    /// Thrust when it is all there, N.
    thrust_n: f64,
    /// Steps of the physics so far.
    steps: u64,
    /// When the clamp opened last, unless it holds.
    released: Option<Ticks>,
    /// Pitch to which the clamp is being moved, rad.
    clamp_rad: f64,
    /// The sensor off the drone, and whether it is on its way back.
    hand: Option<(HeldSensor, bool)>,
    tap: LogicAnalyzer,
    truth: GroundTruth,
}

impl Environment {
    /// Power-on: the clamp holds the drone at its start, the rudder is at zero.
    ///
    /// # Errors
    /// Impossible parameters of the drone.
    pub fn new(bench: &BenchConfig) -> Result<Self, ParameterError> {
        let mut drone = Drone::new(&bench.parameters, bench.start_rad, 0.0)?;
        drone.clamp(bench.start_rad);
        let zero_rad = drone.crank().angle_rad;
        let model = bench
            .servo
            .fitted(ZERO_RUDDER_US, zero_rad, bench.horn_error_rad);
        let mut sensor = bench.sensor.clone();
        if let Some(temperature) = &bench.disturbances.temperature {
            sensor.errors = temperature.of(sensor.errors);
        }
        Ok(Self {
            drone,
            servo: Servo::new(model, zero_rad, 0.0),
            sensor: Bno055::new(sensor),
            heading_rad: bench.heading_rad,
            field: bench.field,
            disturbances: bench.disturbances,
            faults: bench.faults.clone(),
            thrust_n: bench.parameters.thrust_n,
            steps: 0,
            released: None,
            clamp_rad: bench.start_rad,
            hand: None,
            tap: LogicAnalyzer::default(),
            truth: GroundTruth::default(),
        })
    }

    /// Runs the physics up to `now`.
    pub fn advance(&mut self, now: Ticks) {
        while STEP * (self.steps + 1) <= now {
            self.step();
        }
    }

    /// The drone.
    pub fn drone(&self) -> &Drone {
        &self.drone
    }

    /// The drone, to kick it.
    pub fn drone_mut(&mut self) -> &mut Drone {
        &mut self.drone
    }

    /// The servo.
    pub fn servo(&self) -> &Servo {
        &self.servo
    }

    /// The sensor.
    pub fn sensor(&self) -> &Bno055 {
        &self.sensor
    }

    /// The sensor, to play a recording.
    pub fn sensor_mut(&mut self) -> &mut Bno055 {
        &mut self.sensor
    }

    /// What has happened.
    pub fn truth(&self) -> &GroundTruth {
        &self.truth
    }

    /// What has happened, to begin a new page.
    pub fn truth_mut(&mut self) -> &mut GroundTruth {
        &mut self.truth
    }

    /// Tilts the clamped drone by hand, at 0.5 rad/s; a free one does not care.
    pub fn tilt_clamp(&mut self, pitch_rad: f64) {
        self.clamp_rad = pitch_rad;
    }

    /// The clamp has arrived where it was tilted to.
    pub fn clamp_rests(&self) -> bool {
        self.drone.held() && self.drone.pitch_rad() == self.clamp_rad
    }

    /// Opens the clamp; the drone leaves it with a rate, rad/s.
    pub fn release(&mut self, rate_rad_s: f64) {
        self.drone.release(rate_rad_s);
        self.released.get_or_insert(STEP * self.steps);
    }

    /// Catches the drone where it is; the faults of its flight are over.
    pub fn catch(&mut self) {
        let now = STEP * self.steps;
        for timed in &self.faults {
            self.sensor.clear(now, timed.fault);
        }
        self.clamp_rad = self.drone.pitch_rad();
        self.drone.clamp(self.clamp_rad);
        self.released = None;
    }

    /// Moves the sensor by hand, off the drone.
    pub fn handle(&mut self, movement: SensorMotion) {
        let (grip, back) = self
            .hand
            .get_or_insert((HeldSensor::new(self.mounted()), false));
        grip.begin(movement);
        *back = false;
    }

    /// Puts the sensor back on the drone, if it is off.
    pub fn put_back(&mut self) {
        let home = self.mounted();
        if let Some((grip, back)) = &mut self.hand {
            grip.begin(SensorMotion::To(home, BACK_S));
            *back = true;
        }
    }

    /// Attitude of the sensor on the drone, to north-east-down.
    pub fn mounted(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.0, self.drone.pitch_rad(), self.heading_rad)
    }

    /// Switches a fault of the sensor or its cable on.
    pub fn inject(&mut self, now: Ticks, fault: Fault) {
        self.advance(now);
        self.sensor.inject(now, fault);
    }

    /// Switches it off.
    pub fn clear(&mut self, now: Ticks, fault: Fault) {
        self.advance(now);
        self.sensor.clear(now, fault);
    }

    /// The chip has been reset: its pins float.
    pub fn chip_reset(&mut self) {
        self.tap.reset();
    }

    fn step(&mut self) {
        self.steps += 1;
        let now = STEP * self.steps;
        let dt_s = STEP.as_secs_f64();
        self.disturb(now);
        self.switch_faults(now);
        let load = self.drone.hinge_torque_n_m();
        let crank = self.servo.advance(now.as_secs_f64(), load);
        let hands_rad_s = if self.drone.held() {
            self.tilt(dt_s)
        } else {
            0.0
        };
        self.drone.step(dt_s, crank);
        let rate_rad_s = self.drone.rate_rad_s() + hands_rad_s;
        let pitch_rad = self.drone.pitch_rad();
        let stimulus = match self.handled(dt_s) {
            Some(handled) => handled,
            None => self.shaken(now, self.stimulus(pitch_rad, rate_rad_s)),
        };
        self.sensor.sense(now, &stimulus);
        if self.steps.is_multiple_of(MOTION_EVERY) {
            self.truth.motion.push(Motion {
                time: now,
                pitch_rad,
                rate_rad_s,
                rudder_rad: self.drone.rudder_rad(),
                crank_rad: crank.angle_rad,
                target_rad: self.servo.target_rad(),
            });
        }
    }

    /// What the sensor feels while it is off the drone.
    fn handled(&mut self, dt_s: f64) -> Option<Stimulus> {
        let (grip, back) = self.hand.as_mut()?;
        let rate = grip.advance(dt_s);
        let g = self.drone.mechanism().parameters().gravity_m_s2;
        let felt = sensor_motion::stimulus(&grip.attitude(), rate, &self.field, g);
        if *back && grip.has_arrived() {
            self.hand = None;
        }
        Some(felt)
    }

    /// Supply of the servo and thrust, as they are now.
    fn disturb(&mut self, now: Ticks) {
        let since_s = self
            .released
            .map(|released| now.saturating_sub(released).as_secs_f64());
        if let Some(sag) = self.disturbances.supply {
            let current = self.servo.current_share();
            let share = since_s.map_or(1.0, |since_s| sag.share(since_s, current));
            self.servo.set_supply(share);
        }
        if let Some(ramp) = self.disturbances.thrust {
            let share = ramp.share(since_s.unwrap_or(0.0));
            self.drone.set_thrust(share * self.thrust_n);
        }
    }

    /// The faults that begin or end between the last step and this one.
    fn switch_faults(&mut self, now: Ticks) {
        let Some(released) = self.released else {
            return;
        };
        let since = now.saturating_sub(released);
        for timed in &self.faults {
            match timed.switched(since.saturating_sub(STEP), since) {
                Some(true) => self.sensor.inject(now, timed.fault),
                Some(false) => self.sensor.clear(now, timed.fault),
                None => {}
            }
        }
    }

    /// The stimulus with the propeller's vibration, while the drone is free.
    fn shaken(&self, now: Ticks, mut stimulus: Stimulus) -> Stimulus {
        if let Some(vibration) = self.disturbances.vibration
            && self.released.is_some()
        {
            let (force, rate) = vibration.at(now.as_secs_f64());
            for axis in 0..3 {
                stimulus.specific_force_m_s2[axis] += force[axis];
                stimulus.rate_rad_s[axis] += rate[axis];
            }
        }
        stimulus
    }

    /// Moves the clamp towards where it is wanted; the rate of that, rad/s.
    fn tilt(&mut self, dt_s: f64) -> f64 {
        let missing = self.clamp_rad - self.drone.pitch_rad();
        if missing == 0.0 {
            return 0.0;
        }
        let most = TILT_RATE_RAD_S * dt_s;
        if missing.abs() <= most {
            self.drone.clamp(self.clamp_rad);
        } else {
            self.drone
                .clamp(self.drone.pitch_rad() + most.copysign(missing));
        }
        missing.clamp(-most, most) / dt_s
    }

    /// What the sensor feels, along its axes, which are the body's.
    fn stimulus(&self, pitch_rad: f64, rate_rad_s: f64) -> Stimulus {
        let g = self.drone.mechanism().parameters().gravity_m_s2;
        let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
        let (sin_heading, cos_heading) = self.heading_rad.sin_cos();
        let [north, east, down] = self.field.north_east_down();
        let ahead = cos_heading * north + sin_heading * east;
        let right = -sin_heading * north + cos_heading * east;
        Stimulus {
            specific_force_m_s2: [g * sin_pitch, 0.0, -g * cos_pitch],
            rate_rad_s: [0.0, rate_rad_s, 0.0],
            field_ut: [
                cos_pitch * ahead - sin_pitch * down,
                right,
                sin_pitch * ahead + cos_pitch * down,
            ],
            attitude: self.attitude(pitch_rad),
        }
    }

    /// Body to east-north-up with magnetic north: `(i + j) / sqrt 2` takes north-east-down there.
    fn attitude(&self, pitch_rad: f64) -> [f64; 4] {
        let (sin_p, cos_p) = (0.5 * pitch_rad).sin_cos();
        let (sin_h, cos_h) = (0.5 * (self.heading_rad - self.field.declination_rad)).sin_cos();
        let [w, x, y, z] = [cos_h * cos_p, -sin_h * sin_p, cos_h * sin_p, sin_h * cos_p];
        [-x - y, w + z, w - z, y - x].map(|c| c * FRAC_1_SQRT_2)
    }
}

impl Board for Environment {
    fn i2c_pins(&self) -> Option<I2cPins> {
        Some(I2C_PINS)
    }

    fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.advance(now);
        let reply = self.sensor.i2c(now, event);
        let registers = Registers {
            refresh: self.sensor.refreshed(),
            sound: self.sensor.sound_words(),
        };
        self.tap.i2c(now, event, reply, registers, &mut self.truth);
        reply
    }

    fn i2c_held_low(&self, now: Ticks) -> Lines {
        self.sensor.held_low(now)
    }

    fn i2c_glitch(&mut self, now: Ticks) -> bool {
        self.advance(now);
        self.sensor.glitch(now)
    }

    fn pin(&mut self, now: Ticks, pin: Pin, level: bool) {
        match pin {
            SERVO_PIN => {
                self.advance(now);
                if let Some(pulse) = self.tap.servo(now, level, &mut self.truth) {
                    self.servo.pulse(pulse.rise.as_secs_f64(), pulse.width_us());
                }
            }
            PROBE_PIN => self.tap.probe(now, level, &mut self.truth),
            pin if pin == I2C_PINS.scl && level => self.sensor.clocked(),
            _ => {}
        }
    }

    fn input(&self, _now: Ticks, _pin: Pin) -> Option<bool> {
        None
    }
}

#[cfg(test)]
mod tests;
