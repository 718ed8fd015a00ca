//! The chip as a slave on the I2C bus: transfers, clock stretching, and faults of the cable.

use super::registers::page0;
use super::{Bno055, Fault, FaultKind, Power, Transfer};
use rand::Rng;
use samd21::board::{I2cEvent, I2cReply, Lines, Ticks};
use std::ops::RangeInclusive;

/// How long another master holds the data line low: a byte at 50 kHz.
const FOREIGN_BYTE: Ticks = Ticks::from_us(180);

/// How long the chip holds the clock line, us; each drawn uniformly. Its host controller is slow:
/// it holds SCL until its firmware has served the interrupt of the byte.
#[derive(Clone, Debug, PartialEq)]
pub struct BusTiming {
    /// In each byte (Bosch forum, td-p/7270: about 180 us).
    pub stretch_us: RangeInclusive<u64>,
    /// Some bytes are held longer instead.
    pub stretch_rare: Option<RareStretch>,
    /// Before the STOP after a read: the controller, an Atmel SERCOM slave, is interrupted by the
    /// missing acknowledge as by any byte, and probably holds SCL until its firmware releases it.
    pub stop_read_us: RangeInclusive<u64>,
    /// Before the STOP after a write. A SERCOM slave stretches before its acknowledge, not here.
    pub stop_write_us: RangeInclusive<u64>,
}

impl Default for BusTiming {
    fn default() -> Self {
        Self {
            stretch_us: 160..=200,
            stretch_rare: None,
            stop_read_us: 160..=200,
            stop_write_us: 0..=0,
        }
    }
}

