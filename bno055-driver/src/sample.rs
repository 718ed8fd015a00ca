//! The sampling burst: what it reads, what it gives, and whether to believe it.

mod field;

use crate::config::{AccUnit, Config, MAG_UT, Mode, Power, Units};
use crate::fault::SensorFault;
use crate::registers;
use crate::sensors::GyrBandwidth;
use crate::transfer::{Micros, Transfer};
use crate::words;
use field::FieldChanges;

/// One sample as the chip gave it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawSample {
    /// Start of its burst.
    pub time: Micros,
    /// Acceleration, counts; zero in modes without accelerometer.
    pub acc: [i16; 3],
    /// Magnetic field, counts of 1/16 uT; zero in modes without magnetometer, and from one that
    /// measures nothing where that is no fault.
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

/// Bytes of the rates.
const RATES: u8 = registers::EUL_DATA - registers::GYR_DATA;

/// The burst that reads the rates alone, where `mode` measures more than them.
pub(crate) const fn rates_burst(mode: Mode) -> Option<Transfer> {
    let (_, len) = span(mode);
    if mode.has_gyr() && len > RATES {
        Some(Transfer::read(registers::GYR_DATA, RATES))
    } else {
        None
    }
}

/// Whether an answer of ones alone may be right: rates of -1 on all axes come every few seconds at
/// rest.
pub(crate) fn may_be_ones(bytes: &[u8]) -> bool {
    bytes.is_empty() || bytes.len() == usize::from(RATES)
}

/// Accelerometer, magnetometer and gyroscope words of a burst. In whole machine words, by which
/// small cores copy faster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(4))]
struct Words([[i16; 3]; 3]);

/// The words of a burst, zero for sensors that `mode` does not run; `None` if its length is wrong.
fn words(mode: Mode, bytes: &[u8]) -> Option<Words> {
    let (first, len) = span(mode);
    if bytes.len() != usize::from(len) {
        return None;
    }
    let mut words = [[0; 3]; 3];
    let skipped = usize::from(first - registers::ACC_DATA) / 2;
    words::decode(words.as_flattened_mut().get_mut(skipped..)?, bytes);
    Some(Words(words))
}

/// A burst is compared with the last good one only up to this age; after a longer gap anything may
/// have happened.
pub const STEP_AGE_US: u64 = 35_000;

/// So many different bursts in a row with the very same angular rates show a dead gyroscope: a live
/// one's noise moves the last bit all the time.
///
/// This is a rule of its own because the other sensors go on (users report gyroscopes that stay at
/// zero for ever). At 23 Hz bandwidth, where the noise is 1.4 counts, all three rates stay the same
/// in one of 70 samples, and in six in a row once in 10^11: a false alarm in half a century. At
/// wider bandwidths there is none.
///
/// A gyroscope that is refreshed more slowly than the other sensors has the same rates in several
/// different bursts: see [`Inspector::still_max`].
const GYR_STILL_MAX: u8 = 7;

/// The same at 12 Hz bandwidth, with one count of noise on each axis: all three rates stay the same
/// in one of 23 samples, and in seven in a row once in 10^9, which is a false alarm a year.
const QUIET_GYR_STILL_MAX: u8 = 8;

/// Of them, refreshes that must have the same rates however slowly they come.
const GYR_STILL_REFRESHES: u8 = 4;

/// Most different bursts with the same rates that a slow refresh is taken for: an accelerometer at
/// 100 Hz and a gyroscope at 35 Hz, with a reserve.
const GYR_RUN_MAX: u8 = 4;

/// Of a burst, in which the mean number with the same rates is kept.
const GYR_RUN_UNIT: u16 = 256;

/// Over so many refreshes is that mean taken.
const GYR_RUN_MEAN: u16 = 16;

/// Rates that become zero on all axes in the burst behind one that turned faster than this, 4 deg/s
/// (about the same counts in all units), are none, until the last bit moves: a body that stops as
/// hard has noise. The gyroscope has died, or a data line that was held low has zeroed the end of
/// the burst. Without this rule [`GYR_STILL_MAX`] bursts of a turning body would pass for rest.
const GYR_TURNS: u16 = 64;

/// A word of -1 is not believed if the last good sample was farther than this from -1:
/// 2 m/s^2 or 0.2 g, 5 uT, 4 deg/s (about the same counts in all units).
///
/// The field is refreshed 20 times a second, between which a turning body passes more than that.
/// One of its words may then stay -1 for 50 ms, long enough to be given up: in the next burst the
/// same field is believed. One that was lost on the wire has ones to the end of the burst, and is
/// not believed while the rates are -1 as well. Rates that are refreshed more slowly than they are
/// read are treated likewise: a turn that is about to reverse would cost all bursts of a refresh.
const ONES_JUMP: [u16; 3] = [200, 80, 64];

