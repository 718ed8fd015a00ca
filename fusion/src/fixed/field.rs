//! The compass in counts: see [`crate::FieldConfig`].

use super::estimator::Scale;
use super::nearest_log2;
use super::rotation::{Products, dot};
use crate::error::{ConfigError, in_range};
use crate::field::{FieldConfig, JUDGE_S, JUDGE_SAMPLES, LEAST_HORIZONTAL_UT};

/// Fractional bits of the reference.
const BITS: u32 = 8;

/// The weight of a field that is like the reference.
const FULL: i32 = 8;

/// Field samples that the reference is, each by itself: those from before tilt and heading were found.
const FORGOTTEN: i32 = 24;

/// Field samples from which the reference is learned, a running mean, before the gate works.
const LEARNING: i32 = 16;

/// Tolerance until then, counts in Q8: more than any field deviates.
const ANYTHING: i32 = 1 << 29;

/// Horizontal field with which the reciprocal begins, counts in Q4: that of middle latitudes for a BNO055.
const FIRST: i32 = 256 << 4;

/// What a field that was seen is due for: to be compared, then to be concluded from.
const COMPARE: u32 = 2;

/// The magnetometer as a compass, and the reference that it is held to. First what is touched with every field
/// sample.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Compass {
    /// `2^27 / limit`.
    inverse: i32,
    /// The horizontal part of the reference that the reciprocal has come to, counts in Q4: the largest part across
    /// that has a sine.
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
    /// Field samples that the reference stands on, as long as it is learned; the share of the next, as a negative
    /// power of two, and the last.
    judged: i32,
    share: u32,
    follow: u32,
    /// When the sample before was seen.
    before: u32,
    /// Samples while another field was there: all, and those while turning; and the limits of both.
    rejected: u32,
    turned: u32,
    reject: u32,
    adopt: u32,
    /// Sum of the rates beyond which the body turns, counts.
    adopt_rate: u32,
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
            inverse: (1 << 27) / FIRST,
            limit: FIRST,
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
            judged: -FORGOTTEN,
            share: 0,
            follow: limits.log2_follow.into(),
            before: 0,
            rejected: 0,
            turned: 0,
            reject: limits.reject,
            adopt: limits.adopt,
            adopt_rate: limits.adopt_rate,
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
        (self.judged == LEARNING).then(|| self.reference.map(|part| part >> BITS))
    }

    /// Sine of the heading error, Q15, of a field in counts, as far as it is to be believed.
    #[inline(always)]
    pub(super) fn heading(
        &mut self,
        p: &Products,
        down: &[i32; 3],
        mag: &[i32; 3],
        tick: u32,
    ) -> i32 {
        let (north, east) = (dot(&p.north(), mag), dot(&p.east(), mag));
        if tick.wrapping_sub(self.last) >= self.interval {
            self.last = tick;
            self.due = COMPARE;
            self.seen = [north, east, dot(down, mag)].map(|q15| q15 >> (15 - BITS));
        }
        let sign = east >> 31;
        let most = (self.limit ^ sign) - sign;
        let across = east >> 11;
        // Beyond a right angle all of it is across, and twice that: back sooner.
        let across = if north < 0 {
            2 * most
        } else if (across ^ sign) > (most ^ sign) {
            most
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
        self.due -= 1;
        if self.due == COMPARE - 1 {
            self.compare();
        } else {
            self.conclude(gyr);
        }
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
            let share = self.share & 31;
            self.reference[0] += dh >> share;
            self.reference[1] += dv >> share;
        }
        self.invert();
    }

    fn conclude(&mut self, gyr: &[i16; 3]) {
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

    /// The reciprocal follows the reference: a Newton step. It converges from any that is less than twice too large,
    /// so that the reference is followed upwards by halves.
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
    let positive = |value: i32| value & !(value >> 31);
    let more = positive(a - b);
    let (most, least) = (b + more, a - more);
    most + positive((least >> 1) - (most >> 3))
}
