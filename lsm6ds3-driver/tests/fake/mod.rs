//! An LSM6DS3 at register level with a clock of its own, and every way to make it fail.
//!
//! | behaviour | source |
//! |---|---|
//! | no answer until booted, 15 ms | data sheet 5.6 |
//! | software reset; both sensors off after it | 9.14, 9.12 |
//! | rates and accelerations at the rate of CTRL1_XL and CTRL2_G, with noise | 9.12, 9.13 |
//! | gyroscope's first data after 70 ms | table 4 |
//! | stimulus of the self-test | table 3 |
//! | FUNC_CFG_ACCESS hides the other registers | 9.1 |
//!
//! Left out: physics, filters, interrupts, the FIFO, the embedded functions.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "a module of several test files, each with its own part"
)]

use std::cell::RefCell;
use std::rc::Rc;

use embedded_hal::i2c::{ErrorKind, ErrorType, NoAcknowledgeSource, Operation};
use lsm6ds3_driver::{
    BusError, Config, Driver, Imu, Micros, Next, RawSample, SensorFault, TRANSFER_DEADLINE_US,
    Transfer,
};

pub const BOOT_US: u64 = 15_000;
pub const TICK_US: u64 = 5_000;
/// A byte at 400 kHz.
const BYTE_US: u64 = 23;
const TURN_ON_US: u64 = 70_000;

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
    /// The only address that answers.
    pub address: u8,
    pub id: u8,
    pub registers: [u8; 128],
    /// Since when the gyroscope has been on.
    on_since: u64,
    refreshed: u64,
    pub acc: [i16; 3],
    pub gyr: [i16; 3],
    random: u64,
    pub transfers: u64,
    pub log: Vec<Transfer>,
    pub spoiler: Option<Spoiler>,
    /// Every transfer fails.
    pub bus: Option<BusError>,
    /// Outputs stand still.
    pub frozen: bool,
    /// Without a stimulus in the self-test.
    pub is_dead: bool,
    wire: Option<Wire>,
}

impl Chip {
    pub fn new(id: u8) -> Self {
        let mut chip = Self {
            now: 0,
            booted_at: 0,
            address: 0x6A,
            id,
            registers: [0; 128],
            on_since: 0,
            refreshed: 0,
            acc: [0; 3],
            gyr: [0; 3],
            random: 0x9E37_79B9_7F4A_7C15,
            transfers: 0,
            log: Vec::new(),
            spoiler: None,
            bus: None,
            frozen: false,
            is_dead: false,
            wire: None,
        };
        chip.power_on(BOOT_US);
        chip
    }

    /// All registers at their defaults, and no answer for `boot_us`.
    pub fn power_on(&mut self, boot_us: u64) {
        self.booted_at = self.now + boot_us;
        self.registers = [0; 128];
        self.registers[0x0F] = self.id;
        self.registers[0x12] = 0x04;
        let last = if self.id == 0x69 { [0x38, 0x38] } else { [0xE0, 0] };
        self.registers[0x18..0x1A].copy_from_slice(&last);
        (self.acc, self.gyr) = ([0; 3], [0; 3]);
    }

