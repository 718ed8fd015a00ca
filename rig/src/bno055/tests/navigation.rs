//! The two navigation experiments of the thesis (chapter 6) with simulated sensors.
//!
//! Its estimators, set as in the thesis, and ours get the same samples of one BNO055, 100 a second.
//! `cargo test -p rig --lib navigation -- --nocapture` prints the errors of all estimators.

use std::f64::consts::TAU;

use recordings::{Choice, Estimate, Facts, FilterName, Mode, RecordedSample, Scalar, Setting};
use samd21::board::Ticks;
use tvc_fusion::{Euler, GRAVITY, Quaternion, fixed};

use super::sensors::{Reading, Sensors};
use crate::bno055::{ImuErrors, Stimulus};

/// The field at Copenhagen: horizontal and downward part, uT (50 uT, 70 deg dip).
const FIELD_UT: (f64, f64) = (17.101, 46.985);
/// Time between two samples, ms; the simulated sensor follows the motion every ms.
const SAMPLE_MS: u64 = 10;
/// Rest before an experiment, in which estimators find north and learn the gyroscope's offset, s.
const WARM_UP_S: f64 = 30.0;
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
/// The gyroscope's offset that the thesis' calibration leaves, deg/s.
const LEFT_DEG_S: f64 = 0.0174;
/// How long the thesis' estimators look at the field where the gyroscope alone gives the yaw, s.
const ALIGNMENT_S: f64 = 1.0;

/// Roll, pitch and yaw, deg.
type Angles = [f64; 3];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Experiment {
    /// Ten minutes at rest, heading 200 deg.
    Static,
    /// Three cycles of pitch, heading 180 deg.
    Motion,
}

impl Experiment {
    /// True heading, deg: about what the compass showed in the thesis.
    fn heading_deg(self) -> f64 {
        if self == Self::Static { 200.0 } else { 180.0 }
    }

    fn duration_s(self) -> f64 {
        if self == Self::Static { 600.0 } else { 2.0 * REST_S + MOTION_S }
    }

    /// Whether errors count: after the warm-up, and in the motion experiment while it moves.
    fn counts(self, time_s: f64) -> bool {
        match self {
            Self::Static => time_s >= 0.0,
            Self::Motion => (REST_S..=REST_S + MOTION_S).contains(&time_s),
        }
    }

    /// Pitch (rad) and pitch rate (rad/s): a sine whose phase speeds up for a second, and slows
    /// down for one.
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

    /// What acts on the sensor, its axes forward, right and down.
    fn stimulus(self, time_s: f64) -> Stimulus {
        let (pitch_rad, rate_rad_s) = self.pitch(time_s);
        let yaw_rad = self.heading_deg().to_radians();
        let attitude = Quaternion::<f64>::from_euler(&Euler { roll_rad: 0.0, pitch_rad, yaw_rad });
        let body = |v: [f64; 3]| attitude.conj().rotate(&v);
        Stimulus {
            specific_force_m_s2: body([0.0, 0.0, -f64::from(GRAVITY)]),
            rate_rad_s: [0.0, rate_rad_s, 0.0],
            field_ut: body([FIELD_UT.0, 0.0, FIELD_UT.1]),
            attitude: Stimulus::REST.attitude,
        }
    }

    /// All samples, those of the warm-up before time 0: the time, s, and what the sensors read.
    fn samples(self, errors: ImuErrors, seed: u64) -> Vec<(f64, Reading)> {
        let mut sensors = Sensors::new(errors, seed);
        let length_ms = ((self.duration_s() + WARM_UP_S) * 1e3) as u64;
        let sensed = (1..=length_ms).filter_map(|ms| {
            let (time_s, now) = (ms as f64 * 1e-3 - WARM_UP_S, Ticks::from_us(1000 * ms));
            sensors.sense(now, &self.stimulus(time_s));
            let reading = ms.is_multiple_of(SAMPLE_MS).then(|| sensors.refresh(now))??;
            Some((time_s, reading))
        });
        sensed.collect()
    }
}

/// A filter, and how it is set.
struct Candidate {
    name: &'static str,
    filter: FilterName,
    scalar: Scalar,
    /// Set as in the thesis: no offset learned at rest, every field believed, no lags.
    of_thesis: bool,
    /// The requirements are for it.
    required: bool,
    /// Combined RMSE that the thesis printed (table 6.3) at rest and in motion, deg.
    published_deg: Option<[f64; 2]>,
}

const fn thesis(name: &'static str, filter: FilterName, published_deg: [f64; 2]) -> Candidate {
    let published_deg = Some(published_deg);
    Candidate { name, filter, scalar: Scalar::F32, of_thesis: true, required: false, published_deg }
}

