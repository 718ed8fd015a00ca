//! The LSM6DS3 of the Nano 33 IoT at register level, as a slave on the I2C bus.
//!
//! Written from the data sheet (ST DocID026899 revision 8, "DS" below), not from any driver.
//!
//! | register | behaviour | source |
//! |---|---|---|
//! | 01 FUNC_CFG_ACCESS | bit 7 lays the embedded functions' registers, which read 0, over the others | DS 9.1 |
//! | 0F WHO_AM_I | 0x69 | DS 9.11 |
//! | 10, 11 CTRL1_XL, CTRL2_G | rate, range; a rate of 0 powers the sensor down | DS 9.12, 9.13 |
//! | 12 CTRL3_C | SW_RESET: all registers at their defaults 50 us later; BDU: a high byte stays until it has been read; IF_INC | DS 9.14 |
//! | 13-19 CTRL4_C-CTRL10_C | stored | DS 9.15-9.21 |
//! | 14 CTRL5_C | ST_XL, ST_G: the self-test's stimulus | DS 9.16 |
//! | 1E STATUS_REG | new data, until a high byte was read | DS 9.26 |
//! | 20-2D temperature, rates, accelerations | refreshed together by the chip's own clock, 3 % off at most (assumed); the first rates 70 ms after power-down | DS 9.28, table 4 |
//!
//! On the bus: address 0x6A; no acknowledge for 15 ms after power-on; no clock stretching; the
//! register pointer is kept over a STOP.
//!
//! Bandwidths follow the rate: half of it for accelerations, up to 400 Hz; for rates as AN5040
//! gives them for the LSM6DSL.
//!
//! Left out: low-power modes, the FIFO, interrupts, the embedded functions, SPI, the sensor hub.
//!
//! [`Fault`] lists what can fail.

mod fault;

#[cfg(test)]
mod tests;

pub use fault::Fault;

use crate::inertial::{
    ImuErrors, Refresh, STANDARD_GRAVITY_M_S2, Sample, Settings, SignalChain, Stimulus,
};
use crate::random::{Stream, generator};
use rand::Rng;
use samd21::board::{I2cEvent, I2cReply, Ticks};

/// The chip's 7-bit address.
pub const ADDRESS: u8 = 0x6A;

/// The first register of the rates; the accelerations follow.
pub(crate) const RATES: u8 = OUT_G as u8;

/// From power-on to the first acknowledge.
const BOOT: Ticks = Ticks::from_ms(15);
/// A software reset.
const RESET: Ticks = Ticks::from_us(50);
/// From power-down to the first rates.
const TURN_ON: Ticks = Ticks::from_ms(70);
/// Largest deviation of the chip's clock, relative.
const CLOCK_ERROR: f64 = 0.03;

const FUNC_CFG_ACCESS: usize = 0x01;
const WHO_AM_I: usize = 0x0F;
const CTRL1_XL: usize = 0x10;
const CTRL2_G: usize = 0x11;
const CTRL3_C: usize = 0x12;
const CTRL5_C: usize = 0x14;
const STATUS_REG: usize = 0x1E;
const OUT_TEMP: usize = 0x20;
const OUT_G: usize = 0x22;
const OUT_XL: usize = 0x28;
const OUT_END: usize = 0x2E;

const SW_RESET: u8 = 0x01;
const IF_INC: u8 = 0x04;
const BDU: u8 = 0x40;

/// Rate of a code of ODR, Hz; 0 for power-down.
const RATES_HZ: [f64; 16] = [
    0.0, 12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1660.0, 3330.0, 6660.0, 0.0, 0.0, 0.0, 0.0,
    0.0,
];
/// Bandwidth of the gyroscope at a code of ODR, Hz.
const GYR_BANDWIDTHS_HZ: [f64; 16] = [
    4.3, 4.3, 8.3, 16.7, 33.0, 66.8, 135.9, 295.5, 1108.1, 1320.7, 1441.8, 4.3, 4.3, 4.3, 4.3, 4.3,
];
/// Range and count of the accelerometer by FS_XL, g and mg.
const ACC_RANGES: [(f64, f64); 4] = [(2.0, 0.061), (16.0, 0.488), (4.0, 0.122), (8.0, 0.244)];
/// Range and count of the gyroscope by FS_G, deg/s and mdeg/s.
const GYR_RANGES: [(f64, f64); 4] = [(245.0, 8.75), (500.0, 17.5), (1000.0, 35.0), (2000.0, 70.0)];
/// The same with FS_125.
const GYR_RANGE_125: (f64, f64) = (125.0, 4.375);
/// Change by the self-test's stimulus, mg and deg/s: in the middle of what the data sheet allows.
const STIMULUS: (f64, f64) = (500.0, 400.0);

