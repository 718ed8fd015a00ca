//! What the firmware knows of a sensor that stands by, beside one that flies.
//!
//! They sit on one body, so that they turn alike. What the LSM6DS3 reads is turned into the
//! BNO055's axes, and the mean difference of the two is added: that is what the BNO055 would have
//! read, its offsets included. So the calibration is the BNO055's alone, and the attitude goes on
//! when the sensor that flies fails: its next sample comes from the other.
//!
//! The difference is followed while the vehicle is disarmed, and slowly in the air. On the ground
//! the sensors disagree where the difference is larger than sound sensors have. In the air they
//! disagree where an angle gathers between the two: the offset of one wanders.

use tvc_imu::{Micros, RawSample, Refresh, Sample, SensorFault};

use super::{ACC_COUNTS, GYR_COUNTS, Kind};
use crate::mount::Relative;

/// Greatest age of a sample of the sensor that stands by, us: two turns of four ticks.
const AGE_US: u64 = 60_000;
/// Comparisons before the difference is known: 3 s.
const KNOWN: u16 = 110;
/// The difference follows by this share, as a negative power of two: a second on the ground, two
/// minutes in the air.
const GROUND_LOG2: u32 = 5;
/// See [`GROUND_LOG2`].
const AIR_LOG2: u32 = 12;
/// Bits of the difference behind the point.
const FINER: u32 = 12;
/// The angle between the two forgets by this share: 1.7 s.
const FORGET_LOG2: u32 = 6;
/// Largest differences on the ground, of accelerations and of rates: 1.5 m/s^2 and 10 deg/s. The
/// data sheets of both together allow 1.2 m/s^2 and 8 deg/s; a wrong mount makes more.
const DIFFERENCE_LIMITS: [i32; 2] = [(1.5 * ACC_COUNTS) as i32, (10.0 * GYR_COUNTS) as i32];
/// Largest angle between the two: 2.5 deg, in counts times comparisons, of which there are 37 a
/// second.
const ANGLE_LIMIT: i32 = (2.5 * GYR_COUNTS * 37.0) as i32;

/// Who has the bus behind the burst of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// The driver of the sensor that flies.
    Flying,
    /// The driver of the other.
    Other,
    /// A burst of the other.
    Burst,
}

/// Samples of the sensor that stands by, and what the two sensors differ by.
#[derive(Clone, Debug)]
pub(super) struct Standby {
    relative: Relative,
    /// How both sit, deg.
    mounts_deg: [[f32; 3]; 2],
    /// The vehicle is armed: the difference is followed slowly.
    pub(super) holds: bool,
    /// Ticks so far, for the turns.
    tick: u8,
    /// The other's burst of this tick has been made.
    burst_made: bool,
    /// The newest sample of the other, in the BNO055's axes and units, without the difference.
    newest: Option<RawSample>,
    /// It has not been compared.
    is_fresh: bool,
    /// Of the BNO055's words from the LSM6DS3's, times `2^FINER`: accelerations and rates.
    differences: [[i32; 3]; 2],
    compared: u16,
    /// Angles between the two, counts times samples.
    angles: [i32; 3],
    /// They disagree.
    differ: bool,
    /// Of the samples that fly.
    refresh: Refresh,
}

impl Standby {
    /// Of sensors that sit on the body by these angles: roll, pitch and yaw of each, deg.
    pub(super) fn new([bno055_deg, lsm6ds3_deg]: [[f32; 3]; 2]) -> Self {
        Self {
            relative: Relative::new(lsm6ds3_deg, bno055_deg),
            mounts_deg: [bno055_deg, lsm6ds3_deg],
            holds: false,
            tick: 0,
            burst_made: false,
            newest: None,
            is_fresh: false,
            differences: [[0; 3]; 2],
            compared: 0,
            angles: [0; 3],
            differ: false,
            refresh: Refresh::default(),
        }
    }

    pub(super) fn mounts_deg(&self) -> [[f32; 3]; 2] {
        self.mounts_deg
    }

    pub(super) fn refresh(&self) -> &Refresh {
        &self.refresh
    }

    /// A tick is over.
    pub(super) fn tick(&mut self) {
        (self.tick, self.burst_made) = (self.tick.wrapping_add(1), false);
    }

