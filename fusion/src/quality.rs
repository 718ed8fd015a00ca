//! How far an estimate may be off.
//!
//! The errors of tilt and heading are each a random walk that a filter pulls back. With the gain
//! `g` (1/s) their variance follows
//!
//! ```text
//! dV/dt = still + scale |w|^2 + noise g^2 - 2 g V
//! ```
//!
//! at the rate `w`. The main errors of a gyroscope are scale and alignment; `noise` is the
//! acceleration's. While nothing shows the heading, its `g` is 0. An error of the offset makes a
//! drift that follows `d/dt = bias - g drift`. Errors that stand still in the body or in the field,
//! from calibration and place, add a constant to each variance.
//!
//! # The pull of the accelerations
//! A lasting acceleration drags the estimate away from the true vertical, and the corrections of
//! the tilt are what drags it. With the corrections `c` (rad/s, earth frame), the tilt's variance
//! grows by the larger of `|P|^2` and `H`:
//!
//! ```text
//! dP/dt = c - pull P
//! H = |P|^2 - explained V      if that is more than H, else dH/dt = -hold H
//! ```
//!
//! Once the estimate follows a lasting acceleration, the corrections cease. `H` remembers them. The
//! errors of the gyroscope also cause corrections, and `explained V` takes no memory of these. Only
//! the VQF class smooths the corrections enough to tell a pull.
//!
//! # The constants
//! The gains are the defaults. The constants come from seven recordings of BROAD with the VQF
//! class; other filters have larger errors.

use core::mem::{replace, take};

use crate::real::Real;
use crate::vector::dot;

/// State of the gyroscope's offset.
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BiasState {
    /// No rest has shown it yet.
    Unknown,
    /// A rest has shown it, or it was set.
    Known,
    /// The body is at rest or turns steadily about the vertical, with a rate beyond
    /// [`RestConfig::max_bias_rad_s`](crate::RestConfig::max_bias_rad_s). The offset may be wrong
    /// by this rate.
    Refused,
}

impl BiasState {
    pub(crate) fn new(is_refused: bool, is_known: bool) -> Self {
        match (is_refused, is_known) {
            (true, _) => Self::Refused,
            (false, true) => Self::Known,
            (false, false) => Self::Unknown,
        }
    }
}

/// Standard deviations of an estimate, and the state of offset and field.
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality<T = f32> {
    /// Of the vertical, rad.
    pub tilt_rad: T,
    /// Of the heading, rad: at most 1.81, for an unknown heading. Without a magnetometer it grows,
    /// against the heading at the start.
    pub heading_rad: T,
    /// Of the gyroscope's offset, each axis, rad/s.
    pub bias_rad_s: T,
    /// State of the offset.
    pub bias: BiasState,
    /// Whether a field shows the heading: undisturbed, within the last half second, with a dip
    /// below 80 deg.
    pub heading_is_observable: bool,
    /// Time since the last undisturbed field, s, to within 64 steps; `None` before the first.
    pub field_age_s: Option<T>,
}

/// Gains of the default filters, 1/s.
pub(crate) const TILT_PER_S: f32 = 0.4;
pub(crate) const HEADING_PER_S: f32 = 0.11;

/// Random walk of a body at rest, rad^2/s.
pub(crate) const STILL: f32 = 1e-7;

/// Growth of the walk with the square of the rate, s.
pub(crate) const SCALE_S: f32 = 3e-6;

/// Noise of the vertical and of the heading that are shown, rad^2 s.
pub(crate) const NOISE_S: f32 = 1e-5;

/// Variance of constant errors of the vertical, rad^2: 0.2 deg.
pub(crate) const TILT: f32 = 1.2e-5;

/// Rates at which the pull and its memory decay, 1/s.
pub(crate) const PULL_PER_S: f32 = 0.28;
pub(crate) const HOLD_PER_S: f32 = 0.08;

/// The square of a pull that the tilt's variance explains, in parts of it: base-2 logarithm.
pub(crate) const EXPLAINED_LOG2: u8 = 4;

/// Variance of constant errors of a horizontal field, rad^2. A steep field's is larger by the
/// square of the whole field over its horizontal part.
pub(crate) const HEADING: f32 = 2.5e-5;

