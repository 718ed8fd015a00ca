//! A BNO055 at register level with a clock of its own, and every way to make it fail.
//!
//! | behaviour | source |
//! |---|---|
//! | NAK until booted; identity block; page select | data sheet 3.2, 4.2 |
//! | settings are taken in CONFIG mode only, bad axis maps and calibration values dropped without a word | 3.3, 3.4, 3.6.4 |
//! | 19 ms to CONFIG, 7 ms from it; all outputs zero in CONFIG | 3.3 |
//! | data refreshed every 10.03 ms with noise, the magnetometer every third time | field |
//! | self-test 0.4 s; clock switch 0.3 s | 3.9.2, 4.3.57 |
//!
//! Left out: physics, fusion (a fixed attitude instead), interrupts, sleep registers: the driver
//! does not use them.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "a module of several test files, each with its own part"
)]

use bno055_driver::{
    BusError, Config, Driver, Imu, Micros, Next, RawSample, SensorFault, Transfer,
};

pub const BOOT_US: u64 = 650_000;
pub const TICK_US: u64 = 10_000;
/// A byte at 400 kHz with its clock stretching.
const BYTE_US: u64 = 200;
const REFRESH_US: u64 = 10_030;

/// One transfer to spoil: its number since the chip was made, the byte (0 is the address) and the
/// error.
#[derive(Clone, Copy, Debug)]
pub struct Spoiler {
    pub transfer: u64,
    pub byte: usize,
    pub error: BusError,
}

/// Changes the bytes of a read from a register.
type Wire = Box<dyn Fn(u8, &mut [u8])>;

pub struct Chip {
    pub now: u64,
    booted_at: u64,
    page: u8,
    pub pages: [[u8; 128]; 2],
    mode_from: u8,
    mode: u8,
    mode_at: u64,
    self_test_until: u64,
    clock_busy_until: u64,
    refreshed: u64,
    data_since: u64,
    pub acc: [i16; 3],
    pub mag: [i16; 3],
    pub gyr: [i16; 3],
    random: u64,
    /// Transfers so far, and those of them that failed.
    pub transfers: u64,
    pub log: Vec<Transfer>,
    pub spoiler: Option<Spoiler>,
    /// Every transfer fails.
    pub bus: Option<BusError>,
    /// Outputs stand still.
    pub frozen: bool,
    pub gyro_dead: bool,
    /// Never answers again after a reset command.
    pub dies_of_reset: bool,
    /// What the wire does to the bytes of a read: see [`Chip::on_wire`].
    pub wire: Option<Wire>,
    pub crystal: bool,
}

impl Chip {
    pub fn new() -> Self {
        let mut chip = Self {
            now: 0,
            booted_at: 0,
            page: 0,
            pages: [[0; 128]; 2],
            mode_from: 0,
            mode: 0,
            mode_at: 0,
            self_test_until: 0,
            clock_busy_until: 0,
            refreshed: 0,
            data_since: u64::MAX,
            acc: [0; 3],
            mag: [0; 3],
            gyr: [0; 3],
            random: 0x9E37_79B9_7F4A_7C15,
            transfers: 0,
            log: Vec::new(),
            spoiler: None,
            bus: None,
            frozen: false,
            gyro_dead: false,
            dies_of_reset: false,
            wire: None,
            crystal: true,
        };
        chip.power_on(BOOT_US);
        chip
    }

    /// All registers at their defaults, and no answer for `boot_us`.
    pub fn power_on(&mut self, boot_us: u64) {
        self.booted_at = self.now + boot_us;
        self.page = 0;
        (self.mode, self.mode_from, self.mode_at) = (0, 0, 0);
        self.pages = [[0; 128]; 2];
        let [zero, one] = &mut self.pages;
        zero[..8].copy_from_slice(&[0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15, 0x00]);
        zero[0x36] = 0x0F;
        zero[0x3B] = 0x80;
        zero[0x41] = 0x24;
        for diagonal in [0x44, 0x4C, 0x54] {
            zero[diagonal] = 0x40;
        }
        one[8..12].copy_from_slice(&[0x0D, 0x6D, 0x38, 0x00]);
        for (index, id) in one[0x50..0x60].iter_mut().enumerate() {
            *id = 0xB0 + index as u8;
        }
    }

    fn random(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random
    }

    fn noise(&mut self, amplitude: i16) -> i16 {
        (self.random() % (2 * amplitude as u64 + 1)) as i16 - amplitude
    }

    /// The operating mode in effect.
    pub fn mode(&self) -> u8 {
        if self.now >= self.mode_at { self.mode } else { self.mode_from }
    }

