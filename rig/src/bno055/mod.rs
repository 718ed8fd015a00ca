//! The BNO055 at register level, as a slave on the I2C bus.
//!
//! Written from the data sheet (BST-BNO055-DS000-14, "DS" and page below) and from users'
//! reports, not from any driver.
//!
//! | register | behaviour | source |
//! |---|---|---|
//! | 00-06 ids | fixed; read 0 for 10-30 ms after the chip first answers | DS-55; users' boot retries |
//! | 07 PAGE_ID | 0 or 1, anything else is ignored; same on both pages | DS-53 |
//! | 08-19 ACC, MAG, GYR | refreshed by the chip's own clock (100 Hz +-1 %, free phase), zero in CONFIG and for sensors that the mode leaves off; MSB shadowed while its LSB is read in the same transfer | DS-22, DS-37 |
//! | 1A-33 EUL, QUA, LIA, GRV | fusion modes only; from the true attitude | DS-22 |
//! | 34 TEMP | the chip's temperature, 27 C unless it warms up ([`WarmUp`]); unit by UNIT_SEL, the same from either source | DS-37 |
//! | 35 CALIB_STAT | 0 without fusion; with it the levels of `calibration`, from rest, poses and motion | DS 3.11; forum reports |
//! | 36 ST_RESULT | 0x0F, gyroscope's bit 0 with the fault | DS-65 |
//! | 37 INT_STA | 0 | |
//! | 38 SYS_CLK_STATUS | 1 for 600 ms after a change of CLK_SEL | MicroPython driver's note |
//! | 39 SYS_STATUS, 3A SYS_ERR | 2, 3 while starting, 0 in CONFIG, 4 in self-test, 5 or 6 running, 1 and code 9 when fusion starts with a refused profile; a mode change clears errors | DS-67; forum reports |
//! | 3B UNIT_SEL, 3E PWR_MODE, 40 TEMP_SOURCE, 41, 42 axis map | writable in CONFIG only; values that do not exist are ignored, a map that uses an axis twice too; suspend stops refreshing | DS-22, DS-25 |
//! | 3D OPR_MODE | any time; shows the new mode after 7 ms (from CONFIG) or 19 ms (to CONFIG); between two running modes it is ignored | DS-21; CircuitPython note |
//! | 3F SYS_TRIGGER | reads 0; RST_SYS boots, SELF_TEST (in CONFIG) takes 400 ms, CLK_SEL in CONFIG | DS-70 |
//! | 43-54 SIC matrix | stored, not applied | DS-51 |
//! | 55-6A offsets, radii | writable in CONFIG; a group counts when its last byte is written; outside its range the group reads 0 and spoils the next fusion mode; offsets are subtracted in fusion modes only, where the chip overwrites them with what it has learned; the radii stay what was written | DS-31..34; forum reports |
//! | page 1 08-0D | sensor settings, writable in CONFIG only; ranges that do not exist are ignored; fusion keeps only the accelerometer's range | DS-27 |
//! | page 1 0F, 10 | stored, any mode; 11-1F in CONFIG | DS-22 |
//! | page 1 50-5F | unique id out of the seed | |
//!
//! On the bus: address 0x28 or 0x29; no acknowledge for 400-650 ms after power-on and reset;
//! every byte, the address included, is stretched by about 180 us; the register pointer counts on
//! by itself and survives a STOP.
//!
//! The gyroscope's bias and the accelerometer's offset drift with the chip's temperature, if
//! [`ImuErrors`] says so.
//!
//! Left out: the chip's own fusion and calibration algorithms (the truth stands in for what they
//! find), interrupts (no board wires INT, and it has been seen not to fire), low power mode (as
//! normal), the soft-iron matrix, HID-I2C and UART, the START directly followed by a STOP that the
//! chip does not recognise. Slow edges of the bus are not modelled as such: what they do to the data
//! is [`Fault::BitFlips`].
//!
//! Faults that can be switched on and off while it runs are the variants of [`Fault`]; what each
//! does to registers or lines stands there.

