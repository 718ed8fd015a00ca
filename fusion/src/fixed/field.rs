//! The compass in counts: see [`crate::FieldConfig`].
//!
//! # The heading error
//! North and east of the field in the earth frame are scalar products with rows: Q15 counts. The
//! field should have no part to the east; with the reference's horizontal part `limit`, the sine of
//! the error is `-east / limit`. The core has no division, so the reciprocal is kept:
//!
//! ```text
//! inverse = 2^27 / limit            limit in Q4, from 32 counts up: inverse <= 2^18
//! sine = east inverse / 2^12        east in Q4, at most limit: product <= 2^27, the sine in Q15
//! ```
//!
//! It follows the reference by Newton's step `inverse += inverse (1 - limit inverse / 2^27)`, once
//! a judgement. `inverse` is cut by 3 bits and the error by 12 for that, so that both have 15. The
//! step converges from any value that is less than twice too large: the limit grows by halves at
//! most.
//!
//! # The judgement
//! About thirty times a second a field is kept in Q8 and compared with the reference: `|dh| + |dv|`
//! of the horizontal and the vertical part must be within `gate` times the reference's length. The
//! weight falls in four steps towards that limit. Lengths are those of [`length`], without a root:
//! exact enough for a gate. The gate is at most 64, so that its product in Q8 with a length in
//! whole counts fits.
//!
//! The reference is first taken from single fields, as tilt and heading are not found yet, then
//! averaged over 16, then followed by a power of two of the difference.

use super::counts::Scale;
use super::format::{Q4, Q8, Q15, nearest_log2, positive};
use super::memory::all;
use super::rotation::{Products, dot};
use crate::error::{ConfigError, in_range};
use crate::field::{FieldConfig, JUDGE_S, JUDGE_SAMPLES, MIN_HORIZONTAL_UT};

/// Fractional bits of the reference.
const BITS: u32 = 8;

/// Weight of a field that is like the reference: a power of two, for steps of a quarter and the
/// half.
const FULL: i32 = 8;

/// Judged fields of which each replaces the reference: tilt and heading are not found yet.
const FORGOTTEN: i32 = 24;

/// Judged fields that are averaged into the reference before the gate works.
const LEARNING: i32 = 16;

/// Tolerance until then, counts: more than any field deviates.
const ANYTHING: Q8 = 1 << 29;

/// Horizontal field with which the reciprocal begins, counts: that of middle latitudes for a
/// BNO055.
const FIRST: Q4 = 256 << 4;

/// `Compass::due` of a field that is to be compared; that of one to be decided on is one less.
const COMPARE: u32 = 2;

/// The magnetometer as a compass, and the reference that it is held to. First what every field
/// sample touches.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Compass {
    /// `2^27 / limit`.
    inverse: i32,
    /// The horizontal part of the reference that the reciprocal has come to, counts: the largest
    /// part across that has a sine.
    limit: Q4,
    /// Weight of the field, in parts of `FULL`.
    weight: i32,
    /// Samples between judgements.
    interval: u32,
    /// Sample number of the last field that was kept for a judgement.
    last: u32,
    /// Steps of the judgement that are to come: `COMPARE` and down to 0, none.
    due: u32,
    /// The field that is judged: north, east and down, counts.
    seen: [Q8; 3],
    /// The reference, horizontal and vertical, counts.
    reference: [Q8; 2],
    /// The same of the field that is judged.
    met: [Q8; 2],
    /// The same of a field unlike the reference, against which later ones are compared.
    candidate: [Q8; 2],
    /// Largest deviation from the reference, counts.
    tolerance: Q8,
    /// By how much the newest field was within the tolerance, counts; negative beyond it.
    margin: Q8,
    /// Gate as a fraction of the reference's length.
    gate: Q8,
    /// Horizontal field below which a compass has no direction, counts.
    min_horizontal: Q8,
    /// Field samples that the reference stands on, while it is learned.
    judged: i32,
    /// The share of the next field in the reference, as a negative power of two.
    share: u32,
    /// That share once the reference is learned.
    follow: u32,
    /// Sample number of the field judged before.
    before: u32,
    /// Samples for which another field has been there.
    rejected: u32,
    /// Those of them in which the body turned.
    turned: u32,
    /// Limit of `rejected`: then the heading follows the field at half the gain.
    max_rejected: u32,
    /// Limit of `turned`: then the other field becomes the reference.
    max_turned: u32,
    /// Sum of the rates' sizes beyond which the body turns, counts.
    adopt_rate: u32,
}