    /// Brings time-driven registers up to date.
    fn refresh(&mut self) {
        let mode = self.mode();
        if mode == 0 {
            self.data_since = u64::MAX;
            self.pages[0][8..0x34].fill(0);
        } else {
            self.data_since = self.data_since.min(self.mode_at.max(self.booted_at));
            let due = (self.now.saturating_sub(self.data_since)) / REFRESH_US;
            if due == 0 {
                self.refreshed = 0;
            }
            while self.refreshed < due && !self.frozen {
                self.refreshed += 1;
                self.measure(self.refreshed.is_multiple_of(3));
            }
        }
        self.pages[0][0x3D] = mode;
        let status = if self.now < self.self_test_until {
            4
        } else {
            [0, 6, 5][usize::from(mode > 0) + usize::from(mode > 7)]
        };
        if self.pages[0][0x39] != 1 {
            self.pages[0][0x39] = status;
        }
        self.pages[0][0x38] = u8::from(self.now < self.clock_busy_until);
    }

    fn measure(&mut self, mag: bool) {
        self.acc = [self.noise(3), self.noise(3), 981 + self.noise(3)];
        if mag {
            self.mag = [320 + self.noise(9), -90 + self.noise(9), 640 + self.noise(9)];
        }
        self.gyr = [0; 3];
        if !self.gyro_dead {
            self.gyr = [self.noise(5), 8 + self.noise(5), self.noise(5)];
        }
        self.publish();
    }

    fn publish(&mut self) {
        let attitude = [0_i16, 0, 0, 16384, 0, 0, 0, self.acc[0], self.acc[1], 0, 0, 0, 981];
        let words = [self.acc, self.mag, self.gyr].into_iter().flatten().chain(attitude);
        for (index, word) in words.enumerate() {
            self.pages[0][8 + 2 * index..10 + 2 * index].copy_from_slice(&word.to_le_bytes());
        }
        self.pages[0][0x34] = 25;
    }

    fn write(&mut self, register: u8, value: u8) {
        self.refresh();
        let config = self.mode() == 0 && self.now >= self.mode_at;
        let at = usize::from(register);
        match (self.page, register) {
            (_, 0x07) => {
                self.page = value & 1;
                self.pages[0][7] = self.page;
                self.pages[1][7] = self.page;
            }
            (0, 0x3D) => {
                self.mode_from = self.mode();
                self.mode = value & 0x0F;
                self.mode_at = self.now
                    + match (self.mode_from, self.mode) {
                        (from, to) if from == to => 0,
                        (_, 0) => 19_000,
                        _ => 7_000,
                    };
            }
            _ if !config => {}
            (0, 0x3F) => {
                if value & 0x20 != 0 {
                    self.power_on(if self.dies_of_reset { u64::MAX / 2 } else { BOOT_US });
                } else if value & 1 != 0 {
                    self.self_test_until = self.now + 400_000;
                } else if value & 0x80 != 0 {
                    self.clock_busy_until =
                        if self.crystal { self.now + 300_000 } else { u64::MAX };
                }
            }
            (0, 0x41) => {
                let axes = [value & 3, value >> 2 & 3, value >> 4 & 3];
                if axes[0] != axes[1]
                    && axes[1] != axes[2]
                    && axes[2] != axes[0]
                    && !axes.contains(&3)
                {
                    self.pages[0][at] = value;
                }
            }
            (0, 0x55..=0x6A) => {
                self.pages[0][at] = value;
                let limits = [8000, 8000, 8000, 6400, 6400, 6400, 32000, 32000, 32000, 1000, 960];
                let word = (at - 0x55) / 2;
                let low = 0x55 + 2 * word;
                let stored = i16::from_le_bytes([self.pages[0][low], self.pages[0][low + 1]]);
                if at == low + 1 && stored.unsigned_abs() > limits[word] {
                    self.pages[0][low..low + 2].fill(0);
                }
            }
            (0, 0x3B | 0x3E | 0x40 | 0x42..=0x54) | (1, 0x08..=0x0D | 0x0F..=0x1F) => {
                self.pages[usize::from(self.page)][at] = value;
            }
            _ => {}
        }
    }

    /// One transaction, byte by byte, each taking its time.
    pub fn perform(&mut self, transfer: &Transfer) -> Result<Vec<u8>, BusError> {
        let number = self.transfers;
        self.transfers += 1;
        self.log.push(*transfer);
        if let Some(error) = self.bus {
            self.now +=
                if error == BusError::Nak { BYTE_US } else { bno055_driver::TRANSFER_DEADLINE_US };
            return Err(error);
        }
        if self.now < self.booted_at {
            self.now += BYTE_US;
            return Err(BusError::Nak);
        }
        let spoiler = self.spoiler.filter(|spoiler| spoiler.transfer == number);
        let spoilt = |byte: usize| {
            spoiler.filter(|spoiler| spoiler.byte == byte).map_or(Ok(()), |s| Err(s.error))
        };
        for byte in 0..2 {
            spoilt(byte)?;
            self.now += BYTE_US;
        }
        match transfer {
            Transfer::Write { register, bytes } => {
                for (index, &value) in bytes.as_slice().iter().enumerate() {
                    spoilt(2 + index)?;
                    self.now += BYTE_US;
                    self.write(register + index as u8, value);
                }
                Ok(Vec::new())
            }
            Transfer::Read { register, len } => {
                spoilt(2)?;
                self.now += BYTE_US;
                self.refresh();
                let from = usize::from(*register);
                let mut bytes =
                    self.pages[usize::from(self.page)][from..from + usize::from(*len)].to_vec();
                for index in 0..bytes.len() {
                    spoilt(3 + index)?;
                    self.now += BYTE_US;
                }
                if let Some(wire) = &self.wire {
                    wire(*register, &mut bytes);
                }
                Ok(bytes)
            }
        }
    }

