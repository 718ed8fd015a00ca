//! The flight: a sample in, a pulse out.
//!
//! [`Flight::step`] is data in, data out. It takes its time step from the samples' own times, so that a replay of the
//! same counts and times gives the same bits on the chip, on the rig and on a laptop.

use core::f32::consts::PI;

use bno055_driver::{Micros, RawSample, SensorFault};
use tvc_fusion::{Attitude, Config, ConfigError, Estimator, Mahony, MahonyGains};
use tvc_pid::Pd;

use crate::config::{CONTROL_PERIOD_US, ESTIMATOR_GAP_US, FIELD_REPEATS, UNIT_TOLERANCE};
use crate::failsafe::{BootReport, Command, Health, Refusal, State, Supervisor};
use crate::mount::Mount;
use crate::params::{Change, Info, ParamError, Params};
use crate::servo::{PulseUs, Servo};

/// Everything that a step gives.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    /// The pulse for the next servo frame.
    pub pulse: PulseUs,
    /// What happened in the step, for telemetry and logs.
    pub snapshot: Snapshot,
}

/// A step, for whoever watches.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// Time of the step.
    pub now: Micros,
    /// The untouched sample, if there was a usable one.
    pub sample: Option<RawSample>,
    /// The newest attitude.
    pub attitude: Attitude,
    /// Crank angle that control asked for last, rad, before limits; zero while it is not active.
    pub crank_rad: f32,
    /// The pulse commanded.
    pub pulse: PulseUs,
    /// Where the flight stands after the step.
    pub state: State,
    /// Why the newest step had no usable sample, if it had none.
    pub fault: Option<SensorFault>,
    /// The sensor has been delivering without a break.
    pub sensor_healthy: bool,
    /// Steps without a usable sample since start-up.
    pub missed: u32,
}

/// Attitude, control, servo and failsafe: all that flies.
#[derive(Clone, Debug)]
pub struct Flight {
    params: Params,
    mount: Mount,
    estimator: Estimator<Mahony<f32>>,
    controller: Pd,
    setpoint_rad: f32,
    crank_rad: f32,
    servo: Servo,
    supervisor: Supervisor,
    /// The newest sample used, and for how many samples its field has not changed.
    last: Option<RawSample>,
    field_repeats: u8,
}

impl Flight {
    /// At start-up, with what the board found.
    ///
    /// # Errors
    /// The estimator's configuration is impossible; no set of parameters within their ranges makes it so.
    pub fn new(params: Params, report: BootReport) -> Result<Self, ConfigError> {
        let mut flight = Self {
            mount: Mount::new(&params),
            estimator: Estimator::new(&estimator_config(&params))?,
            controller: Pd { kp: 0.0, kd: 0.0 },
            setpoint_rad: 0.0,
            crank_rad: 0.0,
            servo: Servo::new(&params),
            supervisor: Supervisor::new(report),
            last: None,
            field_repeats: 0,
            params,
        };
        flight.configure();
        Ok(flight)
    }

    /// One control step: a sample, or the reason why there is none, becomes the pulse of the next servo frame.
    pub fn step(&mut self, now: Micros, reading: Result<RawSample, SensorFault>) -> Outputs {
        let reading = reading.and_then(|raw| self.interval_s(&raw).map(|dt_s| (raw, dt_s)));
        match reading {
            Ok((raw, dt_s)) => {
                let attitude = self.estimate(&raw, dt_s);
                let health = health(&attitude);
                self.supervisor.sample(now, &raw, health);
                self.control(&attitude, dt_s);
                if !health.valid {
                    self.restart_estimator();
                }
            }
            Err(fault) => {
                self.supervisor.miss(now, fault);
                self.hold();
            }
        }
        self.outputs(now, reading.ok().map(|(raw, _)| raw))
    }

    /// Obey the operator, or say why not.
    ///
    /// # Errors
    /// The [`Refusal`]; nothing changes.
    pub fn command(&mut self, now: Micros, command: Command) -> Result<(), Refusal> {
        self.supervisor.command(now, command)
    }

