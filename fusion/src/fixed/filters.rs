//! The corrections: [`Mahony`], [`Madgwick`], [`Complementary`] and [`Vqf`].
//!
//! # The error
//! Let `n`, `e`, `d` be the rows of the rotation matrix (Q15) and `a` the specific force (counts),
//! `-g d` at rest. The tilt error times `g` is `d x a` in the body frame, and `(-e a, n a)` about
//! north and east in the earth frame. Both errors are Q15 counts, at most
//! `2^15 * 2^15 sqrt(3) < 2^31`.
//!
//! # The gain
//! [`Gain`] takes such an error to half an angle in Q31. It is cut by 11 bits first, so that a
//! factor of 11 to 12 bits has room; for a gain of `k` per sample,
//!
//! ```text
//! factor / 2^shift = k 2^30 / (2^15 per_g / 2^11) = k 2^26 / per_g
//! ```
//!
//! # Mahony
//! `c = k d x a / (2 g)`: three products.
//!
//! # Complementary
//! The same with the direction `u` of `a`, which has 2^14 counts for `per_g` ([`direction`]).
//!
//! # Madgwick
//! The error is the whole attitude's: with the sine `h` of the heading error its length is
//! `m = |(d x u, h)|`, because the two parts are at right angles. The step has the direction of the
//! error and a length of its own, `c = beta dt (d x u, h) / m`, at most the error's. For `m` the
//! parts are Q15, and its square is below `2^31`. During a running mean, the longer of this step
//! and the mean's counts.
//!
//! # VQF
//! The error is smoothed in the earth frame, where gravity stands still: `z' = (error - z) / T`,
//! `c = k z`. The corrections of a slow filter are smaller than the last bits, so remainders are
//! kept:
//!
//! - `z` is Q8 (25 bits with sign). The difference is cut to Q1, rounded, and multiplied by the
//!   share `period / T` in Q16, at most `2^13`. Of the product in Q17, 9 bits are kept for the next
//!   sample, and the others are added to `z`.
//! - The correction about north and east is added up in Q31. Rows in Q15 take its upper bits, Q18,
//!   into the body frame: Q33, cut by two bits. The lower 13 bits are kept for the next step.
//! - A running mean is smooth enough: meanwhile the error is not smoothed, and `z` stays 0.

use bytemuck::{Pod, Zeroable};

use super::format::{Q8, Q15, Q16, Q31, are_within, inverse_root, normalised};
use super::rotation::{Products, cross, dot};
use super::start_up::Gains;
use crate::complementary::ComplementaryGains;
use crate::error::{ConfigError, in_range, positive};
use crate::madgwick::MadgwickGains;
use crate::mahony::MahonyGains;
use crate::vqf::VqfGains;

/// Length of a [`direction`], counts.
const UNIT: f32 = 16_384.0;

/// Least specific force that shows a vertical, as a fraction of gravity: less is free fall.
const MIN_ACC: f32 = 0.05;

/// Largest correction of the heading, half an angle: an eighth of a radian in Q16.
pub(super) const EIGHTH: i32 = 1 << 13;

/// Largest correction of the heading whose product with a row in Q15 fits, Q(16 + `heading_shift`).
pub(super) const MAX_HEADING_TURN: i32 = 7 << 13;

/// A gain: for the tilt from an error in Q15 counts to half an angle in Q31, for the heading from a
/// sine in Q15 to half an angle in Q16.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Gain {
    /// Factor of the tilt error, cut by 11 bits; for the heading below `2^13`, Q(15 + `shift`).
    pub(super) factor: i32,
    /// Right shift of the product.
    pub(super) shift: u32,
}

impl Gain {
    #[inline(always)]
    fn of(self, error: i32) -> Q31 {
        self.of_cut(error >> 11)
    }

    /// Of an error that is cut by 11 bits.
    #[inline(always)]
    fn of_cut(self, error: i32) -> Q31 {
        (error * self.factor) >> (self.shift & 31)
    }
}

/// A filter in fixed point: [`Vqf`], [`Mahony`], [`Madgwick`], [`Complementary`], or
/// [`AnyFilter`](super::AnyFilter). It makes a correction from accelerometer and magnetometer.
pub trait Filter: sealed::Sealed + Sized {
    /// Its gains, equal to the float filter's.
    type Gains: Copy;

