//! Standard deviations of an estimate: the equations of [`crate::Quality`], once a block.
//!
//! # The number formats
//! | number | format | bound and its reason |
//! |---|---|---|
//! | variances of tilt and heading | Q28 rad^2 | pi^2 / 3, of an unknown angle, is below 8 |
//! | drifts of both | Q28 rad | below 8 |
//! | pull of the accelerations | Q28 rad | 1 |
//! | variance of the offset | Q40 (rad/s)^2 | `0.02^2`, of an unknown offset, is below `2^-9` |
//! | square of the rate | Q14 (rad/s)^2 | 100, for faster turns too |
//! | shares of a block | Q15 | 1 |
//!
//! A variance or drift is multiplied by a share in two parts of 15 bits, so that small values are
//! exact.

use bytemuck::{Pod, Zeroable};

use super::counts::Scale;
use super::format::{Q15, Q28, Q31, are_within, normalised};
use crate::quality::{
    BIAS_AT_REST, BIAS_UNKNOWN, BIAS_WALK, BiasState, EXPLAINED_LOG2, FIRST, FRESH_S, HEADING,
    HEADING_PER_S, HOLD_PER_S, NOISE_S, PULL_PER_S, Quality, SCALE_S, STEEP, STILL, TILT,
    TILT_PER_S, UNKNOWN,
};

/// Variance of an offset, (rad/s)^2.
type Q40 = i32;

const fn q28(value: f32) -> Q28 {
    (value * 268_435_456.0) as i32
}

const fn q40(value: f32) -> Q40 {
    (value * 1_099_511_627_776.0) as i32
}

const fn q20(value: f32) -> i32 {
    (value * 1_048_576.0) as i32
}

/// Largest deviation of an offset, Q20 rad/s: its square fits.
const MOST_DEVIATION: i32 = 40_000;

/// Largest share of a variance that a block removes: a running mean's first gains would remove
/// more.
const MOST: Q15 = 30_000;

/// Largest drift and walk of a block, Q28.
const MOST_GROWTH: Q28 = 1 << 24;

/// Largest pull about an axis, Q28: 1 rad.
const MOST_PULL: Q28 = 1 << 28;

/// Variance that a gap in the samples adds, rad^2.
const GAP: f32 = 0.25;

/// Effect of a filter's own gain on the uncertainty of an angle in a block.
#[derive(Clone, Debug, PartialEq)]
struct Decay {
    /// Shares of the variance and of the drift that it removes.
    variance: Q15,
    drift: Q15,
    /// Its noise, rad^2.
    noise: Q28,
}

impl Decay {
    fn new(per_s: f32, block_s: f32) -> Self {
        let share = per_s * block_s;
        Self {
            variance: lost(2.0 * share),
            drift: lost(share),
            noise: q28(NOISE_S * per_s * per_s * block_s).min(1 << 12),
        }
    }
}

/// The share of a number that a block removes, of the product of a rate and its time.
fn lost(product: f32) -> Q15 {
    (product / (1.0 + product) * 32_768.0) as i32
}

/// The uncertainty of an angle: its random walk, and its drift by the offset's error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Angle {
    variance: Q28,
    drift: Q28,
}

impl Angle {
    /// A block's corrections, by the filter's own gain times `2^gain_log2`.
    #[inline(never)]
    fn correct(&mut self, decay: &Decay, gain_log2: i32) {
        let log2 = gain_log2.min(8);
        let taken = |share: Q15| (share << log2).min(MOST);
        self.variance += (decay.noise << (2 * log2)) - part(self.variance, taken(decay.variance));
        self.drift -= part(self.drift, taken(decay.drift));
    }

    /// A block's walk and drift.
    #[inline(always)]
    fn grow(&mut self, walk: Q28, drift: Q28) {
        self.variance = (self.variance + walk).min(q28(UNKNOWN));
        self.drift = (self.drift + drift).min(q28(UNKNOWN));
    }