/// Rates that let the field move by a count more: in 50 ms a turn of 1/16 deg/s moves the earth's
/// field, of 65 uT at most, by 0.057 counts.
const FIELD_PER_RATE: u16 = 16;

/// More than this many words of -1 in a sample are never chance.
///
/// At rest and level, five of the nine words (two of acceleration, three of rate) lie near zero and
/// are -1 one time in five: three at once are common, and even a rate of (-1, -1, -1) comes every
/// few seconds.
const ONES_MAX: usize = 5;

/// Largest magnetic field that an axis of the sensor measures, counts: 1300 uT and a sixty-fourth.
const MAG_MAX: u16 = 21_125;

/// Acceleration and field that chips were seen to show around crashes (m/s^2 units).
const CRASH_PATTERN: [[i16; 3]; 2] = [[1962, 568, 0], [0, 5120, 3843]];

/// The judge of bursts, with what it remembers of those before.
#[derive(Clone, Debug)]
pub(crate) struct Inspector {
    /// Last burst, good or bad.
    last: Option<Words>,
    /// How many bursts in a row were equal to the last one.
    equal: u8,
    /// How many different bursts in a row had the last one's angular rates.
    gyr_still: u8,
    /// How many different bursts have the same rates in the mean, times [`GYR_RUN_UNIT`].
    gyr_run: u16,
    /// The rates are zero since the burst behind one that turned, see [`GYR_TURNS`].
    gyr_died: bool,
    /// Last good sample.
    good: Option<(Micros, Words)>,
    /// The last good rates that were others than its.
    gyr_before: Option<[i16; 3]>,
    /// When the words of the field last changed.
    field: FieldChanges,
    /// Last burst, if it was held back for a jump that the next one may confirm.
    jumped: Option<Words>,
    /// The last burst was good.
    content: bool,
    /// The last burst was of the rates alone.
    alone: bool,
}

/// A burst that was believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Judged {
    pub(crate) sample: RawSample,
    /// Whether it differs from the burst before.
    pub(crate) fresh: bool,
}

impl Default for Inspector {
    fn default() -> Self {
        Self {
            last: None,
            equal: 0,
            gyr_still: 0,
            // Until it is known otherwise the refresh is slow, so that none is taken for death.
            gyr_run: u16::from(GYR_RUN_MAX) * GYR_RUN_UNIT,
            gyr_died: false,
            good: None,
            gyr_before: None,
            field: FieldChanges::default(),
            jumped: None,
            content: false,
            alone: false,
        }
    }
}

impl Inspector {
    /// Whether the last burst was good.
    pub(crate) fn is_content(&self) -> bool {
        self.content
    }

    /// Whether the last burst was of the rates alone.
    pub(crate) fn was_alone(&self) -> bool {
        self.alone
    }

    /// A burst brought no data: it was not good.
    pub(crate) fn unheard(&mut self) {
        self.content = false;
    }

