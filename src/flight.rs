//! The flight: a sample in, a pulse for each axis out.
//!
//! [`Flight::step`] is data in, data out. It takes its time step from the samples' own times, so
//! that a replay of the same counts and times gives the same bits on the chip, on the rig and on a
//! laptop.

mod memory;
mod orders;

use orders::{Rudder, TestPulse};
use tvc_fusion::fixed::{Angles, Orientation};
use tvc_fusion::{Attitude, ConfigError};
use tvc_imu::{Micros, RawSample, Sample, SensorFault};
use tvc_pid::Q16;

use crate::axis::Axis;
use crate::board_status::BoardStatus;
use crate::channel::Channel;
use crate::config::{CLOCK_CHANGE, STRETCH_LONGER_US, STRETCH_MAX_US, STRETCH_SHORTER_US};
use crate::controller;
use crate::failsafe::{BootReport, Command, Health, Refusal, State, Supervisor};
use crate::gain_schedule::GainSchedule;
use crate::launch::{Event, Launch};
use crate::navigation::Navigation;
use crate::params::{Change, Info, ParamError, Params, Polarity};
use crate::servo::PulseUs;
use crate::store::Loaded;
use crate::ticks::{CarriedTicks, Timing};

/// What the first half of a step hands to the second.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    sample: RawSample,
    /// Time since the sample before, us.
    dt_us: u32,
    /// The attitude is a rotation.
    valid: bool,
}

/// What a step results in: the pulses, and what telemetry and recorder tell of it.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// Time of the step.
    pub now: Micros,
    /// The untouched sample, if there was a usable one.
    pub sample: Option<RawSample>,
    /// The newest attitude.
    pub orientation: Orientation,
    /// Roll, pitch and yaw rate of the newest sample, rad/s, body axes.
    pub rates: [Q16; 3],
    /// The attitude has settled since start-up.
    pub settled: bool,
    /// Crank angles that control asked for last, rad, before limits; zero while it is not active.
    pub cranks: [Q16; Axis::COUNT],
    /// The pulses for the next servo frame; [`PulseUs::NONE`] for an axis that is not steered.
    pub pulses: [PulseUs; Axis::COUNT],
    /// Where the flight stands after the step.
    pub state: State,
    /// Why the newest step had no usable sample, if it had none.
    pub fault: Option<SensorFault>,
    /// The sensor has been delivering without a break.
    pub sensor_healthy: bool,
    /// The magnetometer measures a field.
    pub field_healthy: bool,
    /// Steps without a usable sample since start-up.
    pub missed: u32,
}

/// Who looks at the memory of values, whatever they are.
pub trait Watch {
    /// Take this one.
    fn see<T>(&mut self, value: &T);
}

/// Attitude, control, servo and failsafe.
#[derive(Clone, Debug)]
pub struct Flight {
    params: Params,
    /// Their digest when they were changed last.
    digest: i32,
    /// What the parameters say of it.
    timing: Timing,
    navigation: Navigation,
    launch: Launch,
    gains: GainSchedule,
    carried: CarriedTicks,
    /// Of every axis, steered or not.
    channels: [Channel; Axis::COUNT],
    /// How many of them are steered.
    steered: usize,
    /// The channel of roll has not taken over the newest parameters yet.
    roll_is_due: bool,
    test_pulse: TestPulse,
    supervisor: Supervisor,
}

impl Flight {
    /// At start-up, with what the board found.
    ///
    /// # Errors
    /// The estimator's configuration is impossible; no set of parameters within their ranges makes
    /// it so.
    pub fn new(params: Params, report: BootReport) -> Result<Self, ConfigError> {
        let mut supervisor = Supervisor::new(report);
        supervisor.require_host(params.fs_host() == 1.0);
        let timing = params.timing();
        let mut gains = GainSchedule::default();
        gains.configure(&params);
        Ok(Self {
            navigation: Navigation::new(&params)?,
            launch: Launch::new(&params),
            gains,
            carried: CarriedTicks::new(&timing),
            channels: Axis::ALL.map(|axis| Channel::new(&params, axis)),
            steered: params.axes().len(),
            roll_is_due: false,
            test_pulse: TestPulse::NONE,
            supervisor,
            digest: params.digest(),
            params,
            timing,
        })
    }

