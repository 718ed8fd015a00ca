//! The compass in counts: see [`crate::FieldConfig`].

use super::estimator::Scale;
use super::nearest_log2;
use super::rotation::{Products, Rotation, dot};
use crate::config::{ConfigError, in_range};
use crate::field::{FieldConfig, JUDGE_S};

/// Fractional bits of the reference.
const BITS: u32 = 8;

/// The weight of a field that is like the reference.
const FULL: u8 = 8;

/// Field samples from which the reference is learned before the gate works.
const LEARNING: u8 = 64;

/// Tolerance until then, counts in Q8: more than any field deviates.
const ANYTHING: i32 = 1 << 29;

/// The share of the newest of so many, as a negative power of two: that of a running mean, which forgets those
/// from before the tilt and the heading were found.
const fn learning_share(judged: u8) -> u8 {
    match judged {
        0..16 => 2,
        16..24 => 3,
        24..40 => 4,
        _ => 5,
    }
}

/// Turns of the first alignment about down, 90 deg and its halves: cosine and sine, and those of the half
/// angle, Q15. They leave at most 1.4 deg.
const TURNS: [[i32; 4]; 7] = [
    [0, 32_768, 23_170, 23_170],
    [23_170, 23_170, 30_274, 12_540],
    [30_274, 12_540, 32_138, 6_393],
    [32_138, 6_393, 32_610, 3_212],
    [32_610, 3_212, 32_729, 1_608],
    [32_729, 1_608, 32_758, 804],
    [32_758, 804, 32_766, 402],
];

/// What is touched with every field sample.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Compass {
    /// Horizontal part of the reference, counts in Q8.
    horizontal: i32,
    /// `2^25 / horizontal` with the horizontal in counts.
    inverse: i32,
    /// Largest part across that has a sine, counts in Q4; 0 while the reciprocal is not there yet.
    limit: i32,
    /// Horizontal field below which a compass has no direction, counts in Q8.
    least: i32,
    /// There is a field to be judged.
    pub(super) pending: bool,
    disturbed: bool,
    /// How far the field is to be believed, in parts of `FULL`.
    weight: u8,
    /// Samples between judgements; when the last was, and how long after the one before.
    interval: u16,
    last: u16,
    elapsed: u16,
    /// What is to be judged: north, east, sine of the heading error, down in Q15 counts.
    seen: [i32; 4],
}

/// What is touched when a field sample is judged.
#[derive(Clone, Debug)]
pub(super) struct Field {
    /// Vertical part of the reference, counts in Q8.
    vertical: i32,
    /// The last field that was disturbed, and one that has been there for a while.
    met: [i32; 2],
    candidate: [i32; 2],
    /// Largest deviation from the reference, and how far the last field was within it, counts in Q8.
    tolerance: i32,
    margin: i32,
    /// Gate as a fraction, Q8.
    gate: i32,
    /// Share of a judged sample in the reference, as a negative power of two.
    follow: u8,
    /// The share of the next sample: that, or while the reference is learned a larger one.
    share: u8,
    /// Field samples judged so far, up to `LEARNING`.
    judged: u8,
    job: Job,
    /// Samples while another field was there: all, and those while turning; and the limits of both.
    rejected: i32,
    turned: i32,
    reject: i32,
    adopt: i32,
    adopt_rate: i32,
}

/// What a judgement is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Job {
    Compare,
    Conclude,
    Weigh,
}

/// Limits in counts, times in samples.
pub(super) struct Limits {
    pub(super) gate_q8: i32,
    pub(super) log2_follow: u8,
    pub(super) reject: i32,
    pub(super) adopt: i32,
    pub(super) adopt_rate: i32,
}

impl Compass {
    pub(super) fn new(scale: &Scale, period_s: f32) -> Self {
        let interval = (JUDGE_S / period_s) as u16 + 1;
        // Below 32 counts a reciprocal would not fit.
        let least = ((1.0 / scale.mag_ut) as i32).max(32) << BITS;
        Self {
            least,
            horizontal: 0,
            inverse: 1 << 16,
            limit: 0,
            pending: false,
            interval,
            last: 0,
            elapsed: 0,
            disturbed: false,
            weight: FULL,
            seen: [0; 4],
        }
    }

    pub(super) fn is_disturbed(&self) -> bool {
        self.disturbed
    }

    /// At the start the heading may be off by any angle, and a slow magnetometer would take long to correct
    /// it: turn to the field that was seen, by one of `TURNS` with each sample.
    #[inline(never)]
    pub(super) fn align(&mut self, turn: u16, rotation: &mut Rotation) {
        let Some(&[cos, sin, half_cos, half_sin]) = TURNS.get(usize::from(turn)) else {
            return;
        };
        let [north, east, ..] = self.seen;
        // The first is for a field behind, and nothing for one that has not been seen.
        if (turn == 0 && north >= 0) || (north == 0 && east == 0) {
            return;
        }
        let (sin, half_sin) = if east > 0 {
            (sin, -half_sin)
        } else {
            (-sin, half_sin)
        };
        self.seen[0] = (north * cos + east * sin + (1 << 14)) >> 15;
        self.seen[1] = (east * cos - north * sin + (1 << 14)) >> 15;
        self.seen[2] = 0;
        rotation.turn_about_down(half_cos, half_sin);
    }

