//! DSU: device service unit. Its identity, and the engine that takes CRC-32 of the flash beside the
//! core (D21, 13.11.3).
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL | SWRST, CRC |
//! | 01 | STATUSA | DONE and BERR; ones clear them |
//! | 02 | STATUSB | no debugger, not protected |
//! | 04, 08, 0C | ADDR, LENGTH, DATA | stored; DATA is the sum to begin with, and the sum at the end |
//! | 18 | DID | SAMD21G18A, die revision D |
//!
//! The sum is of the flash as it is when the engine starts. How long a word takes is not published:
//! the chip's options say it.
//!
//! | left out | why |
//! |---|---|
//! | sums of the SRAM | wrong on silicon (erratum 1.8.3): they fault |
//! | what the engine's reads cost the core's fetches | not published |
//! | chip erase, memory test, debug channel, CoreSight ROM | a programmer's tools, not an application's |

use crc::{CRC_32_ISO_HDLC, Crc, Table};

use super::access::{Bus, DONE as TAKEN, Lanes, RESERVED, Read, Refusal, Write};
use super::clock::FRACTION;
use crate::board::Ticks;
use crate::memory::Memory;

/// Device identification: SAM D21 family, revision 3, G18A.
const DID: u32 = 0x1001_0305;

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// CTRL.
const SWRST: u8 = 1 << 0;
const START: u8 = 1 << 2;
/// STATUSA.
const DONE: u8 = 1 << 0;
const BERR: u8 = 1 << 2;

#[derive(Clone, Debug, Default)]
pub(crate) struct Dsu {
    status: u8,
    address: u32,
    length: u32,
    data: u32,
    /// When the engine is done, and what DATA and STATUSA are then.
    running: Option<(Ticks, u32, u8)>,
    word_cycles: u32,
}

impl Dsu {
    /// A word of the flash takes `word_cycles` cycles of the core.
    pub(crate) fn new(word_cycles: u32) -> Self {
        Self { word_cycles, ..Self::default() }
    }

    /// What the engine has done until now.
    fn catch_up(&mut self, now: Ticks) {
        if let Some((_, data, status)) = self.running.take_if(|(end, ..)| *end <= now) {
            self.data = data;
            self.status |= status;
        }
    }

    /// The flash cannot be read for a while.
    pub(crate) fn hold(&mut self, now: Ticks, time: Ticks) {
        self.catch_up(now);
        if let Some((end, ..)) = &mut self.running {
            *end += time;
        }
    }

    pub(crate) fn read(&mut self, now: Ticks, offset: u32) -> Read {
        self.catch_up(now);
        Ok(match offset {
            0x00 => u32::from(self.status) << 8,
            0x04 => self.address,
            0x08 => self.length,
            0x0C => self.data,
            0x18 => DID,
            _ => return Err(RESERVED),
        })
    }

    /// `cycle` is the length of a cycle of the core in parts of a tick.
    pub(crate) fn write(
        &mut self,
        bus: &mut Bus<'_>,
        offset: u32,
        lanes: Lanes,
        memory: &Memory,
        cycle: u64,
    ) -> Write {
        self.catch_up(bus.now);
        match offset {
            0x00 => {
                self.status &= !lanes.byte(1).unwrap_or(0);
                match lanes.byte(0).unwrap_or(0) {
                    0 => {}
                    SWRST => *self = Self::new(self.word_cycles),
                    START => return self.start(bus, memory, cycle),
                    _ => return Err(Refusal::Unmodelled("this command of CTRL")),
                }
            }
            _ if self.running.is_some() => bus.note("DSU", "written while the engine runs"),
            0x04 => self.address = lanes.merge(self.address) & !3,
            0x08 => self.length = lanes.merge(self.length) & !3,
            0x0C => self.data = lanes.merge(self.data),
            _ => return Err(RESERVED),
        }
        TAKEN
    }

    /// Flips a bit of a register, that of DONE in the word of CTRL and STATUSA.
    pub(crate) fn flip(&mut self, now: Ticks, offset: u32, bit: u32) -> bool {
        self.catch_up(now);
        match offset {
            0x00 if bit == 8 => self.status ^= DONE,
            0x04 if bit > 1 => self.address ^= 1 << bit,
            0x08 if bit > 1 => self.length ^= 1 << bit,
            0x0C => self.data ^= 1 << bit,
            _ => return false,
        }
        true
    }

