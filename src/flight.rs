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
use crate::channel::{Channel, ChannelState};
use crate::config::{CLOCK_CHANGE, STRETCH_LONGER_US, STRETCH_MAX_US, STRETCH_SHORTER_US};
use crate::controller;
use crate::failsafe::{BootReport, Health, Refusal, State, Supervisor};
use crate::free_flight::{self, FreeFlight};
use crate::navigation::{self, Navigation};
use crate::params::{Change, Info, ParamError, Params, Polarity};
use crate::servo::PulseUs;
use crate::store::Loaded;
use crate::ticks::{CarriedTicks, Ticks, Timing};

/// A sample, or the reason why there is none.
pub type Reading = Result<Sample, SensorFault>;

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

/// Attitude, control, servo and failsafe: settings, which only orders change, and a state, which
/// every step changes.
#[derive(Clone, Debug)]
pub struct Flight {
    settings: Settings,
    state: Memory,
}

/// The parameters, and what follows from them.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    params: Params,
    timing: Timing,
    ticks: Ticks,
    navigation: Navigation,
    free_flight: FreeFlight,
    /// Of every axis, steered or not.
    channels: [Channel; Axis::COUNT],
    /// How many of them are steered.
    steered: usize,
    /// How many steered channels have not taken over the newest parameters yet: the last ones.
    due: usize,
}

/// All that the next steps depend on besides settings, samples and orders.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    carried: CarriedTicks,
    supervisor: Supervisor,
    navigation: navigation::State,
    free_flight: free_flight::State,
    channels: [ChannelState; Axis::COUNT],
    test_pulse: TestPulse,
}

impl Settings {
    #[inline(never)]
    fn new(navigation: Navigation, params: &Params) -> Self {
        let timing = params.timing();
        Self {
            navigation,
            free_flight: FreeFlight::new(params),
            ticks: Ticks::new(&timing),
            channels: [Channel::new(params, Axis::Pitch), Channel::new(params, Axis::Roll)],
            steered: params.axes().len(),
            due: 0,
            timing,
            params: params.clone(),
        }
    }
}

impl Memory {
    #[inline(never)]
    fn new(navigation: &Navigation, params: &Params, report: BootReport) -> Self {
        let mut supervisor = Supervisor::new(report);
        supervisor.require_host(params.fs_host() == 1.0);
        Self {
            carried: CarriedTicks::default(),
            supervisor,
            navigation: navigation.at_rest(),
            free_flight: free_flight::State::default(),
            channels: [
                ChannelState::at_rest(params, Axis::Pitch),
                ChannelState::at_rest(params, Axis::Roll),
            ],
            test_pulse: TestPulse::NONE,
        }
    }
}

impl Flight {
    /// At start-up, with what the board found.
    ///
    /// # Errors
    /// The estimator's configuration is impossible; no set of parameters within their ranges makes
    /// it so.
    pub fn new(params: Params, report: BootReport) -> Result<Self, ConfigError> {
        let navigation = Navigation::new(&params)?;
        Ok(Self::with(navigation, &params, report))
    }

    /// As [`new`](Self::new), with the navigation of these parameters.
    // Not inlined, and no `Result`: the stack would hold the whole of it once more.
    #[inline(never)]
    pub fn with(navigation: Navigation, params: &Params, report: BootReport) -> Self {
        Self {
            state: Memory::new(&navigation, params, report),
            settings: Settings::new(navigation, params),
        }
    }

    /// What only orders change.
    pub(crate) fn settings_in_memory(&self) -> &Settings {
        &self.settings
    }

    /// What every step changes.
    pub(crate) fn state_in_memory(&self) -> &Memory {
        &self.state
    }

    /// The processor stood still for its flash.
    pub fn halted(&mut self) {
        self.state.supervisor.halted();
    }

    /// A tick whose step is carried by the next pulse came then.
    pub fn carried_tick(&mut self, at: Micros) {
        self.state.carried.seen(at);
    }

    /// One control step: a sample, or the reason why there is none, becomes the pulses of the next
    /// servo frame.
    pub fn step(&mut self, now: Micros, reading: Reading) -> Snapshot {
        let estimate = self.estimate(now, reading);
        let snapshot = self.act(now, estimate);
        self.catch_up();
        snapshot
    }

    /// What is left to do behind a step, when its pulses have been written. Says whether the
    /// settings have changed by it.
    pub fn catch_up(&mut self) -> bool {
        let Settings { due, steered, .. } = &mut self.settings;
        let axis = Axis::ALL.into_iter().take(*steered).nth(steered.saturating_sub(*due));
        *due = due.saturating_sub(1);
        axis.is_some_and(|axis| {
            self.configure_channel(axis);
            true
        })
    }