    /// Its variance by the walk and the drift.
    #[inline(always)]
    fn variance(&self) -> u32 {
        let drift = (self.drift >> 14) as u32;
        (self.variance as u32 + drift * drift).min(q28(UNKNOWN) as u32)
    }
}

/// The standard deviation of a variance, rad.
#[inline(never)]
fn deviation_rad(variance_q28: u32) -> f32 {
    root(variance_q28.min(q28(UNKNOWN) as u32)) as f32 / 16_384.0
}

/// The root of a number, rounded down, bit by bit: a sixth of the library's code, and fast enough
/// for once a block.
#[inline(never)]
fn root(square: u32) -> u32 {
    let (mut root, mut left) = (0, square);
    for bit in (0..16).rev().map(|half| 1 << (2 * half)) {
        let next = root + bit;
        root >>= 1;
        if left >= next {
            left -= next;
            root += bit;
        }
    }
    root
}

/// A share of a number.
fn part(value: i32, share: Q15) -> i32 {
    (value >> 15) * share + (((value & 0x7fff) * share) >> 15)
}

/// The jobs of a block, the first with the largest number; a step has time for one.
pub(super) mod job {
    pub(in super::super) const CLOSE: u32 = 6;
    pub(in super::super) const TURN: u32 = 5;
    pub(in super::super) const TILT: u32 = 4;
    pub(in super::super) const HEADING: u32 = 3;
    pub(in super::super) const PULL: u32 = 2;
    pub(in super::super) const GROW: u32 = 1;

    /// Whether a job takes the step with this number in its block even from a field, to correct the
    /// heading by, or from the compass. Steps without a field come first; a block of 32 has six of
    /// these.
    #[inline(always)]
    pub(in super::super) fn is_turn(step: u32) -> bool {
        step & 3 == 3
    }
}

/// Growth and decay of the uncertainties in a block.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Uncertainty {
    tilt: Decay,
    heading: Decay,
    /// Shares of the pull and of its memory that a block removes.
    pull_lost: Q15,
    hold_lost: Q15,
    /// Rate of a count, Q(7 + `shift`) rad/s.
    per_count: i32,
    shift: u32,
    /// Walk at rest, and by the square of the rate.
    still: Q28,
    scale: Q28,
    bias_walk: Q40,
    /// A block, Q15 s.
    block: Q15,
    /// Blocks for which a field is fresh.
    fresh: u32,
    block_s: f32,
}

/// The uncertainties.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct UncertaintyState {
    tilt: Angle,
    heading: Angle,
    /// The pull of the accelerations, about north and east, and the memory of its square.
    pull: [Q28; 2],
    held: Q28,
    /// Variance of the offset.
    bias: Q40,
    /// Its root, Q20 rad/s.
    deviation: i32,
    /// Blocks since the last undisturbed field; `u32::MAX` before the first.
    field_age: u32,
    /// Growth of drifts and variances in this block.
    drift: Q28,
    walk: Q28,
}

impl Uncertainty {
    #[inline(always)]
    pub(super) fn new(scale: &Scale, block_s: f32) -> Self {
        let (per_count, shift) = normalised(scale.gyr_rad_s * 128.0, 16_384.0);
        Self {
            tilt: Decay::new(TILT_PER_S, block_s),
            heading: Decay::new(HEADING_PER_S, block_s),
            pull_lost: lost(PULL_PER_S * block_s),
            hold_lost: lost(HOLD_PER_S * block_s),
            per_count,
            shift,
            still: q28(STILL * block_s),
            scale: q28(SCALE_S * block_s),
            bias_walk: q40(BIAS_WALK * block_s),
            block: (block_s * 32_768.0) as i32,
            fresh: (FRESH_S / block_s) as u32 + 1,
            block_s,
        }
    }