    /// Change a parameter.
    ///
    /// # Errors
    /// [`ParamError`]; the old value stays.
    pub fn set_param(&mut self, name: &str, value: f32) -> Result<&'static Info, ParamError> {
        let info = Params::info(name).ok_or(ParamError::Unknown)?;
        if info.change == Change::Disarmed && self.state().is_armed() {
            return Err(ParamError::Armed { name: info.name });
        }
        let declination = self.params.declination_deg();
        self.params.set(name, value)?;
        if self.params.declination_deg() != declination {
            self.restart_estimator();
        }
        self.configure();
        Ok(info)
    }

    /// A ground station's heartbeat has arrived.
    pub fn host_heard(&mut self, now: Micros) {
        self.supervisor.host_heard(now);
    }

    /// Where the flight stands.
    pub fn state(&self) -> State {
        self.supervisor.state()
    }

    /// The parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The newest attitude.
    pub fn attitude(&self) -> Attitude {
        self.estimator.attitude()
    }

    /// Where the sensor sits and how it is calibrated.
    pub fn mount_mut(&mut self) -> &mut Mount {
        &mut self.mount
    }

    /// Seconds since the sample before. One that is not newer is late.
    fn interval_s(&self, raw: &RawSample) -> Result<f32, SensorFault> {
        let interval_us = match &self.last {
            None => CONTROL_PERIOD_US,
            Some(last) => raw.time.0.saturating_sub(last.time.0),
        };
        match interval_us {
            0 => Err(SensorFault::Late),
            _ => Ok(interval_us as f32 * 1.0e-6),
        }
    }

    fn estimate(&mut self, raw: &RawSample, dt_s: f32) -> Attitude {
        if dt_s > ESTIMATOR_GAP_US as f32 * 1.0e-6 {
            self.restart_estimator();
        }
        let mut sample = self.mount.convert(raw);
        if !self.field_is_fresh(raw) {
            sample.mag = None;
        }
        self.last = Some(*raw);
        self.estimator.update(dt_s, &sample)
    }

    /// The magnetometer is slower than the loop: its registers repeat until it has measured again. A field that stays
    /// the same for long is taken as one that does not change.
    fn field_is_fresh(&mut self, raw: &RawSample) -> bool {
        let repeated = self.last.is_some_and(|last| last.mag == raw.mag);
        self.field_repeats = if repeated { self.field_repeats + 1 } else { 0 };
        if self.field_repeats == FIELD_REPEATS {
            self.field_repeats = 0;
        }
        self.field_repeats == 0
    }

    /// The control law, where the state lets it move the rudder. Positive crank angles pitch the nose down, so the
    /// crank follows pitch and its rate with positive sign: `crank = kp (pitch - setpoint) + kd rate`.
    fn control(&mut self, attitude: &Attitude, dt_s: f32) {
        if !self.state().is_active() {
            return self.rest();
        }
        let pitch_rad = attitude.orientation.pitch();
        self.crank_rad = -self
            .controller
            .update(self.setpoint_rad, pitch_rad, attitude.rate.y);
        self.servo.command(self.crank_rad, dt_s);
    }

    /// Without a sample the last command stays, for as long as the supervisor lets it.
    fn hold(&mut self) {
        if !self.state().is_active() {
            self.rest();
        }
    }

    fn rest(&mut self) {
        self.crank_rad = 0.0;
        self.servo.neutral();
    }

    fn outputs(&self, now: Micros, sample: Option<RawSample>) -> Outputs {
        let pulse = self.servo.pulse();
        Outputs {
            pulse,
            snapshot: Snapshot {
                now,
                sample,
                attitude: self.attitude(),
                crank_rad: self.crank_rad,
                pulse,
                state: self.state(),
                fault: self.supervisor.fault(),
                sensor_healthy: self.supervisor.sensor_is_healthy(),
                missed: self.supervisor.missed(),
            },
        }
    }

    /// Hand the parameters to the parts that they belong to.
    fn configure(&mut self) {
        self.mount.configure(&self.params);
        self.servo.configure(&self.params);
        self.controller = Pd {
            kp: self.params.pid_kp(),
            kd: self.params.pid_kd(),
        };
        self.setpoint_rad = self.params.pitch_set_deg() * (PI / 180.0);
        self.supervisor.require_host(self.params.fs_host() == 1.0);
    }

    fn restart_estimator(&mut self) {
        if let Ok(estimator) = Estimator::new(&estimator_config(&self.params)) {
            self.estimator = estimator;
        }
    }
}

fn estimator_config(params: &Params) -> Config<MahonyGains> {
    Config {
        declination_rad: params.declination_deg() * (PI / 180.0),
        ..Config::default()
    }
}

fn health(attitude: &Attitude) -> Health {
    let q = &attitude.orientation;
    let norm2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    Health {
        valid: (norm2 - 1.0).abs() < UNIT_TOLERANCE,
        settled: attitude.flags.initialised,
        cos_tilt: 2.0 * q.half_down().z,
    }
}

#[cfg(test)]
pub(crate) mod tests;