mod access;
mod bus;
mod calibration;
mod fault;
mod fault_kind;
mod imperfections;
mod registers;
mod replay;
mod sensors;
mod signal;
mod words;

#[cfg(test)]
mod tests;

pub use fault::{Fault, Faults};
pub use fault_kind::FaultKind;
pub use imperfections::{ImuErrors, WarmUp};
pub use registers::Mode;
pub use sensors::{Reading, Sensors};
pub(crate) use signal::STANDARD_GRAVITY_M_S2;
pub use signal::Stimulus;

use crate::random::{Stream, generator};
use calibration::{Calibration, Learner};
use rand::{Rng, RngCore};
use rand_chacha::ChaCha8Rng;
use recordings::Recording;
use registers::{AXIS_MAP_RESET, UNIT_SEL_RESET, error, page0, page1, reset_pages};
use replay::Playback;
use samd21::board::Ticks;
use signal::{Sample, Settings, SignalChain};
use std::ops::RangeInclusive;
use std::sync::Arc;
use words::{FusionWords, Words, acc_per_m_s2, gyr_per_rad_s, mag_per_ut};

/// What is fixed about one sensor and its place on the bus.
#[derive(Clone, Debug)]
pub struct Config {
    /// Seed of everything random about it.
    pub seed: u64,
    /// 7-bit address: 0x28 or 0x29.
    pub address: u8,
    /// Imperfections of the sensors.
    pub errors: ImuErrors,
    /// From power-on to the first acknowledge, ms; drawn uniformly.
    pub boot_ms: RangeInclusive<u64>,
    /// Clock stretching of a byte, us; drawn uniformly.
    pub stretch_us: RangeInclusive<u64>,
    /// Largest deviation of the chip's clock, relative; drawn uniformly.
    pub clock_error: f64,
    /// A reset by command leaves the chip dead until its power is cut, as some units do.
    pub reset_hangs: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            address: 0x28,
            errors: ImuErrors::default(),
            boot_ms: 400..=650,
            stretch_us: 160..=200,
            clock_error: 0.01,
            reset_hangs: false,
        }
    }
}

/// The chip's supply and start.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Power {
    Off,
    /// Reset hung: does not answer until the power is cut.
    Hung,
    /// Does not acknowledge before `answers`; then ids and settings are not there before `ready`.
    Booting {
        answers: Ticks,
        ready: Ticks,
    },
    On,
}

/// Where in a transfer the bus is.
#[derive(Clone, Copy, Debug, Default)]
struct Transfer {
    selected: bool,
    expects_pointer: bool,
    /// The most significant byte that belongs to the least significant one read last, and where.
    shadow: Option<(u8, u8)>,
}

/// A refresh of the data registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refresh {
    /// When the registers took it.
    pub at: Ticks,
    /// The newest sample of the recording in it, when one plays.
    pub recorded: Option<usize>,
}

/// An emulated BNO055.
///
/// `sense` is called with the physical truth in steps of at most 1 ms; `i2c` is its bus. Times must
/// not go back. `Clone` copies the whole state, random generators included.
#[derive(Clone, Debug)]
pub struct Bno055 {
    config: Config,
    unique_id: [u8; 16],
    bus_noise: ChaCha8Rng,
    signals: SignalChain,
    refresh_period_s: f64,
    next_refresh: Ticks,
    refresh: Refresh,
    power: Power,
    pages: [[u8; 128]; 2],
    page: usize,
    staged: [u8; 22],
    refused: [bool; GROUPS.len()],
    mode: Mode,
    calibration: Calibration,
    switching: Option<(Mode, Ticks)>,
    self_test_until: Ticks,
    clock_busy_until: Ticks,
    pointer: u8,
    transfer: Transfer,
    /// The line that another master holds low, until then.
    foreign_until: Ticks,
    faults: Faults,
    /// The data registers as they were before the last refresh.
    older: [u8; DATA],
    output: Output,
    faultless: [i16; 9],
}