impl ImuErrors {
    /// A typical LSM6DS3: 0.007 deg/s/sqrt(Hz), a bias of +-1 deg/s drawn from the seed, 90
    /// ug/sqrt(Hz) (data sheet table 3); instability as of the BNO055.
    pub const LSM6DS3: Self = Self {
        gyro_noise_density: 0.007 * std::f64::consts::PI / 180.0,
        acc_noise_density: 90e-6 * STANDARD_GRAVITY_M_S2,
        ..Self::TYPICAL
    };
}

/// How far the transfer on the bus has come.
#[derive(Clone, Copy, Debug, Default)]
struct Transfer {
    selected: bool,
    expects_pointer: bool,
}

/// An emulated LSM6DS3.
///
/// Call [`Lsm6ds3::sense`] with the physical truth in steps of at most 1 ms; [`Lsm6ds3::i2c`] is
/// its bus. Times must not go back.
#[derive(Clone, Debug)]
pub struct Lsm6ds3 {
    signals: SignalChain,
    registers: [u8; 128],
    /// What the outputs show once their words are whole.
    newest: [i16; 7],
    /// What they would show without a fault: accelerations, no field, rates.
    pub(crate) faultless: [[i16; 3]; 3],
    /// The refresh whose data the registers hold.
    pub(crate) refresh: Refresh,
    /// High bytes that have not been read yet, under BDU.
    held: [bool; 7],
    /// From when on it answers.
    boots: Ticks,
    /// When a software reset acts.
    resets: Option<Ticks>,
    /// When the gyroscope left power-down.
    on_since: Option<Ticks>,
    /// Relative rate of the chip's clock.
    clock: f64,
    /// The next refresh, s; its phase is that of the moment at which the chip was turned on.
    next_s: f64,
    pointer: u8,
    transfer: Transfer,
    faults: Vec<Fault>,
}

impl Lsm6ds3 {
    /// A sensor that gets its power at time zero.
    #[must_use]
    pub fn new(seed: u64, errors: ImuErrors) -> Self {
        let mut unit = generator(seed, Stream::SecondSensorUnit);
        let noise = generator(seed, Stream::SecondSensorNoise);
        let clock = 1.0 + CLOCK_ERROR * unit.random_range(-1.0..=1.0);
        let signals = SignalChain::new(errors, &mut unit, noise);
        let mut chip = Self {
            signals,
            registers: [0; 128],
            newest: [0; 7],
            faultless: [[0; 3]; 3],
            refresh: Refresh::default(),
            held: [false; 7],
            boots: BOOT,
            resets: None,
            on_since: None,
            clock,
            next_s: 0.0,
            pointer: 0,
            transfer: Transfer::default(),
            faults: Vec::new(),
        };
        chip.reset();
        chip
    }

    /// The gyroscope's true bias now, rad/s along the package axes.
    #[must_use]
    pub fn gyro_bias_rad_s(&self) -> [f64; 3] {
        self.signals.gyro_bias_rad_s()
    }

    /// The power comes on again.
    pub fn power_on(&mut self, now: Ticks) {
        self.run(now);
        self.reset();
        self.boots = now + BOOT;
        self.transfer = Transfer::default();
    }

    /// Whether the transfer under way is with it.
    #[must_use]
    pub fn is_selected(&self) -> bool {
        self.transfer.selected
    }