/// Limits in counts, times in samples.
pub(super) struct Limits {
    min_horizontal: Q8,
    gate: Q8,
    /// Base-2 logarithm of the judgements in the reference's time constant.
    log2_follow: u8,
    max_rejected: u32,
    max_turned: u32,
    adopt_rate: u32,
}

impl Compass {
    pub(super) fn new(limits: &Limits, period_s: f32) -> Self {
        Self {
            inverse: (1 << 27) / FIRST,
            limit: FIRST,
            weight: FULL,
            interval: u32::from(JUDGE_SAMPLES).max((JUDGE_S / period_s) as u32 + 1),
            last: 0,
            due: 0,
            seen: [0; 3],
            reference: [limits.min_horizontal, 0],
            met: [0; 2],
            candidate: [0; 2],
            tolerance: ANYTHING,
            margin: 0,
            gate: limits.gate,
            min_horizontal: limits.min_horizontal,
            judged: -FORGOTTEN,
            share: 0,
            follow: limits.log2_follow.into(),
            before: 0,
            rejected: 0,
            turned: 0,
            max_rejected: limits.max_rejected,
            max_turned: limits.max_turned,
            adopt_rate: limits.adopt_rate,
        }
    }

    /// See [`Estimator::memory`](super::Estimator::memory).
    #[inline(never)]
    pub(super) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        self.inverse = each(self.inverse);
        self.limit = each(self.limit);
        self.weight = each(self.weight);
        self.last = each(self.last as i32) as u32;
        self.due = each(self.due as i32) as u32;
        all(&mut self.seen, each);
        all(&mut self.reference, each);
        all(&mut self.met, each);
        all(&mut self.candidate, each);
        self.tolerance = each(self.tolerance);
        self.margin = each(self.margin);
        self.judged = each(self.judged);
        self.share = each(self.share as i32) as u32;
        self.before = each(self.before as i32) as u32;
        self.rejected = each(self.rejected as i32) as u32;
        self.turned = each(self.turned as i32) as u32;
    }

    /// The field that was judged last is not like the reference.
    pub(super) fn is_disturbed(&self) -> bool {
        self.margin < 0
    }

    /// The field that was judged last is like the reference, to its full weight.
    #[inline(always)]
    pub(super) fn is_like_reference(&self) -> bool {
        self.weight == FULL && self.margin >= 0
    }

    /// A judgement is under way.
    pub(super) fn is_due(&self) -> bool {
        self.due != 0
    }

    /// The reference, north and down in counts, once it is learned.
    #[inline(always)]
    pub(super) fn reference(&self) -> Option<[i32; 2]> {
        (self.judged == LEARNING).then(|| self.reference.map(|part| part >> BITS))
    }

    /// Sine of the heading error that a field in counts shows, times its weight.
    #[inline(always)]
    pub(super) fn heading(
        &mut self,
        p: &Products,
        down: &[Q15; 3],
        mag: &[i32; 3],
        tick: u32,
    ) -> Q15 {
        let (north, east) = (dot(&p.north(), mag), dot(&p.east(), mag));
        if tick.wrapping_sub(self.last) >= self.interval {
            self.last = tick;
            self.due = COMPARE;
            self.seen = [north, east, dot(down, mag)].map(|q15| q15 >> (15 - BITS));
        }
        let sign = east >> 31;
        let max = (self.limit ^ sign) - sign;
        let across = east >> 11;
        // Beyond a right angle all of it is across, and twice that: back sooner.
        let across = if north < 0 {
            2 * max
        } else if (across ^ sign) > (max ^ sign) {
            max
        } else {
            across
        };
        -((((across * self.inverse) >> 12) * self.weight) >> 3)
    }
}

