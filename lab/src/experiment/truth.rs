//! The true motion of an experiment, and what a simulated BNO055 measures of it.

use std::f64::consts::TAU;

use rig::Ticks;
use rig::bno055::{ImuErrors, Reading, Sensors, Stimulus};
use tvc_fusion::{Euler, GRAVITY, Quaternion};

use crate::experiment::GyroBias;
use crate::experiment::Sensing;

/// The field at Copenhagen: horizontal and downward part, uT (50 uT, 70 deg dip).
const FIELD_UT: (f64, f64) = (17.101, 46.985);
/// Frequency of the vibration, Hz: it passes the accelerometer's filter, and is no divisor of the
/// rate.
const VIBRATION_HZ: f64 = 40.3;
/// Time between two samples, ms; the simulated sensor follows the motion every ms.
const SAMPLE_MS: u64 = 10;
/// Rest before a motion, and after it, s.
const REST_S: f64 = 10.0;
/// Length of a cycle, s: with a reference that is 150 ms late it makes the thesis' errors.
const CYCLE_S: f64 = 7.0;
/// How long the motion takes to reach its full speed, and to end, s.
const EASE_S: f64 = 1.0;
/// Three cycles.
const MOTION_S: f64 = 3.0 * CYCLE_S + EASE_S;
/// Amplitude of a cycle, deg.
const AMPLITUDE_DEG: f64 = 45.0;

/// Which experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Ten minutes at rest, heading 200 deg.
    Static,
    /// Three cycles of pitch, heading 180 deg.
    Motion,
}

/// Roll, pitch and yaw, deg.
pub type Angles = [f64; 3];

impl Kind {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Motion => "motion",
        }
    }

    /// True heading, deg: about what the compass showed in the thesis.
    pub fn heading_deg(self) -> f64 {
        match self {
            Self::Static => 200.0,
            Self::Motion => 180.0,
        }
    }

    /// Length, s.
    pub fn duration_s(self) -> f64 {
        match self {
            Self::Static => 600.0,
            Self::Motion => 2.0 * REST_S + MOTION_S,
        }
    }

    /// Whether errors count at a time: after the warm-up, and in the motion experiment while it
    /// moves.
    pub fn counts(self, time_s: f64) -> bool {
        match self {
            Self::Static => time_s >= 0.0,
            Self::Motion => (REST_S..=REST_S + MOTION_S).contains(&time_s),
        }
    }

    /// Pitch (rad) and pitch rate (rad/s) in the motion experiment: a sine whose phase speeds up
    /// for a second, and slows down for one.
    fn pitch(self, time_s: f64) -> (f64, f64) {
        let moving_s = time_s - REST_S;
        if self != Self::Motion || !(0.0..=MOTION_S).contains(&moving_s) {
            return (0.0, 0.0);
        }
        let speed = TAU / CYCLE_S;
        // Seconds from the nearer end; the second half is the first, run backwards.
        let edge_s = moving_s.min(MOTION_S - moving_s);
        let (phase, phase_rate) = if edge_s < EASE_S {
            let share = edge_s / EASE_S;
            (0.5 * speed * share * edge_s, speed * share)
        } else {
            (speed * (edge_s - 0.5 * EASE_S), speed)
        };
        let sign = if moving_s > 0.5 * MOTION_S { -1.0 } else { 1.0 };
        let amplitude = AMPLITUDE_DEG.to_radians();
        (sign * amplitude * phase.sin(), amplitude * phase_rate * phase.cos())
    }

    /// True roll, pitch and yaw.
    pub fn angles_deg(self, time_s: f64) -> Angles {
        let (pitch_rad, _) = self.pitch(time_s);
        [0.0, pitch_rad.to_degrees(), self.heading_deg()]
    }

    /// What acts on the sensor, its axes forward, right and down.
    fn stimulus(self, time_s: f64, vibration_m_s2: f64) -> Stimulus {
        let (pitch_rad, rate_rad_s) = self.pitch(time_s);
        let attitude: Quaternion<f64> = Quaternion::from_euler(&Euler {
            roll_rad: 0.0,
            pitch_rad,
            yaw_rad: self.heading_deg().to_radians(),
        });
        let body = |v: [f64; 3]| attitude.conj().rotate(&v);
        let mut specific_force_m_s2 = body([0.0, 0.0, -f64::from(GRAVITY)]);
        for (axis, force) in specific_force_m_s2.iter_mut().enumerate() {
            let phase = TAU * (VIBRATION_HZ * time_s + axis as f64 / 3.0);
            *force += vibration_m_s2 * std::f64::consts::SQRT_2 * phase.sin();
        }
        Stimulus {
            specific_force_m_s2,
            rate_rad_s: [0.0, rate_rad_s, 0.0],
            field_ut: body([FIELD_UT.0, 0.0, FIELD_UT.1]),
            attitude: Stimulus::REST.attitude,
        }
    }
}

