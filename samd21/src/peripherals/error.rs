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

/// Size of a bus access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// 8 bits.
    Byte,
    /// 16 bits.
    Half,
    /// 32 bits.
    Word,
}

impl Width {
    /// 1, 2 or 4.
    pub const fn bytes(self) -> u32 {
        match self {
            Self::Byte => 1,
            Self::Half => 2,
            Self::Word => 4,
        }
    }
}

/// An access that stops the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// Nothing is at this address.
    Unmapped {
        /// The address.
        addr: u32,
    },
    /// The address is no multiple of the access' size.
    Misaligned {
        /// The address.
        addr: u32,
    },
    /// Something is there on the real chip, but no model of it here.
    Unmodelled {
        /// The address.
        addr: u32,
        /// Name in the data sheet.
        peripheral: &'static str,
        /// The register, or which of its values.
        register: &'static str,
    },
    /// The power manager has masked the peripheral's clock.
    Unclocked {
        /// The address.
        addr: u32,
        /// Name in the data sheet.
        peripheral: &'static str,
    },
    /// The peripheral access controller protects the peripheral from writes.
    Protected {
        /// The address.
        addr: u32,
        /// Name in the data sheet.
        peripheral: &'static str,
    },
    /// The access would hang or damage the real chip.
    Forbidden {
        /// The address.
        addr: u32,
        /// Name in the data sheet.
        peripheral: &'static str,
        /// What is wrong.
        why: &'static str,
    },
}

impl fmt::Display for BusError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Unmapped { addr } => write!(f, "nothing at {addr:#010x}"),
            Self::Misaligned { addr } => write!(f, "misaligned access at {addr:#010x}"),
            Self::Unmodelled {
                addr,
                peripheral,
                register,
            } => write!(
                f,
                "{peripheral} at {addr:#010x}: {register} is not modelled"
            ),
            Self::Unclocked { addr, peripheral } => {
                write!(f, "{peripheral} at {addr:#010x}: its bus clock is masked")
            }
            Self::Protected { addr, peripheral } => {
                write!(
                    f,
                    "{peripheral} at {addr:#010x}: write-protected by the PAC"
                )
            }
            Self::Forbidden {
                addr,
                peripheral,
                why,
            } => write!(f, "{peripheral} at {addr:#010x}: {why}"),
        }
    }
}

impl std::error::Error for BusError {}
