//! The pitch loop on the host: drone, servo, sensor delay, servo frame and a control law.
//!
//! ```text
//! drone -> delay -> law (every control period) -> pulse (every frame) -> servo -> drone
//! ```
//!
//! The law is a closure over what the sensor delivers, so that gains, schedules, observers and
//! the firmware's own controller all fly in the same loop. [`Pd`] is the reference law.

use serde::{Deserialize, Serialize};

use crate::drone::{Crank, Drone};
use crate::linkage::Linkage;
use crate::parameters::{Checked, Parameters, check, finite, named, not_negative, positive};
use crate::response::{ResponseError, StepResponse};
use crate::servo::{Servo, ServoModel};

/// Shortest step of the simulation, in s.
const SHORTEST_STEP_S: f64 = 1e-5;
/// Longest period and longest delay, in s.
const LONGEST_S: f64 = 1.0;

/// When things happen in the loop, and what the sensor adds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Step of the simulation, in s; the servo divides it further by itself.
    pub step_s: f64,
    /// Period of the control law, in s; a run may come up to half a step early.
    pub control_s: f64,
    /// Period of the servo frame, in s.
    pub frame_s: f64,
    /// Time of the first pulse's rising edge, in s.
    pub phase_s: f64,
    /// Age of a measurement when the law gets it, in s.
    pub delay_s: f64,
    /// Where the law is locked to the servo frame: time from one of its runs to the rising edge
    /// that carries it, in s. Without, it runs freely from the start on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead_s: Option<f64>,
    /// Where the sensor refreshes its registers by a clock of its own: the period, in s. The law
    /// then sees the newest refresh, and the delay counts up to that; of the pitch it sees the sum
    /// of such rates, each over a period of the refresh, as the firmware estimates it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refresh_s: Option<f64>,
    /// Time of the first refresh after the start, in s.
    #[serde(default)]
    pub refresh_phase_s: f64,
}

impl Timing {
    /// Analogue servo: 50 Hz frame, law at 500 Hz, sensor delay 5 ms.
    pub const ANALOGUE: Self = Self {
        step_s: 0.5e-3,
        control_s: 2e-3,
        frame_s: 20e-3,
        phase_s: 0.0,
        delay_s: 5e-3,
        lead_s: None,
        refresh_s: None,
        refresh_phase_s: 0.0,
    };

    /// Digital servo: frames of 3 ms, else the same.
    pub const DIGITAL: Self = Self { frame_s: 3e-3, ..Self::ANALOGUE };

    /// The firmware with an analogue servo: samples at 150 Hz locked to the 50 Hz frame, every
    /// third one carried by a pulse 5.62 ms later. The sensor's own 100 Hz run free, so that what
    /// it shows is 0 to 10 ms old; its gyroscope's 47 Hz filter adds 3.4 ms.
    pub const NANO_50HZ: Self = Self {
        control_s: 20e-3 / 3.0,
        delay_s: 3.4e-3,
        lead_s: Some(5.62e-3),
        refresh_s: Some(10e-3),
        refresh_phase_s: 5e-3,
        ..Self::ANALOGUE
    };

    /// The firmware with a digital servo: the same sampling, frames at 300 Hz.
    pub const NANO_300HZ: Self = Self { frame_s: 10e-3 / 3.0, ..Self::NANO_50HZ };

    /// The presets and their names.
    pub(crate) const PRESETS: [(&'static str, Self); 4] = [
        ("ANALOGUE", Self::ANALOGUE),
        ("DIGITAL", Self::DIGITAL),
        ("NANO_50HZ", Self::NANO_50HZ),
        ("NANO_300HZ", Self::NANO_300HZ),
    ];

    /// Checks that every time is finite and in range.
    ///
    /// # Errors
    /// The first time out of range, by name.
    pub fn validate(&self) -> Checked {
        // What the sensor has seen is kept for as many steps as its delay has.
        let periods = named!(self; step_s, control_s, frame_s);
        check(&periods, "0.00001 s or more", |value| value >= SHORTEST_STEP_S)?;
        let refresh = [("refresh_s", self.refresh_s.unwrap_or(LONGEST_S))];
        for times in [&named!(self; step_s, control_s, frame_s, delay_s)[..], &refresh] {
            check(times, "1 s or less", |value| value <= LONGEST_S)?;
        }
        not_negative(&[
            ("phase_s", self.phase_s),
            ("delay_s", self.delay_s),
            ("lead_s", self.lead_s.unwrap_or(0.0)),
            ("refresh_phase_s", self.refresh_phase_s),
        ])?;
        positive(&[("refresh_s", self.refresh_s.unwrap_or(1.0))])
    }

    /// The number of the sensor's newest refresh at a time (s), by the period of its clock (s).
    pub fn newest_refresh(&self, time_s: f64, period_s: f64) -> f64 {
        ((time_s - self.refresh_phase_s) / period_s + 1e-9).floor()
    }
}

/// What the sensor delivers to the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Time at which the law runs, in s.
    pub time_s: f64,
    /// Pitch, in rad.
    pub pitch_rad: f64,
    /// Pitch rate, in rad/s.
    pub rate_rad_s: f64,
}

