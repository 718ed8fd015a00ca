//! The chip as a slave on the I2C bus: transfers, clock stretching, and faults of the cable.

use super::registers::page0;
use super::{Bno055, Fault, Power, Transfer};
use rand::Rng;
use samd21::board::{I2cEvent, I2cReply, Lines, Ticks};

/// How long another master holds the data line low: a byte at 50 kHz.
const FOREIGN_BYTE: Ticks = Ticks::from_us(180);

impl Bno055 {
    /// The chip's reply to an event of the bus master.
    pub fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.run(now);
        if self.loses_acknowledge(event) {
            self.transfer = Transfer::default();
            return I2cReply::NAK;
        }
        let reply = match event {
            I2cEvent::Start { address, read } => {
                let selected = address == self.config.address && self.answers(now);
                self.transfer = Transfer {
                    selected,
                    expects_pointer: !read,
                    ..Transfer::default()
                };
                if selected {
                    I2cReply::ACK
                } else {
                    I2cReply::NAK
                }
            }
            I2cEvent::Write(value) if self.selected(now) => {
                if self.transfer.expects_pointer {
                    self.transfer.expects_pointer = false;
                    self.pointer = value & 0x7F;
                } else {
                    self.write(now, self.pointer, value);
                    self.advance_pointer();
                }
                I2cReply::ACK
            }
            I2cEvent::Read if self.selected(now) => {
                let value = self.read_next(now);
                I2cReply::data(value)
            }
            I2cEvent::Write(_) | I2cEvent::Read => I2cReply::NAK,
            I2cEvent::Stop => {
                self.transfer = Transfer::default();
                I2cReply::NAK
            }
        };
        if self.transfer.selected {
            reply.stretched(self.stretch())
        } else {
            reply
        }
    }

    /// True if a START or STOP lies inside the byte that begins at `now`. Another master may take
    /// the bus at this moment too.
    pub fn glitch(&mut self, now: Ticks) -> bool {
        let mut glitch = false;
        for fault in self.faults.iter() {
            match *fault {
                Fault::BusErrors { probability } => {
                    glitch |= self.bus_noise.random_bool(probability);
                }
                Fault::ArbitrationLosses { probability }
                    if self.bus_noise.random_bool(probability) =>
                {
                    self.foreign_until = now + FOREIGN_BYTE;
                }
                _ => {}
            }
        }
        glitch
    }

    /// The lines that the chip, a fault of its cable or another master holds low.
    pub fn held_low(&self, now: Ticks) -> Lines {
        let stuck =
            self.faults.has(Fault::SdaStuck) || self.faults.has(Fault::SdaHeld { clocks: 0 });
        let inside_a_byte = self.faults.has(Fault::ClockHang) && self.power != Power::Hung;
        Lines {
            sda: stuck || inside_a_byte || now < self.foreign_until,
            scl: self.faults.has(Fault::SclStuck),
        }
    }

    /// A rising edge of SCL outside of a transfer: the master clocks a held data line free.
    pub fn clocked(&mut self) {
        if self.faults.has(Fault::ClockHang) {
            self.power = Power::Hung;
        }
        let mut done = false;
        for fault in self.faults.iter_mut() {
            if let Fault::SdaHeld { clocks } = fault {
                *clocks = clocks.saturating_sub(1);
                done = *clocks == 0;
            }
        }
        if done {
            self.faults.clear(Fault::SdaHeld { clocks: 0 });
        }
    }

    /// True if a bad contact loses the acknowledge of this address or byte written.
    fn loses_acknowledge(&mut self, event: I2cEvent) -> bool {
        let acknowledged = match event {
            I2cEvent::Start { address, .. } => address == self.config.address,
            I2cEvent::Write(_) => self.transfer.selected,
            I2cEvent::Read | I2cEvent::Stop => false,
        };
        acknowledged && self.strikes(Fault::Naks { probability: 0.0 })
    }

    /// True if the fault of this kind is on and strikes now, which its probability decides.
    fn strikes(&mut self, kind: Fault) -> bool {
        let probability = self.faults.get(kind).and_then(Fault::probability);
        probability.is_some_and(|probability| self.bus_noise.random_bool(probability))
    }

    fn answers(&self, now: Ticks) -> bool {
        match self.power {
            Power::Off | Power::Hung => false,
            Power::Booting { answers, .. } => now >= answers,
            Power::On => true,
        }
    }

    fn selected(&self, now: Ticks) -> bool {
        self.transfer.selected && self.answers(now)
    }

    fn stretch(&mut self) -> Ticks {
        let mut stretch =
            Ticks::from_us(self.bus_noise.random_range(self.config.stretch_us.clone()));
        for fault in self.faults.iter() {
            if let Fault::LongStretch {
                stretch: long,
                probability,
            } = *fault
                && self.bus_noise.random_bool(probability)
            {
                stretch += long;
            }
        }
        stretch
    }

    fn advance_pointer(&mut self) {
        self.pointer = (self.pointer + 1) & 0x7F;
    }

    fn read_next(&mut self, now: Ticks) -> u8 {
        let address = self.pointer;
        self.advance_pointer();
        if self.faults.has(Fault::AllOnes) {
            return 0xFF;
        }
        let value = self.stored_next(now, address);
        self.flip(value)
    }

    fn stored_next(&mut self, now: Ticks, address: u8) -> u8 {
        if let Some((at, value)) = self.transfer.shadow.take()
            && at == address
        {
            return value;
        }
        let value = self.read(now, address);
        let is_data = (page0::ACC_DATA..page0::TEMP).contains(&address);
        if self.page == 0 && is_data && address.is_multiple_of(2) && self.power == Power::On {
            let high = if self.strikes(Fault::TornWords { probability: 0.0 }) {
                self.older[usize::from(address + 1 - page0::ACC_DATA)]
            } else {
                self.get(address + 1)
            };
            let [low, high] = self
                .disturb(i16::from_le_bytes([value, high]))
                .to_le_bytes();
            self.transfer.shadow = Some((address + 1, high));
            return low;
        }
        value
    }

    /// A byte after [`Fault::BitFlips`].
    fn flip(&mut self, byte: u8) -> u8 {
        if self.strikes(Fault::BitFlips { probability: 0.0 }) {
            byte ^ 1 << self.bus_noise.random_range(0..8)
        } else {
            byte
        }
    }

    /// A data word after [`Fault::CorruptWords`] and [`Fault::Spikes`].
    fn disturb(&mut self, mut word: i16) -> i16 {
        for fault in self.faults.iter() {
            match *fault {
                Fault::CorruptWords { probability } if self.bus_noise.random_bool(probability) => {
                    word = -1;
                }
                Fault::Spikes { probability } if self.bus_noise.random_bool(probability) => {
                    word ^= i16::MIN;
                }
                _ => {}
            }
        }
        word
    }
}