    /// The coefficients for a sampling period and an accelerometer with `per_g` counts at standard
    /// gravity. An error names a gain that is out of range or does not exist in fixed point.
    #[doc(hidden)]
    fn new(gains: &Self::Gains, period_s: f32, per_g: f32) -> Made<Self>;

    /// The correction of a step.
    #[doc(hidden)]
    fn correction(&self, state: &mut FilterState, view: &View<'_>) -> Correction;
}

pub(super) mod sealed {
    pub trait Sealed {}
}

/// A filter and its pace, or an error.
pub(super) type Made<F> = Result<(F, Pace), ConfigError>;

/// How fast a filter follows.
pub struct Pace {
    /// Rates of tilt and heading, 1/s: a running mean ends when it is as slow.
    pub(super) per_s: (f32, f32),
    /// Counts of a tilt error of a right angle, for the tilt gain.
    pub(super) counts: f32,
}

/// A filter's memory: the same words for all filters, though only the VQF class needs any.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct FilterState {
    /// Smoothed horizontal acceleration, north and east, counts.
    smooth: [Q8; 2],
    /// Remainder of the smoothing, Q17 counts, below a bit of `smooth`.
    remainder: [i32; 2],
    /// Half angle about north and east still to be applied.
    carry: [Q31; 2],
}

/// Largest smoothed acceleration, counts: 16 bits along three axes, with a norm that is off by a
/// hundredth.
const MOST_SMOOTH: Q8 = 14_700_000;

/// Bits of `remainder` and of `carry`.
const REMAINDER: i32 = 0x1ff;
const CARRY: i32 = 0x1fff;

impl FilterState {
    /// Half the correction of the tilt in a sample, about north and east.
    pub(super) fn half_correction(&self, gain: Gain) -> [Q31; 2] {
        let [north, east] = self.smooth;
        [gain.of_cut(-east >> 4), gain.of_cut(north >> 4)]
    }

    /// Whether an update can have left these numbers.
    pub(super) fn is_sound(&self) -> bool {
        are_within(&self.smooth, MOST_SMOOTH)
            && self.remainder.iter().all(|left| left & !REMAINDER == 0)
            && self.carry.iter().all(|left| left & !CARRY == 0)
    }
}

/// The correction of a step.
pub struct Correction {
    /// Tilt: half a rotation vector in the body frame, rad.
    pub(super) tilt: [Q31; 3],
    /// Heading: half an angle about down, Q(16 + `heading_shift`) rad.
    pub(super) heading: i32,
}

/// The heading error of a field.
#[derive(Clone, Copy)]
pub(super) struct Heading {
    /// Sine of the error, times the field's weight.
    pub(super) sine: Q15,
    /// Samples since the last field, for which the field stands.
    pub(super) samples: i32,
}

/// The estimate and the sensors, as a filter sees them.
pub struct View<'a> {
    /// The orientation after the step.
    pub(super) products: &'a Products,
    /// Down in the body frame.
    pub(super) down: &'a [Q15; 3],
    /// Specific force, counts.
    pub(super) acc: &'a [i32; 3],
    /// The heading error, where a field shows one.
    pub(super) heading: Option<Heading>,
    /// The gains of the step.
    pub(super) gains: &'a Gains,
}

impl View<'_> {
    /// `d x a`.
    #[inline(always)]
    fn error(&self, a: &[i32; 3]) -> [i32; 3] {
        cross(self.down, a)
    }

    /// The correction in proportion to the errors of tilt and heading.
    #[inline(always)]
    fn proportional(&self, error: [i32; 3]) -> Correction {
        Correction {
            tilt: error.map(|error| self.gains.tilt.of(error)),
            heading: self.proportional_heading(),
        }
    }

    #[inline(always)]
    fn proportional_heading(&self) -> i32 {
        let Some(Heading { sine, samples }) = self.heading else {
            return 0;
        };
        self.limited(((sine * self.gains.heading.factor) >> 15) * samples)
    }

    /// A correction of the heading, limited.
    #[inline(always)]
    fn limited(&self, heading: i32) -> i32 {
        let max = self.gains.most_turn;
        // Not `clamp`, which would panic were the limit negative.
        heading.min(max).max(-max)
    }
}