    /// The sample in a burst, or the fault of the first rule that the burst breaks.
    pub(crate) fn judge(
        &mut self,
        config: &Config,
        time: Micros,
        bytes: &[u8],
    ) -> Result<Judged, SensorFault> {
        let alone = rates_burst(config.mode).is_some() && bytes.len() == usize::from(RATES);
        let was_alone = core::mem::replace(&mut self.alone, alone);
        let was_content = core::mem::take(&mut self.content);
        let now = match (alone, self.good) {
            (false, _) => words(config.mode, bytes).ok_or(SensorFault::Protocol)?,
            (true, Some((_, Words([acc, mag, _])))) if was_content => {
                let mut rates = [0; 3];
                words::decode(&mut rates, bytes);
                Words([acc, mag, rates])
            }
            // There is nothing to judge them by.
            (true, _) => return Err(SensorFault::Protocol),
        };
        let before = self.last;
        let differs = self.count_repeats(now);
        // One refresh is not to be counted for its rates and, in the next burst, for the rest.
        let fresh = differs && (!was_alone || before.map(rates_of) != Some(rates_of(now)));
        // Only the very next burst can confirm a jump.
        let jumped = self.jumped.take();
        let Words([acc, mag, gyr]) = now;
        self.gyr_died = gyr == [0; 3] && (self.gyr_died || self.turned(time));

        if all_zero(config.mode, &now) {
            return Err(SensorFault::AllZero);
        }
        if self.all_ones(time, &now, before.as_ref()) {
            return Err(SensorFault::AllOnes);
        }
        if self.frozen(config) {
            return Err(SensorFault::Frozen);
        }
        if self.gyr_died && has_noisy_gyr(config) {
            return Err(SensorFault::Torn);
        }
        if out_of_range(config, &now) || crash_pattern(config, &now) {
            self.field.is_seen(time, mag);
            return Err(SensorFault::Implausible);
        }
        if let Some(limit) = config.step_limit
            && self.recent(time).is_some_and(|good| moved(good, &now, limit))
            // A second burst at the new place, and not merely the same bytes again, shows a real
            // jump.
            && !(differs && jumped.is_some_and(|jumped| !moved(&jumped, &now, limit)))
        {
            self.jumped = Some(now);
            self.field.is_seen(time, mag);
            return Err(SensorFault::Torn);
        }
        // A burst of the rates alone has the field of the one before.
        if !alone && config.mode.has_mag() && self.field.come_too_soon(time, mag) {
            return Err(SensorFault::Torn);
        }
        let rates_before = self.recent(time).map(|good| rates_of(*good));
        if rates_before != Some(gyr) {
            self.gyr_before = rates_before;
        }
        self.good = Some((time, now));
        self.content = true;
        let sample = RawSample {
            time,
            acc,
            mag,
            gyr,
        };
        Ok(Judged { sample, fresh })
    }

    /// Counts how often the burst and its rates have come in a row; whether it differs from the
    /// last.
    fn count_repeats(&mut self, now: Words) -> bool {
        let fresh = self.last != Some(now);
        self.equal = if fresh {
            1
        } else {
            self.equal.saturating_add(1)
        };
        let Words([_, _, gyr]) = now;
        let same_rates = self.last.is_some_and(|Words([_, _, last])| last == gyr);
        if !same_rates && self.last.is_some() {
            let run = u16::from(self.gyr_still.clamp(1, GYR_RUN_MAX)) * GYR_RUN_UNIT;
            self.gyr_run = (self.gyr_run * (GYR_RUN_MEAN - 1) + run) / GYR_RUN_MEAN;
        }
        self.gyr_still = match (same_rates, fresh) {
            (false, _) => 1,
            (true, true) => self.gyr_still.saturating_add(1),
            // Nothing was measured between the two.
            (true, false) => self.gyr_still,
        };
        self.last = Some(now);
        fresh
    }

    /// Whether there are words of -1 (0xFFFF on the wire) that are not chance: see [`ONES_JUMP`]
    /// and [`ONES_MAX`].
    ///
    /// Gravity and the earth's field cannot both be -1 count on all their axes; an angular rate
    /// can.
    fn all_ones(&self, time: Micros, now: &Words, before: Option<&Words>) -> bool {
        let Words(words) = now;
        let ones = words.as_flattened().iter().filter(|&&word| word == -1);
        let ones = ones.count();
        if ones == 0 {
            // Nearly always.
            return false;
        }
        let [acc, mag, gyr] = words;
        if *acc == [-1; 3] || *mag == [-1; 3] || ones > ONES_MAX {
            return true;
        }
        let jumps = |now: &[i16; 3], good: &[i16; 3], jump: u16| {
            let mut words = now.iter().zip(good);
            words.any(|(&now, &good)| now == -1 && good.abs_diff(-1) > jump)
        };
        let [acc_jump, mag_jump, gyr_jump] = ONES_JUMP;
        let rates = gyr.iter().map(|rate| rate.unsigned_abs());
        let turn = rates.max().unwrap_or(0) / FIELD_PER_RATE;
        let is_shown_again = before.is_some_and(|Words([_, before, _])| before == mag);
        let rates_again = before.is_some_and(|Words([_, _, before])| before == gyr);
        self.recent(time)
            .is_some_and(|Words([good_acc, good_mag, good_gyr])| {
                jumps(acc, good_acc, acc_jump)
                    || (*gyr == [-1; 3] || !is_shown_again) && jumps(mag, good_mag, mag_jump + turn)
                    || jumps(gyr, good_gyr, gyr_jump)
                        && (*gyr == [-1; 3] || !(rates_again || self.passes(gyr, good_gyr)))
            })
    }