/// The registers that decide how a sample becomes words.
#[derive(Clone, Copy, Debug)]
struct Output {
    units: u8,
    map: u8,
    sign: u8,
}

/// Length of the data registers.
const DATA: usize = (page0::TEMP - page0::ACC_DATA) as usize;

/// The groups of calibration registers: first byte in the block of 22, number of words.
const GROUPS: [(usize, usize); 5] = [(0, 3), (6, 3), (12, 3), (18, 1), (20, 1)];

impl Bno055 {
    /// A sensor that gets its power at time zero.
    pub fn new(config: Config) -> Self {
        let mut unit = generator(config.seed, Stream::SensorUnit);
        let noise = generator(config.seed, Stream::SensorNoise);
        let mut unique_id = [0; 16];
        unit.fill_bytes(&mut unique_id);
        let clock = 1.0 + config.clock_error * unit.random_range(-1.0..=1.0);
        let signals = SignalChain::new(config.errors, &mut unit, noise);
        let mut chip = Self {
            unique_id,
            bus_noise: generator(config.seed, Stream::Bus),
            signals,
            refresh_period_s: 0.01 * clock,
            next_refresh: Ticks::ZERO,
            refresh: Refresh::default(),
            power: Power::Off,
            pages: reset_pages(unique_id),
            page: 0,
            staged: [0; 22],
            refused: [false; GROUPS.len()],
            mode: Mode::Config,
            calibration: Calibration::default(),
            switching: None,
            self_test_until: Ticks::ZERO,
            clock_busy_until: Ticks::ZERO,
            pointer: 0,
            transfer: Transfer::default(),
            foreign_until: Ticks::ZERO,
            faults: Faults::default(),
            older: [0; DATA],
            output: Output {
                units: UNIT_SEL_RESET,
                map: AXIS_MAP_RESET,
                sign: 0,
            },
            faultless: [0; 9],
            config,
        };
        chip.boot(Ticks::ZERO);
        chip
    }

    /// Puts a recording in place of the sensors; its first sample lies at `start`.
    pub fn play(&mut self, recording: Arc<Recording>, start: Ticks) {
        self.signals.play(Playback::new(recording, start));
    }

    /// The recording that plays has come to its end.
    pub fn playback_finished(&self) -> bool {
        self.signals.playback().is_some_and(Playback::finished)
    }

    /// What the data registers show now.
    pub fn refreshed(&self) -> Refresh {
        self.refresh
    }

    /// What the data registers would show now if the chip had no fault and were set up as its master
    /// left it at the last change of mode: accelerometer, magnetometer, gyroscope. Zero until it has
    /// sampled.
    pub fn faultless_words(&self) -> [i16; 9] {
        self.faultless
    }

    /// Its 7-bit address on the bus.
    pub fn address(&self) -> u8 {
        self.config.address
    }

    /// The mode in force.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The gyroscope's true bias now, rad/s along the package axes.
    pub fn gyro_bias_rad_s(&self) -> [f64; 3] {
        self.signals.gyro_bias_rad_s()
    }

    /// Applies `truth` to the sensors from the last call until `now`.
    pub fn sense(&mut self, now: Ticks, truth: &Stimulus) {
        self.run(now);
        let settings = self.settings();
        self.signals.sense(now, truth, &settings);
    }

    fn boot(&mut self, now: Ticks) {
        self.reset_registers();
        self.transfer = Transfer::default();
        let range = self.config.boot_ms.clone();
        let answers = now + Ticks::from_ms(self.bus_noise.random_range(range));
        let ready = answers + Ticks::from_ms(self.bus_noise.random_range(10..=30));
        self.power = Power::Booting { answers, ready };
    }

    fn reset_registers(&mut self) {
        self.pages = reset_pages(self.unique_id);
        self.page = 0;
        self.staged = [0; 22];
        self.refused = [false; GROUPS.len()];
        self.mode = Mode::Config;
        self.switching = None;
        self.self_test_until = Ticks::ZERO;
        self.clock_busy_until = Ticks::ZERO;
        self.pointer = 0;
        self.signals.restart();
    }