const fn ours(name: &'static str, filter: FilterName, scalar: Scalar, required: bool) -> Candidate {
    Candidate { name, filter, scalar, of_thesis: false, required, published_deg: None }
}

const CANDIDATES: [Candidate; 10] = [
    thesis("integrated gyro, thesis", FilterName::Gyro, [3.4796, 8.557]),
    thesis("complementary, thesis", FilterName::Complementary, [3.4712, 8.057]),
    thesis("Mahony, thesis", FilterName::Mahony, [0.3898, 3.3193]),
    thesis("Madgwick, thesis", FilterName::Madgwick, [1.5579, 4.6223]),
    ours("Mahony", FilterName::Mahony, Scalar::F32, true),
    ours("Mahony, fixed point", FilterName::Mahony, Scalar::Fixed, true),
    ours("VQF class", FilterName::Vqf, Scalar::F32, true),
    ours("VQF class, fixed point", FilterName::Vqf, Scalar::Fixed, true),
    ours("Madgwick", FilterName::Madgwick, Scalar::F32, false),
    ours("complementary", FilterName::Complementary, Scalar::F32, false),
];

const SETTINGS_OF_THESIS: [(&str, &str); 7] = [
    ("preset", "thesis"),
    ("rest.rate_rad_s", "0"),
    ("field.gate", "inf"),
    ("gyr_lag_s", "0"),
    ("acc_lag_s", "0"),
    ("mag_lag_s", "0"),
    ("mag_lag_sd_s", "0"),
];

/// Mean and root mean square of an estimator's error, estimate less reference, deg.
struct Errors {
    mean_deg: Angles,
    rmse_deg: Angles,
}

impl Errors {
    /// Root of the sum of the squares of the three axes, deg.
    fn combined_deg(&self) -> f64 {
        self.rmse_deg.iter().map(|deg| deg * deg).sum::<f64>().sqrt()
    }
}

impl Candidate {
    /// The filter's errors on the samples, against a reference that is late by `lag_s`.
    fn errors(&self, experiment: Experiment, samples: &[(f64, Reading)], lag_s: f64) -> Errors {
        let settings = SETTINGS_OF_THESIS.iter().filter(|_| self.of_thesis);
        let settings =
            settings.map(|(key, value)| Setting { key: (*key).into(), value: (*value).into() });
        let choice = Choice {
            filter: self.filter,
            scalar: self.scalar,
            mode: Mode::NineD,
            settings: settings.collect(),
        };
        let facts = Facts { period_s: 0.01, scale: fixed::Scale::BNO055, gyro_range_rad_s: None };
        let mut estimate = Estimate::new(&choice, &facts).unwrap();
        // The gyroscope alone gives the yaw of these two, from the first field on.
        let gyro_yaw =
            self.of_thesis && matches!(self.filter, FilterName::Gyro | FilterName::Complementary);
        let mut started = !gyro_yaw;
        let (mut n, mut sums, mut squares) = (0.0, [0.0; 3], [0.0; 3]);
        for (time_s, reading) in samples {
            started |= *time_s >= 0.0 && reading.mag.is_some();
            if !started {
                continue;
            }
            let field = !gyro_yaw || *time_s <= ALIGNMENT_S;
            let angles = angles_deg(estimate.update(&recorded(*time_s, reading, field)));
            if experiment.counts(*time_s) {
                let (pitch_rad, _) = experiment.pitch(time_s - lag_s);
                let reference_deg = [0.0, pitch_rad.to_degrees(), experiment.heading_deg()];
                n += 1.0;
                for axis in 0..3 {
                    let off =
                        (angles[axis] - reference_deg[axis] + 180.0).rem_euclid(360.0) - 180.0;
                    sums[axis] += off;
                    squares[axis] += off * off;
                }
            }
        }
        Errors { mean_deg: sums.map(|sum| sum / n), rmse_deg: squares.map(|sum| (sum / n).sqrt()) }
    }
}

fn recorded(time_s: f64, reading: &Reading, field: bool) -> RecordedSample {
    let unit = fixed::Scale::BNO055;
    let si = |counts: [i16; 3], unit: f32| counts.map(|count| f64::from(count) * f64::from(unit));
    RecordedSample {
        time_s,
        gyr_rad_s: si(reading.gyr, unit.gyr_rad_s),
        acc_m_s2: si(reading.acc, unit.acc_m_s2),
        mag_ut: reading.mag.filter(|_| field).map(|mag| si(mag, unit.mag_ut)),
        reference: None,
        movement: true,
    }
}