    /// A tick whose step is carried by the next pulse came then.
    pub fn carried_tick(&mut self, at: Micros) {
        self.carried.seen(at);
    }

    /// One control step: a sample, or the reason why there is none, becomes the pulses of the next
    /// servo frame.
    pub fn step(&mut self, now: Micros, reading: Result<Sample, SensorFault>) -> Snapshot {
        let estimate = self.estimate(now, reading);
        let snapshot = self.act(now, estimate);
        self.catch_up();
        snapshot
    }

    /// What is left to do behind a step, when its pulses have been written.
    pub fn catch_up(&mut self) {
        if core::mem::take(&mut self.roll_is_due) {
            let [_, roll] = &mut self.channels;
            roll.configure(&self.params);
        }
    }

    /// The first half of a step: the attitude, and what state follows from it.
    pub fn estimate(
        &mut self,
        now: Micros,
        reading: Result<Sample, SensorFault>,
    ) -> Option<Estimate> {
        let is_free = self.launch.is_free(&self.state());
        // The time of one that is yet to come is wrong, and all after it would be older.
        let reading = match reading {
            Ok(sample) if sample.raw.time > now => Err(SensorFault::Late),
            reading => reading,
        };
        let estimated = reading.and_then(|sample| {
            let dt_us = self.navigation.update(&sample, is_free)?;
            Ok((sample.raw, dt_us))
        });
        match estimated {
            Ok((sample, dt_us)) => {
                let health = self.health();
                if self.supervisor.is_testing() {
                    self.supervisor.test(&self.navigation.in_body(&sample));
                }
                self.supervisor.sample(now, sample.time, health);
                if self.launch.is_needed() {
                    self.follow_launch(now, sample.time);
                }
                Some(Estimate {
                    sample,
                    dt_us,
                    valid: health.valid,
                })
            }
            Err(fault) => {
                self.supervisor.miss(now, fault);
                None
            }
        }
    }

    /// The second half: the pulses.
    pub fn act(&mut self, now: Micros, estimate: Option<Estimate>) -> Snapshot {
        match &estimate {
            Some(estimate) => {
                self.control(now, estimate);
                if !estimate.valid {
                    self.navigation.restart();
                }
            }
            None => self.hold(now),
        }
        self.snapshot(now, estimate.map(|estimate| estimate.sample))
    }

    /// Shows the values, as they lie in memory, from which the next pulses follow, beside the
    /// parameters, which have a [check](Self::settings_are_intact) of their own.
    pub fn show(&self, watch: &mut impl Watch) {
        watch.see(&self.navigation);
        watch.see(&self.supervisor);
        watch.see(&self.launch);
        watch.see(&self.carried);
        watch.see(&self.test_pulse);
        for channel in self.channels.iter().take(self.steered) {
            watch.see(channel);
        }
        if !self.gains.is_constant() {
            watch.see(&self.gains);
        }
    }

    /// Whether the state is what the newest step or order made it: quick, for every step.
    pub fn state_is_intact(&self) -> bool {
        self.supervisor.is_intact()
    }

    /// Whether the parameters are as they were set, and the neutral and limits of the servos as
    /// they say: a flipped bit of memory may have made others of them.
    // Not inlined: the step does not need it.
    #[inline(never)]
    pub fn settings_are_intact(&self) -> bool {
        // One that is yet to be configured is not as they say.
        let configured = self.steered.saturating_sub(self.roll_is_due.into());
        let channels = self.channels.iter().take(configured);
        self.digest == self.params.digest()
            && channels
                .clone()
                .all(|channel| channel.is_intact(&self.params))
    }

