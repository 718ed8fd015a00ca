//! Blows: a propeller that touches its guard, a landing, a loose board.
//!
//! The accelerometer clips at its range, in front of its filter, and the mean of the filter's
//! output is then unknown: 50 ms of it turn the estimate by up to 0.1 rad. The gyroscope goes on
//! measuring. So the accelerometer is left out of the estimate during a blow. What lasts longer is
//! no blow, but a motion, whose mean is gravity.

use tvc_imu::RawSample;

use crate::sensor;
use crate::words::words;

/// An acceleration beyond this is a blow, counts: three quarters of the range. The filter passes
/// that much of what clips.
const BLOW_ACC: u16 = sensor::ACC_RANGE / 4 * 3;

/// How long the accelerometer is left out behind such a sample, us. What shakes so hard shows it
/// again meanwhile, at any frequency that the sensor's refresh leaves.
const FELT_US: u32 = 100_000;

/// Longest time for which it is left out in a row, us, of which a 32nd of the time since comes
/// back.
const LONGEST_US: u32 = 400_000;

words! {
    /// What is remembered of blows.
    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Blow {
        /// Time for which the newest blow is still felt, us.
        felt_us: u32,
        /// Time for which the accelerometer may be left out, us.
        left_us: u32,
    }
}

impl Default for Blow {
    fn default() -> Self {
        Self { felt_us: 0, left_us: LONGEST_US }
    }
}

impl Blow {
    /// Takes a sample, `dt_us` after the one before.
    pub(crate) fn feel(&mut self, raw: &RawSample, dt_us: u32) {
        let mut words = raw.acc.iter();
        self.felt_us = if words.any(|word| word.unsigned_abs() > BLOW_ACC) {
            FELT_US
        } else {
            self.felt_us.saturating_sub(dt_us)
        };
        self.left_us = if self.felt_us > 0 {
            self.left_us.saturating_sub(dt_us)
        } else {
            LONGEST_US.min(self.left_us + dt_us / 32)
        };
    }

    /// Whether the accelerometer is to be left out of the estimate.
    pub(crate) fn is_felt(&self) -> bool {
        self.felt_us > 0 && self.left_us > 0
    }

    /// Whether it may have come about.
    pub(crate) fn is_possible(&self) -> bool {
        self.felt_us <= FELT_US && self.left_us <= LONGEST_US
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_US: u32 = 6_667;

    fn raw(x: i16) -> RawSample {
        RawSample { acc: [x, 0, -981], ..RawSample::default() }
    }

    /// How many of the samples the accelerometer is left out in.
    fn left_out(blow: &mut Blow, samples: impl Iterator<Item = i16>) -> usize {
        samples
            .filter(|x| {
                blow.feel(&raw(*x), TICK_US);
                blow.is_felt()
            })
            .count()
    }

    #[test]
    fn a_blow_leaves_the_accelerometer_out_until_it_is_over() {
        let mut blow = Blow::default();
        assert_eq!(left_out(&mut blow, [5_886, -5_886, 300].into_iter()), 0);
        assert_eq!(left_out(&mut blow, [-5_887].into_iter()), 1);
        // 100 ms are 15 ticks, the last of which is over.
        assert_eq!(left_out(&mut blow, std::iter::repeat_n(300, 100)), 14);
    }

    #[test]
    fn a_motion_that_lasts_is_believed_again() {
        let mut blow = Blow::default();
        let shaken = |seconds: usize| (0..150 * seconds).map(|i| [6_000, -6_000][i % 2]);
        // 400 ms are 60 ticks.
        assert_eq!(left_out(&mut blow, shaken(10)), 59);
        // Three seconds of rest give back 94 ms.
        let rest = std::iter::repeat_n(0, 465);
        left_out(&mut blow, rest);
        assert_eq!(left_out(&mut blow, shaken(1)), 14);
    }
}
