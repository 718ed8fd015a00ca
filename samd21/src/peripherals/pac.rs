//! PAC0 to PAC2: peripheral access controllers.
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00 | WPCLR | reads the protections, ones clear them |
//! | 04 | WPSET | reads the protections, ones set them |
//!
//! A write to a protected peripheral is answered with an exception, and so is clearing a clear bit
//! or setting a set one.
//!
//! | left out | why |
//! |---|---|
//! | nothing | |

use super::Bridge;
use super::access::{DONE, Lanes, RESERVED, Read, Refusal, Write};

#[derive(Clone, Debug)]
pub(crate) struct Pac {
    protected: [u32; 3],
}

impl Pac {
    pub(crate) fn new() -> Self {
        // From reset only the DSU is protected.
        Self { protected: [0, 1 << 1, 0] }
    }

    /// Whether writes to peripheral `index` of a bridge fail.
    pub(crate) fn protects(&self, bridge: Bridge, index: u32) -> bool {
        index != 0 && self.protected[bridge as usize] >> index & 1 != 0
    }

    pub(crate) fn read(&self, pac: usize, offset: u32) -> Read {
        match offset {
            0x00 | 0x04 => Ok(self.protected[pac]),
            _ => Err(RESERVED),
        }
    }

    pub(crate) fn write(&mut self, pac: usize, offset: u32, lanes: Lanes) -> Write {
        let bits = lanes.bits();
        let protected = &mut self.protected[pac];
        let (wrong, new) = match offset {
            0x00 => (bits & !*protected, *protected & !bits),
            0x04 => (bits & *protected, *protected | bits),
            _ => return Err(RESERVED),
        };
        if wrong != 0 {
            return Err(Refusal::Exception("protection already is as asked for"));
        }
        *protected = new;
        DONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protection_is_set_and_cleared_by_ones() {
        let mut pac = Pac::new();
        assert!(pac.protects(Bridge::B, 1));
        pac.write(0, 0x04, Lanes::word(1 << 4)).unwrap();
        assert!(pac.protects(Bridge::A, 4));
        assert!(pac.write(0, 0x04, Lanes::word(1 << 4)).is_err());
        pac.write(0, 0x00, Lanes::word(1 << 4)).unwrap();
        assert!(!pac.protects(Bridge::A, 4));
    }
}