    /// Sine of the heading error, Q15, of a field in counts, as far as it is to be believed.
    #[inline(always)]
    pub(super) fn heading(
        &mut self,
        p: &Products,
        down: &[i32; 3],
        mag: &[i16; 3],
        tick: u16,
    ) -> i32 {
        let mag = &mag.map(i32::from);
        let north = dot(&p.north(), mag) >> 15;
        let east = dot(&p.east(), mag) >> 11;
        let sine = if north < 0 || east >= self.limit || east <= -self.limit {
            if east < 0 { 32_767 } else { -32_767 }
        } else {
            -((east * self.inverse) >> 14)
        };
        let elapsed = tick.wrapping_sub(self.last);
        if elapsed >= self.interval {
            self.last = tick;
            self.elapsed = elapsed;
            self.pending = true;
            self.seen = [north, east >> 4, sine, dot(down, mag)];
        }
        (sine * i32::from(self.weight)) >> 3
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
        let samples = |time_s: f32| time_s / period_s;
        Ok(Self {
            gate_q8: (config.gate.min(64.0) * 256.0) as i32,
            log2_follow: nearest_log2(config.tau_s / JUDGE_S).min(15),
            reject: samples(config.reject_s) as i32,
            adopt: samples(config.adopt_s) as i32,
            adopt_rate: (config.adopt_rate_rad_s / scale.gyr_rad_s) as i32,
        })
    }
}

impl Field {
    pub(super) const fn new(limits: &Limits) -> Self {
        Self {
            vertical: 0,
            met: [0; 2],
            candidate: [0; 2],
            tolerance: ANYTHING,
            margin: 0,
            gate: limits.gate_q8,
            follow: limits.log2_follow,
            share: learning_share(0),
            judged: 0,
            job: Job::Compare,
            rejected: 0,
            turned: 0,
            reject: limits.reject,
            adopt: limits.adopt,
            adopt_rate: limits.adopt_rate,
        }
    }

    /// Judge the field that was seen, one job with each sample until all is done.
    #[inline(never)]
    pub(super) fn judge(&mut self, compass: &mut Compass, gyr: &[i16; 3]) {
        match self.job {
            Job::Compare => self.compare(compass),
            Job::Conclude if compass.disturbed => {
                self.job = Job::Compare;
                compass.pending = false;
                self.consider(compass, gyr);
            }
            Job::Conclude => {
                self.job = Job::Weigh;
                self.refresh(compass);
            }
            Job::Weigh => {
                self.job = Job::Compare;
                compass.pending = false;
                if self.judged < LEARNING {
                    self.judged += 1;
                    self.share = learning_share(self.judged);
                    return;
                }
                self.share = self.follow;
                compass.weight = weight(self.margin, self.tolerance);
                let total = length(compass.horizontal, self.vertical.abs());
                self.tolerance = (total >> 8) * self.gate;
            }
        }
    }

    fn compare(&mut self, compass: &mut Compass) {
        self.job = Job::Conclude;
        let [north, east, sine, down_q15] = compass.seen;
        // Turned by the heading error: h = N cos + E sin. Wraps for a field of more than 32767 counts, which
        // is none of the earth's.
        let cos = 32_767 - ((sine * sine) >> 16);
        let horizontal = (north * cos).wrapping_sub(east * sine) >> (15 - BITS);
        let vertical = down_q15 >> (15 - BITS);
        let (dh, dv) = (horizontal - compass.horizontal, vertical - self.vertical);
        self.margin = self.tolerance - dh.abs() - dv.abs();
        compass.disturbed = self.margin < 0;
        if compass.disturbed {
            self.met = [horizontal, vertical];
        } else {
            compass.horizontal += dh >> self.share;
            self.vertical += dv >> self.share;
        }
    }

    /// A field unlike the reference: does it stay the same while the body turns?
    fn consider(&mut self, compass: &mut Compass, gyr: &[i16; 3]) {
        self.rejected += i32::from(compass.elapsed);
        compass.weight = if self.rejected > self.reject {
            FULL / 2
        } else {
            0
        };
        let [h, v] = self.met;
        let [like_h, like_v] = self.candidate;
        if (h - like_h).abs() + (v - like_v).abs() > self.tolerance {
            self.candidate = self.met;
            self.turned = 0;
        } else if gyr.iter().fold(0, |sum, &rate| sum + i32::from(rate).abs()) > self.adopt_rate {
            self.turned += i32::from(compass.elapsed);
            if self.turned > self.adopt {
                [compass.horizontal, self.vertical] = self.candidate;
            }
        }
    }

    /// What follows from the reference: its reciprocal by a Newton step.
    fn refresh(&mut self, compass: &mut Compass) {
        self.rejected = 0;
        self.turned = 0;
        compass.horizontal = compass.horizontal.max(compass.least);
        // y (2 - h y), with h y in Q27. Far off it would not fit.
        compass.limit = 0;
        if (compass.horizontal >> 12) * (compass.inverse >> 8) > 1 << 15 {
            compass.inverse >>= 2;
        } else {
            let error = (1 << 27) - (compass.horizontal >> 6) * compass.inverse;
            let factor = ((1 << 27) + error).clamp(1 << 26, 1 << 28) >> 18;
            compass.inverse = (compass.inverse * factor) >> 9;
            if error.abs() < 1 << 25 {
                compass.limit = compass.horizontal >> 4;
            }
        }
    }
}

/// A part of the whole in parts of `FULL`, rounded up to quarters.
fn weight(part: i32, whole: i32) -> u8 {
    let quarter = whole >> 2;
    let quarters =
        1 + u8::from(part > quarter) + u8::from(part > 2 * quarter) + u8::from(part > 3 * quarter);
    quarters * (FULL / 4)
}

/// Length of a vector with components that are not negative: within 3 % (the larger, or 7/8 of it and half of the
/// smaller).
fn length(a: i32, b: i32) -> i32 {
    let (most, least) = if a > b { (a, b) } else { (b, a) };
    most.max(most - (most >> 3) + (least >> 1))
}