impl Limits {
    #[inline(always)]
    pub(super) fn new(
        config: &FieldConfig,
        scale: &Scale,
        period_s: f32,
    ) -> Result<Self, ConfigError> {
        in_range(config.gate, 0.01, f32::INFINITY, "field.gate")?;
        in_range(config.tau_s, 0.1, 1e4, "field.tau_s")?;
        in_range(config.adopt_s, 0.1, 1e3, "field.adopt_s")?;
        in_range(config.reject_s, 0.1, 1e3, "field.reject_s")?;
        in_range(config.adopt_rate_rad_s, 0.0, 10.0, "field.adopt_rate_rad_s")?;
        let samples = |time_s: f32| (time_s / period_s) as u32;
        Ok(Self {
            // Below 32 counts the reciprocal would not fit.
            min_horizontal: ((MIN_HORIZONTAL_UT / scale.mag_ut) as i32).max(32) << BITS,
            gate: (config.gate.min(64.0) * 256.0) as i32,
            log2_follow: nearest_log2(config.tau_s / JUDGE_S).min(15),
            max_rejected: samples(config.reject_s),
            max_turned: samples(config.adopt_s),
            adopt_rate: (config.adopt_rate_rad_s / scale.gyr_rad_s) as u32,
        })
    }
}

impl Compass {
    /// Judge the field that was kept, in two steps: this is the next.
    #[inline(never)]
    pub(super) fn judge(&mut self, gyr: &[i16; 3]) {
        self.due -= 1;
        if self.due == COMPARE - 1 {
            self.compare();
        } else {
            self.decide(gyr);
        }
    }

    /// How far the field is from the reference, which follows it if it is near.
    fn compare(&mut self) {
        let [north, east, down] = self.seen;
        self.met = [length(north, east).max(self.min_horizontal), down];
        let (dh, dv) = (
            self.met[0] - self.reference[0],
            self.met[1] - self.reference[1],
        );
        self.margin = self.tolerance - dh.abs() - dv.abs();
        if self.margin >= 0 {
            let share = self.share & 31;
            self.reference[0] += dh >> share;
            self.reference[1] += dv >> share;
        }
        self.invert();
    }

    /// What the comparison makes of the weight, the tolerance and the candidate.
    fn decide(&mut self, gyr: &[i16; 3]) {
        let elapsed = self.last.wrapping_sub(self.before);
        self.before = self.last;
        if self.margin >= 0 {
            self.rejected = 0;
            self.turned = 0;
            if self.judged < LEARNING {
                self.judged += 1;
                self.share += u32::from((self.judged >> 1) >> (self.share & 31) > 0);
            } else {
                self.share = self.follow;
                // A part of the whole in parts of `FULL`, rounded up to quarters: a sign is -1.
                let quarter = self.tolerance >> 2;
                let sign = |value: i32| value >> 31;
                let quarters = 4
                    + sign(self.margin - quarter)
                    + sign(self.margin - 2 * quarter)
                    + sign(self.margin - 3 * quarter);
                self.weight = quarters * (FULL / 4);
                let [horizontal, vertical] = self.reference;
                self.tolerance = (length(horizontal, vertical) >> BITS) * self.gate;
            }
            return;
        }
        self.rejected = self.rejected.wrapping_add(elapsed);
        self.weight = if self.rejected > self.max_rejected {
            FULL / 2
        } else {
            0
        };
        // Does it stay the same while the body turns? By a tolerance of its own: that of a strong
        // reference would take any weak field for none at all. Its larger part stands for its
        // length, which would take longer.
        let ([h, v], [like_h, like_v]) = (self.met, self.candidate);
        let tolerance = (like_h.max(like_v.abs()) >> BITS) * self.gate;
        if (h - like_h).abs() + (v - like_v).abs() > tolerance {
            self.candidate = self.met;
            self.turned = 0;
        } else if size(gyr) > self.adopt_rate {
            self.turned = self.turned.wrapping_add(elapsed);
            if self.turned > self.max_turned {
                self.reference = self.candidate;
            }
        }
    }

    /// The reciprocal follows the reference by a Newton step.
    fn invert(&mut self) {
        self.limit = (self.reference[0] >> (BITS - 4)).min(self.limit + (self.limit >> 1));
        let error = (1 << 27) - self.limit * self.inverse;
        self.inverse += ((self.inverse >> 3) * (error >> 12)) >> 12;
    }
}

/// Sum of the sizes of the components: at least the length, at most 1.73 times that.
#[inline(never)]
pub(super) fn size(v: &[i16; 3]) -> u32 {
    v.iter().map(|c| u32::from(c.unsigned_abs())).sum()
}

/// Length of a vector within 3 %: the larger component, or 7/8 of it and half of the smaller.
// Without a branch: the core has no conditional move.
#[inline(never)]
fn length(a: i32, b: i32) -> i32 {
    let (a, b) = (a.abs(), b.abs());
    let more = positive(a - b);
    let (larger, smaller) = (b + more, a - more);
    larger + positive((smaller >> 1) - (larger >> 3))
}