    /// Whether rates that are -1 are where the last two led, within [`ONES_JUMP`] or as much as
    /// they were apart: a turn that reverses passes -1 one time in a hundred.
    fn passes(&self, now: &[i16; 3], good: &[i16; 3]) -> bool {
        let [_, _, jump] = ONES_JUMP;
        self.gyr_before.is_some_and(|before| {
            let mut axes = now.iter().zip(good).zip(&before);
            axes.all(|((&now, &good), &before)| {
                let step = i32::from(good) - i32::from(before);
                let off = i32::from(now) - (i32::from(good) + step);
                now != -1 || off.abs() <= step.abs().max(jump.into())
            })
        })
    }

    /// Whether the last good sample, if it is recent, turned.
    fn turned(&self, time: Micros) -> bool {
        let turns = |rate: &i16| rate.unsigned_abs() > GYR_TURNS;
        self.recent(time)
            .is_some_and(|Words([_, _, rates])| rates.iter().any(turns))
    }

    /// Whether the same burst has come too often, or the same rates from a gyroscope whose noise
    /// shows.
    fn frozen(&self, config: &Config) -> bool {
        let noisy_gyr = has_noisy_gyr(config);
        self.equal >= config.frozen_after.get()
            || noisy_gyr && self.gyr_still >= self.still_max(config)
    }

    /// Different bursts with the same rates that show a dead gyroscope: [`GYR_STILL_MAX`] where
    /// each has new ones, and as many more as [`GYR_STILL_REFRESHES`] take where they come slowly.
    /// Where one refresh in a hundred has the rates of the one before, as at the bandwidth that a
    /// control loop wants, four in a row have them once in 10^8.
    fn still_max(&self, config: &Config) -> u8 {
        let most = match config.sensors.gyr_bandwidth {
            GyrBandwidth::Hz12 => QUIET_GYR_STILL_MAX,
            _ => GYR_STILL_MAX,
        };
        let refreshes = u16::from(GYR_STILL_REFRESHES) * self.gyr_run / GYR_RUN_UNIT;
        most - GYR_STILL_REFRESHES + refreshes as u8
    }

    /// The last good sample, if it is recent enough to be compared with one of `time`.
    fn recent(&self, time: Micros) -> Option<&Words> {
        let (then, good) = self.good.as_ref()?;
        (time.since(*then) <= STEP_AGE_US).then_some(good)
    }
}

fn rates_of(Words([_, _, rates]): Words) -> [i16; 3] {
    rates
}

/// Whether every rate has noise: fusion removes it, and a sleeping sensor has none.
fn has_noisy_gyr(config: &Config) -> bool {
    let mode = config.mode;
    mode.has_gyr() && !mode.is_fusion() && config.power == Power::Normal
}

/// Whether the burst may show CONFIG mode, in which all outputs are zero.
///
/// A field of zero may also be a magnetometer that has not yet measured: where acceleration and
/// rate are both live, they suffice.
fn all_zero(mode: Mode, Words([acc, mag, gyr]): &Words) -> bool {
    let both = mode.has_acc() && mode.has_gyr();
    *acc == [0; 3] && *gyr == [0; 3] && (both || *mag == [0; 3])
}

/// Whether a word is beyond the configured range and a sixty-fourth of it (sensors clip at their
/// range, offsets come on top), or there is no magnetic field at all.
fn out_of_range(config: &Config, Words([acc, mag, gyr]): &Words) -> bool {
    let g = match config.units.acc {
        AccUnit::MetrePerSecondSquared => 981,
        AccUnit::MilliG => 1000,
    };
    let acc_range = u16::from(config.sensors.acc_range.g()) * g;
    // 16 counts for 1 deg/s; 900 for 1 rad/s are 2 % fewer.
    let gyr_range = config.sensors.gyr_range_in(config.mode).dps() * 16;
    let beyond =
        |words: &[i16; 3], limit: u16| words.iter().any(|word| word.unsigned_abs() > limit);
    beyond(acc, acc_range + acc_range / 64)
        || beyond(gyr, gyr_range + gyr_range / 64)
        || beyond(mag, MAG_MAX)
        || config.needs_mag && config.mode.has_mag() && *mag == [0; 3]
}

/// Whether the burst is [`CRASH_PATTERN`].
fn crash_pattern(config: &Config, &Words([acc, mag, _]): &Words) -> bool {
    config.units.acc == AccUnit::MetrePerSecondSquared && [acc, mag] == CRASH_PATTERN
}

/// Whether any word moved by more than `limit`.
fn moved(Words(from): &Words, Words(to): &Words, limit: u16) -> bool {
    from.as_flattened()
        .iter()
        .zip(to.as_flattened())
        .any(|(from, to)| from.abs_diff(*to) > limit)
}

#[cfg(test)]
mod tests;
