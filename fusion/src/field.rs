//! The magnetic field as a compass: when to trust it, and the heading error that it shows.
//!
//! The magnetometer corrects the heading only, so no disturbance reaches roll or pitch. The filter
//! compares the field's horizontal and vertical part, in the estimated earth frame, with a
//! reference. The reference is averaged at start-up and follows slowly.
//!
//! A field that differs is a disturbance, and the filter ignores it until one of two events. If the
//! field has stayed the same while the body turned, the place has changed, and the field becomes
//! the reference. If the disturbance has lasted long, the heading's drift would be worse than the
//! field's error, and the heading follows it.

use core::f32::consts::PI;

use crate::config::Config;
use crate::error::{ConfigError, in_range, positive, require};
use crate::estimator::FieldReference;
use crate::lag::{self, FieldLag};
use crate::quaternion::{HalfRows, Quaternion};
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{dot, within};

settings! {
    /// Handling of the magnetometer.
    pub struct FieldConfig {
        /// Largest horizontal or vertical deviation of an undisturbed field from the reference, as
        /// a fraction of the reference's magnitude. `f32::INFINITY` lets every field pass.
        gate: f32 = 0.2,
        /// Time constant with which the reference follows an undisturbed field, s.
        tau_s: f32 = 20.0,
        /// Time of turning for which a different field must stay the same to become the reference,
        /// s.
        adopt_s: f32 = 20.0,
        /// Slowest turning that counts for adopting, rad/s.
        adopt_rate_rad_s: f32 = 0.35,
        /// Longest time for which a disturbance is ignored, s. After it the heading follows at half
        /// the gain.
        reject_s: f32 = 60.0,
    }
}

/// Heading error: the angle from the estimated direction of the horizontal field to its reference,
/// positive from north to east.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingError<T> {
    /// Sine of the angle for a field as strong as the reference; +-1 beyond a right angle. Half of
    /// it when a disturbance has lasted too long to be ignored.
    pub sin: T,
    /// The field is like the reference.
    pub undisturbed: bool,
}

/// Horizontal and vertical part of the field, both taken with half rows (uT/2).
type Parts<T> = [T; 2];

/// The parts of a field with these components in the earth frame, at half size.
#[inline(always)]
fn parts<T: Real>(north: T, east: T, down: T) -> Parts<T> {
    [(north * north + east * east).sqrt(), down]
}

/// Declination other than zero.
#[derive(Clone, Copy, Debug)]
struct Declination<T> {
    rad: T,
    sin: T,
    cos: T,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Field<T> {
    gate: T,
    /// `1 / tau_s`.
    per_tau: T,
    adopt_s: T,
    adopt_rate: T,
    reject_s: T,
    declination: Option<Declination<T>>,
    lag: FieldLag<T>,
    reference: Option<Reference<T>>,
    /// Samples in the reference's average so far.
    averaged: u32,
    /// A field unlike the reference, and for how long it has stayed the same while the body turned,
    /// s.
    candidate: Option<(Reference<T>, T)>,
    /// Time for which the field has been disturbed, s.
    rejected_s: T,
    since_refresh_s: T,
    since_judged_s: T,
    /// Field samples since the last judgement.
    unjudged: u8,
    /// Weight of the field, from the last judgement.
    weight: T,
    /// The last judgement found the field unlike the reference.
    disturbed: bool,
    /// The weight over the reference's horizontal part.
    weighted_inverse: T,
}

#[derive(Clone, Copy, Debug)]
struct Reference<T> {
    parts: Parts<T>,
    /// One over the largest deviation.
    inverse_tolerance: T,
    /// One over the horizontal part.
    inverse_horizontal: T,
}

/// Interval at which the reference's reciprocals are renewed, s: each time costs a root and two
/// divisions.
const REFRESH_S: f32 = 0.25;

/// Interval at which the field is judged, s: 25 to 35 times a second are enough.
pub(crate) const JUDGE_S: f32 = 0.027;

/// Fewest field samples between two judgements. In fixed point, the samples of a judgement do not
/// correct the heading.
pub(crate) const JUDGE_SAMPLES: u8 = 8;

/// Horizontal field below which a compass has no direction, uT. A field in gauss, or in parts of
/// the earth's, is large enough too.
pub(crate) const MIN_HORIZONTAL_UT: f32 = 0.03;

/// Largest plausible field component, uT: a thousand times the earth's.
const MAX_UT: f32 = 50_000.0;

/// The weight of a field up to a deviation in parts of the gate, in steps, as fixed point has it
/// without a division.
const STEPS: [(f32, f32); 4] = [(0.25, 1.0), (0.5, 0.75), (0.75, 0.5), (1.0, 0.25)];

/// Judged samples averaged into the reference before the gate works.
const AVERAGED: u32 = 16;

impl<T: Real> Reference<T> {
    fn new(parts: Parts<T>, gate: T) -> Option<Self> {
        let [horizontal, vertical] = parts;
        if horizontal.within(T::from_f32(0.5 * MIN_HORIZONTAL_UT)) {
            return None;
        }
        let total = (horizontal * horizontal + vertical * vertical).sqrt();
        Some(Self {
            parts,
            inverse_tolerance: (gate * total).recip(),
            inverse_horizontal: horizontal.recip(),
        })
    }