    /// [`job::CLOSE`]: whether the block belonged to a rest that shows the offset, and whether it
    /// had an undisturbed field.
    pub(super) fn close(&self, state: &mut UncertaintyState, at_rest: bool, good_field: bool) {
        state.field_age = if good_field { 0 } else { state.field_age.saturating_add(1) };
        if at_rest {
            (state.bias, state.deviation) = (q40(BIAS_AT_REST * BIAS_AT_REST), q20(BIAS_AT_REST));
        } else if state.deviation < MOST_DEVIATION {
            state.bias += self.bias_walk;
            // Its root grows by less than a bit in a block, so none is computed.
            let next = state.deviation + 1;
            if next * next <= state.bias {
                state.deviation = next;
            }
        }
        // Q20 times Q15, to Q28.
        state.drift = (state.deviation * self.block) >> 7;
    }

    /// [`job::TURN`]: the last rates less their offset, counts.
    pub(super) fn turn(&self, state: &mut UncertaintyState, rates: &[i32; 3]) {
        let mut square = 0;
        for rate in rates {
            let rate = (rate * self.per_count) >> (self.shift & 31);
            square += rate * rate;
        }
        // Q14; the scale has 10 bits at most.
        state.walk = self.still + (((square.min(100 << 14) >> 6) * self.scale) >> 8);
    }

    /// [`job::TILT`]: the raise of the tilt's gain, as a power of two.
    pub(super) fn correct_tilt(&self, state: &mut UncertaintyState, gain_log2: i32) {
        state.tilt.correct(&self.tilt, gain_log2);
    }

    /// [`job::HEADING`]: likewise of the heading.
    pub(super) fn correct_heading(&self, state: &mut UncertaintyState, gain_log2: i32) {
        if self.is_field_fresh(state) {
            state.heading.correct(&self.heading, gain_log2);
        }
    }

    /// [`job::PULL`]: half the correction of the tilt in a sample of the block.
    pub(super) fn pull(&self, state: &mut UncertaintyState, half: [Q31; 2], samples_log2: u32) {
        // As much as a block removes of a pull just below `MOST_PULL`, which therefore stays.
        let most = (self.pull_lost * 8_191) >> (samples_log2 & 31);
        for (pull, half) in state.pull.iter_mut().zip(half) {
            let correction = (half >> 2).min(most).max(-most) << (samples_log2 & 31);
            *pull += correction - (*pull >> 15) * self.pull_lost;
        }
    }

    /// [`job::GROW`]: walk and drift of both angles, and the memory of the pull.
    pub(super) fn grow(&self, state: &mut UncertaintyState) {
        let (walk, drift) = (state.walk, state.drift);
        state.tilt.grow(walk, drift);
        state.heading.grow(walk, drift);
        // At most 2^29, of which a block loses less than 2^-5.
        state.held -= ((state.held >> 8) * self.hold_lost) >> 7;
        // More explains any pull.
        let walked = state.tilt.variance().min(1 << 26);
        let excess = state.pull_square() - ((walked << EXPLAINED_LOG2) as i32);
        state.held = state.held.max(excess);
    }

    fn is_field_fresh(&self, state: &UncertaintyState) -> bool {
        state.field_age < self.fresh
    }

    /// See [`Estimator::quality`](super::Estimator::quality); with the field's reference, north and
    /// down.
    pub(super) fn quality(
        &self,
        state: &UncertaintyState,
        field: Option<[i32; 2]>,
        bias: BiasState,
    ) -> Quality<f32> {
        let steepness = field.map(|[north, down]| {
            let ratio = down as f32 / (north.max(1)) as f32;
            1.0 + ratio * ratio
        });
        let place = q28(steepness.map_or(0.0, |ratio| ratio * HEADING).min(UNKNOWN));
        let heading = state.heading.variance() + place as u32;
        let pulled = state.pull_square().max(state.held);
        Quality {
            tilt_rad: deviation_rad(state.tilt_variance(pulled)),
            heading_rad: deviation_rad(heading),
            bias_rad_s: state.deviation as f32 / 1_048_576.0,
            bias,
            heading_is_observable: self.is_field_fresh(state)
                && steepness.is_some_and(|ratio| ratio <= STEEP),
            field_age_s: (state.field_age != u32::MAX)
                .then_some(state.field_age as f32 * self.block_s),
        }
    }
}

