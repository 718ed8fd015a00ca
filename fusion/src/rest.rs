//! Rest detection, and the gyroscope's zero-rate offset learned there.
//!
//! Gyroscope and accelerometer are averaged over short blocks. If the averages of consecutive
//! blocks stay close to the first for long enough, the body is at rest, and the gyroscope shows its
//! offset. Block averages cost little and ignore vibration, whose mean is zero.

use crate::error::{ConfigError, in_range, positive, require};
use crate::quality::BiasState;
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{add_scaled, difference, within};

settings! {
    /// Rest detection, and the offset that it teaches.
    pub struct RestConfig {
        /// Largest deviation of the rotation rate, per axis, rad/s. 0 turns rest detection off.
        rate_rad_s: f32 = 2.0 * DEG,
        /// Largest deviation of the acceleration, per axis, m/s^2. Float takes 0.1 at most: a
        /// larger drift of gravity shows a slow turn.
        acc_m_s2: f32 = 0.5,
        /// Time of rest after which the offset is learned, s.
        time_s: f32 = 1.5,
        /// Largest offset per axis, rad/s: a larger mean rate is a rotation.
        max_bias_rad_s: f32 = 4.0 * DEG,
        /// Time constant of a known offset, s of rest.
        tau_s: f32 = 8.0,
        /// Deviation of the vertical in the mean of two seconds without acceleration, rad;
        /// accelerations add to it. Until a rest shows the offset, the filter finds it from the
        /// tilt that it causes in motion, with this deviation. `f32::INFINITY` waits for a rest, as
        /// fixed point always does.
        motion_tilt_rad: f32 = 0.01,
    }
}

const DEG: f32 = core::f32::consts::PI / 180.0;

/// Length of a block, s.
pub(crate) const BLOCK_S: f32 = 0.25;

/// Once an offset is known, the limit for rest is this fraction of the configured one.
const TIGHT: f32 = 0.25;

/// Largest drift of gravity in a rest, m/s^2: a turn by 0.6 deg.
const DRIFT_M_S2: f32 = 0.1;

/// Fractional bits of the sums of rates (rad/s) and accelerations (m/s^2). Sums in integers take a
/// fifth of the cycles without an FPU. They wrap only in motion, which does not use them.
const GYR_BITS: u8 = 22;
const ACC_BITS: u8 = 16;

#[derive(Clone, Debug, Default)]
pub(crate) struct Rest<T> {
    rate_limit: T,
    acc_limit: T,
    max_bias: T,
    block_s: T,
    /// Blocks that make a rest.
    needed: u32,
    /// Blocks that the offset is averaged over.
    most_learned: u32,
    block: Block<T>,
    reference: Option<([T; 3], [T; 3])>,
    /// Consecutive blocks at rest.
    still: u32,
    /// Mean rate of the blocks at rest that the offset has not learned yet. The newest block waits
    /// until the next is at rest too: a motion may have begun in it.
    mean: [T; 3],
    /// Their number.
    held: u32,
    /// Blocks in the offset's mean.
    learned: u32,
    /// A block differed from the block before.
    moved: bool,
    /// Consecutive blocks of a steady rate that is too large for an offset.
    refused: u32,
}

#[derive(Clone, Debug, Default)]
struct Block<T> {
    gyr: [i32; 3],
    acc: [i32; 3],
    count: u32,
    time_s: T,
}

impl<T: Real> Rest<T> {
    pub(crate) fn new(config: &RestConfig) -> Result<Self, ConfigError> {
        in_range(config.rate_rad_s, 0.0, f32::MAX, "rest.rate_rad_s")?;
        positive(config.acc_m_s2, "rest.acc_m_s2")?;
        positive(config.time_s, "rest.time_s")?;
        positive(config.max_bias_rad_s, "rest.max_bias_rad_s")?;
        positive(config.tau_s, "rest.tau_s")?;
        require(config.motion_tilt_rad > 0.0, "rest.motion_tilt_rad")?;
        let blocks = |time_s: f32| ((time_s / BLOCK_S + 0.5) as u32).max(1);
        Ok(Self {
            rate_limit: T::from_f32(config.rate_rad_s),
            acc_limit: T::from_f32(config.acc_m_s2.min(DRIFT_M_S2)),
            max_bias: T::from_f32(config.max_bias_rad_s),
            block_s: T::from_f32(BLOCK_S),
            needed: blocks(config.time_s),
            most_learned: blocks(config.tau_s),
            ..Self::default()
        })
    }

    /// Whether an offset is one that a gyroscope may have.
    pub(crate) fn allows(&self, bias: &[T; 3]) -> bool {
        within(bias, self.max_bias)
    }

