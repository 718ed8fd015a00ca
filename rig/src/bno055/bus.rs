//! The chip as a slave on the I2C bus: transfers, clock stretching, what a bad cable makes of it.

use super::registers::page0;
use super::{Bno055, Fault, Power, Transfer};
use rand::Rng;
use samd21::board::{I2cEvent, I2cReply, Lines, Ticks};

/// How long another master holds the data line low, a byte at 50 kHz.
const FOREIGN_BYTE: Ticks = Ticks::from_us(180);

impl Bno055 {
    /// The bus master does `event`.
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
                    shadow: None,
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

    /// A byte begins at `now`: whether a START or STOP lies inside it. Another master may take the
    /// bus here too.
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

    /// The lines that the sensor, a fault of its cable or another master holds low.
    pub fn held_low(&self, now: Ticks) -> Lines {
        let stuck =
            self.faults.has(Fault::SdaStuck) || self.faults.has(Fault::SdaHeld { clocks: 0 });
        let inside_a_byte = self.faults.has(Fault::ClockHang) && self.power != Power::Hung;
        Lines {
            sda: stuck || inside_a_byte || now < self.foreign_until,
            scl: self.faults.has(Fault::SclStuck),
        }
    }

    /// The master clocks the bus by hand: one rising edge of SCL.
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

    /// A bad contact takes the acknowledge of an address or of a byte written.
    fn loses_acknowledge(&mut self, event: I2cEvent) -> bool {
        let acknowledged = match event {
            I2cEvent::Start { address, .. } => address == self.config.address,
            I2cEvent::Write(_) => self.transfer.selected,
            I2cEvent::Read | I2cEvent::Stop => false,
        };
        acknowledged
            && self.faults.iter().any(|fault| match *fault {
                Fault::Naks { probability } => self.bus_noise.random_bool(probability),
                _ => false,
            })
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
            let high = if self.tears() {
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

    /// The shadowing of a word fails.
    fn tears(&mut self) -> bool {
        self.faults.iter().any(|fault| match *fault {
            Fault::TornWords { probability } => self.bus_noise.random_bool(probability),
            _ => false,
        })
    }

    /// What a bad cable makes of a byte.
    fn flip(&mut self, byte: u8) -> u8 {
        let mut flipped = byte;
        for fault in self.faults.iter() {
            if let Fault::BitFlips { probability } = *fault
                && self.bus_noise.random_bool(probability)
            {
                flipped ^= 1 << self.bus_noise.random_range(0..8);
            }
        }
        flipped
    }

    /// What a bad cable makes of a data word.
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