    fn start(&mut self, bus: &mut Bus<'_>, memory: &Memory, cycle: u64) -> Write {
        if self.running.is_some() {
            bus.note("DSU", "engine started while it runs");
            return TAKEN;
        }
        let flash = memory.flash();
        let begin = self.address as usize;
        let range = begin..begin.saturating_add(self.length as usize);
        let (words, sum, status) = match flash.get(range) {
            Some(bytes) => {
                let mut digest = CRC.digest_with_initial(self.data.reverse_bits());
                digest.update(bytes);
                (self.length / 4, !digest.finalize(), DONE)
            }
            None if begin < flash.len() => (0, self.data, DONE | BERR),
            None => return Err(Refusal::Unmodelled("a sum of other memory than the flash")),
        };
        let time = u64::from(words) * u64::from(self.word_cycles) * cycle;
        self.running = Some((bus.now + Ticks(time >> FRACTION), sum, status));
        TAKEN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(dsu: &mut Dsu, memory: &Memory, now: Ticks, offset: u32, value: u32) -> Write {
        Bus::alone(now, |bus| dsu.write(bus, offset, Lanes::word(value), memory, 1 << FRACTION))
    }

    /// The sum of `length` bytes from `address` on that begins with `data`, and when it is there.
    fn sum(memory: &Memory, address: u32, length: u32, data: u32) -> (u32, Ticks) {
        let mut dsu = Dsu::new(4);
        for (offset, value) in [(4, address), (8, length), (12, data), (0, u32::from(START))] {
            write(&mut dsu, memory, Ticks(100), offset, value).unwrap();
        }
        let (end, ..) = dsu.running.unwrap();
        assert_eq!(dsu.read(Ticks(end.0 - 1), 0).unwrap(), 0);
        assert_eq!(dsu.read(end, 0).unwrap(), u32::from(DONE) << 8);
        (dsu.read(end, 12).unwrap(), end)
    }

    #[test]
    fn the_sum_of_a_text_is_the_published_one_and_parts_go_on() {
        let mut memory = Memory::new(0);
        // The check value of the catalogue is that of nine digits; of eight, by hand of `cksum`.
        memory.load(0x100, b"12345678").expect("it fits");
        let (whole, end) = sum(&memory, 0x100, 8, u32::MAX);
        assert_eq!(!whole, 0x9AE0_DAAF);
        assert_eq!(end, Ticks(100 + 2 * 4));
        let (first, _) = sum(&memory, 0x100, 4, u32::MAX);
        assert_eq!(sum(&memory, 0x104, 4, first).0, whole);
    }

    #[test]
    fn the_end_of_the_flash_is_a_bus_error_and_other_memory_is_refused() {
        let memory = Memory::new(0);
        let mut dsu = Dsu::new(4);
        for (offset, value) in [(4, 0x3_FFFC), (8, 8), (0, u32::from(START))] {
            write(&mut dsu, &memory, Ticks(0), offset, value).unwrap();
        }
        assert_eq!(dsu.read(Ticks(0), 0).unwrap(), u32::from(DONE | BERR) << 8);
        write(&mut dsu, &memory, Ticks(0), 0, u32::from(DONE | BERR) << 8).unwrap();
        assert_eq!(dsu.read(Ticks(0), 0).unwrap(), 0);
        write(&mut dsu, &memory, Ticks(0), 4, 0x2000_0000).unwrap();
        assert!(write(&mut dsu, &memory, Ticks(0), 0, u32::from(START)).is_err());
        write(&mut dsu, &memory, Ticks(0), 0, u32::from(SWRST)).unwrap();
        assert_eq!(dsu.read(Ticks(0), 4).unwrap(), 0);
    }

    #[test]
    fn while_the_flash_is_written_the_engine_waits() {
        let memory = Memory::new(0);
        let mut dsu = Dsu::new(4);
        for (offset, value) in [(8, 4), (0, u32::from(START))] {
            write(&mut dsu, &memory, Ticks(0), offset, value).unwrap();
        }
        dsu.hold(Ticks(0), Ticks(1000));
        assert_eq!(dsu.read(Ticks(1000), 0).unwrap(), 0);
        assert_eq!(dsu.read(Ticks(1000 + 4), 0).unwrap(), u32::from(DONE) << 8);
    }
}