    /// Exposes the sensors to `truth` from the last call until `now`.
    pub fn sense(&mut self, now: Ticks, truth: &Stimulus) {
        self.run(now);
        if self.rate_hz() > 0.0 {
            let settings = self.settings();
            self.signals.sense(now, truth, &settings);
        }
    }

    /// The chip's reply to an event of the bus master.
    pub fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.run(now);
        let answers = now >= self.boots && !self.faults.contains(&Fault::Silent);
        match event {
            I2cEvent::Start { address, read } => {
                let selected = address == ADDRESS && answers;
                self.transfer = Transfer { selected, expects_pointer: !read };
                if selected { I2cReply::ACK } else { I2cReply::NAK }
            }
            I2cEvent::Write(value) if self.transfer.selected && answers => {
                if std::mem::take(&mut self.transfer.expects_pointer) {
                    self.pointer = value & 0x7F;
                } else {
                    self.write(now, usize::from(self.pointer), value);
                    self.advance_pointer();
                }
                I2cReply::ACK
            }
            I2cEvent::Read if self.transfer.selected && answers => {
                let value = self.read(usize::from(self.pointer));
                self.advance_pointer();
                I2cReply::data(value)
            }
            I2cEvent::Write(_) | I2cEvent::Read => I2cReply::NAK,
            I2cEvent::Stop => {
                self.transfer = Transfer::default();
                I2cReply::NAK
            }
        }
    }

    fn advance_pointer(&mut self) {
        if self.registers[CTRL3_C] & IF_INC != 0 {
            self.pointer = (self.pointer + 1) & 0x7F;
        }
    }

    fn reset(&mut self) {
        self.registers = [0; 128];
        self.registers[WHO_AM_I] = 0x69;
        self.registers[CTRL3_C] = IF_INC;
        self.registers[0x18..0x1A].fill(0x38);
        self.newest = [0; 7];
        self.held = [false; 7];
        self.resets = None;
        self.on_since = None;
        self.signals.restart();
    }

    fn write(&mut self, now: Ticks, register: usize, value: u8) {
        let is_open = self.registers[FUNC_CFG_ACCESS] & 0x80 != 0;
        match register {
            FUNC_CFG_ACCESS => self.registers[register] = value,
            _ if is_open => {}
            0x06..=0x0E | CTRL1_XL..=0x19 => {
                self.registers[register] = value;
                if register == CTRL3_C && value & SW_RESET != 0 {
                    self.resets = Some(now + RESET);
                }
                if register == CTRL1_XL || register == CTRL2_G {
                    self.set_rate(now);
                }
            }
            _ => {}
        }
    }

    /// The rate has been set: refreshes count from now on.
    fn set_rate(&mut self, now: Ticks) {
        let runs = self.registers[CTRL2_G] >> 4 != 0;
        self.on_since = runs.then_some(self.on_since.unwrap_or(now));
        let rate_hz = self.rate_hz();
        if rate_hz > 0.0 {
            self.next_s = now.as_secs_f64() + 1.0 / rate_hz;
        }
    }

    fn read(&mut self, register: usize) -> u8 {
        if self.registers[FUNC_CFG_ACCESS] & 0x80 != 0 && register != FUNC_CFG_ACCESS {
            return 0;
        }
        let value = self.registers[register];
        if (OUT_TEMP..OUT_END).contains(&register) {
            let word = (register - OUT_TEMP) / 2;
            let is_high = !register.is_multiple_of(2);
            self.held[word] = !is_high && self.registers[CTRL3_C] & BDU != 0;
            if is_high {
                self.registers[STATUS_REG] &= match word {
                    0 => !0x04,
                    1..=3 => !0x02,
                    _ => !0x01,
                };
            }
        }
        value
    }

    /// Refreshes a second of the gyroscope, or of the accelerometer alone; 0 in power-down.
    fn rate_hz(&self) -> f64 {
        let [acc, gyr] = [CTRL1_XL, CTRL2_G].map(|at| usize::from(self.registers[at] >> 4));
        self.clock * if gyr != 0 { RATES_HZ[gyr] } else { RATES_HZ[acc] }
    }

    fn acc_range(&self) -> (f64, f64) {
        ACC_RANGES[usize::from(self.registers[CTRL1_XL] >> 2 & 3)]
    }

    fn gyr_range(&self) -> (f64, f64) {
        let control = self.registers[CTRL2_G];
        if control & 2 != 0 { GYR_RANGE_125 } else { GYR_RANGES[usize::from(control >> 2 & 3)] }
    }

    fn settings(&self) -> Settings {
        let [acc, gyr] = [CTRL1_XL, CTRL2_G].map(|at| usize::from(self.registers[at] >> 4));
        Settings {
            // The words clip, a little beyond the range.
            acc_range_g: self.acc_range().1 * 32.767,
            acc_bandwidth_hz: (RATES_HZ[acc] / 2.0).clamp(5.0, 400.0),
            gyr_range_dps: self.gyr_range().1 * 32.767,
            gyr_bandwidth_hz: GYR_BANDWIDTHS_HZ[gyr],
            mag_rate_hz: 1.0,
        }
    }

    /// Does what the chip does by itself up to `now`.
    fn run(&mut self, now: Ticks) {
        if self.resets.is_some_and(|at| at <= now) {
            self.reset();
        }
        let rate_hz = self.rate_hz();
        if rate_hz <= 0.0 {
            return;
        }
        let now_s = now.as_secs_f64();
        if self.next_s <= now_s {
            // Nothing is sensed between two calls, so that one refresh stands for all of them.
            self.next_s += ((now_s - self.next_s) * rate_hz).floor() / rate_hz + 1.0 / rate_hz;
            self.refresh(now);
        }
    }

    fn refresh(&mut self, now: Ticks) {
        if self.faults.contains(&Fault::Frozen) {
            return;
        }
        let Some(mut sample) = self.signals.sample(now, false) else { return };
        self.stimulate(&mut sample);
        let [acc, gyr] = self.counts(&sample);
        self.faultless = [acc, [0; 3], gyr];
        self.refresh = Refresh { at: now, recorded: None };
        let temperature = ((self.signals.temperature_c() - 25.0) * 16.0) as i16;
        let turned_on = self.on_since.is_some_and(|since| now >= since + TURN_ON);
        let (has_acc, has_gyr) = (self.registers[CTRL1_XL] >> 4 != 0, turned_on);
        self.newest[0] = temperature;
        if has_gyr {
            self.newest[1..4].copy_from_slice(&gyr);
        }
        if has_acc {
            self.newest[4..7].copy_from_slice(&acc);
        }
        self.registers[STATUS_REG] |= 0x04 | u8::from(has_gyr) << 1 | u8::from(has_acc);
        for ((word, held), at) in self.newest.iter().zip(self.held).zip((OUT_TEMP..).step_by(2)) {
            if !held {
                self.registers[at..at + 2].copy_from_slice(&word.to_le_bytes());
            }
        }
    }

    /// The words of a sample.
    fn counts(&self, sample: &Sample) -> [[i16; 3]; 2] {
        let (mg, mdps) = (self.acc_range().1, self.gyr_range().1);
        [
            sample.acc_m_s2.map(|a| (a / STANDARD_GRAVITY_M_S2 * 1000.0 / mg) as i16),
            sample.gyr_rad_s.map(|rate| (rate.to_degrees() * 1000.0 / mdps) as i16),
        ]
    }

    /// Adds the self-test's stimulus.
    fn stimulate(&self, sample: &mut Sample) {
        let sign = |bits: u8, negative: u8| match bits & 3 {
            1 => 1.0,
            bits if bits == negative => -1.0,
            _ => 0.0,
        };
        let control = self.registers[CTRL5_C];
        let (mg, dps) = STIMULUS;
        for acc in &mut sample.acc_m_s2 {
            *acc += sign(control, 2) * mg / 1000.0 * STANDARD_GRAVITY_M_S2;
        }
        for rate in &mut sample.gyr_rad_s {
            *rate += sign(control >> 2, 3) * dps.to_radians();
        }
    }
}

const _: () = assert!(OUT_G == OUT_TEMP + 2 && OUT_XL == OUT_G + 6 && OUT_END == OUT_XL + 6);
