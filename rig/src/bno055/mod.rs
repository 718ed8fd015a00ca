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
//! | 34 TEMP | the chip's temperature, 27 C unless it warms up ([`WarmUp`](crate::inertial::WarmUp)); unit by UNIT_SEL, the same from either source | DS-37 |
//! | 35 CALIB_STAT | 0 without fusion; with it the levels of `calibration`, from rest, poses and motion | DS 3.11; forum reports |
//! | 36 ST_RESULT | 0x0F, gyroscope's bit 0 with the fault | DS-65 |
//! | 37 INT_STA | 0 | |
//! | 38 SYS_CLK_STATUS | 1 for 600 ms after a change of CLK_SEL | MicroPython driver's note |
//! | 39 SYS_STATUS, 3A SYS_ERR | 2, 3 while starting, 0 in CONFIG, 4 in self-test, 5 or 6 running, 1 and code 9 when fusion starts with a refused profile; a mode change clears errors | DS-67; forum reports |
//! | 3B UNIT_SEL, 3E PWR_MODE, 40 TEMP_SOURCE, 41, 42 axis map | writable in CONFIG only; values that do not exist are ignored, a map that uses an axis twice too; suspend stops refreshing | DS-22, DS-25 |
//! | 3D OPR_MODE | any time; shows the new mode after 7 ms (from CONFIG) or 19 ms (to CONFIG); between two running modes it is ignored | DS-21; CircuitPython note |
//! | 3F SYS_TRIGGER | reads 0; RST_SYS boots, SELF_TEST (in CONFIG) takes 400 ms, CLK_SEL in CONFIG | DS-70 |
//! | 43-54 SIC matrix | stored, not applied | DS-51 |
//! | 55-6A offsets, radii | writable in CONFIG; a group takes effect when its last byte is written; a group out of its range reads 0, and the next fusion mode does not start; offsets are subtracted in fusion modes only, where the chip overwrites them with what it has learned; the radii stay what was written | DS-31..34; forum reports |
//! | page 1 08-0D | sensor settings, writable in CONFIG only; ranges that do not exist are ignored; fusion keeps only the accelerometer's range | DS-27 |
//! | page 1 0F, 10 | stored, any mode; 11-1F in CONFIG | DS-22 |
//! | page 1 50-5F | unique id out of the seed | |
//!
//! On the bus: address 0x28 or 0x29; no acknowledge for 400-650 ms after power-on and reset;
//! every byte, the address included, is stretched by about 180 us; the register pointer increments
//! by itself and is kept over a STOP.
//!
//! The gyroscope's bias and the accelerometer's offset drift with the chip's temperature, if
//! [`ImuErrors`] says so.
//!
//! [`Config`] makes the chip as unkind as real ones have been or may be; the defaults are the kind
//! side of each:
//!
//! | option | behaviour | source |
//! |---|---|---|
//! | `late_registers` | a write acts late, and its register reads as before until then | Adafruit's driver waits 10 ms after each write |
//! | `lost_within` | a write that follows too soon is lost | Adafruit's CircuitPython driver, issue 91: commands fail when sent quickly one after the other |
//! | `refresh` | each sensor refreshed by a clock of its own | DS has no rate for the modes without fusion; nobody has published one |
//! | `magnetometer` | the field is old, zero or stuck | users' reports of (0, 0, 0); the age is an estimate |
//!
//! Left out: the chip's own fusion and calibration algorithms (their results are the truth's), the
//! soft-iron matrix, HID-I2C and UART. Interrupts are left out, too: no board wires INT, and it has
//! been seen not to fire. Low power mode is treated as normal. Real chips also miss a START which a
//! STOP follows directly. Slow edges on the bus are not modelled; what they do to the data is
//! [`Fault::BitFlips`].
//!
//! [`Fault`] lists the faults that can be switched on and off while it runs, and what each does to
//! registers or lines.

mod access;
mod bus;
mod calibration;
mod config;
mod fault;
mod fault_kind;
mod refresh;
pub(crate) mod registers;
mod settings;
mod words;

#[cfg(test)]
pub(crate) mod tests;

pub use bus::{BusTiming, RareStretch};
pub use config::{Config, RefreshRates};
pub use fault_kind::{Fault, FaultKind};
pub use registers::Mode;

use crate::inertial::{ImuErrors, Playback, Refresh, SignalChain, Stimulus};
use crate::random::{Stream, generator};
use access::LateWrite;
use calibration::Calibration;
use fault::Faults;
use rand::{Rng, RngCore};
use rand_chacha::ChaCha8Rng;
use recordings::Recording;
use refresh::{Output, RefreshClock};
use registers::{AXIS_MAP_RESET, UNIT_SEL_RESET, error, page0, reset_pages};
use samd21::board::Ticks;
use std::collections::VecDeque;
use std::sync::Arc;

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

/// How far the transfer on the bus has come.
#[derive(Clone, Copy, Debug, Default)]
struct Transfer {
    selected: bool,
    /// The master reads.
    reads: bool,
    expects_pointer: bool,
    /// Register and value of the high byte that was latched when its low byte was read.
    shadow: Option<(u8, u8)>,
    /// Whether it came too soon after the write before; known from the first byte to a register on.
    lost: Option<bool>,
}

