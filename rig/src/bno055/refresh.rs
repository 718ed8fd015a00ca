//! What the chip does at each of its refreshes: it samples the sensors, calibrates itself, and
//! writes the data registers.

use super::calibration::Learner;
use super::registers::{Mode, error, page0, page1};
use super::settings;
use super::words::{FusionWords, MAG_PER_UT, acc_per_m_s2, gyr_per_rad_s, words};
use super::{Bno055, FaultKind, GROUPS, RefreshRates};
use crate::inertial::{Playback, Refresh, Sample, Settings};
use rand::Rng;
use samd21::board::Ticks;

/// The registers that decide how a sample becomes words: UNIT_SEL, AXIS_MAP_CONFIG, AXIS_MAP_SIGN.
#[derive(Clone, Copy, Debug)]
pub(super) struct Output {
    pub(super) units: u8,
    pub(super) map: u8,
    pub(super) sign: u8,
}

/// Which of accelerometer, magnetometer and gyroscope are refreshed, in the order of registers.
type Group = [bool; 3];

const ALL: Group = [true; 3];
const GYROSCOPE: usize = 2;

/// When the data registers are refreshed, by the chip's own clock: all of them together, and each
/// sensor's by itself where [`RefreshRates`] says so.
#[derive(Clone, Debug)]
pub(super) struct RefreshClock {
    /// Time between two refreshes at 100 Hz, s.
    period_s: f64,
    next: Ticks,
    own: Option<[OwnClock; 3]>,
}

/// The refreshes of one sensor.
#[derive(Clone, Copy, Debug)]
struct OwnClock {
    period: Ticks,
    /// Time from the chip's start to the first one.
    phase: Ticks,
    next: Ticks,
}

impl RefreshClock {
    /// With `period_s` between two refreshes at 100 Hz; the phases of the sensors' own clocks are
    /// drawn from `dice`.
    pub(super) fn new(period_s: f64, rates: Option<RefreshRates>, dice: &mut impl Rng) -> Self {
        let own = rates.map(|rates| {
            [rates.acc_hz, rates.mag_hz, rates.gyr_hz].map(|hz| {
                let own_s = 100.0 * period_s / hz;
                OwnClock {
                    period: Ticks::from_secs_f64(own_s),
                    phase: Ticks::from_secs_f64(own_s * dice.random_range(0.0..1.0)),
                    next: Ticks::ZERO,
                }
            })
        });
        Self { period_s, next: Ticks::ZERO, own }
    }

    /// The chip starts.
    pub(super) fn start(&mut self, at: Ticks) {
        self.next = at;
        for clock in self.own.iter_mut().flatten() {
            clock.next = at + clock.phase;
        }
    }

    /// Skips the refreshes up to `at` when the chip enters a mode; the phases stay.
    pub(super) fn pass(&mut self, at: Ticks, mode: Mode) {
        let period = self.period(mode);
        while self.next <= at {
            self.next += period;
        }
        for clock in self.own.iter_mut().flatten() {
            while clock.next <= at {
                clock.next += clock.period;
            }
        }
    }

    /// Time between two refreshes of all sensors together.
    fn period(&self, mode: Mode) -> Ticks {
        Ticks::from_secs_f64(self.period_s * 100.0 / mode.refresh_hz())
    }

    /// The earliest refresh that is due at `now` and the sensors that it is for.
    fn take(&mut self, now: Ticks, mode: Mode, together: bool) -> Option<(Ticks, Group)> {
        match &mut self.own {
            Some(own) if !together => {
                let first = (0..own.len()).min_by_key(|&i| own[i].next)?;
                let at = own[first].next;
                (at <= now).then(|| {
                    own[first].next += own[first].period;
                    (at, [0, 1, 2].map(|i| i == first))
                })
            }
            _ => {
                let at = self.next;
                (at <= now).then(|| {
                    self.next += self.period(mode);
                    (at, ALL)
                })
            }
        }
    }
}

impl Bno055 {
    /// Carries out the refreshes that are due up to `now`.
    pub(super) fn refresh_until(&mut self, now: Ticks) {
        let together = self.mode.is_fusion() || self.signals.playback.is_some();
        while let Some((at, sensors)) = self.clock.take(now, self.mode, together) {
            let settings = self.settings();
            // The sensors go on converting even while the registers stand still.
            let sample = if sensors == ALL {
                self.signals.refresh(at, &settings)
            } else {
                let [_, field, _] = sensors;
                self.signals.sample(at, field)
            };
            let suspended = self.get(page0::PWR_MODE) == 2;
            let refused = self.get(page0::SYS_ERR) == error::FUSION_CONFIG;
            let Some(sample) = sample else { continue };
            if self.mode == Mode::Config || suspended || refused {
                continue;
            }
            if self.mode.is_fusion() {
                self.calibrate(&sample);
            }
            let faultless = self.words(&sample, &settings, self.output);
            for (sensor, on) in sensors.into_iter().enumerate() {
                if on {
                    self.faultless[sensor] = faultless[sensor];
                }
            }
            if !self.faults.has(FaultKind::Frozen) && !self.faults.has(FaultKind::AllZero) {
                self.write_data(at, &sample, &settings, sensors);
            }
        }
    }

