//! PM: power manager. Clock dividers, clock masks, reset cause.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | CTRL | reads 0 |
//! | 01 | SLEEP | stored; every sleep depth is the core's WFI |
//! | 08 | CPUSEL | CPU clock = GCLK0 / 2^CPUDIV |
//! | 09-0B | APBxSEL | stored |
//! | 14 | AHBMASK | stored |
//! | 18, 1C, 20 | APBAMASK, APBBMASK, APBCMASK | an access to a masked peripheral faults |
//! | 34-36 | INTENCLR, INTENSET, INTFLAG | CKRDY always set |
//! | 38 | RCAUSE | one bit, the cause of the last reset |
//!
//! | left out | why |
//! |---|---|
//! | sleep modes | firmware sleeps in IDLE only; the time to wake is the core's |
//! | what APB dividers do to access times | access times are the core's business |
//! | a masked AHB clock | the masks of the APB bridges catch the same mistake |

use super::access::{DONE, Lanes, RESERVED, Read, Write};
use super::interrupts::Interrupts;
use super::map::Block;
use super::{Bridge, ResetCause};

const CKRDY: u32 = 1 << 0;

#[derive(Clone, Debug)]
pub(crate) struct Pm {
    sleep: u8,
    select: u32,
    ahb_mask: u32,
    apb_masks: [u32; 3],
    pub(crate) interrupts: Interrupts<CKRDY>,
    cause: ResetCause,
}

impl Pm {
    pub(crate) fn new(cause: ResetCause) -> Self {
        let mut interrupts = Interrupts::of(Block::Pm);
        interrupts.flags = CKRDY;
        Self {
            sleep: 0,
            select: 0,
            ahb_mask: 0x7F,
            apb_masks: [0x7F, 0x7F, 0x0001_0000],
            interrupts,
            cause,
        }
    }

    /// The CPU clock is GCLK0 divided by this.
    pub(crate) fn cpu_divisor(&self) -> u64 {
        1 << (self.select & 7)
    }

    /// Whether peripheral `index` of a bridge has its bus clock.
    pub(crate) fn is_clocked(&self, bridge: Bridge, index: u32) -> bool {
        self.apb_masks[bridge as usize] >> index & 1 != 0
    }

    /// The registers that keep what they are given: where, and what can be written to them.
    fn stored(&mut self, offset: u32) -> Option<(&mut u32, u32)> {
        Some(match offset {
            0x08 => (&mut self.select, 0x0707_0707),
            0x14 => (&mut self.ahb_mask, 0x7F),
            0x18 => (&mut self.apb_masks[0], 0x7F),
            0x1C => (&mut self.apb_masks[1], 0x7F),
            0x20 => (&mut self.apb_masks[2], 0x001F_FFFF),
            _ => return None,
        })
    }

    /// A bit of a register flips: see [`upset`](crate::upset).
    pub(crate) fn flip(&mut self, offset: u32, bit: u32) -> bool {
        // Of the words of CPUSEL and APBxSEL, CPUSEL alone.
        let Some((register, bits)) = self.stored(offset).filter(|_| offset != 0x08 || bit < 3)
        else {
            return false;
        };
        *register ^= bits & 1 << bit;
        bits >> bit & 1 != 0
    }

    pub(crate) fn read(&mut self, offset: u32) -> Read {
        Ok(match offset {
            0x00 => u32::from(self.sleep) << 8,
            0x34 => self.interrupts.read_bytes(),
            0x38 => u32::from(self.cause as u8),
            _ => *self.stored(offset).ok_or(RESERVED)?.0,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, lanes: Lanes) -> Write {
        match offset {
            0x00 => {
                if let Some(sleep) = lanes.byte(1) {
                    self.sleep = sleep & 3;
                }
            }
            0x34 => {
                self.interrupts.write_bytes(lanes);
                // Every clock is ready at once, always.
                self.interrupts.flags = CKRDY;
            }
            0x38 => {}
            _ => {
                let (register, bits) = self.stored(offset).ok_or(RESERVED)?;
                *register = lanes.merge(*register) & bits;
            }
        }
        DONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_start_as_the_data_sheet_says_and_follow_writes() {
        let mut pm = Pm::new(ResetCause::PowerOn);
        assert!(pm.is_clocked(Bridge::A, 3));
        assert!(!pm.is_clocked(Bridge::C, 8));
        let mask = pm.read(0x20).unwrap() | 1 << 8;
        pm.write(0x20, Lanes::word(mask)).unwrap();
        assert!(pm.is_clocked(Bridge::C, 8));
        assert!(pm.is_clocked(Bridge::C, 16));
    }

    #[test]
    fn reset_cause_has_the_bit_of_the_cause() {
        assert_eq!(Pm::new(ResetCause::PowerOn).read(0x38), Ok(0x01));
        assert_eq!(Pm::new(ResetCause::Watchdog).read(0x38), Ok(0x20));
        assert_eq!(Pm::new(ResetCause::System).read(0x38), Ok(0x40));
    }

    #[test]
    fn byte_writes_divide_the_cpu_clock() {
        let mut pm = Pm::new(ResetCause::PowerOn);
        pm.write(0x08, Lanes::new(2, 0, 1)).unwrap();
        pm.write(0x08, Lanes::new(3, 1, 1)).unwrap();
        assert_eq!(pm.cpu_divisor(), 4);
        assert_eq!(pm.read(0x08), Ok(0x0302));
    }
}
