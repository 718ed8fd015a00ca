//! What goes wrong in the core; each fault prints as one line.

use crate::peripherals::{BusError, Width};
use thiserror::Error;

/// Something that an instruction could not do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("pc 0x{pc:08x}: {kind}")]
pub struct Fault {
    /// Address of the instruction.
    pub pc: u32,
    /// What it could not do.
    pub kind: FaultKind,
}

/// What an instruction could not do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FaultKind {
    /// A load that is not aligned to its width: HardFault.
    #[error("{width} load from 0x{address:08x} is not aligned")]
    UnalignedLoad {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// A store that is not aligned to its width: HardFault.
    #[error("{width} store to 0x{address:08x} is not aligned")]
    UnalignedStore {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// A load from where nothing answers: HardFault.
    #[error("load from 0x{address:08x}, where nothing answers")]
    UnmappedLoad {
        /// The address asked for.
        address: u32,
    },
    /// A store to where nothing answers: HardFault.
    #[error("store to 0x{address:08x}, where nothing answers")]
    UnmappedStore {
        /// The address asked for.
        address: u32,
    },
    /// Instructions can be fetched from flash and SRAM only: HardFault.
    #[error("no instruction can be fetched from 0x{address:08x}")]
    UnmappedFetch {
        /// The address of the half-word.
        address: u32,
    },
    /// An encoding that ARMv6-M leaves undefined or unpredictable: HardFault. A 16-bit encoding
    /// has zeros above.
    #[error("undefined instruction 0x{encoding:0digits$x}", digits = digits(.encoding))]
    Undefined {
        /// The encoding; of a 32-bit one the first half-word is above.
        encoding: u32,
    },
    /// A branch or a vector to an address with bit 0 clear (ARM state, which this core does not
    /// have): HardFault.
    #[error("branch to an address with bit 0 clear (ARM state)")]
    NotThumb,
    /// An exception return with a value, a state or a stacked xPSR that does not fit: HardFault.
    #[error("exception return 0x{value:08x} does not fit the core's state")]
    ExceptionReturn {
        /// The EXC_RETURN value.
        value: u32,
    },
    /// SVC where its priority does not allow it: HardFault.
    #[error("SVC where its priority does not allow it")]
    SupervisorCall,
    /// Deep sleep (SCR.SLEEPDEEP) is not modelled: the chip stops.
    #[error("WFI or WFE with SCR.SLEEPDEEP: not modelled")]
    DeepSleep,
    /// A register of the system control space that is not modelled, or not accessed as a word: the
    /// chip stops.
    #[error("{width} access to 0x{address:08x} in the system control space: not modelled")]
    SystemControl {
        /// The address asked for.
        address: u32,
        /// The width asked for.
        width: Width,
    },
    /// An access that a peripheral answers with an exception: HardFault; or one that its model does
    /// not cover: the chip stops.
    #[error("{0}")]
    Peripheral(BusError),
}

/// Digits of an instruction of 16 or 32 bits.
fn digits(encoding: &u32) -> usize {
    if *encoding > 0xFFFF { 8 } else { 4 }
}
