//! The compass in counts: see [`crate::FieldConfig`].

use super::estimator::Scale;
use super::nearest_log2;
use super::rotation::{Products, dot};
use crate::config::{ConfigError, in_range};
use crate::field::{FieldConfig, JUDGE_S, JUDGE_SAMPLES, LEAST_HORIZONTAL_UT};

/// Fractional bits of the reference.
const BITS: u32 = 8;

/// The weight of a field that is like the reference.
const FULL: i32 = 8;

/// Field samples from which the reference is learned before the gate works.
const LEARNING: u32 = 40;

/// Tolerance until then, counts in Q8: more than any field deviates.
const ANYTHING: i32 = 1 << 29;

/// Two to this many field samples are the reference, then as many have half of it each, and so on: a running mean
/// that forgets those from before tilt and heading were found.
const SHARE_FALLS: u32 = 3;

/// What a field that was seen is due for: to be compared, to be concluded from, then another part of a division.
const COMPARE: u32 = 3;
const CONCLUDE: u32 = 2;

/// Bits of the quotient that each of the division's four parts gives.
const PART_BITS: u32 = 5;
const BEGUN: i32 = 1 << PART_BITS;
const DONE: i32 = 1 << (4 * PART_BITS);

/// What is left before the first part: less than any divisor, and two to that is 2^31.
const DIVIDEND: i32 = 1 << (31 - 4 * PART_BITS);

/// The magnetometer as a compass, and the reference that it is held to. First what is touched with every field
/// sample.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Compass {
    /// `2^23 / horizontal` with the horizontal in counts.
    inverse: i32,
    /// The horizontal that it is for, counts in Q4: the largest part across that has a sine.
    limit: i32,
    /// How far the field is to be believed, in parts of `FULL`.
    weight: i32,
    /// Samples between judgements, and when the last was.
    interval: u32,
    last: u32,
    /// What the field that was seen is due for: `COMPARE` and down to 0, nothing.
    due: u32,
    /// What is to be judged: north, east and down, counts in Q8.
    seen: [i32; 3],
    /// The reference, horizontal and vertical; what was seen last, and another field that has been there for a while:
    /// counts in Q8.
    reference: [i32; 2],
    met: [i32; 2],
    candidate: [i32; 2],
    /// Largest deviation from the reference, and by how much the newest was within: counts in Q8.
    tolerance: i32,
    margin: i32,
    /// Gate as a fraction, Q8.
    gate: i32,
    /// Horizontal field below which a compass has no direction, counts in Q8.
    least: i32,
    /// Field samples judged so far, up to those after which the share falls no more.
    judged: u32,
    most_judged: u32,
    /// When the sample before was seen.
    before: u32,
    /// Samples while another field was there: all, and those while turning; and the limits of both.
    rejected: u32,
    turned: u32,
    reject: u32,
    adopt: u32,
    /// Sum of the rates beyond which the body turns, counts.
    adopt_rate: u32,
    /// Of the division under way: by what, a one and the bits of the quotient so far, what is left, and what the
    /// quotient does not reach in this part.
    divisor: i32,
    quotient: i32,
    remainder: i32,
    whole: i32,
}

/// Limits in counts, times in samples.
pub(super) struct Limits {
    least: i32,
    gate_q8: i32,
    log2_follow: u8,
    reject: u32,
    adopt: u32,
    adopt_rate: u32,
}

impl Compass {
    pub(super) fn new(limits: &Limits, period_s: f32) -> Self {
        Self {
            inverse: i32::MAX / limits.least,
            limit: limits.least >> (BITS - 4),
            weight: FULL,
            interval: u32::from(JUDGE_SAMPLES).max((JUDGE_S / period_s) as u32 + 1),
            last: 0,
            due: 0,
            seen: [0; 3],
            reference: [limits.least, 0],
            met: [0; 2],
            candidate: [0; 2],
            tolerance: ANYTHING,
            margin: 0,
            gate: limits.gate_q8,
            least: limits.least,
            judged: 0,
            most_judged: u32::from(limits.log2_follow) << SHARE_FALLS,
            before: 0,
            rejected: 0,
            turned: 0,
            reject: limits.reject,
            adopt: limits.adopt,
            adopt_rate: limits.adopt_rate,
            divisor: limits.least,
            quotient: 1,
            remainder: DIVIDEND,
            whole: BEGUN,
        }
    }

    /// The field that was seen last is not like the reference.
    pub(super) fn is_disturbed(&self) -> bool {
        self.margin < 0
    }

    /// There is a field to be judged.
    pub(super) fn is_due(&self) -> bool {
        self.due != 0
    }

    /// The reference, north and down in counts, once it is one.
    #[inline(always)]
    pub(super) fn reference(&self) -> Option<[i32; 2]> {
        (self.judged > LEARNING).then(|| self.reference.map(|part| part >> BITS))
    }