/// The walk while a rate is clipped and some seconds after, rad^2/s.
const CLIPPED: f32 = 3e-3;

/// Deviation of an unknown offset and of an offset from a rest, rad/s, and growth of its variance,
/// (rad/s)^2/s.
pub(crate) const BIAS_UNKNOWN: f32 = 0.02;
pub(crate) const BIAS_AT_REST: f32 = 5e-4;
pub(crate) const BIAS_WALK: f32 = 1e-9;

/// Variance of the first vertical, of a single sample in motion, rad^2.
pub(crate) const FIRST: f32 = 0.03;

/// Oldest field that shows the heading, s.
pub(crate) const FRESH_S: f32 = 0.5;

/// The whole field over its horizontal part, squared, at a dip of 80 deg. Steeper fields show no
/// heading.
pub(crate) const STEEP: f32 = 33.2;

/// Variance of an unknown angle, rad^2: pi^2 / 3.
pub(crate) const UNKNOWN: f32 = 3.29;

/// Observations of a step.
pub(crate) struct Evidence<T> {
    /// The accelerometer.
    pub(crate) acc: bool,
    /// The pull of the accelerations.
    pub(crate) pull: bool,
    /// The filter's least gain, 1/s.
    pub(crate) floor: T,
    /// A rate is clipped, or was.
    pub(crate) clipped: bool,
    /// The offset was learned at this rest.
    pub(crate) rest: bool,
}

/// The variances.
#[derive(Clone, Debug, Default)]
pub(crate) struct Uncertainty<T> {
    /// Of the vertical and of the heading, rad^2.
    tilt: T,
    heading: T,
    /// Drifts of both by the offset's error, rad.
    tilt_drift: T,
    heading_drift: T,
    /// Mean correction of the tilt since the last update, rad/s.
    mean_pull: [T; 2],
    /// The pull, rad, and the memory of its square, rad^2.
    pull: [T; 2],
    held: T,
    /// Of the offset, (rad/s)^2.
    bias: T,
    field_age_s: Option<T>,
    /// Time since the last update, s, and whether it had an undisturbed field.
    time_s: T,
    good_field: bool,
}

impl<T: Real> Uncertainty<T> {
    pub(crate) fn new() -> Self {
        Self {
            tilt: T::from_f32(FIRST),
            bias: T::from_f32(BIAS_UNKNOWN * BIAS_UNKNOWN),
            ..Self::default()
        }
    }

    /// Time passes, s.
    #[inline(always)]
    pub(crate) fn pass(&mut self, dt: T, good_field: bool) {
        self.time_s += dt;
        self.good_field |= good_field;
    }

    /// A correction of the tilt, about two axes of the earth, rad/s, for this share of the time
    /// between two updates.
    #[inline(always)]
    pub(crate) fn add_pull(&mut self, rate: [T; 2], share: T) {
        for (mean, rate) in self.mean_pull.iter_mut().zip(rate) {
            *mean += rate * share;
        }
    }

    /// The attitude's variance has grown, rad^2.
    pub(crate) fn widen(&mut self, variance: T) {
        self.tilt += variance;
        self.heading += variance;
    }

    /// The attitude comes from a new sample; the offset keeps its deviation.
    pub(crate) fn restart(&mut self) {
        *self = Self { bias: self.bias, ..Self::new() };
    }

    /// The offset is known as from a rest.
    pub(crate) fn know_bias(&mut self) {
        self.bias = T::from_f32(BIAS_AT_REST * BIAS_AT_REST);
    }

    /// Bounds the variance of the offset, (rad/s)^2.
    pub(crate) fn narrow_bias(&mut self, variance: T) {
        if self.bias > variance {
            self.bias = variance;
        }
    }

    /// The attitude is known as after a long time.
    pub(crate) fn know_attitude(&mut self) {
        (self.tilt, self.heading) = (T::ZERO, T::ZERO);
        (self.tilt_drift, self.heading_drift) = (T::ZERO, T::ZERO);
        (self.pull, self.held) = ([T::ZERO; 2], T::ZERO);
    }

