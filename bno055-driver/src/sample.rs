//! The sampling burst: what it reads, what it gives, and whether to believe it.

use crate::config::{AccUnit, Config, MAG_UT, Mode, Power, Units};
use crate::fault::SensorFault;
use crate::registers;
use crate::transfer::{Micros, Transfer};

/// One sample as the chip gave it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawSample {
    /// Start of its burst.
    pub time: Micros,
    /// Acceleration, counts; zero in modes without accelerometer.
    pub acc: [i16; 3],
    /// Magnetic field, counts of 1/16 uT; zero in modes without magnetometer.
    pub mag: [i16; 3],
    /// Angular rate, counts; zero in modes without gyroscope.
    pub gyr: [i16; 3],
}

impl RawSample {
    /// Acceleration in m/s^2, in the chip's mapped axes.
    #[must_use]
    pub fn acc_m_s2(&self, units: &Units) -> [f32; 3] {
        self.acc.map(|count| f32::from(count) * units.acc_m_s2())
    }

    /// Angular rate in rad/s, in the chip's mapped axes.
    #[must_use]
    pub fn gyr_rad_s(&self, units: &Units) -> [f32; 3] {
        self.gyr.map(|count| f32::from(count) * units.gyr_rad_s())
    }

    /// Magnetic field in uT, in the chip's mapped axes.
    #[must_use]
    pub fn mag_ut(&self) -> [f32; 3] {
        self.mag.map(|count| f32::from(count) * MAG_UT)
    }
}

/// First register and length of the one burst that reads all that `mode` measures.
const fn span(mode: Mode) -> (u8, u8) {
    let first = if mode.has_acc() {
        registers::ACC_DATA
    } else if mode.has_mag() {
        registers::MAG_DATA
    } else {
        registers::GYR_DATA
    };
    let end = if mode.has_gyr() {
        registers::EUL_DATA
    } else if mode.has_mag() {
        registers::GYR_DATA
    } else {
        registers::MAG_DATA
    };
    (first, end - first)
}

/// The burst that reads all that `mode` measures: 18 bytes in AMG mode.
pub(crate) const fn burst(mode: Mode) -> Transfer {
    let (first, len) = span(mode);
    Transfer::read(first, len)
}

/// Accelerometer, magnetometer and gyroscope words of a burst; `None` if its length is wrong.
fn words(mode: Mode, bytes: &[u8]) -> Option<[[i16; 3]; 3]> {
    let (first, len) = span(mode);
    if bytes.len() != usize::from(len) {
        return None;
    }
    let mut words = [[0; 3]; 3];
    let skipped = usize::from(first - registers::ACC_DATA) / 2;
    for (to, pair) in words
        .as_flattened_mut()
        .iter_mut()
        .skip(skipped)
        .zip(bytes.as_chunks::<2>().0)
    {
        *to = i16::from_le_bytes(*pair);
    }
    Some(words)
}

/// A jump is judged against a good sample not older than this; after a longer gap anything may have happened.
pub const STEP_AGE_US: u64 = 35_000;

/// So many bursts with the very same angular rates are a dead gyroscope: its noise moves the last bit all the time.
/// Kept apart from the frozen chip because the other sensors go on (hardware reports of a gyroscope at zero for ever).
const GYR_STILL_MAX: u8 = 20;

/// A word of -1 that lay farther than this from -1 in the last good sample is not believed:
/// 2 m/s^2 or 0.2 g, 5 uT, 4 deg/s (counts are alike in all units).
const ONES_JUMP: [u16; 3] = [200, 80, 64];

/// More than this many words of -1 in a sample are never chance.
///
/// At rest and level, five of the nine words (two of acceleration, three of rate) hover round zero and are -1 one time in
/// five, so that three at once are common and even a rate of (-1, -1, -1) comes every few seconds.
const ONES_MAX: usize = 5;

/// Magnetic field that no sensor axis measures, counts: 1300 uT and 3 %.
const MAG_MAX: u16 = 21_450;

/// Acceleration and field that chips were seen to show around crashes (m/s^2 units).
const CRASH_PATTERN: [[i16; 3]; 2] = [[1962, 568, 0], [0, 5120, 3843]];

/// The judge of bursts: remembers as much of the past as it needs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Inspector {
    /// Last burst, good or bad, and how often it and its rates came in a row.
    last: Option<[[i16; 3]; 3]>,
    equal: u8,
    gyr_still: u8,
    /// Last good sample.
    good: Option<(Micros, [[i16; 3]; 3])>,
    /// Last sample, if it was held back for a jump that the next one may confirm.
    jumped: Option<[[i16; 3]; 3]>,
}

/// A burst that was believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Judged {
    pub(crate) sample: RawSample,
    /// Whether it differs from the burst before.
    pub(crate) fresh: bool,
}

