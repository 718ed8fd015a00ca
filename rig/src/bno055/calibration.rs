//! How the chip calibrates itself in its fusion modes: what CALIB_STAT shows, and when the chip
//! overwrites the profile.
//!
//! Bosch does not publish the algorithm; this is what the data sheet and users report of it. The
//! durations and angles are estimates.
//!
//! | | reaches 3 | source |
//! |---|---|---|
//! | gyroscope | after 2 s of rest, 1 and 2 on the way; every later rest learns the bias anew | DS 3.11; "a few seconds" by Bosch's forum |
//! | accelerometer | after six poses held for a second and at least 45 deg apart; 1 at two, 2 at four | DS 3.11 |
//! | magnetometer | after the field has come from nine directions at least 30 deg apart, fifteen where there is no fast calibration (all modes but NDOF); 1 and 2 on the way | DS 3.11; Bosch's forum |
//! | system | as the lower of gyroscope and magnetometer where the mode has both; the accelerometer does not count | Bosch's forum |
//!
//! A group of the profile that is not zero when fusion starts counts as restored: gyroscope and
//! accelerometer show 3 at once, the magnetometer 0 until the first motion, though the system takes
//! it for calibrated (a user's report).
//!
//! Levels fall again, as the thesis saw under motion (6.1): a second of forces far from 1 g sets
//! the accelerometer back to 2, and a second in a field of another strength restarts the
//! magnetometer.

use super::registers::Mode;
use crate::inertial::{STANDARD_GRAVITY_M_S2, Sample};

/// At rest the rate is within this of its own mean, rad/s, and the force within this of 1 g, m/s^2.
const STILL_RAD_S: f64 = 1.0 / 57.3;
const STILL_M_S2: f64 = 0.5;
/// Time constant of the mean rate, s.
const MEAN_S: f64 = 0.5;
/// A mean rate above this is not rest, however even it is, rad/s.
const SLOW_RAD_S: f64 = 5.0 / 57.3;
/// Rest after which the gyroscope shows 1, 2 and 3, s.
const RESTS_S: [f64; 3] = [0.5, 1.0, 2.0];
/// Poses after which the accelerometer shows 1, 2 and 3, how long each is held, s, and how far
/// apart they are, as a cosine.
const POSES: [usize; 3] = [2, 4, 6];
const POSE_S: f64 = 1.0;
const COS_POSES: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Directions of the field after which the magnetometer shows 1, 2 and 3, and how far apart they
/// are, as a cosine.
const FIELDS_FAST: [usize; 3] = [3, 6, 9];
const FIELDS: [usize; 3] = [5, 10, 15];
const COS_FIELDS: f64 = 0.866;
/// A force that far from 1 g, m/s^2, or a field whose strength differs by that share from the usual
/// one disturbs the calibration once it has lasted for this long, s.
const SHAKEN_M_S2: f64 = 2.0;
const DISTURBED_FIELD: f64 = 0.2;
const DISTURBED_S: f64 = 1.0;
/// The poses that a restored accelerometer counts as seen.
const FACES: [[f64; 3]; 6] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
];

/// A sensor that calibrates itself; in the order of the profile's groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Learner {
    Accelerometer = 0,
    Magnetometer = 1,
    Gyroscope = 2,
}

/// The state of calibration since fusion has started.
#[derive(Clone, Debug, Default)]
pub(super) struct Calibration {
    /// The magnetometer's, the gyroscope's group came from the profile.
    mag_restored: bool,
    gyr_restored: bool,
    mean_rad_s: Option<[f64; 3]>,
    rest_s: f64,
    longest_rest_s: f64,
    poses: Vec<[f64; 3]>,
    fields: Vec<[f64; 3]>,
    /// Strength of the field in which the magnetometer learns, uT.
    learned_in_ut: Option<f64>,
    /// How long force and field have been disturbed, s.
    shaken_s: f64,
    disturbed_s: f64,
}

impl Calibration {
    /// At the start of fusion, with the groups of the profile that are set.
    pub(super) fn new([acc, mag, gyr]: [bool; 3]) -> Self {
        Self {
            mag_restored: mag,
            gyr_restored: gyr,
            poses: if acc { FACES.to_vec() } else { Vec::new() },
            ..Self::default()
        }
    }

