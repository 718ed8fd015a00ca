//! What goes wrong in the core; each fault prints as one line.

use std::fmt;

use crate::peripherals::{BusError, Width};

/// Something that an instruction could not do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Address of the instruction.
    pub pc: u32,
    /// What it could not do.
    pub kind: FaultKind,
}

/// What an instruction could not do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// A load that is not aligned to its width: HardFault.
    UnalignedLoad {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// A store that is not aligned to its width: HardFault.
    UnalignedStore {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// A load from where nothing answers: HardFault.
    UnmappedLoad {
        /// The address asked for.
        address: u32,
    },
    /// A store to where nothing answers: HardFault.
    UnmappedStore {
        /// The address asked for.
        address: u32,
    },
    /// Instructions can be fetched from flash and SRAM only: HardFault.
    UnmappedFetch {
        /// The address of the half-word.
        address: u32,
    },
    /// An encoding that ARMv6-M leaves undefined or unpredictable: HardFault. A 16-bit encoding
    /// has zeros above.
    Undefined {
        /// The encoding; of a 32-bit one the first half-word is above.
        encoding: u32,
    },
    /// A branch or a vector to an address with bit 0 clear (ARM state, which this core does not
    /// have): HardFault.
    NotThumb,
    /// An exception return with a value, a state or a stacked xPSR that does not fit: HardFault.
    ExceptionReturn {
        /// The EXC_RETURN value.
        value: u32,
    },
    /// SVC where its priority does not allow it: HardFault.
    SupervisorCall,
    /// Deep sleep (SCR.SLEEPDEEP) is not modelled: the chip stops.
    DeepSleep,
    /// A register of the system control space that is not modelled, or not accessed as a word: the
    /// chip stops.
    SystemControl {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// An access that a peripheral answers with an exception: HardFault; or one that its model does
    /// not cover: the chip stops.
    Peripheral(BusError),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pc 0x{:08x}: {}", self.pc, self.kind)
    }
}

impl std::error::Error for Fault {}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnalignedLoad { address, width } => {
                write!(f, "{width} load from 0x{address:08x} is not aligned")
            }
            Self::UnalignedStore { address, width } => {
                write!(f, "{width} store to 0x{address:08x} is not aligned")
            }
            Self::UnmappedLoad { address } => {
                write!(f, "load from 0x{address:08x}, where nothing answers")
            }
            Self::UnmappedStore { address } => {
                write!(f, "store to 0x{address:08x}, where nothing answers")
            }
            Self::UnmappedFetch { address } => {
                write!(f, "no instruction can be fetched from 0x{address:08x}")
            }
            Self::Undefined { encoding } if *encoding > 0xFFFF => {
                write!(f, "undefined instruction 0x{encoding:08x}")
            }
            Self::Undefined { encoding } => write!(f, "undefined instruction 0x{encoding:04x}"),
            Self::NotThumb => write!(f, "branch to an address with bit 0 clear (ARM state)"),
            Self::ExceptionReturn { value } => {
                write!(
                    f,
                    "exception return 0x{value:08x} does not fit the core's state"
                )
            }
            Self::SupervisorCall => write!(f, "SVC where its priority does not allow it"),
            Self::DeepSleep => write!(f, "WFI or WFE with SCR.SLEEPDEEP: not modelled"),
            Self::SystemControl { address, width } => write!(
                f,
                "{width} access to 0x{address:08x} in the system control space: not modelled"
            ),
            Self::Peripheral(error) => write!(f, "{error}"),
        }
    }
}