    /// Sine of the heading error, Q15, of a field in counts, as far as it is to be believed.
    #[inline(always)]
    pub(super) fn heading(
        &mut self,
        p: &Products,
        down: &[i32; 3],
        mag: &[i16; 3],
        tick: u32,
    ) -> i32 {
        let mag = &mag.map(i32::from);
        let (north, east) = (dot(&p.north(), mag), dot(&p.east(), mag));
        if tick.wrapping_sub(self.last) >= self.interval {
            self.last = tick;
            self.due = COMPARE;
            self.seen = [north, east, dot(down, mag)].map(|q15| q15 >> (15 - BITS));
        }
        // Beyond a right angle all of it is across.
        let across = if north < 0 {
            i32::MAX ^ (east >> 31)
        } else {
            east >> 11
        };
        // Not `clamp`, which would panic were the limit negative.
        let across = across.min(self.limit).max(-self.limit);
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
            // Below 32 counts a reciprocal would not fit.
            least: ((LEAST_HORIZONTAL_UT / scale.mag_ut) as i32).max(32) << BITS,
            gate_q8: (config.gate.min(64.0) * 256.0) as i32,
            log2_follow: nearest_log2(config.tau_s / JUDGE_S).min(15),
            reject: samples(config.reject_s),
            adopt: samples(config.adopt_s),
            adopt_rate: (config.adopt_rate_rad_s / scale.gyr_rad_s) as u32,
        })
    }
}

impl Compass {
    /// Judge the field that was seen, one job with each sample until all is done.
    #[inline(never)]
    pub(super) fn judge(&mut self, gyr: &[i16; 3]) {
        match self.due {
            COMPARE => self.compare(),
            CONCLUDE => self.conclude(gyr),
            _ => self.divide(),
        }
        self.due -= 1;
    }

    fn compare(&mut self) {
        let [north, east, down] = self.seen;
        self.met = [length(north, east).max(self.least), down];
        let (dh, dv) = (
            self.met[0] - self.reference[0],
            self.met[1] - self.reference[1],
        );
        self.margin = self.tolerance - dh.abs() - dv.abs();
        if self.margin >= 0 {
            let share = (self.judged >> SHARE_FALLS) & 31;
            self.reference[0] += dh >> share;
            self.reference[1] += dv >> share;
        }
    }

    fn conclude(&mut self, gyr: &[i16; 3]) {
        let elapsed = self.last.wrapping_sub(self.before);
        self.before = self.last;
        if self.margin >= 0 {
            self.rejected = 0;
            self.turned = 0;
            if self.judged < self.most_judged {
                self.judged += 1;
            }
            if self.judged > LEARNING {
                // A part of the whole in parts of `FULL`, rounded up to quarters: a sign is -1.
                let quarter = self.tolerance >> 2;
                let sign = |value: i32| value >> 31;
                let quarters = 4
                    + sign(self.margin - quarter)
                    + sign(self.margin - 2 * quarter)
                    + sign(self.margin - 3 * quarter);
                self.weight = quarters * (FULL / 4);
                let [horizontal, vertical] = self.reference;
                self.tolerance = (length(horizontal, vertical) >> 8) * self.gate;
            }
            return;
        }
        self.rejected = self.rejected.wrapping_add(elapsed);
        self.weight = if self.rejected > self.reject {
            FULL / 2
        } else {
            0
        };
        // Does it stay the same while the body turns?
        let ([h, v], [like_h, like_v]) = (self.met, self.candidate);
        if (h - like_h).abs() + (v - like_v).abs() > self.tolerance {
            self.candidate = self.met;
            self.turned = 0;
        } else if size(gyr) > self.adopt_rate {
            self.turned = self.turned.wrapping_add(elapsed);
            if self.turned > self.adopt {
                self.reference = self.candidate;
            }
        }
    }

    /// A quarter of what `2^31 / horizontal` takes: a bit of the quotient is a shift, a subtraction, and an addition
    /// where that was too much.
    fn divide(&mut self) {
        let (divisor, whole) = (self.divisor, self.whole);
        let (mut quotient, mut remainder) = (self.quotient, self.remainder);
        while quotient < whole {
            let left = 2 * remainder - divisor;
            let too_much = left >> 31;
            remainder = left + (divisor & too_much);
            quotient = 2 * quotient + 1 + too_much;
        }
        (self.quotient, self.remainder, self.whole) = (quotient, remainder, whole << PART_BITS);
        if whole == DONE {
            self.inverse = quotient - whole;
            self.limit = divisor >> (BITS - 4);
            self.divisor = self.reference[0];
            (self.quotient, self.remainder, self.whole) = (1, DIVIDEND, BEGUN);
        }
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
    let positive = |value: i32| value & !(value >> 31);
    let more = positive(a - b);
    let (most, least) = (b + more, a - more);
    most + positive((least >> 1) - (most >> 3))
}