    /// Whose turn it is: the driver of the sensor that flies has every second tick, and the other
    /// one's burst and driver share the rest.
    pub(super) fn turn(&self) -> Turn {
        match self.tick & 3 {
            1 if self.burst_made => Turn::Flying,
            1 => Turn::Burst,
            3 => Turn::Other,
            _ => Turn::Flying,
        }
    }

    /// Takes what the sensor that stands by has read, if it could be read.
    pub(super) fn take(&mut self, raw: Option<RawSample>, is_onboard: bool) {
        self.burst_made = true;
        if let Some(raw) = raw {
            let raw = if is_onboard { self.turned(raw) } else { raw };
            // A sensor that stands still is left to its driver's judgement.
            let is_same = |last: RawSample| (last.acc, last.gyr) == (raw.acc, raw.gyr);
            self.is_fresh = !self.newest.is_some_and(is_same);
            self.newest = Some(raw);
        }
    }

    /// The sensor that stands by can fly from the next tick on.
    pub(super) fn is_ready(&self, now: Micros) -> bool {
        let is_recent = self.newest.is_some_and(|raw| now.since(raw.time) <= AGE_US);
        is_recent && self.compared >= KNOWN
    }

    /// Both sample, and the vehicle is disarmed.
    pub(super) fn is_matched(&self) -> bool {
        !self.holds && self.newest.is_some()
    }

    /// The sensors change places.
    pub(super) fn change(&mut self, onboard_flies: bool) {
        (self.newest, self.is_fresh) = (None, false);
        let kind = if onboard_flies { Kind::Lsm6ds3 } else { Kind::Bno055 };
        self.refresh = Refresh::with_period(kind.description().refresh_us);
    }

    /// The sample of the sensor that flies, as of the BNO055.
    ///
    /// # Errors
    /// The two disagree.
    pub(super) fn join(&mut self, raw: RawSample, is_onboard: bool) -> Result<Sample, SensorFault> {
        let raw = if is_onboard { self.turned(raw) } else { raw };
        if let Some(other) = self.newest.filter(|_| self.is_fresh) {
            self.is_fresh = false;
            let (bno055, lsm6ds3) = if is_onboard { (&other, &raw) } else { (&raw, &other) };
            self.compare(bno055, lsm6ds3);
        }
        if self.differ {
            return Err(SensorFault::Disagreement);
        }
        Ok(self.refresh.read(if is_onboard { self.with_differences(raw) } else { raw }))
    }

    /// A sample of the LSM6DS3 along the BNO055's axes.
    fn turned(&self, raw: RawSample) -> RawSample {
        let [acc, gyr] = [&raw.acc, &raw.gyr].map(|words| self.relative.turn(words));
        RawSample { acc, gyr, ..raw }
    }

    /// What the BNO055 would have read where the LSM6DS3 has read this, along its axes.
    fn with_differences(&self, mut raw: RawSample) -> RawSample {
        let [acc, gyr] = &self.differences;
        for (words, differences) in [(&mut raw.acc, acc), (&mut raw.gyr, gyr)] {
            for (word, difference) in words.iter_mut().zip(differences) {
                let sum = i32::from(*word) + ((difference + (1 << (FINER - 1))) >> FINER);
                *word = sum.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
            }
        }
        raw
    }