    /// Everything the chip does by itself up to `now`.
    fn run(&mut self, now: Ticks) {
        if let Power::Booting { ready, .. } = self.power {
            if now < ready {
                return;
            }
            self.power = Power::On;
            self.next_refresh = ready;
        }
        if self.power != Power::On {
            return;
        }
        if let Some((mode, at)) = self.switching
            && at <= now
        {
            self.refresh_until(at);
            self.enter(mode, at);
        }
        self.refresh_until(now);
    }

    fn enter(&mut self, mode: Mode, at: Ticks) {
        self.switching = None;
        self.mode = mode;
        self.calibration = Calibration::new([0, 1, 2].map(|group| self.is_set(group)));
        self.output = self.output();
        self.clear_data();
        self.signals.restart();
        // A profile that was refused lets no fusion start; any other error is over.
        let spoiled = mode.is_fusion() && self.refused.contains(&true);
        let error = if spoiled { error::FUSION_CONFIG } else { 0 };
        self.set(page0::SYS_ERR, error);
        // The refresh goes on at its own phase, which the first one after a start-up sets.
        let period = self.refresh_period();
        while self.next_refresh <= at {
            self.next_refresh += period;
        }
    }

    fn refresh_period(&self) -> Ticks {
        Ticks::from_secs_f64(self.refresh_period_s * 100.0 / self.mode.refresh_hz())
    }

    fn refresh_until(&mut self, now: Ticks) {
        while self.next_refresh <= now {
            let at = self.next_refresh;
            self.next_refresh += self.refresh_period();
            let settings = self.settings();
            // The sensors convert on, whether or not the registers follow.
            let sample = self.signals.refresh(at, &settings);
            let suspended = self.get(page0::PWR_MODE) == 2;
            let spoiled = self.get(page0::SYS_ERR) == error::FUSION_CONFIG;
            let stopped = self.faults.has(Fault::Frozen) || self.faults.has(Fault::AllZero);
            let Some(sample) = sample else { continue };
            if self.mode == Mode::Config || suspended || spoiled {
                continue;
            }
            if self.mode.is_fusion() {
                self.calibrate(&sample);
            }
            self.faultless = self.words(&sample, &settings, self.output);
            if !stopped {
                self.show(at, &sample, &settings);
            }
        }
    }

    /// Gives a sample to the chip's own calibration; the offsets that it learns go into the profile.
    fn calibrate(&mut self, sample: &Sample) {
        let hard_iron = self.signals.hard_iron_ut();
        let field = [0, 1, 2].map(|axis| sample.mag_ut[axis] - hard_iron[axis]);
        let dt_s = self.refresh_period().as_secs_f64();
        let units = self.get(page0::UNIT_SEL);
        for learner in self.calibration.update(self.mode, sample, field, dt_s) {
            let (offset, scale) = match learner {
                Learner::Accelerometer => (self.signals.acc_offset_m_s2(), acc_per_m_s2(units)),
                Learner::Magnetometer => (hard_iron, mag_per_ut()),
                Learner::Gyroscope => (self.signals.gyro_bias_rad_s(), gyr_per_rad_s(units)),
            };
            let (first, _) = GROUPS[learner as usize];
            let words = offset.map(|value| (value * scale).round() as i16);
            self.set_words(page0::ACC_OFFSET + first as u8, &words);
        }
    }

    /// The group of the profile is not zero.
    fn is_set(&self, group: usize) -> bool {
        let (first, words) = GROUPS[group];
        (0..2 * words).any(|byte| self.get(page0::ACC_OFFSET + (first + byte) as u8) != 0)
    }

    fn settings(&self) -> Settings {
        let page = &self.pages[1];
        Settings::decode(
            self.mode,
            page[usize::from(page1::ACC_CONFIG)],
            page[usize::from(page1::MAG_CONFIG)],
            page[usize::from(page1::GYR_CONFIG_0)],
        )
    }