/// The reference law: `u = kp pitch + kd filtered rate` in servo radians, sent through the
/// inverse linkage so that the rudder is linear in `u`.
#[derive(Clone, Debug)]
pub struct Pd {
    /// Gain on pitch, servo rad/rad.
    pub kp: f64,
    /// Gain on filtered rate, servo rad s/rad.
    pub kd: f64,
    linkage: Linkage,
    zero_rad: f64,
    keep: f64,
    rate: Option<f64>,
}

/// Corner of the reference law's first-order filter on the rate, in Hz.
pub const RATE_FILTER_HZ: f64 = 40.0;
/// Rudder radians for each servo radian near zero rudder: the linkage's ratio there.
pub const RUDDER_PER_SERVO: f64 = 0.5568;
/// Largest crank command either side, in rad: beyond 60 deg the linkage has lost its gain.
pub const COMMAND_LIMIT_RAD: f64 = std::f64::consts::FRAC_PI_3;

impl Pd {
    /// The law for a drone's linkage, run every `control_s` seconds.
    pub fn new(kp: f64, kd: f64, linkage: &Linkage, control_s: f64) -> Self {
        Self {
            kp,
            kd,
            linkage: *linkage,
            zero_rad: linkage.zero_rudder_crank_rad(),
            keep: (-std::f64::consts::TAU * RATE_FILTER_HZ * control_s).exp(),
            rate: None,
        }
    }

    /// Takes a measurement and gives the crank command, in rad.
    pub fn update(&mut self, measurement: Measurement) -> f64 {
        let new = measurement.rate_rad_s;
        let rate = self.rate.map_or(new, |old| new + self.keep * (old - new));
        self.rate = Some(rate);
        let servo_rad = self.kp * measurement.pitch_rad + self.kd * rate;
        // The servo radians from zero rudder, through the inverse linkage, within the limit.
        self.linkage
            .crank_for_rudder(RUDDER_PER_SERVO * servo_rad)
            .unwrap_or(self.zero_rad + servo_rad.signum() * std::f64::consts::PI)
            .clamp(-COMMAND_LIMIT_RAD, COMMAND_LIMIT_RAD)
    }
}

/// One sample of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, in s.
    pub time_s: f64,
    /// True pitch, in rad.
    pub pitch_rad: f64,
    /// True pitch rate, in rad/s.
    pub rate_rad_s: f64,
    /// The crank.
    pub crank: Crank,
    /// The law's last crank command, in rad.
    pub command_rad: f64,
}

/// Drone and servo in a loop that a law closes.
#[derive(Clone, Debug)]
pub struct PitchLoop {
    drone: Drone,
    servo: Servo,
    timing: Timing,
    steps: u64,
    /// Time of the law's first run, in s, and how often it has run.
    first_control_s: f64,
    controls: u64,
    frames: u64,
    history: Vec<[f64; 2]>,
    command_rad: f64,
    /// The command before, and when the law was due to replace it, in s: a run may come up to half
    /// a step early, and an edge before that time still carries the former command.
    replaced: (f64, f64),
    /// The pitch at the start and the sum of the measured rates since, in rad, and the number of
    /// the refresh that was the newest of them.
    summed_rad: f64,
    summed: f64,
}

impl PitchLoop {
    /// A loop released at a pitch (rad) and pitch rate (rad/s), rudder at zero.
    ///
    /// # Errors
    /// As [`Parameters::validate`], [`ServoModel::validate`] and [`Timing::validate`].
    pub fn new(
        parameters: &Parameters,
        model: ServoModel,
        timing: Timing,
        pitch_rad: f64,
        rate_rad_s: f64,
    ) -> Checked<Self> {
        model.validate()?;
        timing.validate()?;
        finite(&named!(pitch_rad, rate_rad_s))?;
        let drone = Drone::new(parameters, pitch_rad, rate_rad_s)?;
        let zero_rad = drone.crank().angle_rad;
        // One state a step, back to the oldest that the delay reaches.
        let oldest_s = timing.delay_s + timing.refresh_s.unwrap_or(0.0);
        let depth = (oldest_s / timing.step_s).ceil() as usize + 2;
        Ok(Self {
            drone,
            servo: Servo::new(model, zero_rad, 0.0),
            timing,
            steps: 0,
            first_control_s: timing
                .lead_s
                .map_or(0.0, |lead| (timing.phase_s - lead).rem_euclid(timing.control_s)),
            controls: 0,
            frames: 0,
            history: vec![[pitch_rad, rate_rad_s]; depth],
            command_rad: zero_rad,
            replaced: (zero_rad, 0.0),
            summed_rad: pitch_rad,
            summed: timing.refresh_s.map_or(0.0, |period_s| timing.newest_refresh(0.0, period_s)),
        })
    }