impl Inspector {
    /// The sample in a burst, or why it is none.
    pub(crate) fn judge(
        &mut self,
        config: &Config,
        time: Micros,
        bytes: &[u8],
    ) -> Result<Judged, SensorFault> {
        let mode = config.mode;
        let now = words(mode, bytes).ok_or(SensorFault::Protocol)?;
        let [acc, mag, gyr] = now;

        let fresh = self.last != Some(now);
        self.equal = if fresh {
            1
        } else {
            self.equal.saturating_add(1)
        };
        let same_rates = self.last.is_some_and(|[_, _, last]| last == gyr);
        self.gyr_still = if same_rates {
            self.gyr_still.saturating_add(1)
        } else {
            1
        };
        self.last = Some(now);
        let jumped = self.jumped.take();

        if all_zero(mode, &now) {
            return Err(SensorFault::Reset);
        }
        if self.all_ones(time, &now) {
            return Err(SensorFault::AllOnes);
        }
        let noisy_gyr = mode.has_gyr() && !mode.is_fusion() && config.power == Power::Normal;
        if self.equal >= config.frozen_after.get() || noisy_gyr && self.gyr_still >= GYR_STILL_MAX {
            return Err(SensorFault::Frozen);
        }
        if out_of_range(config, &now) {
            return Err(SensorFault::Implausible);
        }
        if config.units.acc == AccUnit::MetrePerSecondSquared && [acc, mag] == CRASH_PATTERN {
            return Err(SensorFault::Implausible);
        }
        if let Some(limit) = config.step_limit
            && let Some((then, good)) = self.good
            && time.since(then) <= STEP_AGE_US
            && moved(&good, &now, limit)
        {
            // A second burst at the new place, and not merely the same bytes again, shows a real jump.
            let confirmed = fresh && jumped.is_some_and(|jumped| !moved(&jumped, &now, limit));
            if !confirmed {
                self.jumped = Some(now);
                return Err(SensorFault::Torn);
            }
        }
        self.good = Some((time, now));
        Ok(Judged {
            sample: RawSample {
                time,
                acc,
                mag,
                gyr,
            },
            fresh,
        })
    }

    /// Words of 0xFFFF that are not chance (see [`ONES_JUMP`] and [`ONES_MAX`]).
    ///
    /// Gravity and the earth's field cannot both be -1 count on all their axes; an angular rate can.
    fn all_ones(&self, time: Micros, now: &[[i16; 3]; 3]) -> bool {
        let [acc, mag, _] = now;
        if *acc == [-1; 3] || *mag == [-1; 3] {
            return true;
        }
        if now
            .as_flattened()
            .iter()
            .filter(|&&word| word == -1)
            .count()
            > ONES_MAX
        {
            return true;
        }
        let Some((then, good)) = &self.good else {
            return false;
        };
        time.since(*then) <= STEP_AGE_US
            && now
                .iter()
                .zip(good)
                .zip(ONES_JUMP)
                .any(|((now, good), jump)| {
                    now.iter()
                        .zip(good)
                        .any(|(&now, &good)| now == -1 && good.abs_diff(-1) > jump)
                })
    }
}

/// The signature of CONFIG mode: all outputs are zero. A field of zero may also be a magnetometer that has not yet measured,
/// so that acceleration and rate suffice where both are live.
fn all_zero(mode: Mode, [acc, mag, gyr]: &[[i16; 3]; 3]) -> bool {
    let both = mode.has_acc() && mode.has_gyr();
    *acc == [0; 3] && *gyr == [0; 3] && (both || *mag == [0; 3])
}

/// Beyond the configured ranges and 3 %, or no magnetic field at all.
fn out_of_range(config: &Config, [acc, mag, gyr]: &[[i16; 3]; 3]) -> bool {
    let g = match config.units.acc {
        AccUnit::MetrePerSecondSquared => 981,
        AccUnit::MilliG => 1000,
    };
    let acc_range = u16::from(config.sensors.acc_range.g()) * g;
    // 16 counts for 1 deg/s; 900 for 1 rad/s are 2 % fewer. Fusion modes choose the range themselves.
    let gyr_range = if config.mode.is_fusion() {
        32_000
    } else {
        config.sensors.gyr_range.dps() * 16
    };
    let beyond =
        |words: &[i16; 3], limit: u16| words.iter().any(|word| word.unsigned_abs() > limit);
    beyond(acc, acc_range + acc_range / 32)
        || beyond(gyr, gyr_range + gyr_range / 32)
        || beyond(mag, MAG_MAX)
        || config.mode.has_mag() && *mag == [0; 3]
}

/// Whether any word moved by more than `limit`.
fn moved(from: &[[i16; 3]; 3], to: &[[i16; 3]; 3], limit: u16) -> bool {
    from.as_flattened()
        .iter()
        .zip(to.as_flattened())
        .any(|(from, to)| from.abs_diff(*to) > limit)
}