impl UncertaintyState {
    pub(super) fn start() -> Self {
        Self {
            tilt: Angle { variance: q28(FIRST), drift: 0 },
            bias: q40(BIAS_UNKNOWN * BIAS_UNKNOWN),
            deviation: q20(BIAS_UNKNOWN),
            field_age: u32::MAX,
            ..Self::zeroed()
        }
    }

    /// The offset keeps its deviation.
    pub(super) fn keep_bias(&mut self, before: &Self) {
        (self.bias, self.deviation) = (before.bias, before.deviation);
    }

    /// Samples are missing: the attitude is uncertain.
    #[cold]
    pub(super) fn widen(&mut self) {
        for angle in [&mut self.tilt, &mut self.heading] {
            angle.variance = (angle.variance + q28(GAP)).min(q28(UNKNOWN));
        }
    }

    /// The accelerations pull no longer. What they pulled is remembered.
    pub(super) fn end_pull(&mut self) {
        self.pull = [0; 2];
    }

    /// Nothing but the rates turns the attitude.
    pub(super) fn lose_tilt(&mut self) {
        self.tilt.variance = q28(FIRST);
    }

    fn pull_square(&self) -> Q28 {
        let [north, east] = self.pull.map(|part| part >> 14);
        north * north + east * east
    }

    /// Variance of the tilt, with this pull.
    fn tilt_variance(&self, pulled: Q28) -> u32 {
        self.tilt.variance() + (pulled + q28(TILT)) as u32
    }

    /// See [`Estimator::tilt_is_within`](super::Estimator::tilt_is_within).
    pub(super) fn tilt_is_within(&self, variance: Q28) -> bool {
        self.tilt_variance(self.pull_square()) <= variance.unsigned_abs()
    }

    /// Whether an update can have left these numbers.
    pub(super) fn is_sound(&self) -> bool {
        let angles = [self.tilt, self.heading];
        let mut parts = angles.iter().flat_map(|angle| [angle.variance, angle.drift]);
        parts.all(|part| (0..=q28(UNKNOWN)).contains(&part))
            && are_within(&self.pull, MOST_PULL)
            && (0..=2 * MOST_PULL).contains(&self.held)
            && (0..=MOST_DEVIATION * MOST_DEVIATION + (1 << 16)).contains(&self.bias)
            && (0..=MOST_DEVIATION).contains(&self.deviation)
            && [self.drift, self.walk].iter().all(|growth| (0..=MOST_GROWTH).contains(growth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// However the accelerations pull, to whichever side.
        #[test]
        fn a_pull_stays_within_its_bounds(
            sides in proptest::collection::vec((-1_i32..=1, -1_i32..=1), 1..9),
            block_s in 0.17f32..0.36,
            log2 in 5_u32..12,
        ) {
            let uncertainty = Uncertainty::new(&Scale::BNO055, block_s);
            let mut state = UncertaintyState::start();
            for (north, east) in sides {
                for _ in 0..300 {
                    uncertainty.pull(&mut state, [north * i32::MAX, east * i32::MAX], log2);
                    uncertainty.grow(&mut state);
                    prop_assert!(state.is_sound(), "{state:?}");
                }
            }
        }

        #[test]
        fn roots_are_those_of_the_library(square in any::<u32>(), small in 0_u32..70_000) {
            prop_assert_eq!(root(square), square.isqrt());
            prop_assert_eq!(root(small), small.isqrt());
        }

        /// To the last bits.
        #[test]
        fn a_part_is_the_product(value in i32::MIN..i32::MAX, share in 0_i32..32_768) {
            let exact = (i64::from(value) * i64::from(share)) >> 15;
            prop_assert!((i64::from(part(value, share)) - exact).abs() <= 1);
        }
    }
}