    /// A number around 0, up to `amplitude`.
    fn noise(&mut self, amplitude: i16) -> i16 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random % (2 * amplitude as u64 + 1)) as i16 - amplitude
    }

    /// Brings the outputs up to date: 1 g along z, no turn.
    fn refresh(&mut self) {
        let period_us = match self.registers[0x11] >> 4 {
            0 => return,
            rate => 1_000_000 / (13_000 << (rate - 1)) * 1000 + 1,
        };
        if self.frozen || self.now / period_us == self.refreshed {
            return;
        }
        self.refreshed = self.now / period_us;
        let mg = [61, 488, 122, 244][usize::from(self.registers[0x10] >> 2 & 3)];
        let mdps = [8_750, 17_500, 35_000, 70_000][usize::from(self.registers[0x11] >> 2 & 3)];
        let stimulus = self.registers[0x14];
        let (mut acc, mut rate) = (0, 0);
        if !self.is_dead {
            acc = if stimulus & 3 == 1 { 500 } else { 0 };
            rate = if stimulus >> 2 & 3 == 1 { 400 } else { 0 };
        }
        let g = [0, 0, 1000].map(|z| ((z + acc) * 1000 / mg) as i16);
        self.acc = g.map(|word| word + self.noise(4));
        let word = (rate * 1_000_000 / mdps) as i16;
        self.gyr = [0; 3].map(|_: i16| word + self.noise(4));
        if self.now < self.on_since + TURN_ON_US {
            self.gyr = [0; 3];
        }
    }

    fn write(&mut self, register: u8, value: u8) {
        match register {
            0x12 if value & 1 != 0 => self.power_on(0),
            0x01..=0x0E | 0x10..=0x19 => {
                if register == 0x11 && self.registers[0x11] >> 4 == 0 {
                    self.on_since = self.now;
                }
                self.registers[usize::from(register)] = value;
            }
            _ => {}
        }
    }

    /// One transaction, byte by byte, each taking its time.
    pub fn perform(&mut self, address: u8, transfer: &Transfer) -> Result<Vec<u8>, BusError> {
        let number = self.transfers;
        self.transfers += 1;
        self.log.push(*transfer);
        if let Some(error) = self.bus {
            self.now += if error == BusError::Nak { BYTE_US } else { TRANSFER_DEADLINE_US };
            return Err(error);
        }
        if self.now < self.booted_at || address != self.address {
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
                let words = [0, self.gyr[0], self.gyr[1], self.gyr[2]];
                let words = words.iter().chain(&self.acc).flat_map(|word| word.to_le_bytes());
                for (to, byte) in self.registers[0x20..].iter_mut().zip(words) {
                    *to = byte;
                }
                let from = usize::from(*register);
                let mut bytes = self.registers[from..from + usize::from(*len)].to_vec();
                if self.registers[1] != 0 {
                    bytes.fill(0);
                }
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
}

/// A driver on its chip, run as firmware would: main loop, and a tick every 5 ms.
pub struct Rig {
    pub chip: Chip,
    pub driver: Driver,
    next_tick: u64,
    /// Outcome of every tick that had a burst: time, and sample or fault.
    pub ticks: Vec<(u64, Result<RawSample, SensorFault>)>,
}

impl Rig {
    pub fn new(config: Config) -> Self {
        Self::of(0x69, config)
    }

    /// With a chip of this identification.
    pub fn of(id: u8, config: Config) -> Self {
        Self { chip: Chip::new(id), driver: Driver::new(config), next_tick: 0, ticks: Vec::new() }
    }

    /// A rig a while into sampling.
    pub fn flying(config: Config) -> Self {
        let mut rig = Self::new(config);
        rig.run_until_sampling(1_000_000);
        let outcomes = rig.bursts(100);
        assert!(outcomes.iter().all(Result::is_ok), "clean: {outcomes:?}");
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
        let address = self.driver.bursts().address;
        match self.driver.next(now) {
            Next::Transfer(transfer) => {
                let outcome = self.chip.perform(address, &transfer);
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
                let outcome = self.chip.perform(address, &self.driver.burst());
                let sample =
                    self.driver.sample(Micros(start), outcome.as_deref().map_err(|error| *error));
                self.ticks.push((start, sample.map(|sample| sample.raw)));
            }
        }
    }
}

/// The chip as a bus of `embedded-hal`, with its clock and delay.
#[derive(Clone)]
pub struct Bus(pub Rc<RefCell<Chip>>);

impl Bus {
    pub fn new() -> Self {
        Self(Rc::new(RefCell::new(Chip::new(0x69))))
    }

    pub fn clock(&self) -> impl FnMut() -> Micros + use<> {
        let chip = self.0.clone();
        move || Micros(chip.borrow().now)
    }

    fn perform(&self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        let mut chip = self.0.borrow_mut();
        let outcome = match operations {
            [Operation::Write(bytes)] => {
                let transfer = Transfer::Write {
                    register: bytes[0],
                    bytes: lsm6ds3_driver::Bytes::from_slice(&bytes[1..]).unwrap(),
                };
                chip.perform(address, &transfer).map(drop)
            }
            [Operation::Write([register]), Operation::Read(buffer)] => chip
                .perform(address, &Transfer::read(*register, buffer.len() as u8))
                .map(|bytes| buffer.copy_from_slice(&bytes)),
            _ => panic!("a transaction of another form"),
        };
        outcome.map_err(|error| match error {
            BusError::Nak => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
            BusError::Arbitration => ErrorKind::ArbitrationLoss,
            BusError::Stuck => ErrorKind::Bus,
            BusError::Protocol => ErrorKind::Overrun,
            BusError::Timeout => ErrorKind::Other,
        })
    }
}

impl ErrorType for Bus {
    type Error = ErrorKind;
}

impl embedded_hal::i2c::I2c for Bus {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), ErrorKind> {
        self.perform(address, operations)
    }
}

impl embedded_hal_async::i2c::I2c for Bus {
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), ErrorKind> {
        self.perform(address, operations)
    }
}

impl embedded_hal::delay::DelayNs for Bus {
    fn delay_ns(&mut self, ns: u32) {
        self.0.borrow_mut().now += u64::from(ns.div_ceil(1000));
    }
}

impl embedded_hal_async::delay::DelayNs for Bus {
    async fn delay_ns(&mut self, ns: u32) {
        embedded_hal::delay::DelayNs::delay_ns(self, ns);
    }
}