    /// Follows the differences of two samples, and the angle that gathers between them.
    fn compare(&mut self, bno055: &RawSample, lsm6ds3: &RawSample) {
        let log2 = if self.holds { AIR_LOG2 } else { GROUND_LOG2 };
        self.compared = (self.compared + 1).min(KNOWN);
        let [acc, gyr] = &mut self.differences;
        let pairs = [(&bno055.acc, &lsm6ds3.acc, acc), (&bno055.gyr, &lsm6ds3.gyr, gyr)];
        let mut errors = [0; 3];
        for (of_bno055, of_lsm6ds3, differences) in pairs {
            let both = of_bno055.iter().zip(of_lsm6ds3).zip(differences).zip(&mut errors);
            for (((bno055, lsm6ds3), difference), error) in both {
                let now = (i32::from(*bno055) - i32::from(*lsm6ds3)) << FINER;
                *error = (now - *difference) >> FINER;
                *difference += (now - *difference) >> log2;
            }
        }
        if !self.holds {
            self.angles = [0; 3];
            let mut pairs = self.differences.iter().zip(DIFFERENCE_LIMITS);
            let is_large = |limit: i32| move |of: &i32| (of >> FINER).abs() > limit;
            self.differ = self.compared == KNOWN
                && pairs.any(|(differences, limit)| differences.iter().any(is_large(limit)));
            return;
        }
        // The errors left are those of the rates.
        for (angle, error) in self.angles.iter_mut().zip(errors) {
            *angle += error - (*angle >> FORGET_LOG2);
            self.differ |= angle.abs() > ANGLE_LIMIT;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of both, 27 ms apart: the BNO055 flies, and the other reads the same words and these
    /// besides.
    fn compared(standby: &mut Standby, times: u32, acc: i16, gyr: i16) -> Result<(), SensorFault> {
        for _ in 0..times {
            // What moves does not stand still.
            let moves = standby.newest.map_or(0, |last| 1 - last.gyr[2]);
            let raw = RawSample { acc: [0, 0, 981], gyr: [0, 0, moves], ..RawSample::default() };
            let other = RawSample { acc: [acc, 0, 981], gyr: [0, gyr, moves], ..raw };
            standby.take(Some(other), true);
            standby.join(raw, false)?;
        }
        Ok(())
    }

    fn standby() -> Standby {
        Standby::new([[0.0; 3]; 2])
    }

    /// The LSM6DS3 reads 0.5 m/s^2 and 2 deg/s more: where it flies, its samples are the BNO055's.
    #[test]
    fn the_sensor_that_stands_by_reads_as_the_other() {
        let mut standby = standby();
        compared(&mut standby, 300, 50, 32).unwrap();
        let newest = standby.newest.unwrap();
        assert!(standby.is_ready(newest.time.after(AGE_US)));
        assert!(!standby.is_ready(newest.time.after(AGE_US + 1)), "it is too old");
        standby.change(true);
        let raw = RawSample { acc: [50, 0, 981], gyr: [0, 32, 100], ..RawSample::default() };
        let RawSample { acc, gyr, .. } = standby.join(raw, true).unwrap().raw;
        assert_eq!((acc, gyr), ([0, 0, 981], [0, 0, 100]));
    }

    #[test]
    fn it_is_not_ready_before_the_difference_is_known() {
        let mut standby = standby();
        compared(&mut standby, u32::from(KNOWN) - 1, 0, 0).unwrap();
        assert!(!standby.is_ready(Micros(0)));
        compared(&mut standby, 1, 0, 0).unwrap();
        assert!(standby.is_ready(Micros(0)));
    }

    /// 1.5 m/s^2 and 10 deg/s are 150 and 160 counts.
    #[test]
    fn on_the_ground_large_differences_disagree() {
        for (acc, gyr, agree) in [(140, 150, true), (160, 0, false), (0, -170, false)] {
            let mut standby = standby();
            assert_eq!(compared(&mut standby, 600, acc, gyr).is_ok(), agree, "{acc} {gyr}");
            // The difference goes, and they agree again.
            let _ = (0..600).map(|_| compared(&mut standby, 1, 0, 0)).last();
            assert_eq!(compared(&mut standby, 1, 0, 0), Ok(()));
        }
    }

    /// A rate of 1 deg/s between the two makes 1.7 deg at most, since the angle forgets; one of
    /// 3 deg/s makes 2.5 deg in a second and a half.
    #[test]
    fn in_the_air_an_angle_between_the_two_disagrees() {
        let mut standby = standby();
        compared(&mut standby, 300, 0, 0).unwrap();
        standby.holds = true;
        compared(&mut standby, 300, 0, 16).unwrap();
        assert_eq!(compared(&mut standby, 20, 0, 48), Err(SensorFault::Disagreement));
    }

    #[test]
    fn a_sensor_that_stands_still_is_not_compared() {
        let mut standby = standby();
        compared(&mut standby, 300, 0, 0).unwrap();
        standby.holds = true;
        let still = standby.newest;
        for rate in 0..100 {
            standby.take(still, true);
            let raw = RawSample { gyr: [100 * rate, 0, 0], ..RawSample::default() };
            standby.join(raw, false).unwrap();
        }
    }
}