    /// Begin anew as after power-on: self-test, and the gyro's offset learned at rest.
    ///
    /// # Errors
    /// The [`Refusal`] where the attitude is needed or a fault is to be acknowledged; nothing
    /// changes.
    pub fn calibrate(&mut self) -> Result<(), Refusal> {
        self.supervisor.restart()?;
        self.navigation.restart();
        Ok(())
    }

    /// Change a parameter.
    ///
    /// # Errors
    /// [`ParamError`]; the old value stays.
    pub fn set_param(&mut self, name: &str, value: f32) -> Result<&'static Info, ParamError> {
        let index = Params::index_of(name).ok_or(ParamError::Unknown)?;
        let (info, before) = self.params.by_index(index).ok_or(ParamError::Unknown)?;
        if info.change != Change::Live && self.state().is_armed() {
            return Err(ParamError::Armed { name: info.name });
        }
        // A file of parameters says 1 of another vehicle.
        if Params::POLARITIES.contains(&index) && value == 1.0 && before == 0.0 {
            return Err(ParamError::Unseen { name: info.name });
        }
        self.change(|params| {
            params.set_by_id(info.id, value)?;
            if info.change == Change::Turning && before != value {
                params.forget_polarity();
            }
            Ok(())
        })?;
        self.configure(info.change);
        Ok(info)
    }

    /// Change parameters. A bit of them that had flipped before stays noticeable.
    fn change<T>(&mut self, change: impl FnOnce(&mut Params) -> T) -> T {
        let was_intact = self.digest == self.params.digest();
        let changed = change(&mut self.params);
        if was_intact {
            self.digest = self.params.digest();
        }
        changed
    }

    /// Change all parameters at once.
    ///
    /// # Errors
    /// [`ParamError::ArmedAll`]; the old values stay.
    pub fn replace_params(&mut self, params: Params) -> Result<(), ParamError> {
        if self.state().is_armed() {
            return Err(ParamError::ArmedAll);
        }
        self.params = params;
        self.digest = self.params.digest();
        self.configure(Change::Disarmed);
        Ok(())
    }

    /// Take over what the board has measured of its parts, while the drone is not armed: how long
    /// the sensor stretches a byte, and what USB has disciplined the clock to. Says which parameter
    /// has changed by it.
    pub fn learn(&mut self, board: &BoardStatus) -> Option<usize> {
        if self.state().is_armed() {
            return None;
        }
        if self.learn_stretch(board) {
            self.configure(Change::Disarmed);
            return Some(Params::STRETCH);
        }
        let fine = board.clock_fine?;
        let kept = self.params.clock_fine();
        let changed = kept.is_none_or(|kept| kept.abs_diff(fine) > CLOCK_CHANGE);
        changed.then(|| {
            self.change(|params| params.set_clock_fine(fine));
            Params::CLOCK
        })
    }

    fn learn_stretch(&mut self, board: &BoardStatus) -> bool {
        let timing = &self.timing;
        let stretch_us = timing
            .stretch_of(board.bursts.planned_us(board.stop_us))
            .min(STRETCH_MAX_US);
        // Where bytes vary, the longest that were seen count.
        let longer = stretch_us > timing.stretch_us + STRETCH_LONGER_US;
        let shorter = stretch_us + STRETCH_SHORTER_US < timing.stretch_us;
        let changed = board.bursts.mean_us > 0 && (longer || shorter);
        if changed {
            self.change(|params| params.set_stretch(stretch_us));
        }
        changed
    }

    /// What was found of stored parameters at start-up.
    pub fn stored(&self) -> Loaded {
        self.supervisor.stored()
    }

    /// A ground station's heartbeat has arrived.
    pub fn host_heard(&mut self, now: Micros) {
        self.supervisor.host_heard(now);
    }

    /// The neutral pulses of the parameters in use; [`PulseUs::NONE`] for an axis that is not
    /// steered.
    pub fn neutral(&self) -> [PulseUs; Axis::COUNT] {
        self.of_steered(PulseUs::NONE, Channel::neutral_pulse)
    }

    /// The self-test is passed, the attitude has settled, and the gyro's offset is known.
    pub fn is_calibrated(&self) -> bool {
        self.supervisor.is_calibrated()
    }

    /// Where the flight stands.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// What the timing of the loop follows from, by the parameters.
    pub fn timing(&self) -> Timing {
        self.timing
    }

    /// The parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The newest attitude in float, for whoever does not count cycles.
    pub fn attitude(&self) -> Attitude {
        self.navigation.attitude()
    }

    /// The newest attitude in fixed point, as it is estimated.
    pub fn orientation(&self) -> Orientation {
        self.navigation.orientation()
    }

    /// Roll, pitch and yaw of the newest attitude, rad: yaw, pitch, roll in turn, from north, nose
    /// up positive.
    pub fn angles_rad(&self) -> [f32; 3] {
        let angles = self.orientation().angles();
        [angles.roll, angles.pitch, angles.yaw].map(Angles::to_rad)
    }

    /// Release the vehicle at its launch, and end its control with the burn.
    // Not inlined: most vehicles never need it.
    #[inline(never)]
    fn follow_launch(&mut self, now: Micros, at: Micros) {
        let upwards = self.navigation.upwards();
        let command = match self.launch.watch(at, upwards, &self.state()) {
            None => return,
            Some(Event::Launch) => Command::Release,
            Some(Event::End) => Command::Disarm,
        };
        // A vehicle that cannot be released stays armed, with its rudders at neutral.
        let _ = self.supervisor.command(now, command);
    }

    /// Standard deviations of the tilt about either axis, and of the heading, deg: as the estimator
    /// has them, but for the tilt of a vehicle whose attitude follows its gyroscope alone.
    pub fn attitude_sd_deg(&self) -> [f32; 2] {
        const DEG: f32 = 180.0 / core::f32::consts::PI;
        let [tilt, heading] = self.navigation.attitude_sd().map(|rad| rad * DEG);
        let tilt = if self.launch.is_free(&self.state()) {
            self.launch.tilt_sd_deg(self.params.gyr_per_g())
        } else {
            tilt
        };
        [tilt, heading]
    }

    /// The control laws, where the state lets them move their rudders. Positive crank angles turn
    /// the vehicle to negative angles, so the crank follows the angle and its rate with positive
    /// sign: `crank = kp (angle - setpoint) + kd rate`.
    fn control(&mut self, now: Micros, estimate: &Estimate) {
        let is_carried = self.carried.tick(estimate.sample.time);
        if !self.gains.is_constant() {
            self.follow_schedule();
        }
        let [roll_rate, pitch_rate, _] = self.navigation.rates();
        let sample = |angle, rate, navigation: &Navigation| controller::Sample {
            angle,
            rate,
            rate_age_us: navigation.rate_age_us(),
            refresh_us: navigation.refresh_us(),
            is_carried,
        };
        if self.steered == 1 {
            let pitch = sample(self.navigation.pitch(), pitch_rate, &self.navigation);
            return self.steer(now, Axis::Pitch, &pitch, estimate.dt_us);
        }
        let [pitch, roll] = self.navigation.tilt();
        let pitch = sample(pitch, pitch_rate, &self.navigation);
        self.steer(now, Axis::Pitch, &pitch, estimate.dt_us);
        let roll = sample(roll, roll_rate, &self.navigation);
        self.steer(now, Axis::Roll, &roll, estimate.dt_us);
    }

    /// The laws take over the gains of this moment.
    #[inline(never)]
    fn follow_schedule(&mut self) {
        if let Some(gains) = self.gains.at(self.launch.seconds()) {
            let steered = self.channels.iter_mut().take(self.steered);
            steered.for_each(|channel| channel.follow(&gains));
        }
    }

    /// The control of an axis, `dt_us` after the last.
    #[inline(never)]
    fn steer(&mut self, now: Micros, axis: Axis, sample: &controller::Sample, dt_us: u32) {
        let rudder = self.rudder(now, axis);
        let is_active = self.state().is_active();
        let channel = channel(&mut self.channels, axis);
        match rudder {
            Rudder::Controlled if is_active => channel.control(sample, dt_us),
            Rudder::Controlled => channel.show(sample, dt_us),
            Rudder::Tested(pulse) => channel.rest(Some(pulse)),
            Rudder::Neutral => channel.rest(None),
        }
    }

    /// Without a sample the last commands stay, for as long as the supervisor lets them.
    fn hold(&mut self, now: Micros) {
        let is_carried = self.carried.missed();
        for axis in Axis::ALL.into_iter().take(self.steered) {
            let rudder = self.rudder(now, axis);
            let channel = channel(&mut self.channels, axis);
            match rudder {
                Rudder::Controlled => channel.coast(is_carried),
                Rudder::Tested(pulse) => channel.rest(Some(pulse)),
                Rudder::Neutral => channel.rest(None),
            }
        }
    }

    /// A figure of every channel, `other` for one that is not steered.
    fn of_steered<T>(&self, other: T, figure: impl Fn(&Channel) -> T) -> [T; Axis::COUNT] {
        let [pitch, roll] = &self.channels;
        let roll = if self.steered == 1 {
            other
        } else {
            figure(roll)
        };
        [figure(pitch), roll]
    }

    fn snapshot(&self, now: Micros, sample: Option<RawSample>) -> Snapshot {
        Snapshot {
            now,
            sample,
            orientation: self.orientation(),
            rates: self.navigation.rates(),
            settled: self.navigation.has_settled(),
            cranks: self.of_steered(Q16::default(), Channel::crank),
            pulses: self.of_steered(PulseUs::NONE, Channel::pulse),
            state: self.state(),
            fault: self.supervisor.fault(),
            sensor_healthy: self.supervisor.sensor_is_healthy(),
            field_healthy: self.navigation.field_is_healthy(),
            missed: self.supervisor.missed(),
        }
    }

    /// Hand the parameters to the parts that they belong to, after one with this rule of change.
    /// What alters the meaning of the samples starts the estimate over, and arming waits for it.
    fn configure(&mut self, change: Change) {
        // Nothing that may change in flight concerns navigation, whose sines would cost a sample.
        if change != Change::Live && self.navigation.configure(&self.params) {
            self.supervisor.attitude_lost();
        }
        if self.params.polarity(self.test_pulse.axis) == Polarity::Watched {
            self.test_pulse = TestPulse::NONE;
        }
        self.launch.configure(&self.params);
        self.gains.configure(&self.params);
        self.timing = self.params.timing();
        self.carried.configure(&self.timing);
        self.steered = self.params.axes().len();
        let [pitch, _] = &mut self.channels;
        pitch.configure(&self.params);
        // There is time for one of them between two ticks.
        self.roll_is_due = true;
        self.supervisor.require_host(self.params.fs_host() == 1.0);
    }

    fn health(&self) -> Health {
        let orientation = self.orientation();
        Health {
            valid: orientation.is_rotation(),
            settled: self.navigation.has_settled(),
            bias: self.navigation.bias_state(),
            certain: self.navigation.tilt_is_certain(),
            cos_tilt_q30: orientation.cos_tilt_q30(),
        }
    }
}

/// The channel of an axis.
fn channel(channels: &mut [Channel; Axis::COUNT], axis: Axis) -> &mut Channel {
    let [pitch, roll] = channels;
    match axis {
        Axis::Pitch => pitch,
        Axis::Roll => roll,
    }
}

#[cfg(test)]
pub(crate) mod tests;