    /// The weight of a field: 1 where it is like the reference, falling to 0 at the gate.
    fn weight(&self, parts: &Parts<T>) -> T {
        let ([own_h, own_v], [h, v]) = (self.parts, parts);
        let deviation = ((*h - own_h).abs() + (*v - own_v).abs()) * self.inverse_tolerance;
        STEPS
            .iter()
            .find(|(limit, _)| deviation.within(T::from_f32(*limit)))
            .map_or(T::ZERO, |(_, weight)| T::from_f32(*weight))
    }

    /// Linear interpolation from `self` towards `parts` by `share`.
    fn moved(&self, parts: &Parts<T>, share: T) -> Parts<T> {
        let ([own_h, own_v], [h, v]) = (self.parts, parts);
        [own_h + (*h - own_h) * share, own_v + (*v - own_v) * share]
    }
}

impl<T: Real> Field<T> {
    pub(crate) fn new<G>(shared: &Config<G>) -> Result<Self, ConfigError> {
        let (config, declination_rad) = (&shared.field, shared.declination_rad);
        require(config.gate > 0.0, "field.gate")?;
        positive(config.tau_s, "field.tau_s")?;
        positive(config.adopt_s, "field.adopt_s")?;
        let rate = config.adopt_rate_rad_s;
        in_range(rate, 0.0, 100.0, "field.adopt_rate_rad_s")?;
        positive(config.reject_s, "field.reject_s")?;
        in_range(declination_rad, -PI, PI, "declination_rad")?;
        Ok(Self {
            // Infinity times zero would be NaN. A gate a million times the field lets every field
            // pass.
            gate: T::from_f32(config.gate.min(1e6)),
            per_tau: T::from_f32(1.0 / config.tau_s),
            adopt_s: T::from_f32(config.adopt_s),
            adopt_rate: T::from_f32(config.adopt_rate_rad_s),
            reject_s: T::from_f32(config.reject_s),
            declination: (declination_rad != 0.0).then(|| {
                let rad = T::from_f32(declination_rad);
                // Sine and cosine of an angle, from sine and cosine of half of it, without a table.
                let half = Quaternion::from_rotation_vector(&[T::ZERO, T::ZERO, rad]);
                let (sin, cos) = (half.w * half.z, T::HALF - half.z * half.z);
                Declination { rad, sin: sin + sin, cos: cos + cos }
            }),
            lag: FieldLag::new(shared.mag_lag_s, shared.mag_lag_sd_s)?,
            weight: T::ONE,
            ..Self::default()
        })
    }

    /// For going back in time: reference and lag are known, and the lag is not learned.
    #[cfg(feature = "offline")]
    pub(crate) fn reversed(&self) -> Self {
        Self { lag: self.lag.reversed(), candidate: None, ..*self }
    }