    /// Lets the wire change the bytes of every read from a register.
    pub fn on_wire(&mut self, change: impl Fn(u8, &mut [u8]) + 'static) {
        self.wire = Some(Box::new(change));
    }

    /// Bytes on the wire of a transfer, addresses and register included.
    pub fn wire_len(transfer: &Transfer) -> usize {
        match transfer {
            Transfer::Write { bytes, .. } => 2 + bytes.len(),
            Transfer::Read { len, .. } => 3 + usize::from(*len),
        }
    }

    /// The burst that the registers hold, after a change of its words.
    pub fn burst_with(&self, change: impl FnOnce(&mut [i16])) -> Vec<u8> {
        let mut words = [self.acc, self.mag, self.gyr];
        change(words.as_flattened_mut());
        words.as_flattened().iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// The sample that the registers hold.
    pub fn truth(&self) -> ([i16; 3], [i16; 3], [i16; 3]) {
        (self.acc, self.mag, self.gyr)
    }

    /// Whether the chip is what `config` asks for.
    pub fn holds(&self, config: &Config) -> bool {
        let [zero, one] = &self.pages;
        self.page == 0
            && self.mode() == config.mode as u8
            && zero[0x3B] == config.units.register()
            && zero[0x3E] == config.power as u8
            && zero[0x41..0x43] == config.axes.registers()
            && one[8..12] == config.sensors.registers()
            && config.profile.is_none_or(|profile| zero[0x55..0x6B] == profile.registers())
            && config.soft_iron.is_none_or(|matrix| zero[0x43..0x55] == matrix.registers())
    }
}

/// A driver on its chip, run as firmware would: main loop, and a tick every 10 ms.
pub struct Rig {
    pub chip: Chip,
    pub driver: Driver,
    next_tick: u64,
    /// Outcome of every tick that had a burst: time, and sample or fault.
    pub ticks: Vec<(u64, Result<RawSample, SensorFault>)>,
}

impl Rig {
    pub fn new(config: Config) -> Self {
        Self { chip: Chip::new(), driver: Driver::new(config), next_tick: 0, ticks: Vec::new() }
    }

    /// A rig that has come up.
    pub fn sampling(config: Config) -> Self {
        let mut rig = Self::new(config);
        rig.run_until_sampling(2_000_000);
        rig
    }

    pub fn run_until_sampling(&mut self, patience_us: u64) {
        let deadline = self.chip.now + patience_us;
        while !self.driver.is_sampling() {
            assert!(self.chip.now < deadline, "not sampling: {:?}", self.driver.fault());
            self.turn();
        }
    }

    pub fn run_for(&mut self, us: u64) {
        let end = self.chip.now + us;
        while self.chip.now < end {
            self.turn();
        }
    }

    /// Ticks until `count` more bursts have been judged, or the driver has no use for them; their
    /// outcomes.
    pub fn bursts(&mut self, count: usize) -> Vec<Result<RawSample, SensorFault>> {
        let from = self.ticks.len();
        while self.ticks.len() < from + count && self.driver.is_sampling() {
            self.turn();
        }
        self.ticks[from..].iter().map(|(_, outcome)| *outcome).collect()
    }

    /// One turn of the main loop.
    pub fn turn(&mut self) {
        let now = Micros(self.chip.now);
        match self.driver.next(now) {
            Next::Transfer(transfer) => {
                let outcome = self.chip.perform(&transfer);
                self.driver
                    .complete(Micros(self.chip.now), outcome.as_deref().map_err(|error| *error));
            }
            Next::Wait(until) => {
                assert!(until > now, "a wait that is over");
                self.chip.now = until.0.min(self.chip.now + TICK_US);
            }
            Next::Sample => {
                self.next_tick = (self.next_tick.max(self.chip.now)).div_ceil(TICK_US) * TICK_US;
                self.chip.now = self.next_tick;
                self.next_tick += TICK_US;
                let start = self.chip.now;
                let outcome = self.chip.perform(&self.driver.burst());
                let sample =
                    self.driver.sample(Micros(start), outcome.as_deref().map_err(|error| *error));
                self.ticks.push((start, sample.map(|sample| sample.raw)));
            }
        }
    }
}

/// A rig a while into sampling, with `config`.
pub fn flying(config: Config) -> Rig {
    let mut rig = Rig::sampling(config);
    let outcomes = rig.bursts(100);
    assert!(outcomes.iter().all(Result::is_ok), "clean: {outcomes:?}");
    rig
}