/// The direction of a specific force, as a vector of 2^14 counts; `None` if its square is below
/// `least`.
///
/// With `y / 2^(30 - h)` for one over its length, `a y <= 2^15 2^15`.
#[inline(always)]
fn direction(acc: &[i32; 3], least: u32) -> Option<[i32; 3]> {
    let square = (acc[0] * acc[0]) as u32 + (acc[1] * acc[1]) as u32 + (acc[2] * acc[2]) as u32;
    if square < least {
        return None;
    }
    let (y, h) = inverse_root(square);
    let shift = 16 - h;
    let part = |acc: i32| (acc * y + (1 << (shift - 1))) >> shift;
    Some([part(acc[0]), part(acc[1]), part(acc[2])])
}

/// The square of the least specific force that shows a vertical, counts.
fn least(per_g: f32) -> u32 {
    let least = MIN_ACC * per_g;
    ((least * least) as u32).max(1)
}

/// Mahony's filter: see [`crate::Mahony`].
#[derive(Clone, Debug, PartialEq)]
pub struct Mahony;

impl Filter for Mahony {
    type Gains = MahonyGains;

    fn new(gains: &MahonyGains, _: f32, counts: f32) -> Made<Self> {
        in_range(gains.integral_per_s2, 0.0, 0.0, "integral_per_s2")?;
        let per_s = (gains.acc_per_s, gains.mag_per_s);
        Ok((Self, Pace { per_s, counts }))
    }

    #[inline(always)]
    fn correction(&self, _: &mut FilterState, view: &View<'_>) -> Correction {
        view.proportional(view.error(view.acc))
    }
}

/// The complementary filter: see [`crate::Complementary`].
#[derive(Clone, Debug, PartialEq)]
pub struct Complementary {
    /// Square of the least specific force that is used, counts.
    least: u32,
}

impl Filter for Complementary {
    type Gains = ComplementaryGains;

    fn new(gains: &ComplementaryGains, period_s: f32, per_g: f32) -> Made<Self> {
        in_range(gains.acc_tau_s, 0.0, 1e4, "acc_tau_s")?;
        in_range(gains.mag_tau_s, 0.0, 1e4, "mag_tau_s")?;
        let rate = |tau_s: f32| 1.0 / (tau_s + period_s);
        let per_s = (rate(gains.acc_tau_s), rate(gains.mag_tau_s));
        let (least, counts) = (least(per_g), UNIT);
        Ok((Self { least }, Pace { per_s, counts }))
    }

    #[inline(always)]
    fn correction(&self, _: &mut FilterState, view: &View<'_>) -> Correction {
        let up = direction(view.acc, self.least);
        view.proportional(up.map_or([0; 3], |up| view.error(&up)))
    }
}

/// Madgwick's filter: see [`crate::Madgwick`]. A field of a slow magnetometer turns the heading for
/// all samples since the last field.
#[derive(Clone, Debug, PartialEq)]
pub struct Madgwick {
    /// Length of a step, half an angle, Q(16 + `shift`) rad.
    factor: i32,
    /// Right shift of the product with `factor`.
    shift: u32,
    /// The same, rad.
    step: Q31,
    /// Square of the error that one step corrects, Q30.
    reached: u32,
    /// Square of the least specific force that is used, counts.
    least: u32,
}

/// Largest half angle of a step, rad.
const MAX_STEP: f32 = 0.125;

/// Rate, 1/s, of a running mean that is as slow as the slowest filter.
const SETTLED_PER_S: f32 = 0.1;

impl Filter for Madgwick {
    type Gains = MadgwickGains;

    fn new(gains: &MadgwickGains, period_s: f32, per_g: f32) -> Made<Self> {
        let step = gains.beta_per_s * period_s;
        in_range(step, 1e-6, MAX_STEP, "beta_per_s")?;
        let (factor, shift) = normalised(step * 65_536.0, 32_768.0);
        // Twice the half angle.
        let reached = step * 65_536.0;
        let filter = Self {
            factor,
            shift,
            step: (step * 2_147_483_648.0) as i32,
            reached: (reached * reached) as u32,
            least: least(per_g),
        };
        let (per_s, counts) = ((SETTLED_PER_S, SETTLED_PER_S), UNIT);
        Ok((filter, Pace { per_s, counts }))
    }