    /// Renews the variances, at this rate, rad/s.
    #[inline(never)]
    pub(crate) fn update(&mut self, rate: &[T; 3], evidence: &Evidence<T>) {
        let dt = replace(&mut self.time_s, T::ZERO);
        if take(&mut self.good_field) {
            self.field_age_s = Some(T::ZERO);
        } else if let Some(age_s) = &mut self.field_age_s {
            *age_s += dt;
        }
        if evidence.rest {
            self.know_bias();
        }
        self.bias += T::from_f32(BIAS_WALK) * dt;
        let bias = self.bias.sqrt();
        let mut walk = T::from_f32(STILL) + T::from_f32(SCALE_S) * dot(rate, rate);
        if evidence.clipped {
            walk += T::from_f32(CLIPPED);
        }
        let gain = |seen: bool, per_s: f32| {
            let own = T::from_f32(per_s);
            match (seen, evidence.floor > own) {
                (false, _) => T::ZERO,
                (true, true) => evidence.floor,
                (true, false) => own,
            }
        };
        let heading_gain = gain(self.field_is_fresh(), HEADING_PER_S);
        let tilt = (&mut self.tilt, &mut self.tilt_drift);
        step(tilt, dt, walk, bias, gain(evidence.acc, TILT_PER_S));
        let heading = (&mut self.heading, &mut self.heading_drift);
        step(heading, dt, walk, bias, heading_gain);
        if evidence.pull {
            self.renew_pull(dt);
        }
    }

    fn renew_pull(&mut self, dt: T) {
        let left = |per_s: f32| (T::ONE + T::from_f32(per_s) * dt).recip();
        let pull_left = left(PULL_PER_S);
        for (pull, mean) in self.pull.iter_mut().zip(take(&mut self.mean_pull)) {
            *pull = ((*pull + mean * dt) * pull_left).limited(T::ONE);
        }
        let explained = T::from_f32(f32::from(1u8 << EXPLAINED_LOG2)) * self.walked();
        let excess = (self.pull_square() - explained).at_most(T::from_f32(UNKNOWN));
        self.held = larger(self.held * left(HOLD_PER_S), excess);
    }

    /// Variance of the tilt by the walk and the drift, rad^2.
    fn walked(&self) -> T {
        self.tilt + self.tilt_drift * self.tilt_drift
    }

    fn pull_square(&self) -> T {
        let [north, east] = self.pull;
        north * north + east * east
    }

    fn field_is_fresh(&self) -> bool {
        self.field_age_s.is_some_and(|age_s| age_s.within(T::from_f32(FRESH_S)))
    }

    /// The deviations, with the whole field over its horizontal part, squared, if known.
    pub(crate) fn quality(&self, steepness: Option<T>, bias: BiasState) -> Quality<T> {
        let place = steepness.map_or(T::ZERO, |ratio| ratio * T::from_f32(HEADING));
        let pulled = larger(self.pull_square(), self.held);
        let tilt = self.walked() + pulled + T::from_f32(TILT);
        let heading = self.heading + self.heading_drift * self.heading_drift + place;
        let deviation = |variance: T| variance.at_most(T::from_f32(UNKNOWN)).sqrt();
        Quality {
            tilt_rad: deviation(tilt),
            heading_rad: deviation(heading),
            bias_rad_s: self.bias.sqrt(),
            bias,
            heading_is_observable: self.field_is_fresh()
                && steepness.is_some_and(|ratio| ratio.within(T::from_f32(STEEP))),
            field_age_s: self.field_age_s,
        }
    }
}

fn larger<T: Real>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// A step of variance and drift, stable for any product of gain and time.
fn step<T: Real>((variance, drift): (&mut T, &mut T), dt: T, walk: T, bias: T, gain: T) {
    let share = gain * dt;
    let left = (T::ONE + share + share).recip();
    let unknown = T::from_f32(UNKNOWN);
    let grown = *variance + (walk + T::from_f32(NOISE_S) * gain * gain) * dt;
    *variance = (grown * left).at_most(unknown);
    *drift = ((*drift + bias * dt) * (T::ONE + share).recip()).at_most(unknown);
}