    /// Takes a sample, `dt_s` after the one before; `field_ut` is its field without the hard iron.
    /// Returns the sensors whose offsets became known with this sample.
    pub(super) fn update(
        &mut self,
        mode: Mode,
        sample: &Sample,
        field_ut: [f64; 3],
        dt_s: f64,
    ) -> Vec<Learner> {
        let mut learned = Vec::new();
        let rested = self.rest_s;
        self.rest_s = if self.is_still(mode, sample, dt_s) { rested + dt_s } else { 0.0 };
        self.longest_rest_s = self.longest_rest_s.max(self.rest_s);
        self.forget(sample, field_ut, dt_s);
        let [_, _, enough_s] = RESTS_S;
        if mode.has_gyr() && rested < enough_s && self.rest_s >= enough_s {
            learned.push(Learner::Gyroscope);
        }
        if mode.has_acc()
            && self.rest_s >= POSE_S
            && add_direction(&mut self.poses, sample.acc_m_s2, COS_POSES, POSES)
        {
            learned.push(Learner::Accelerometer);
        }
        if mode.has_mag() && add_direction(&mut self.fields, field_ut, COS_FIELDS, fields(mode)) {
            learned.push(Learner::Magnetometer);
        }
        learned
    }

    /// The value of CALIB_STAT.
    pub(super) fn register(&self, mode: Mode) -> u8 {
        let gyr = if self.gyr_restored { 3 } else { level(RESTS_S, self.longest_rest_s) };
        let acc = level(POSES, self.poses.len());
        let mag = match self.fields.len() {
            0 | 1 => 0,
            _ if self.mag_restored => 3,
            directions => level(fields(mode), directions),
        };
        let mag_for_system = if self.mag_restored { 3 } else { mag };
        let on = |has: bool, level: u8| if has { level } else { 0 };
        let system = [(mode.has_gyr(), gyr), (mode.has_mag(), mag_for_system)]
            .into_iter()
            .filter_map(|(has, level)| has.then_some(level))
            .min()
            .unwrap_or(0);
        system << 6
            | on(mode.has_gyr(), gyr) << 4
            | on(mode.has_acc(), acc) << 2
            | on(mode.has_mag(), mag)
    }

    /// Lowers the levels where force or field have been disturbed for too long.
    fn forget(&mut self, sample: &Sample, field_ut: [f64; 3], dt_s: f64) {
        let shaken = (norm(sample.acc_m_s2) - STANDARD_GRAVITY_M_S2).abs() > SHAKEN_M_S2;
        self.shaken_s = if shaken { self.shaken_s + dt_s } else { 0.0 };
        if self.shaken_s >= DISTURBED_S {
            let [_, some, _] = POSES;
            self.poses.truncate(some);
        }
        let strength = norm(field_ut);
        let usual = *self.learned_in_ut.get_or_insert(strength);
        let disturbed = (strength - usual).abs() > DISTURBED_FIELD * usual;
        self.disturbed_s = if disturbed { self.disturbed_s + dt_s } else { 0.0 };
        if self.disturbed_s >= DISTURBED_S {
            self.fields.clear();
            self.mag_restored = false;
            self.learned_in_ut = Some(strength);
        }
    }

    fn is_still(&mut self, mode: Mode, sample: &Sample, dt_s: f64) -> bool {
        let even = (norm(sample.acc_m_s2) - STANDARD_GRAVITY_M_S2).abs() < STILL_M_S2;
        if !mode.has_gyr() {
            return even;
        }
        let rate = sample.gyr_rad_s;
        let mean = self.mean_rad_s.get_or_insert(rate);
        for axis in 0..3 {
            mean[axis] += (rate[axis] - mean[axis]) * (dt_s / MEAN_S).min(1.0);
        }
        let mean = *mean;
        even && (0..3).all(|axis| (rate[axis] - mean[axis]).abs() < STILL_RAD_S)
            && norm(mean) < SLOW_RAD_S
    }
}

/// Numbers of field directions after which the magnetometer shows 1, 2 and 3 in this mode.
fn fields(mode: Mode) -> [usize; 3] {
    if mode == Mode::Ndof { FIELDS_FAST } else { FIELDS }
}

/// 0 to 3: how many of the thresholds are reached.
fn level<T: PartialOrd>(thresholds: [T; 3], reached: T) -> u8 {
    thresholds.iter().filter(|t| reached >= **t).count() as u8
}

/// Adds the direction of `vector` if it is at least `cos_apart` from those kept; true when this
/// completes the last level.
fn add_direction(
    directions: &mut Vec<[f64; 3]>,
    vector: [f64; 3],
    cos_apart: f64,
    enough: [usize; 3],
) -> bool {
    let [_, _, enough] = enough;
    let length = norm(vector);
    if directions.len() == enough || length == 0.0 {
        return false;
    }
    let direction = vector.map(|v| v / length);
    let is_new = directions.iter().all(|other| {
        let cos: f64 = other.iter().zip(direction).map(|(a, b)| a * b).sum();
        cos < cos_apart
    });
    if is_new {
        directions.push(direction);
    }
    is_new && directions.len() == enough
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