    /// Whether the last blocks were at rest.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.still >= self.needed
    }

    /// State of the offset. "Refused": the last blocks show a steady rate that is too large for an
    /// offset, from a turn about the vertical or from a large offset.
    pub(crate) fn bias_state(&self) -> BiasState {
        BiasState::new(self.refused >= self.needed, self.is_bias_known())
    }

    /// An offset was learned, or is known from elsewhere.
    pub(crate) fn is_bias_known(&self) -> bool {
        self.learned > 0
    }

    /// The body has moved since the start, so no rest from the start is about to show the offset.
    pub(crate) fn has_moved(&self) -> bool {
        self.moved
    }

    /// An offset from elsewhere, with the weight of a shortest rest.
    pub(crate) fn know(&mut self) {
        self.learned = self.learned.max(self.needed);
    }

    /// For going back in time: only the weight of the offset stays.
    #[cfg(feature = "offline")]
    pub(crate) fn reversed(&self) -> Self {
        Self {
            block: Block::default(),
            reference: None,
            mean: [T::ZERO; 3],
            still: 0,
            held: 0,
            refused: 0,
            ..*self
        }
    }

    /// Samples are missing: ends the rest under way and keeps the learned offset.
    pub(crate) fn interrupt(&mut self) {
        self.block = Block::default();
        self.reference = None;
        (self.still, self.refused) = (0, 0);
    }

    /// One sample: rotation rate as measured (rad/s) and specific force (m/s^2). `bias` is
    /// corrected when a block of rest is complete.
    #[inline(always)]
    pub(crate) fn update(&mut self, dt: T, gyr: &[T; 3], acc: &[T; 3], bias: &mut [T; 3]) {
        let block = &mut self.block;
        add(&mut block.gyr, gyr, GYR_BITS);
        add(&mut block.acc, acc, ACC_BITS);
        block.count += 1;
        block.time_s += dt;
        if !block.time_s.within(self.block_s) {
            self.close_block(bias);
        }
    }

    #[cold]
    #[inline(never)]
    fn close_block(&mut self, bias: &mut [T; 3]) {
        let block = core::mem::take(&mut self.block);
        let per_sample = T::from_f32(block.count as f32).recip();
        let mean = |sum: [i32; 3], bits: u8| {
            let k = per_sample * T::from_f32(1.0 / (1u32 << (bits & 31)) as f32);
            sum.map(|sum| T::from_f32(sum as f32) * k)
        };
        let (gyr, acc) = (mean(block.gyr, GYR_BITS), mean(block.acc, ACC_BITS));
        let tight = if self.learned > 0 { T::from_f32(TIGHT) } else { T::ONE };
        let steady = self.reference.as_ref().is_some_and(|(gyr_ref, acc_ref)| {
            near(&gyr, gyr_ref, self.rate_limit * tight) && near(&acc, acc_ref, self.acc_limit)
        });
        let small = within(&gyr, self.max_bias);
        self.refused = match (steady, small) {
            (true, false) => self.refused.saturating_add(1),
            _ => 0,
        };
        self.moved |= self.reference.is_some() && !steady;
        if !(steady && small) {
            // This block may hold the end of a motion. The next block is compared with it, but the
            // mean leaves it out.
            self.reference = Some((gyr, acc));
            self.still = 0;
            return;
        }
        self.still = self.still.saturating_add(1);
        if self.still >= self.needed {
            let learned = self.learned.saturating_add(self.held);
            self.learned = learned.min(self.most_learned).max(self.held);
            let share = T::from_f32(self.held as f32) * T::from_f32(self.learned as f32).recip();
            step_towards(bias, &self.mean, share);
            self.mean = gyr;
            self.held = 1;
        } else {
            self.held = self.still;
            step_towards(&mut self.mean, &gyr, T::from_f32(self.held as f32).recip());
        }
    }
}

#[inline(always)]
fn add<T: Real>(sum: &mut [i32; 3], v: &[T; 3], bits: u8) {
    sum[0] = sum[0].wrapping_add(v[0].to_fixed(bits));
    sum[1] = sum[1].wrapping_add(v[1].to_fixed(bits));
    sum[2] = sum[2].wrapping_add(v[2].to_fixed(bits));
}

fn near<T: Real>(a: &[T; 3], b: &[T; 3], limit: T) -> bool {
    within(&difference(a, b), limit)
}

/// `from += (to - from) share`
fn step_towards<T: Real>(from: &mut [T; 3], to: &[T; 3], share: T) {
    let way = difference(to, from);
    add_scaled(from, &way, share);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rest: &mut Rest<f32>, bias: &mut [f32; 3], seconds: f32, gyr: impl Fn(f32) -> [f32; 3]) {
        for k in 0..(seconds * 100.0) as u32 {
            rest.update(0.01, &gyr(k as f32 * 0.01), &[0.0, 0.0, -9.81], bias);
        }
    }

    #[test]
    fn an_offset_is_learned_within_two_seconds_of_rest() {
        let (mut rest, mut bias) = (Rest::new(&RestConfig::default()).expect("valid"), [0.0; 3]);
        run(&mut rest, &mut bias, 1.2, |_| [0.01, -0.02, 0.03]);
        assert!(!rest.is_at_rest() && bias == [0.0; 3]);
        run(&mut rest, &mut bias, 0.8, |_| [0.01, -0.02, 0.03]);
        assert!(rest.is_at_rest());
        assert!(within(&difference(&bias, &[0.01, -0.02, 0.03]), 5e-7));
    }

    #[test]
    fn vibration_does_not_hide_rest() {
        let (mut rest, mut bias) = (Rest::new(&RestConfig::default()).expect("valid"), [0.0; 3]);
        run(&mut rest, &mut bias, 3.0, |t| [0.01 + 0.05 * (t * 251.3).sin(), 0.0, 0.0]);
        assert!(rest.is_at_rest());
        assert!((bias[0] - 0.01).abs() < 5e-3, "{bias:?}");
    }

    #[test]
    fn a_slow_turn_is_not_an_offset() {
        let (mut rest, mut bias) = (Rest::new(&RestConfig::default()).expect("valid"), [0.0; 3]);
        run(&mut rest, &mut bias, 10.0, |_| [0.0, 0.0, 0.2]);
        assert!(!rest.is_at_rest());
        assert_eq!(bias, [0.0; 3]);
    }

    #[test]
    fn motion_ends_rest_and_the_offset_stays() {
        let (mut rest, mut bias) = (Rest::new(&RestConfig::default()).expect("valid"), [0.0; 3]);
        run(&mut rest, &mut bias, 3.0, |_| [0.01, 0.0, 0.0]);
        run(&mut rest, &mut bias, 3.0, |t| [(3.0 * t).sin(), 0.0, 0.0]);
        assert!(!rest.is_at_rest());
        assert!((bias[0] - 0.01).abs() < 1e-6);
    }
}
