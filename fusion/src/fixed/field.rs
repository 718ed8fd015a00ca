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
//! a judgement. For that, `inverse` is cut by 3 bits and the error by 12, so both have 15. The step
//! converges from any value less than twice too large: the limit grows by halves at most.
//!
//! # The judgement
//! Every eighth field, but at most 37 a second, is kept and compared with the reference, in Q8. The
//! deviations of the horizontal and the vertical part, `|dh| + |dv|`, must be within `gate` times
//! the reference's length. The weight falls in four steps towards that limit. [`length`] gives
//! lengths without a root, exact enough for a gate. The gate is at most 64, so that its product in
//! Q8 with a length in whole counts fits.
//!
//! At first single fields set the reference, because tilt and heading are not found yet. Then it
//! averages 16 fields, and after that it follows by a power of two of the difference.

use bytemuck::{Pod, Zeroable};

use super::counts::Scale;
use super::format::{Q4, Q8, Q15, are_within, nearest_log2, positive};
use super::rotation::{Products, dot};
use crate::error::{ConfigError, in_range};
use crate::field::{FieldConfig, JUDGE_S, JUDGE_SAMPLES, MIN_HORIZONTAL_UT};

/// Fractional bits of the reference.
const BITS: u32 = 8;

/// Weight of a field like the reference: a power of two, for steps of a quarter and the half.
const FULL: i32 = 8;

/// Judged fields that each replace the reference: tilt and heading are not found yet.
const FORGOTTEN: i32 = 24;

/// Judged fields that are averaged into the reference before the gate works.
const LEARNING: i32 = 16;

/// Tolerance until then, counts: above any deviation.
const ANYTHING: Q8 = 1 << 29;

/// Horizontal field for the first reciprocal, counts: middle latitudes for a BNO055.
const FIRST: Q4 = 256 << 4;

/// Least and largest horizontal field whose reciprocal fits, counts.
const LIMITS: (Q4, Q4) = (32 << 4, 1 << 21);

/// Least reciprocal from which Newton's steps find back.
const LEAST_INVERSE: i32 = 64;

/// Largest part of a field, counts: above 16 bits along three axes.
const MOST: Q8 = 1 << 24;

/// `CompassState::due` of a field to compare. One less is a field to decide on.
const COMPARE: u32 = 2;

/// The magnetometer as a compass: limits in counts, times in samples.
#[derive(Clone, Debug, PartialEq)]
#[repr(C)]
pub(super) struct Compass {
    /// Samples between judgements.
    interval: u32,
    /// Gate as a fraction of the reference's length.
    gate: Q8,
    /// Horizontal field below which a compass has no direction, counts.
    min_horizontal: Q8,
    /// Share of a field in a learned reference, as a negative power of two.
    follow: u32,
    /// Limit of `rejected`: then the heading follows the field at half the gain.
    max_rejected: u32,
    /// Limit of `turned`: then the other field becomes the reference.
    max_turned: u32,
    /// Sum of the rates' sizes beyond which the body turns, counts.
    adopt_rate: u32,
}

/// The reference of the compass, and the judgement under way. The fields that every field sample
/// touches come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct CompassState {
    /// `2^27 / limit`.
    inverse: i32,
    /// The horizontal part of the reference by the reciprocal, counts: the largest transverse part
    /// that has a sine.
    limit: Q4,
    /// Weight of the field, in parts of `FULL`.
    weight: i32,
    /// Sample number from which on the next field is judged.
    judge_at: u32,
    /// Sample number of the field that is judged.
    last: u32,
    /// Steps of the judgement still to come: `COMPARE` down to 0.
    due: u32,
    /// The field that is judged: north, east and down, Q15 counts.
    seen: [i32; 3],
    /// The reference, horizontal and vertical, counts.
    reference: [Q8; 2],
    /// The same of the field that is judged.
    met: [Q8; 2],
    /// North, east and down of a field unlike the reference, for comparison with later fields.
    candidate: [Q8; 2],
    /// Largest deviation from the reference, counts.
    tolerance: Q8,
    /// Margin of the newest field to the tolerance, counts; negative beyond it.
    margin: Q8,
    /// Field samples in the reference so far.
    judged: i32,
    /// The share of the next field in the reference, as a negative power of two.
    share: u32,
    /// Sample number of the field that was judged before.
    before: u32,
    /// Samples for which another field has been there.
    rejected: u32,
    /// Those of them in which the body turned.
    turned: u32,
}