    /// The first half of a step: the attitude, and what state follows from it.
    pub fn estimate(&mut self, now: Micros, reading: Reading) -> Option<Estimate> {
        let is_free = self.is_free();
        // The time of one that is yet to come is wrong, and all after it would be older.
        let reading = match reading {
            Ok(sample) if sample.raw.time > now => Err(SensorFault::Late),
            reading => reading,
        };
        let estimated = reading.and_then(|sample| {
            let dt_us =
                self.settings.navigation.update(&mut self.state.navigation, &sample, is_free)?;
            Ok((sample.raw, dt_us))
        });
        match estimated {
            Ok((sample, dt_us)) => {
                let health = self.health();
                if self.state.supervisor.is_testing() {
                    self.state.supervisor.test(&self.state.navigation.in_body(&sample));
                }
                self.state.supervisor.sample(now, sample.time, health);
                if self.settings.free_flight.is_needed() {
                    self.follow_launch(now, sample.time);
                }
                Some(Estimate { sample, dt_us, valid: health.valid })
            }
            Err(fault) => {
                self.state.supervisor.miss(now, fault);
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
                    self.settings.navigation.restart(&mut self.state.navigation);
                }
            }
            None => self.hold(now),
        }
        self.snapshot(now, estimate.map(|estimate| estimate.sample))
    }

    /// Begin anew as after power-on: self-test, and the gyro's offset learned at rest.
    ///
    /// # Errors
    /// The [`Refusal`] where the attitude is needed or a fault is to be acknowledged; nothing
    /// changes.
    pub fn calibrate(&mut self) -> Result<(), Refusal> {
        self.state.supervisor.restart()?;
        self.settings.navigation.restart(&mut self.state.navigation);
        Ok(())
    }

    /// Change a parameter.
    ///
    /// # Errors
    /// [`ParamError`]; the old value stays.
    pub fn set_param(&mut self, name: &str, value: f32) -> Result<&'static Info, ParamError> {
        let index = Params::index_of(name).ok_or(ParamError::Unknown)?;
        let (info, before) = self.settings.params.by_index(index).ok_or(ParamError::Unknown)?;
        if info.change != Change::Live && self.state().is_armed() {
            return Err(ParamError::Armed { name: info.name });
        }
        // A file of parameters says 1 of another vehicle.
        if Params::POLARITIES.contains(&index) && value == 1.0 && before == 0.0 {
            return Err(ParamError::Unseen { name: info.name });
        }
        self.settings.params.set_by_id(info.id, value)?;
        if info.change == Change::Turning && before != value {
            self.settings.params.forget_polarity();
        }
        self.configure(info.change);
        Ok(info)
    }

    /// Change all parameters at once.
    ///
    /// # Errors
    /// [`ParamError::ArmedAll`]; the old values stay.
    pub fn replace_params(&mut self, params: Params) -> Result<(), ParamError> {
        if self.state().is_armed() {
            return Err(ParamError::ArmedAll);
        }
        self.settings.params = params;
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
        let kept = self.settings.params.clock_fine();
        let changed = kept.is_none_or(|kept| kept.abs_diff(fine) > CLOCK_CHANGE);
        changed.then(|| {
            self.settings.params.set_clock_fine(fine);
            Params::CLOCK
        })
    }

    fn learn_stretch(&mut self, board: &BoardStatus) -> bool {
        let timing = &self.settings.timing;
        let stretch_us =
            timing.stretch_of(board.bursts.planned_us(board.stop_us)).min(STRETCH_MAX_US);
        // Where bytes vary, the longest that were seen count.
        let longer = stretch_us > timing.stretch_us + STRETCH_LONGER_US;
        let shorter = stretch_us + STRETCH_SHORTER_US < timing.stretch_us;
        let changed = board.bursts.mean_us > 0 && (longer || shorter);
        if changed {
            self.settings.params.set_stretch(stretch_us);
        }
        changed
    }

    /// What was found of stored parameters at start-up.
    pub fn stored(&self) -> Loaded {
        self.state.supervisor.stored()
    }

    /// A ground station's heartbeat has arrived.
    pub fn host_heard(&mut self, now: Micros) {
        self.state.supervisor.host_heard(now);
    }

    /// The neutral pulses of the parameters in use; [`PulseUs::NONE`] for an axis that is not
    /// steered.
    pub fn neutral(&self) -> [PulseUs; Axis::COUNT] {
        self.of_steered(&self.settings.channels, PulseUs::NONE, Channel::neutral_pulse)
    }

    /// The self-test is passed, the attitude has settled, and the gyro's offset is known.
    pub fn is_calibrated(&self) -> bool {
        self.state.supervisor.is_calibrated()
    }

    /// Where the flight stands.
    pub fn state(&self) -> State {
        self.state.supervisor.state()
    }

    /// What the timing of the loop follows from, by the parameters.
    pub fn timing(&self) -> Timing {
        self.settings.timing
    }

    /// The parameters.
    pub fn params(&self) -> &Params {
        &self.settings.params
    }

    /// The newest attitude in float, for whoever does not count cycles.
    pub fn attitude(&self) -> Attitude {
        self.settings.navigation.attitude(&self.state.navigation)
    }

    /// The newest attitude in fixed point, as it is estimated.
    pub fn orientation(&self) -> Orientation {
        self.settings.navigation.orientation(&self.state.navigation)
    }

    /// Roll, pitch and yaw of the newest attitude, rad: yaw, pitch, roll in turn, from north, nose
    /// up positive.
    pub fn angles_rad(&self) -> [f32; 3] {
        let angles = self.orientation().angles();
        [angles.roll, angles.pitch, angles.yaw].map(Angles::to_rad)
    }

    /// Release the vehicle at its launch, and end its control with the burn.
    fn follow_launch(&mut self, now: Micros, at: Micros) {
        let flight = self.state();
        let Self { settings, state } = self;
        let upwards = state.navigation.upwards();
        let free_flight = &settings.free_flight;
        if let Some(order) = free_flight.follow(&mut state.free_flight, at, upwards, &flight) {
            // A vehicle that cannot be released stays armed, with its rudders at neutral.
            let _ = state.supervisor.command(now, order);
        }
    }

    /// Standard deviations of the tilt about either axis, and of the heading, deg: as the estimator
    /// has them, but for the tilt of a vehicle whose attitude follows its gyroscope alone.
    pub fn attitude_sd_deg(&self) -> [f32; 2] {
        const DEG: f32 = 180.0 / core::f32::consts::PI;
        let [tilt, heading] =
            self.settings.navigation.attitude_sd(&self.state.navigation).map(|rad| rad * DEG);
        let tilt = if self.is_free() {
            let Self { settings, state } = self;
            settings.free_flight.tilt_sd_deg(&state.free_flight, &settings.params)
        } else {
            tilt
        };
        [tilt, heading]
    }

    /// The plant's gain that the control law of pitch estimates, in those of `PITCH_GAIN`: 1 to 2.
    pub fn plant_gain(&self) -> Q16 {
        let [pitch, _] = &self.state.channels;
        pitch.plant_gain()
    }

    /// The control laws, where the state lets them move their rudders. Positive crank angles turn
    /// the vehicle to negative angles, so the crank follows the angle and its rate with positive
    /// sign: `crank = kp (angle - setpoint) + kd rate`.
    fn control(&mut self, now: Micros, estimate: &Estimate) {
        let Self { settings, state } = self;
        let is_carried = state.carried.tick(&settings.ticks, estimate.sample.time);
        let (navigation, attained) = (&settings.navigation, &state.navigation);
        let [roll_rate, pitch_rate, _] = navigation.rates(attained);
        let sample = |angle, rate| controller::Sample {
            angle,
            rate,
            rate_age_us: attained.rate_age_us(),
            refresh_us: attained.refresh_us(),
            is_carried,
        };
        if settings.steered == 1 {
            let pitch = sample(navigation.pitch(attained), pitch_rate);
            return self.steer(now, Axis::Pitch, &pitch, estimate.dt_us);
        }
        let [pitch, roll] = navigation.tilt(attained);
        let (pitch, roll) = (sample(pitch, pitch_rate), sample(roll, roll_rate));
        self.steer(now, Axis::Pitch, &pitch, estimate.dt_us);
        self.steer(now, Axis::Roll, &roll, estimate.dt_us);
    }

    /// The control of an axis, `dt_us` after the last.
    fn steer(&mut self, now: Micros, axis: Axis, sample: &controller::Sample, dt_us: u32) {
        let rudder = self.rudder(now, axis);
        let is_active = self.state().is_active();
        let Self { settings, state } = self;
        let channel = axis.of(settings.channels.each_ref());
        let channel_state = axis.of(state.channels.each_mut());
        match rudder {
            Rudder::Controlled if is_active => {
                let gains = settings.free_flight.gains(&state.free_flight);
                channel.control(channel_state, sample, gains.as_ref(), dt_us);
            }
            Rudder::Controlled => channel.show(channel_state, sample, dt_us),
            Rudder::Tested(pulse) => channel.rest(channel_state, Some(pulse)),
            Rudder::Neutral => channel.rest(channel_state, None),
        }
    }

    /// Without a sample the last commands stay, for as long as the supervisor lets them.
    fn hold(&mut self, now: Micros) {
        let is_carried = self.state.carried.missed(&self.settings.ticks);
        for axis in Axis::ALL.into_iter().take(self.settings.steered) {
            let rudder = self.rudder(now, axis);
            let channel = axis.of(self.settings.channels.each_ref());
            let state = axis.of(self.state.channels.each_mut());
            match rudder {
                Rudder::Controlled => channel.coast(state, is_carried),
                Rudder::Tested(pulse) => channel.rest(state, Some(pulse)),
                Rudder::Neutral => channel.rest(state, None),
            }
        }
    }

    /// A figure of every axis; `other` for one that is not steered.
    fn of_steered<T, C>(
        &self,
        channels: &[C; Axis::COUNT],
        other: T,
        figure: impl Fn(&C) -> T,
    ) -> [T; Axis::COUNT] {
        let [pitch, roll] = channels;
        let roll = if self.settings.steered == 1 { other } else { figure(roll) };
        [figure(pitch), roll]
    }

    /// The rates alone turn the attitude.
    fn is_free(&self) -> bool {
        let Self { settings, state } = self;
        let flight = state.supervisor.state();
        settings.free_flight.is_free(&state.free_flight, &flight)
    }

    /// Hand the parameters to the channel of an axis.
    fn configure_channel(&mut self, axis: Axis) {
        let Self { settings, state } = self;
        let channel = axis.of(settings.channels.each_mut());
        channel.configure(axis.of(state.channels.each_mut()), &settings.params);
    }

    fn snapshot(&self, now: Micros, sample: Option<RawSample>) -> Snapshot {
        let channels = &self.state.channels;
        Snapshot {
            now,
            sample,
            orientation: self.orientation(),
            rates: self.settings.navigation.rates(&self.state.navigation),
            settled: self.settings.navigation.has_settled(&self.state.navigation),
            cranks: self.of_steered(channels, Q16::default(), |channel| channel.crank),
            pulses: self.of_steered(channels, PulseUs::NONE, |channel| channel.commanded.pulse()),
            state: self.state(),
            fault: self.state.supervisor.fault(),
            sensor_healthy: self.state.supervisor.sensor_is_healthy(),
            field_healthy: self.state.navigation.field_is_healthy(),
            missed: self.state.supervisor.missed(),
        }
    }

    /// Hand the parameters to the parts that they belong to, after one with this rule of change.
    /// What alters the meaning of the samples starts the estimate over, and arming waits for it.
    fn configure(&mut self, change: Change) {
        // Nothing that may change in flight concerns navigation, whose sines would cost a sample.
        if change != Change::Live
            && self.settings.navigation.configure(&mut self.state.navigation, &self.settings.params)
        {
            self.state.supervisor.attitude_lost();
        }
        if self.settings.params.polarity(self.state.test_pulse.axis) == Polarity::Watched {
            self.state.test_pulse = TestPulse::NONE;
        }
        let Settings { free_flight, params, .. } = &mut self.settings;
        free_flight.configure(params);
        self.settings.timing = self.settings.params.timing();
        self.settings.ticks = Ticks::new(&self.settings.timing);
        self.settings.steered = self.settings.params.axes().len();
        // A channel takes 1.6 ms. In flight there is time for one of them behind each step.
        if change == Change::Live {
            self.settings.due = self.settings.steered;
        } else {
            self.settings.due = 0;
            Axis::ALL.into_iter().for_each(|axis| self.configure_channel(axis));
        }
        self.state.supervisor.require_host(self.settings.params.fs_host() == 1.0);
    }

    fn health(&self) -> Health {
        let orientation = self.orientation();
        Health {
            valid: orientation.is_rotation(),
            settled: self.settings.navigation.has_settled(&self.state.navigation),
            bias: self.settings.navigation.bias_state(&self.state.navigation),
            certain: self.settings.navigation.tilt_is_certain(&self.state.navigation),
            cos_tilt_q30: orientation.cos_tilt_q30(),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