/// An emulated BNO055.
///
/// Call [`Bno055::sense`] with the physical truth in steps of at most 1 ms; [`Bno055::i2c`] is its
/// bus. Times must not go back. A clone has the whole state, random generators included.
#[derive(Clone, Debug)]
pub struct Bno055 {
    config: Config,
    unique_id: [u8; 16],
    bus_noise: ChaCha8Rng,
    signals: SignalChain,
    clock: RefreshClock,
    /// The refresh whose data the registers hold.
    pub refresh: Refresh,
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
    /// Writes that have not acted yet, the oldest first.
    late: VecDeque<LateWrite>,
    /// When the last byte was written to a register.
    last_write: Option<Ticks>,
    /// Until when another master holds the data line low.
    foreign_until: Ticks,
    faults: Faults,
    /// The data registers as they were before the last refresh.
    older: [u8; DATA],
    output: Output,
    /// What the data registers would show without a fault.
    pub(crate) faultless: [[i16; 3]; 3],
}

/// Length of the data registers.
const DATA: usize = (page0::TEMP - page0::ACC_DATA) as usize;

/// The groups of the calibration profile: first byte in its block of 22, number of words.
const GROUPS: [(usize, usize); 5] = [(0, 3), (6, 3), (12, 3), (18, 1), (20, 1)];

impl Bno055 {
    /// A sensor that gets its power at time zero.
    pub fn new(config: Config) -> Self {
        let mut unit = generator(config.seed, Stream::SensorUnit);
        let noise = generator(config.seed, Stream::SensorNoise);
        let mut unique_id = [0; 16];
        unit.fill_bytes(&mut unique_id);
        let clock = 1.0 + config.clock_error * unit.random_range(-1.0..=1.0);
        let mut signals = SignalChain::new(config.errors, &mut unit, noise);
        signals.magnetometer = config.magnetometer;
        let mut chip = Self {
            unique_id,
            bus_noise: generator(config.seed, Stream::Bus),
            signals,
            clock: RefreshClock::new(0.01 * clock, config.refresh, &mut unit),
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
            late: VecDeque::new(),
            last_write: None,
            foreign_until: Ticks::ZERO,
            faults: Faults::default(),
            older: [0; DATA],
            output: Output { units: UNIT_SEL_RESET, map: AXIS_MAP_RESET, sign: 0 },
            faultless: [[0; 3]; 3],
            config,
        };
        chip.boot(Ticks::ZERO);
        chip
    }

    /// Puts a recording in place of the sensors; its first sample lies at `start`.
    pub fn play(&mut self, recording: Arc<Recording>, start: Ticks) {
        self.signals.playback = Some(Playback::new(recording, start));
    }

    /// The chip's 7-bit address on the bus.
    pub fn address(&self) -> u8 {
        self.config.address
    }

    /// The gyroscope's true bias now, rad/s along the package axes.
    pub fn gyro_bias_rad_s(&self) -> [f64; 3] {
        self.signals.gyro_bias_rad_s()
    }

    /// The faults that are on.
    pub fn faults(&self) -> impl Iterator<Item = &Fault> {
        self.faults.0.iter()
    }

    /// Its bus and its magnetometer are like those of `config` from now on.
    pub fn set_parts(&mut self, config: &Config) {
        self.config.bus = config.bus.clone();
        self.signals.magnetometer = config.magnetometer;
    }

    /// Replaces the errors of its sensors; the offset of the gyroscope that was drawn stays.
    pub fn set_errors(&mut self, errors: ImuErrors) {
        self.signals.errors = errors;
    }

    /// Exposes the sensors to `truth` from the last call until `now`.
    pub fn sense(&mut self, now: Ticks, truth: &Stimulus) {
        self.run(now);
        let settings = self.settings();
        self.signals.sense(now, truth, &settings);
    }

    fn boot(&mut self, now: Ticks) {
        self.reset_registers();
        self.transfer = Transfer::default();
        let answers = now + Ticks::from_ms(self.bus_noise.random_range(400..=650));
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
        self.late.clear();
        self.last_write = None;
        self.signals.restart();
    }

    /// Does what the chip does by itself up to `now`: boot, carry out late writes, change its mode,
    /// refresh.
    fn run(&mut self, now: Ticks) {
        while let Some(write) = self.late.pop_front_if(|write| write.at <= now) {
            self.run_on(write.at);
            self.carry_out(write);
        }
        self.run_on(now);
    }

    /// As [`Bno055::run`], with no late write until `now`.
    fn run_on(&mut self, now: Ticks) {
        if let Power::Booting { ready, .. } = self.power {
            if now < ready {
                return;
            }
            self.power = Power::On;
            self.clock.start(ready);
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

    /// Completes a change of mode.
    fn enter(&mut self, mode: Mode, at: Ticks) {
        self.switching = None;
        self.mode = mode;
        self.calibration = Calibration::new([0, 1, 2].map(|group| self.is_set(group)));
        self.output = self.output();
        self.clear_data();
        self.signals.restart();
        // Fusion does not start on a profile that was refused; a mode change clears any other
        // error.
        let refused = mode.is_fusion() && self.refused.contains(&true);
        self.set(page0::SYS_ERR, if refused { error::FUSION_CONFIG } else { 0 });
        // Refreshes keep the phase that they have had since start-up.
        self.clock.pass(at, mode);
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