    /// Whether a field has been seen that can serve as a compass.
    pub(crate) fn is_known(&self) -> bool {
        self.reference.is_some()
    }

    /// The reference once it is averaged, uT.
    pub(crate) fn reference(&self) -> Option<FieldReference<T>> {
        let [horizontal, vertical] = self.reference.as_ref()?.parts;
        (self.averaged == AVERAGED).then(|| FieldReference {
            horizontal: horizontal + horizontal,
            down: vertical + vertical,
        })
    }

    /// The reference is known from elsewhere, uT.
    pub(crate) fn know(&mut self, field: &FieldReference<T>) {
        let parts = [field.horizontal, field.down].map(|part| part * T::HALF);
        self.reference = Reference::new(parts, self.gate);
        self.averaged = AVERAGED;
        self.candidate = None;
        self.weigh();
    }

    /// The field's lag is known from elsewhere, s.
    pub(crate) fn set_lag_s(&mut self, lag_s: T) {
        self.lag.set_lag_s(lag_s);
    }

    /// The reference in the earth frame, uT.
    pub(crate) fn expected(&self) -> Option<[T; 3]> {
        let [horizontal, vertical] = self.reference.as_ref()?.parts;
        let horizontal = horizontal + horizontal;
        let (north, east) = match self.declination {
            None => (horizontal, T::ZERO),
            Some(Declination { sin, cos, .. }) => (horizontal * cos, horizontal * sin),
        };
        Some([north, east, vertical + vertical])
    }

    /// The field's whole over its horizontal part, squared.
    pub(crate) fn steepness(&self) -> Option<T> {
        let [horizontal, vertical] = self.reference.as_ref()?.parts;
        let ratio = vertical * horizontal.recip();
        Some(T::ONE + ratio * ratio)
    }

    /// Lag of the field behind the rates, s.
    pub(crate) fn lag_s(&self) -> T {
        self.lag.lag_s()
    }

    /// Declination in rad, `None` when it is zero.
    pub(crate) fn declination_rad(&self) -> Option<T> {
        self.declination.map(|declination| declination.rad)
    }

    /// The heading error that one field sample shows (uT, body frame). The earth's axes are at half
    /// length, `dt` is the time since the last field sample, and `rate` the rotation rate now
    /// (rad/s). `None`: disturbed, or not known yet. Only `trusted` rates teach the lag.
    #[inline(always)]
    pub(crate) fn heading(
        &mut self,
        dt: T,
        rows: &HalfRows<T>,
        mag: &[T; 3],
        rate: &[T; 3],
        trusted: bool,
    ) -> Option<HeadingError<T>> {
        let now = lag::now(mag, rate, self.lag.lag_s());
        let (north, east) = (dot(&rows.north, &now), dot(&rows.east, &now));
        self.since_judged_s += dt;
        self.unjudged = self.unjudged.saturating_add(1);
        if self.unjudged >= JUDGE_SAMPLES && !self.since_judged_s.within(T::from_f32(JUDGE_S)) {
            let parts = parts(north, east, dot(&rows.down, &now));
            self.judge(&parts, rate);
            self.weigh();
            if trusted {
                self.learn_lag(rows, mag, rate);
            }
            (self.since_judged_s, self.unjudged) = (T::ZERO, 0);
        }
        if self.weight.within(T::ZERO) {
            return None;
        }
        Some(HeadingError { sin: self.weighted_sine(north, east), undisturbed: !self.disturbed })
    }

    /// A field of full weight shows its lag.
    fn learn_lag(&mut self, rows: &HalfRows<T>, mag: &[T; 3], rate: &[T; 3]) {
        if let Some(reference) = &self.reference
            && self.averaged == AVERAGED
            && T::ONE.within(self.weight)
            && self.lag.is_due(self.since_judged_s)
        {
            let per_field = reference.inverse_tolerance * self.gate * T::HALF;
            self.lag.learn(rows, mag, rate, per_field);
        }
    }