/// A sample of the simulated sensors, and the reference at its time.
#[derive(Debug, Clone, Copy)]
pub struct TimedSample {
    /// Time since the experiment began, s; negative in the warm-up before it.
    pub time_s: f64,
    /// What the sensors read.
    pub reading: Reading,
    /// Roll, pitch and yaw of the reference, which may be late.
    pub reference_deg: Angles,
}

/// All samples of an experiment, the warm-up's before time 0; `done` is told how many seconds there
/// are so far.
pub fn samples(kind: Kind, sensing: &Sensing, done: &mut dyn FnMut(f64)) -> Vec<TimedSample> {
    let mut sensors = Sensors::new(errors(sensing), sensing.seed);
    let lag_s = sensing.reference_lag * 1e-3;
    let mut samples = Vec::new();
    let length_ms = ((kind.duration_s() + sensing.warm_up) * 1e3) as u64;
    for ms in 1..=length_ms {
        let (passed_s, now) = (ms as f64 * 1e-3, Ticks::from_us(1000 * ms));
        let time_s = passed_s - sensing.warm_up;
        sensors.sense(now, &kind.stimulus(time_s, sensing.vibration));
        if ms.is_multiple_of(SAMPLE_MS)
            && let Some(reading) = sensors.refresh(now)
        {
            samples.push(TimedSample {
                time_s,
                reading,
                reference_deg: kind.angles_deg(time_s - lag_s),
            });
            done(passed_s);
        }
    }
    samples
}

/// The errors of the sensors: a typical chip's noise, and offsets as asked for.
fn errors(sensing: &Sensing) -> ImuErrors {
    let typical = ImuErrors::default();
    let noise = if sensing.no_noise { ImuErrors::NONE } else { typical };
    let [x, y, z] = sensing.soft_iron;
    ImuErrors {
        gyro_bias_rad_s: match sensing.gyro_bias {
            GyroBias::Typical => None,
            GyroBias::Given(deg_s) => Some(deg_s.map(f64::to_radians)),
        },
        gyro_scale: [sensing.gyro_scale / 100.0; 3],
        acc_offset_m_s2: sensing.acc_offset.map(|mg| mg * 1e-3 * f64::from(GRAVITY)),
        hard_iron_ut: sensing.hard_iron,
        soft_iron: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]],
        ..noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_full_cycles_whose_rate_is_the_slope_of_the_pitch() {
        let pitch = |ms: u32| Kind::Motion.pitch(f64::from(ms) * 1e-3);
        let end_ms = (Kind::Motion.duration_s() * 1e3) as u32;
        let (mut most, mut least, mut crossings) = (0.0_f64, 0.0_f64, 0);
        for ms in 1..end_ms {
            let (angle, rate) = pitch(ms);
            let slope = (pitch(ms + 1).0 - pitch(ms - 1).0) / 2e-3;
            assert!((rate - slope).abs() < 2e-3, "{ms}: {rate} against {slope}");
            (most, least) = (most.max(angle), least.min(angle));
            crossings += i32::from(angle <= 0.0 && pitch(ms + 1).0 > 0.0);
        }
        assert!((most.to_degrees() - 45.0).abs() < 0.01 && (least + most).abs() < 1e-4);
        assert_eq!(crossings, 3);
    }

    #[test]
    fn at_rest_the_sensors_show_gravity_and_the_field_of_the_heading() {
        let stimulus = Kind::Static.stimulus(1.0, 0.0);
        assert!((stimulus.specific_force_m_s2[2] + 9.806_65).abs() < 1e-6);
        let [forward, right, down] = stimulus.field_ut;
        assert!((forward - FIELD_UT.0 * 200f64.to_radians().cos()).abs() < 1e-6);
        assert!((right + FIELD_UT.0 * 200f64.to_radians().sin()).abs() < 1e-6);
        assert!((down - FIELD_UT.1).abs() < 1e-6);
        assert_eq!(stimulus.rate_rad_s, [0.0; 3]);
    }
}