    /// Gives a sample to the chip's own calibration and writes the offsets that it learned to the
    /// profile.
    fn calibrate(&mut self, sample: &Sample) {
        let hard_iron = self.signals.errors.hard_iron_ut;
        let field = [0, 1, 2].map(|axis| sample.mag_ut[axis] - hard_iron[axis]);
        let dt_s = self.clock.period(self.mode).as_secs_f64();
        let units = self.get(page0::UNIT_SEL);
        for learner in self.calibration.update(self.mode, sample, field, dt_s) {
            let (offset, scale) = match learner {
                Learner::Accelerometer => (self.signals.acc_offset_m_s2(), acc_per_m_s2(units)),
                Learner::Magnetometer => (hard_iron, MAG_PER_UT),
                Learner::Gyroscope => (self.signals.gyro_bias_rad_s(), gyr_per_rad_s(units)),
            };
            let (first, _) = GROUPS[learner as usize];
            let words = offset.map(|value| (value * scale).round() as i16);
            self.set_words(page0::ACC_OFFSET + first as u8, &words);
        }
    }

    /// True when a byte of this group of the profile is not zero.
    pub(super) fn is_set(&self, group: usize) -> bool {
        let (first, words) = GROUPS[group];
        (0..2 * words).any(|byte| self.get(page0::ACC_OFFSET + (first + byte) as u8) != 0)
    }

    /// Ranges and bandwidths in force.
    pub(super) fn settings(&self) -> Settings {
        let page = &self.pages[1];
        settings::decode(
            self.mode,
            page[usize::from(page1::ACC_CONFIG)],
            page[usize::from(page1::MAG_CONFIG)],
            page[usize::from(page1::GYR_CONFIG_0)],
        )
    }

    /// Writes a sample into the data registers of these sensors.
    fn write_data(&mut self, at: Ticks, sample: &Sample, settings: &Settings, sensors: Group) {
        if sensors[GYROSCOPE] {
            self.refresh =
                Refresh { at, recorded: self.signals.playback.as_ref().map(Playback::shown) };
        }
        let data = usize::from(page0::ACC_DATA)..usize::from(page0::TEMP);
        self.older.copy_from_slice(&self.pages[0][data]);
        let output = self.output();
        let mut words = self.words(sample, settings, output);
        if self.faults.has(FaultKind::GyroDead) {
            words[GYROSCOPE].fill(0);
        }
        for (sensor, words) in words.iter().enumerate() {
            if sensors[sensor] {
                self.set_words(page0::ACC_DATA + 6 * sensor as u8, words);
            }
        }
        if self.mode.is_fusion() {
            let fusion = FusionWords::of(sample, output.units);
            self.set_words(page0::EUL_DATA, &fusion.euler);
            self.set_words(page0::QUA_DATA, &fusion.quaternion);
            self.set_words(page0::LIA_DATA, &output.remap(fusion.linear));
            self.set_words(page0::GRV_DATA, &output.remap(fusion.gravity));
        }
        if self.faults.has(FaultKind::FixedPattern) {
            self.set_words(page0::ACC_DATA, &[1962, 568, 0]);
            self.set_words(page0::MAG_DATA, &[0, 5120, 3843]);
            self.set_words(page0::GYR_DATA, &[0; 3]);
        }
    }

    /// The words of a sample: accelerometer, magnetometer, gyroscope. Those of a sensor that the
    /// mode leaves off are zero.
    fn words(&self, sample: &Sample, settings: &Settings, output: Output) -> [[i16; 3]; 3] {
        let mode = self.mode;
        let mut all = words(sample, output.units, settings);
        let on = [mode.has_acc(), mode.has_mag(), mode.has_gyr()];
        for ((words, on), (first, _)) in all.iter_mut().zip(on).zip(GROUPS) {
            if mode.is_fusion() {
                let offsets = (page0::ACC_OFFSET + first as u8..).step_by(2);
                for (word, offset) in words.iter_mut().zip(offsets) {
                    *word = word.saturating_sub(self.word(offset));
                }
            }
            *words = if on { output.remap(*words) } else { [0; 3] };
        }
        all
    }

    pub(super) fn output(&self) -> Output {
        Output {
            units: self.get(page0::UNIT_SEL),
            map: self.get(page0::AXIS_MAP_CONFIG),
            sign: self.get(page0::AXIS_MAP_SIGN),
        }
    }
}

impl Output {
    /// A vector along the package axes, turned to the output axes (data sheet 3.4).
    fn remap(&self, v: [i16; 3]) -> [i16; 3] {
        [0u8, 1, 2].map(|axis| {
            let value = v[usize::from(self.map >> (2 * axis) & 3)];
            match self.sign >> (2 - axis) & 1 {
                0 => value,
                _ => value.saturating_neg(),
            }
        })
    }
}