    /// The first field, in the body frame and with the orientation found from it.
    #[cold]
    pub(crate) fn begin(&mut self, rows: &HalfRows<T>, mag: &[T; 3]) {
        let (north, east) = (dot(&rows.north, mag), dot(&rows.east, mag));
        let parts = parts(north, east, dot(&rows.down, mag));
        self.reference = Reference::new(parts, self.gate);
        self.averaged = 1;
        self.weigh();
    }

    /// The reference is wrong: the next field is the first one.
    pub(crate) fn forget(&mut self) {
        self.reference = None;
    }

    /// The factor from the field's transverse part to the weighted sine of the heading error.
    fn weigh(&mut self) {
        let reference = self.reference.as_ref();
        let inverse = reference.map_or(T::ZERO, |field| field.inverse_horizontal);
        self.weighted_inverse = inverse * self.weight;
    }

    #[inline(never)]
    fn judge(&mut self, parts: &Parts<T>, rate: &[T; 3]) {
        let Some(reference) = &mut self.reference else {
            return;
        };
        if self.averaged < AVERAGED {
            self.averaged += 1;
            let share = T::from_f32(self.averaged as f32).recip();
            let moved = reference.moved(parts, share);
            *reference = Reference::new(moved, self.gate).unwrap_or(*reference);
            return;
        }
        self.weight = reference.weight(parts);
        self.disturbed = self.weight.within(T::ZERO);
        if !self.disturbed {
            self.candidate = None;
            self.rejected_s = T::ZERO;
            let share = self.since_judged_s * self.per_tau;
            if share.within(T::ONE) {
                reference.parts = reference.moved(parts, share);
            }
            self.since_refresh_s += self.since_judged_s;
            if !self.since_refresh_s.within(T::from_f32(REFRESH_S)) {
                self.since_refresh_s = T::ZERO;
                *reference = Reference::new(reference.parts, self.gate).unwrap_or(*reference);
            }
            return;
        }
        self.rejected_s += self.since_judged_s;
        self.consider(parts, rate);
        let [horizontal, _] = parts;
        let compass = !horizontal.within(T::from_f32(0.5 * MIN_HORIZONTAL_UT));
        if compass && !self.rejected_s.within(self.reject_s) {
            self.weight = T::HALF;
        }
    }

    /// Whether a field unlike the reference stays the same while the body turns.
    #[cold]
    #[inline(never)]
    fn consider(&mut self, parts: &Parts<T>, rate: &[T; 3]) {
        match &mut self.candidate {
            Some((candidate, turned_s)) if candidate.weight(parts) > T::ZERO => {
                if !within(rate, self.adopt_rate) {
                    *turned_s += self.since_judged_s;
                }
                if !turned_s.within(self.adopt_s) {
                    self.reference = Some(*candidate);
                    self.candidate = None;
                    self.rejected_s = T::ZERO;
                }
            }
            _ => {
                self.candidate = Reference::new(*parts, self.gate).map(|field| (field, T::ZERO));
            }
        }
    }

    /// Sine of the angle from the field to its reference, times the weight; +-1 times the weight
    /// beyond a right angle.
    #[inline(always)]
    fn weighted_sine(&self, north: T, east: T) -> T {
        let (along, across) = match self.declination {
            None => (north, -east),
            Some(Declination { sin, cos, .. }) => {
                (cos * north + sin * east, sin * north - cos * east)
            }
        };
        let sin = across * self.weighted_inverse;
        if along.is_negative() {
            self.weight.negated(sin.is_negative())
        } else {
            sin.limited(self.weight)
        }
    }
}

/// Whether a magnetometer sample is usable: finite, not zero, and within the field of a magnet or a
/// motor.
pub(crate) fn plausible<T: Real>(mag: &[T; 3]) -> bool {
    within(mag, T::from_f32(MAX_UT)) && !within(mag, T::from_f32(MIN_HORIZONTAL_UT))
}