fn angles_deg([w, x, y, z]: [f64; 4]) -> Angles {
    let euler = Quaternion { w, x, y, z }.euler();
    [euler.roll_rad, euler.pitch_rad, euler.yaw_rad].map(f64::to_degrees)
}

/// The errors of all candidates, printed.
fn fly(
    experiment: Experiment,
    gyro_bias_rad_s: Option<Angles>,
    seed: u64,
    lag_s: f64,
) -> Vec<(&'static Candidate, Errors)> {
    let imu = ImuErrors { gyro_bias_rad_s, ..ImuErrors::default() };
    let samples = experiment.samples(imu, seed);
    let of = |candidate: &'static Candidate| {
        let errors = candidate.errors(experiment, &samples, lag_s);
        let published = candidate.published_deg.map(|deg| deg[experiment as usize]);
        let (mean, rmse) = (errors.mean_deg, errors.rmse_deg);
        let thesis = published.map_or(String::new(), |deg| format!("; thesis {deg:.3}"));
        let combined = errors.combined_deg();
        println!("{:24} mean {mean:.3?}, RMSE {rmse:.3?}, {combined:.3}{thesis}", candidate.name);
        (candidate, errors)
    };
    CANDIDATES.iter().map(of).collect()
}

/// The offset that the thesis' calibration leaves about the down axis.
fn left() -> Option<Angles> {
    Some([0.0, 0.0, LEFT_DEG_S.to_radians()])
}

fn combined_deg(all: &[(&Candidate, Errors)], name: &str) -> f64 {
    let found = all.iter().find(|(candidate, _)| candidate.name == name);
    found.unwrap_or_else(|| panic!("no {name}")).1.combined_deg()
}

/// The mean error is at most 1.5 deg an axis, as the thesis requires, and `holds`.
fn assert_required(all: &[(&Candidate, Errors)], holds: impl Fn(&Errors) -> bool) {
    for (candidate, errors) in all.iter().filter(|(candidate, _)| candidate.required) {
        assert!(errors.mean_deg.iter().all(|deg| deg.abs() <= 1.5), "{}", candidate.name);
        assert!(holds(errors), "{}: {:?}", candidate.name, errors.rmse_deg);
    }
}

#[test]
fn at_rest_ours_stay_and_an_uncorrected_offset_drifts_as_in_the_thesis() {
    let all = fly(Experiment::Static, left(), 1, 0.0);
    assert_required(&all, |errors| errors.combined_deg() <= 0.4);
    // 0.0174 deg/s for 600 s are 10.4 deg, 6 deg rms.
    for name in ["integrated gyro, thesis", "complementary, thesis"] {
        let rmse = combined_deg(&all, name);
        assert!((4.5..8.0).contains(&rmse), "{name}: {rmse}");
    }
}

#[test]
fn in_motion_ours_stay_within_half_a_degree_an_axis() {
    for (bias, seed) in [(left(), 1), (None, 2)] {
        let all = fly(Experiment::Motion, bias, seed, 0.0);
        assert_required(&all, |errors| errors.rmse_deg.iter().all(|deg| *deg <= 0.5));
    }
}

#[test]
fn a_reference_that_is_150_ms_late_makes_the_errors_of_the_thesis() {
    let all = fly(Experiment::Motion, left(), 1, 0.15);
    for name in ["Mahony, thesis", "Mahony"] {
        let rmse = combined_deg(&all, name);
        assert!((3.3..4.8).contains(&rmse), "{name}: {rmse}");
    }
}

#[test]
fn the_motion_has_three_full_cycles_whose_rate_is_the_slope_of_the_pitch() {
    let pitch = |ms: u32| Experiment::Motion.pitch(f64::from(ms) * 1e-3);
    let end_ms = (Experiment::Motion.duration_s() * 1e3) as u32;
    let (mut most, mut least, mut crossings) = (0.0_f64, 0.0_f64, 0);
    for ms in 1..end_ms {
        let (angle, rate) = pitch(ms);
        let slope = (pitch(ms + 1).0 - pitch(ms - 1).0) / 2e-3;
        assert!((rate - slope).abs() < 2e-3, "{ms}: {rate} against {slope}");
        (most, least) = (most.max(angle), least.min(angle));
        crossings += i32::from(angle <= 0.0 && pitch(ms + 1).0 > 0.0);
    }
    assert!((most.to_degrees() - AMPLITUDE_DEG).abs() < 0.01 && (least + most).abs() < 1e-4);
    assert_eq!(crossings, 3);
}
