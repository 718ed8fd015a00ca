//! The self-test: a second of samples that arrive at their rate, from a gyro that does not move and
//! an accelerometer that feels gravity and nothing else.
//!
//! It works on calibrated counts in integers, before any filter could hide what the sensor did: a
//! sensor whose offset takes it out of the limits is calibrated first.

use tvc_imu::{Micros, RawSample};

use crate::config::{
    GRAVITY_COUNTS, HALTED_BURSTS, SELF_TEST_GRAVITY_TOLERANCE, SELF_TEST_GYRO_LIMIT,
    SELF_TEST_GYRO_SPAN, SELF_TEST_RATE_HZ, SELF_TEST_US,
};
use crate::numbered::numbered;

/// Bounds of the mean squared acceleration, counts squared.
const GRAVITY_SQUARED: (u64, u64) = {
    let low = GRAVITY_COUNTS * (1.0 - SELF_TEST_GRAVITY_TOLERANCE);
    let high = GRAVITY_COUNTS * (1.0 + SELF_TEST_GRAVITY_TOLERANCE);
    ((low * low) as u64, (high * high) as u64)
};

numbered! {
    /// What a failed self-test found.
    Failure {
        /// The gyro moved, or reads more at rest than any healthy one.
        Moving = 1, "gyro moves";
        /// The mean acceleration is not 1 g within [`SELF_TEST_GRAVITY_TOLERANCE`].
        Gravity = 2, "acceleration is not 1 g";
        /// Samples come too slowly.
        Slow = 3, "too few samples";
    }
}

/// What is known after a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Not a second yet.
    Running,
    /// Every check passed.
    Passed,
    /// This check failed.
    Failed(Failure),
}

/// A self-test under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelfTest {
    since: Micros,
    intervals: u32,
    /// Samples that the processor's own halts may have cost.
    halted: u32,
    gyr_low: [i16; 3],
    gyr_high: [i16; 3],
    /// Sum over the samples after the first.
    acc_squared: u64,
    /// What ended the attempt before this one.
    pub failure: Option<Failure>,
}

impl SelfTest {
    /// Begin with a first sample. `failure` is why the last attempt ended, if there was one.
    pub fn new(first: &RawSample, failure: Option<Failure>) -> Self {
        Self {
            since: first.time,
            intervals: 0,
            halted: 0,
            gyr_low: first.gyr,
            gyr_high: first.gyr,
            acc_squared: 0,
            failure,
        }
    }

    /// The processor stood still for its flash.
    pub fn halted(&mut self) {
        self.halted += u32::from(HALTED_BURSTS);
    }

    /// Take in the next sample.
    pub fn observe(&mut self, raw: &RawSample) -> Verdict {
        self.intervals += 1;
        for ((low, high), gyr) in self.gyr_low.iter_mut().zip(&mut self.gyr_high).zip(raw.gyr) {
            *low = gyr.min(*low);
            *high = gyr.max(*high);
            let span = i32::from(*high) - i32::from(*low);
            let out_of_range = *low < -SELF_TEST_GYRO_LIMIT || *high > SELF_TEST_GYRO_LIMIT;
            if span > i32::from(SELF_TEST_GYRO_SPAN) || out_of_range {
                return Verdict::Failed(Failure::Moving);
            }
        }
        self.acc_squared += raw
            .acc
            .iter()
            .map(|&a| u64::from(a.unsigned_abs()) * u64::from(a.unsigned_abs()))
            .sum::<u64>();

        let elapsed_us = raw.time.since(self.since);
        if elapsed_us < SELF_TEST_US {
            return Verdict::Running;
        }
        let intervals = u64::from(self.intervals);
        let accounted = intervals + u64::from(self.halted);
        let (low, high) = GRAVITY_SQUARED;
        if self.acc_squared < low * intervals || self.acc_squared > high * intervals {
            Verdict::Failed(Failure::Gravity)
        } else if accounted * 1_000_000 < u64::from(SELF_TEST_RATE_HZ) * elapsed_us {
            Verdict::Failed(Failure::Slow)
        } else {
            Verdict::Passed
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(index: u64, period_us: u64, acc: [i16; 3], gyr: [i16; 3]) -> RawSample {
        RawSample { time: Micros(index * period_us), acc, mag: [0; 3], gyr }
    }

    /// Feed samples until there is a verdict, and say after how many.
    fn run(period_us: u64, acc: [i16; 3], gyr: impl Fn(u64) -> [i16; 3]) -> (u64, Verdict) {
        let mut test = SelfTest::new(&sample(0, period_us, acc, gyr(0)), None);
        for index in 1..1000 {
            let verdict = test.observe(&sample(index, period_us, acc, gyr(index)));
            if verdict != Verdict::Running {
                return (index, verdict);
            }
        }
        panic!("no verdict");
    }

    #[test]
    fn a_still_sensor_passes_after_one_second_however_it_is_turned() {
        assert_eq!(run(10_000, [0, 0, -981], |_| [8, -16, 20]), (100, Verdict::Passed));
        assert_eq!(run(10_000, [566, 566, -566], |_| [0; 3]), (100, Verdict::Passed));
    }

    #[test]
    fn noise_passes_and_motion_does_not() {
        let noise = |index| [(index % 9) as i16 - 4, 0, 0];
        assert_eq!(run(10_000, [0, 0, -981], noise).1, Verdict::Passed);
        let turning = |index| [0, (index * 2) as i16, 0];
        assert_eq!(run(10_000, [0, 0, -981], turning), (25, Verdict::Failed(Failure::Moving)));
    }

    #[test]
    fn an_impossible_zero_rate_offset_counts_as_motion() {
        assert_eq!(
            run(10_000, [0, 0, -981], |_| [81, 0, 0]),
            (1, Verdict::Failed(Failure::Moving))
        );
        assert_eq!(
            run(10_000, [0, 0, -981], |_| [i16::MIN, 0, 0]).1,
            Verdict::Failed(Failure::Moving)
        );
    }

    #[test]
    fn gravity_must_be_one_g_within_five_percent() {
        for (z, verdict) in [
            (-930, Verdict::Failed(Failure::Gravity)),
            (-933, Verdict::Passed),
            (1028, Verdict::Passed),
            (1031, Verdict::Failed(Failure::Gravity)),
            (i16::MIN, Verdict::Failed(Failure::Gravity)),
        ] {
            assert_eq!(run(10_000, [0, 0, z], |_| [0; 3]), (100, verdict), "{z}");
        }
    }

    #[test]
    fn samples_must_come_at_95_hz_or_more() {
        assert_eq!(run(10_526, [0, 0, -981], |_| [0; 3]).1, Verdict::Passed);
        assert_eq!(run(10_600, [0, 0, -981], |_| [0; 3]).1, Verdict::Failed(Failure::Slow));
    }

    /// At 60 Hz 35 samples a second are missing. 18 pieces of a save may have cost 36.
    #[test]
    fn a_save_costs_samples_and_not_the_self_test() {
        for (pieces, verdict) in [(17, Verdict::Failed(Failure::Slow)), (18, Verdict::Passed)] {
            let at = |index| sample(index, 16_667, [0, 0, -981], [0; 3]);
            let mut test = SelfTest::new(&at(0), None);
            (0..pieces).for_each(|_| test.halted());
            let verdicts = (1..).map(|index| test.observe(&at(index)));
            assert_eq!(
                verdicts.into_iter().find(|found| *found != Verdict::Running),
                Some(verdict)
            );
        }
    }
}