    /// The law runs if its period has come, pulses of this step go out, servo and drone move on.
    pub fn step(&mut self, mut law: impl FnMut(Measurement) -> f64) -> Sample {
        let step_s = self.timing.step_s;
        let now = self.steps as f64 * step_s;
        // A run on a step's boundary belongs to the step that it opens, whatever rounding does.
        let due = self.first_control_s + self.controls as f64 * self.timing.control_s;
        if now > due - 0.5 * step_s {
            self.replaced = (self.command_rad, due);
            let mut measured = self.measure(now);
            if let Some(period_s) = self.timing.refresh_s {
                let newest = self.timing.newest_refresh(now, period_s);
                self.summed_rad += (newest - self.summed) * period_s * measured.rate_rad_s;
                self.summed = newest;
                measured.pitch_rad = self.summed_rad;
            }
            self.command_rad = law(measured);
            self.controls += 1;
        }
        let end = (self.steps + 1) as f64 * step_s;
        loop {
            let edge = self.timing.phase_s + self.frames as f64 * self.timing.frame_s;
            // Half a nanosecond: an edge on a step's boundary belongs to the step that it opens.
            if edge >= end - 0.5e-9 {
                break;
            }
            let (before_rad, replaced_s) = self.replaced;
            let command_rad =
                if edge < replaced_s - 0.5e-9 { before_rad } else { self.command_rad };
            self.servo.pulse(edge, self.servo.model().width_for_crank(command_rad));
            self.frames += 1;
        }
        let crank = self.servo.advance(end, self.drone.crank_load());
        self.drone.step(step_s, crank);
        self.steps += 1;
        let slot = self.steps as usize % self.history.len();
        self.history[slot] = [self.drone.pitch_rad(), self.drone.rate_rad_s()];
        self.sample()
    }

    /// Runs for `seconds` and keeps the true pitch after every step, the start included.
    ///
    /// # Errors
    /// A start on the target gives no response.
    pub fn respond(
        &mut self,
        seconds: f64,
        mut law: impl FnMut(Measurement) -> f64,
    ) -> Result<StepResponse, ResponseError> {
        let steps = (seconds / self.timing.step_s).round() as u64;
        let first = (self.sample().time_s, self.drone.pitch_rad());
        let rest = (0..steps).map(|_| {
            let sample = self.step(&mut law);
            (sample.time_s, sample.pitch_rad)
        });
        StepResponse::new(std::iter::once(first).chain(rest), 0.0)
    }

    /// Where everything stands.
    pub fn sample(&self) -> Sample {
        Sample {
            time_s: self.steps as f64 * self.timing.step_s,
            pitch_rad: self.drone.pitch_rad(),
            rate_rad_s: self.drone.rate_rad_s(),
            crank: self.drone.crank(),
            command_rad: self.command_rad,
        }
    }

    /// The drone, to clamp, release or kick it.
    pub fn drone_mut(&mut self) -> &mut Drone {
        &mut self.drone
    }

    /// The drone.
    pub fn drone(&self) -> &Drone {
        &self.drone
    }

    /// The delayed state, interpolated between steps.
    fn measure(&self, now: f64) -> Measurement {
        let held_s = self.timing.refresh_s.map_or(0.0, |period_s| {
            let newest = self.timing.newest_refresh(now, period_s);
            now - self.timing.refresh_phase_s - newest * period_s
        });
        let age = (self.timing.delay_s + held_s) / self.timing.step_s;
        let (whole, part) = ((age + 1e-9).floor(), (age - (age + 1e-9).floor()).max(0.0));
        let len = self.history.len() as u64;
        let back = |steps: u64| self.history[((self.steps + len - steps % len) % len) as usize];
        let newer = back(whole as u64);
        let older = back((whole as u64 + 1).min(len - 1));
        Measurement {
            time_s: now,
            pitch_rad: newer[0] + part * (older[0] - newer[0]),
            rate_rad_s: newer[1] + part * (older[1] - newer[1]),
        }
    }
}