/// A hold of the clock line that some bytes have instead of the usual one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RareStretch {
    /// How long, us.
    pub us: u64,
    /// Share of the bytes, 0 to 1.
    pub probability: f64,
}

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
                    reads: read,
                    expects_pointer: !read,
                    ..Transfer::default()
                };
                if selected { I2cReply::ACK } else { I2cReply::NAK }
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
            I2cEvent::Read if self.selected(now) => I2cReply::data(self.read_next(now)),
            I2cEvent::Write(_) | I2cEvent::Read => I2cReply::NAK,
            I2cEvent::Stop => {
                let ended = std::mem::take(&mut self.transfer);
                return I2cReply::NAK.stretched(self.hold_before_stop(ended));
            }
        };
        if self.transfer.selected { reply.stretched(self.stretch()) } else { reply }
    }

    /// True if a START or STOP lies inside the byte that begins at `now`. Another master may take
    /// the bus at this moment too.
    pub fn glitch(&mut self, now: Ticks) -> bool {
        let is_error = self.strikes(FaultKind::BusErrors);
        if self.strikes(FaultKind::ArbitrationLosses) {
            self.foreign_until = now + FOREIGN_BYTE;
        }
        is_error
    }

    /// The lines that the chip, a fault of its cable or another master holds low.
    pub fn held_low(&self, now: Ticks) -> Lines {
        let stuck = self.faults.has(FaultKind::SdaStuck) || self.faults.has(FaultKind::SdaHeld);
        let inside_a_byte = self.faults.has(FaultKind::ClockHang) && self.power != Power::Hung;
        Lines {
            sda: stuck || inside_a_byte || now < self.foreign_until,
            scl: self.faults.has(FaultKind::SclStuck),
        }
    }

    /// A rising edge of SCL outside of a transfer: the master clocks a held data line free.
    pub fn clocked(&mut self) {
        if self.faults.has(FaultKind::ClockHang) {
            self.power = Power::Hung;
        }
        self.faults.0.retain_mut(|fault| match fault {
            Fault::SdaHeld { clocks } => {
                *clocks = clocks.saturating_sub(1);
                *clocks > 0
            }
            _ => true,
        });
    }

    /// True if a bad contact loses the acknowledge of this address or byte written.
    fn loses_acknowledge(&mut self, event: I2cEvent) -> bool {
        let acknowledged = match event {
            I2cEvent::Start { address, .. } => address == self.config.address,
            I2cEvent::Write(_) => self.transfer.selected,
            I2cEvent::Read | I2cEvent::Stop => false,
        };
        acknowledged && self.strikes(FaultKind::Naks)
    }

    /// True if the fault of this kind is on and strikes now, which its probability decides.
    fn strikes(&mut self, kind: FaultKind) -> bool {
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
        let mut stretch = match self.config.bus.stretch_rare {
            Some(rare) if self.bus_noise.random_bool(rare.probability) => Ticks::from_us(rare.us),
            _ => self.draw_us(self.config.bus.stretch_us.clone()),
        };
        if self.strikes(FaultKind::LongStretch)
            && let Some(Fault::LongStretch { stretch: long, .. }) =
                self.faults.get(FaultKind::LongStretch)
        {
            stretch += long;
        }
        stretch
    }

    /// How long the STOP that ends this transfer waits.
    fn hold_before_stop(&mut self, ended: Transfer) -> Ticks {
        let bus = &self.config.bus;
        match ended {
            Transfer { selected: false, .. } => Ticks::ZERO,
            Transfer { reads: true, .. } => self.draw_us(bus.stop_read_us.clone()),
            Transfer { reads: false, .. } => self.draw_us(bus.stop_write_us.clone()),
        }
    }

    /// A time out of a range of us. One that is certain leaves the random numbers alone.
    fn draw_us(&mut self, range: RangeInclusive<u64>) -> Ticks {
        Ticks::from_us(match range.start() == range.end() {
            true => *range.start(),
            false => self.bus_noise.random_range(range),
        })
    }

    fn advance_pointer(&mut self) {
        self.pointer = (self.pointer + 1) & 0x7F;
    }

    fn read_next(&mut self, now: Ticks) -> u8 {
        let address = self.pointer;
        self.advance_pointer();
        if self.faults.has(FaultKind::AllOnes) {
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
            let high = if self.strikes(FaultKind::TornWords) {
                self.older[usize::from(address + 1 - page0::ACC_DATA)]
            } else {
                self.get(address + 1)
            };
            let [low, high] = self.disturb(i16::from_le_bytes([value, high])).to_le_bytes();
            self.transfer.shadow = Some((address + 1, high));
            return low;
        }
        value
    }

    /// A byte after [`Fault::BitFlips`].
    fn flip(&mut self, byte: u8) -> u8 {
        if self.strikes(FaultKind::BitFlips) {
            byte ^ 1 << self.bus_noise.random_range(0..8)
        } else {
            byte
        }
    }

    /// A data word after [`Fault::CorruptWords`] and [`Fault::Spikes`].
    fn disturb(&mut self, mut word: i16) -> i16 {
        if self.strikes(FaultKind::Spikes) {
            word ^= i16::MIN;
        }
        if self.strikes(FaultKind::CorruptWords) { -1 } else { word }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bno055::Config;

    /// Later than any start-up.
    const READY: Ticks = Ticks::from_ms(700);

    fn chip(bus: BusTiming) -> Bno055 {
        Bno055::new(Config { bus, ..Config::default() })
    }

    /// The hold before the STOP of a transfer in this direction.
    fn hold(chip: &mut Bno055, address: u8, read: bool) -> Ticks {
        chip.i2c(READY, I2cEvent::Start { address, read });
        chip.i2c(READY, I2cEvent::Stop).stretch
    }

    #[test]
    fn the_stop_waits_after_a_read_of_this_chip_only() {
        let mut chip = chip(BusTiming::default());
        let read = hold(&mut chip, 0x28, true).as_us();
        assert!((160..=200).contains(&read), "{read} us");
        assert_eq!(hold(&mut chip, 0x28, false), Ticks::ZERO);
        assert_eq!(hold(&mut chip, 0x29, true), Ticks::ZERO);
    }

    #[test]
    fn the_stop_waits_after_a_write_if_it_is_to() {
        let mut chip =
            chip(BusTiming { stop_read_us: 0..=0, stop_write_us: 90..=90, ..BusTiming::default() });
        assert_eq!(hold(&mut chip, 0x28, false), Ticks::from_us(90));
        assert_eq!(hold(&mut chip, 0x28, true), Ticks::ZERO);
    }

    #[test]
    fn rare_bytes_are_held_longer() {
        let mut chip = chip(BusTiming {
            stretch_rare: Some(RareStretch { us: 500, probability: 0.1 }),
            ..BusTiming::default()
        });
        let start = I2cEvent::Start { address: 0x28, read: true };
        chip.i2c(READY, start);
        let holds = (0..1000).map(|_| chip.i2c(READY, I2cEvent::Read).stretch.as_us());
        let holds: Vec<u64> = holds.collect();
        let rare = holds.iter().filter(|&&us| us == 500).count();
        assert!((60..140).contains(&rare), "{rare} of 1000");
        assert!(holds.iter().all(|us| *us == 500 || (160..=200).contains(us)));
    }
}