impl CompassState {
    /// The field that was judged last is not like the reference.
    pub(super) fn is_disturbed(&self) -> bool {
        self.margin < 0
    }

    /// A judgement is under way.
    pub(super) fn is_due(&self) -> bool {
        self.due != 0
    }

    /// The reference, north and down in counts, once it is learned.
    #[inline(always)]
    pub(super) fn reference(&self) -> Option<[i32; 2]> {
        let [north, down] = self.reference;
        (self.judged == LEARNING).then_some([north >> BITS, down >> BITS])
    }

    /// The same while the field has its full weight.
    pub(super) fn trusted(&self) -> Option<[i32; 2]> {
        self.reference().filter(|_| self.weight == FULL)
    }

    /// The reciprocal follows the reference by a Newton step.
    fn invert(&mut self) {
        self.limit = (self.reference[0] >> (BITS - 4)).min(self.limit + (self.limit >> 1));
        let error = (1 << 27) - self.limit * self.inverse;
        self.inverse += ((self.inverse >> 3) * (error >> 12)) >> 12;
    }
}

impl Compass {
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
        let interval = u32::from(JUDGE_SAMPLES).max((JUDGE_S / period_s) as u32 + 1);
        Ok(Self {
            interval,
            gate: (config.gate.min(64.0) * 256.0) as i32,
            // Below 32 counts the reciprocal would not fit.
            min_horizontal: ((MIN_HORIZONTAL_UT / scale.mag_ut) as i32).max(32) << BITS,
            follow: nearest_log2(config.tau_s / (interval as f32 * period_s)).min(15).into(),
            max_rejected: samples(config.reject_s),
            max_turned: samples(config.adopt_s),
            adopt_rate: (config.adopt_rate_rad_s / scale.gyr_rad_s) as u32,
        })
    }

    pub(super) fn start(&self) -> CompassState {
        CompassState {
            inverse: (1 << 27) / FIRST,
            limit: FIRST,
            weight: FULL,
            judge_at: self.interval,
            reference: [self.min_horizontal, 0],
            met: [self.min_horizontal, 0],
            tolerance: ANYTHING,
            judged: -FORGOTTEN,
            ..CompassState::zeroed()
        }
    }

    /// Sine of the heading error that a field in counts shows, times its weight. The heading may be
    /// off by any angle if it is `unknown`.
    #[inline(always)]
    pub(super) fn heading(
        &self,
        state: &mut CompassState,
        p: &Products,
        down: &[Q15; 3],
        mag: &[i32; 3],
        (tick, unknown): (u32, bool),
    ) -> Q15 {
        let (north, east) = (dot(&p.north(), mag), dot(&p.east(), mag));
        if tick.wrapping_sub(state.judge_at) as i32 >= 0 {
            state.judge_at = tick.wrapping_add(self.interval);
            state.last = tick;
            state.seen = [north, east, dot(down, mag)];
            state.due = COMPARE;
        }
        let sign = east >> 31;
        let size = (east ^ sign) - sign;
        // Beyond a right angle the whole field counts as transverse, and twice while any heading is
        // possible: it is found sooner.
        let across = match north < 0 {
            true => state.limit << u32::from(unknown),
            false => (size >> 11).min(state.limit),
        };
        let sine = (((across * state.inverse) >> 12) * state.weight) >> 3;
        sign - (sine ^ sign)
    }

    /// Does the next of the two steps that judge the kept field.
    #[inline(never)]
    pub(super) fn judge(&self, state: &mut CompassState, gyr: &[i16; 3]) {
        state.due -= 1;
        if state.due == COMPARE - 1 {
            self.compare(state);
        } else {
            self.decide(state, gyr);
        }
    }

    /// Compares the field with the reference, which follows a field within the tolerance.
    fn compare(&self, state: &mut CompassState) {
        let [north, east, down] = state.seen.map(|q15| q15 >> (15 - BITS));
        state.met = [length(north, east).max(self.min_horizontal), down];
        let (dh, dv) = (state.met[0] - state.reference[0], state.met[1] - state.reference[1]);
        state.margin = state.tolerance - dh.abs() - dv.abs();
        if state.margin >= 0 {
            let share = state.share & 31;
            state.reference[0] += dh >> share;
            state.reference[1] += dv >> share;
        }
        state.invert();
    }

    /// Weight, tolerance and candidate after the comparison.
    fn decide(&self, state: &mut CompassState, gyr: &[i16; 3]) {
        let elapsed = state.last.wrapping_sub(state.before);
        state.before = state.last;
        if state.margin >= 0 {
            state.rejected = 0;
            state.turned = 0;
            if state.judged < LEARNING {
                state.judged += 1;
                state.share += u32::from((state.judged >> 1) >> (state.share & 31) > 0);
            } else {
                state.share = self.follow;
                // A part of the whole in parts of `FULL`, rounded up to quarters. A sign is -1.
                let quarter = state.tolerance >> 2;
                let sign = |value: i32| value >> 31;
                let quarters = 4
                    + sign(state.margin - quarter)
                    + sign(state.margin - 2 * quarter)
                    + sign(state.margin - 3 * quarter);
                state.weight = quarters * (FULL / 4);
                let [horizontal, vertical] = state.reference;
                state.tolerance = (length(horizontal, vertical) >> BITS) * self.gate;
            }
            return;
        }
        state.rejected = state.rejected.wrapping_add(elapsed);
        state.weight = if state.rejected > self.max_rejected { FULL / 2 } else { 0 };
        // Whether the field stays the same while the body turns. Its tolerance is its own: a strong
        // reference's would ignore any difference of weak fields. The larger part stands for the
        // length, to save time.
        let ([h, v], [like_h, like_v]) = (state.met, state.candidate);
        let tolerance = (like_h.max(like_v.abs()) >> BITS) * self.gate;
        if (h - like_h).abs() + (v - like_v).abs() > tolerance {
            state.candidate = state.met;
            state.turned = 0;
        } else if size(gyr) > self.adopt_rate {
            state.turned = state.turned.wrapping_add(elapsed);
            if state.turned > self.max_turned {
                state.reference = state.candidate;
            }
        }
    }

    /// Whether an update can have left these numbers.
    pub(super) fn is_sound(&self, state: &CompassState) -> bool {
        let (least, most) = LIMITS;
        let parts = [state.reference, state.met, state.candidate];
        (least..=most).contains(&state.limit)
            && state.inverse >= LEAST_INVERSE
            && state.inverse.checked_mul(state.limit).is_some_and(|one| one < 1 << 28)
            && (0..=FULL).contains(&state.weight)
            && state.due <= COMPARE
            && state.reference[0] >= self.min_horizontal
            && state.met[0] >= self.min_horizontal
            // No candidate, or a candidate for the reference.
            && (state.candidate == [0; 2] || state.candidate[0] >= self.min_horizontal)
            && are_within(parts.as_flattened(), MOST)
            && (0..=3 << 29).contains(&state.tolerance)
            && (-FORGOTTEN..=LEARNING).contains(&state.judged)
            && state.share <= 31
    }
}

/// Sum of the sizes of the components: 1 to 1.73 times the length.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A power of two is within a factor of the root of two.
    #[test]
    fn the_reference_follows_at_the_configured_pace() {
        for period_us in [500_u16, 1_000, 3_500, 6_667, 10_000] {
            let (config, period_s) = (FieldConfig::default(), f32::from(period_us) * 1e-6);
            let compass = Compass::new(&config, &Scale::BNO055, period_s).expect("in range");
            let judgement_s = compass.interval as f32 * period_s;
            let ratio = (1u32 << compass.follow) as f32 * judgement_s / config.tau_s;
            assert!((0.7..1.42).contains(&ratio), "{ratio} times tau_s at {period_us} us");
        }
    }
}