    /// Writes a sample into the data registers.
    fn show(&mut self, at: Ticks, sample: &Sample, settings: &Settings) {
        self.refresh = Refresh {
            at,
            recorded: self.signals.playback().map(Playback::shown),
        };
        let data = usize::from(page0::ACC_DATA)..usize::from(page0::TEMP);
        self.older.copy_from_slice(&self.pages[0][data]);
        let output = self.output();
        let mut words = self.words(sample, settings, output);
        if self.faults.has(Fault::GyroDead) {
            words[6..].fill(0);
        }
        self.set_words(page0::ACC_DATA, &words);
        if self.mode.is_fusion() {
            let fusion = FusionWords::of(sample, output.units);
            self.set_words(page0::EUL_DATA, &fusion.euler);
            self.set_words(page0::QUA_DATA, &fusion.quaternion);
            self.set_words(page0::LIA_DATA, &output.remap(fusion.linear));
            self.set_words(page0::GRV_DATA, &output.remap(fusion.gravity));
        }
        if self.faults.has(Fault::FixedPattern) {
            self.set_words(page0::ACC_DATA, &[1962, 568, 0]);
            self.set_words(page0::MAG_DATA, &[0, 5120, 3843]);
            self.set_words(page0::GYR_DATA, &[0; 3]);
        }
    }

    /// The nine words of a sample: accelerometer, magnetometer, gyroscope, zero where the mode leaves
    /// the sensor off.
    fn words(&self, sample: &Sample, settings: &Settings, output: Output) -> [i16; 9] {
        let mut words = Words::of(sample, output.units, settings);
        if self.mode.is_fusion() {
            let offset = |group: usize| {
                let first = page0::ACC_OFFSET + GROUPS[group].0 as u8;
                [0, 2, 4].map(|i| self.word(first + i))
            };
            words.acc = subtract(words.acc, offset(0));
            words.mag = subtract(words.mag, offset(1));
            words.gyr = subtract(words.gyr, offset(2));
        }
        let mode = self.mode;
        let mut out = [0; 9];
        for (to, (on, from)) in out.chunks_exact_mut(3).zip([
            (mode.has_acc(), words.acc),
            (mode.has_mag(), words.mag),
            (mode.has_gyr(), words.gyr),
        ]) {
            if on {
                to.copy_from_slice(&output.remap(from));
            }
        }
        out
    }

    fn output(&self) -> Output {
        Output {
            units: self.get(page0::UNIT_SEL),
            map: self.get(page0::AXIS_MAP_CONFIG),
            sign: self.get(page0::AXIS_MAP_SIGN),
        }
    }

    fn clear_data(&mut self) {
        let data = usize::from(page0::ACC_DATA)..usize::from(page0::TEMP);
        self.pages[0][data].fill(0);
    }

    fn get(&self, address: u8) -> u8 {
        self.pages[0][usize::from(address)]
    }

    fn set(&mut self, address: u8, value: u8) {
        self.pages[0][usize::from(address)] = value;
    }

    fn word(&self, address: u8) -> i16 {
        i16::from_le_bytes([self.get(address), self.get(address + 1)])
    }

    fn set_words(&mut self, address: u8, words: &[i16]) {
        for (at, byte) in (address..).zip(words.iter().flat_map(|w| w.to_le_bytes())) {
            self.set(at, byte);
        }
    }
}

impl Output {
    /// Output axes out of package axes (data sheet 3.4).
    fn remap(&self, v: [i16; 3]) -> [i16; 3] {
        [0u8, 1, 2].map(|axis| {
            let value = v[usize::from(self.map >> (2 * axis) & 3)];
            if self.sign >> (2 - axis) & 1 == 1 {
                value.saturating_neg()
            } else {
                value
            }
        })
    }
}

fn subtract(a: [i16; 3], b: [i16; 3]) -> [i16; 3] {
    [0, 1, 2].map(|i| a[i].saturating_sub(b[i]))
}
