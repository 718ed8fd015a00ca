//! Sizes, resets and errors: the words that the bus and the core share.

use std::fmt;

/// Why the chip started anew; the value is the bit in PM.RCAUSE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power was switched on.
    PowerOn = 0x01,
    /// The 3.3 V supply fell below the brown-out level.
    BrownOut33 = 0x04,
    /// The reset pin.
    External = 0x10,
    /// The watchdog ran out or was fed wrongly.
    Watchdog = 0x20,
    /// Software asked: AIRCR.SYSRESETREQ.
    System = 0x40,
}

/// Size of a bus access; the value is its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// 8 bits.
    Byte = 1,
    /// 16 bits.
    Half = 2,
    /// 32 bits.
    Word = 4,
}

impl Width {
    /// 1, 2 or 4.
    pub const fn bytes(self) -> u32 {
        self as u32
    }
}

impl fmt::Display for Width {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Byte => "byte",
            Self::Half => "half-word",
            Self::Word => "word",
        })
    }
}

/// An access that a peripheral refuses or that its model does not cover. What the real chip answers
/// with an exception raises HardFault; anything else stops the emulated chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusError {
    /// The address.
    pub addr: u32,
    /// Name in the data sheet, empty where nothing is.
    pub peripheral: &'static str,
    /// What is wrong.
    pub refusal: Refusal,
}

/// Why an access is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Nothing is at this address.
    Unmapped,
    /// The address is no multiple of the access' size.
    Misaligned,
    /// The power manager has masked the peripheral's clock.
    Unclocked,
    /// The peripheral access controller protects the peripheral from writes.
    Protected,
    /// The peripheral answers with an exception, for this reason.
    Exception(&'static str),
    /// The real chip has this register, or this value of a field, but no model does.
    Unmodelled(&'static str),
    /// The access would hang or damage the real chip, for this reason.
    Forbidden(&'static str),
}

impl fmt::Display for BusError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { addr, peripheral, .. } = self;
        let place = format!("{peripheral} at {addr:#010x}");
        match self.refusal {
            Refusal::Unmapped => write!(f, "nothing at {addr:#010x}"),
            Refusal::Misaligned => write!(f, "misaligned access at {addr:#010x}"),
            Refusal::Unclocked => write!(f, "{place}: its bus clock is masked"),
            Refusal::Protected => write!(f, "{place}: write-protected by the PAC"),
            Refusal::Unmodelled(register) => write!(f, "{place}: {register} is not modelled"),
            Refusal::Exception(why) | Refusal::Forbidden(why) => write!(f, "{place}: {why}"),
        }
    }
}

impl std::error::Error for BusError {}