    #[inline(always)]
    fn correction(&self, _: &mut FilterState, view: &View<'_>) -> Correction {
        // Q29.
        let up = direction(view.acc, self.least);
        let error = up.map_or([0; 3], |up| view.error(&up));
        let heading = view.heading;
        let (sine, samples) = heading.map_or((0, 0), |seen| (seen.sine, seen.samples));
        // Beyond a right angle twice the sine; the length of the step stays.
        let sine = sine.clamp(-(1 << 15), 1 << 15);
        let parts = error.map(|error| (error + (1 << 13)) >> 14);
        let [x, y, z] = parts;
        let square = (x * x + y * y + z * z) as u32 + (sine * sine) as u32;
        let heading_shift = view.gains.heading.shift & 15;
        if square <= self.reached {
            // Half the angle, of Q29 in Q31 and of Q15 in Q16.
            return Correction {
                tilt: error.map(|error| error << 1),
                heading: view.limited(sine << heading_shift),
            };
        }
        let (y, h) = inverse_root(square);
        if !view.gains.is_settled() {
            // The length is its square over it, Q15; a factor of 2^31 has room.
            let length = (((square << (2 * h)) >> 16) as i32 * y) >> (14 + h);
            if view.gains.tilt.of(length << 14) > self.step {
                return view.proportional(error);
            }
        }
        // The part over the length, Q15, times the step.
        let step = |part: i32| (((part * y) >> (15 - h)) * self.factor) >> self.shift;
        Correction {
            tilt: parts.map(step),
            heading: view.limited((step(sine) >> (15 - heading_shift)) * samples),
        }
    }
}

/// The VQF-class filter: see [`crate::Vqf`].
#[derive(Clone, Debug, PartialEq)]
pub struct Vqf {
    /// Share of a sample in the smoothing.
    share: Q16,
}

impl Filter for Vqf {
    type Gains = VqfGains;

    #[inline(always)]
    fn new(gains: &VqfGains, period_s: f32, counts: f32) -> Made<Self> {
        positive(gains.acc_tau_s, "acc_tau_s")?;
        let least_s = 8.0 * period_s;
        in_range(gains.acc_smoothing_s, least_s, 100.0, "acc_smoothing_s")?;
        positive(gains.mag_tau_s, "mag_tau_s")?;
        let share = (65_536.0 * period_s / gains.acc_smoothing_s + 0.5) as i32;
        let per_s = (1.0 / gains.acc_tau_s, 1.0 / gains.mag_tau_s);
        Ok((Self { share }, Pace { per_s, counts }))
    }

    #[inline(always)]
    fn correction(&self, state: &mut FilterState, view: &View<'_>) -> Correction {
        let (north, east) = (view.products.north(), view.products.east());
        let seen = [dot(&north, view.acc) >> 7, dot(&east, view.acc) >> 7];
        let sums = state.smooth.iter_mut().zip(&mut state.remainder);
        for ((smooth, remainder), seen) in sums.zip(seen) {
            let sum = ((seen - *smooth + 64) >> 7) * self.share + *remainder;
            *smooth += sum >> 9;
            *remainder = sum & REMAINDER;
        }
        let [n, e] = if view.gains.is_settled() {
            state.smooth
        } else {
            state.smooth = [0; 2];
            seen
        };
        for (carry, tilt) in state.carry.iter_mut().zip([-e, n]) {
            *carry += view.gains.tilt.of_cut(tilt >> 4);
        }
        let [about_north, about_east] = state.carry.map(|carry| carry >> 13);
        state.carry = state.carry.map(|carry| carry & CARRY);
        let body = |n: i32, e: i32| (about_north * n + about_east * e) >> 2;
        Correction {
            tilt: [body(north[0], east[0]), body(north[1], east[1]), body(north[2], east[2])],
            heading: view.proportional_heading(),
        }
    }
}
