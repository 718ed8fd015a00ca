//! What the firmware knows of a sensor that stands by, beside one that flies.
//!
//! They sit on one body, so that they turn alike. What the LSM6DS3 reads is turned into the BNO055's
//! axes, and the mean difference of the two is added: that is what the BNO055 would have read, its
//! offsets included. So the calibration is the BNO055's alone, and the attitude goes on when the
//! sensor that flies fails: its next sample comes from the other.
//!
//! The difference is followed while the vehicle is disarmed, and slowly in the air. A sensor whose
//! offset wanders in the air is seen by the angle that gathers between the two.

use tvc_imu::{Micros, RawSample, Refresh, Sample, SensorFault};

use super::{GYR_COUNTS, Kind};
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
            self.newest = Some(if is_onboard { self.turned(raw) } else { raw });
            self.is_fresh = true;
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
    /// The two turn differently.
    pub(super) fn join(&mut self, raw: RawSample, is_onboard: bool) -> Result<Sample, SensorFault> {
        let raw = if is_onboard { self.turned(raw) } else { raw };
        if let Some(other) = self.newest.filter(|_| self.is_fresh) {
            self.is_fresh = false;
            let (bno055, lsm6ds3) = if is_onboard { (&other, &raw) } else { (&raw, &other) };
            self.compare(bno055, lsm6ds3)?;
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
    ///
    /// # Errors
    /// The two turn differently.
    fn compare(&mut self, bno055: &RawSample, lsm6ds3: &RawSample) -> Result<(), SensorFault> {
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
        let mut differ = false;
        // The errors left are those of the rates.
        for (angle, error) in self.angles.iter_mut().zip(errors) {
            *angle += error - (*angle >> FORGET_LOG2);
            differ |= self.holds && angle.abs() > ANGLE_LIMIT;
            if !self.holds {
                *angle = 0;
            }
        }
        if differ { Err(SensorFault::Disagreement) } else { Ok(()) }
    }
}
