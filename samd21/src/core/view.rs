//! What a core shows to whoever runs it: why a run ended, what was counted, its registers.

use crate::fault::Fault;
use crate::peripherals::ResetCause;
use thiserror::Error;

/// Why a run ended.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Stop {
    /// The time asked for is reached.
    #[error("the time asked for is reached")]
    Reached,
    /// Firmware or a watchdog asks for a reset. The chip waits for
    /// [`Chip::reset`](crate::Chip::reset).
    #[error("reset: {0:?}")]
    Reset(ResetCause),
    /// An access or a state that no model covers. The chip stands before the instruction.
    #[error("{0}")]
    Fault(Fault),
    /// A BKPT instruction, or a place that whoever runs the chip has named. The chip stands before
    /// it.
    #[error("breakpoint")]
    Breakpoint,
    /// A fault inside of HardFault or NMI: the core stands still until it is reset, by a watchdog
    /// perhaps. Reported once; [`Chip::lockup`](crate::Chip::lockup) and
    /// [`Chip::last_hard_fault`](crate::Chip::last_hard_fault) hold what happened.
    #[error("lockup: a fault inside of HardFault or NMI")]
    Lockup,
}

/// What has been counted since power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Instructions completed.
    pub instructions: u64,
    /// CPU cycles awake: instructions, exception entries and returns, flash wait states.
    pub cycles: u64,
    /// Of these, flash wait states.
    pub flash_wait_cycles: u64,
    /// Time for which peripherals stalled the bus, not in `cycles`.
    pub stall_ticks: u64,
    /// Time asleep, held or locked up.
    pub sleep_ticks: u64,
    /// Handlers started, by entry or by tail-chaining.
    pub exceptions: u64,
    /// HardFaults raised.
    pub hard_faults: u64,
}

/// The core's registers, as a debugger shows them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Registers {
    /// R0 to R12, the stack pointer in use, LR, and the address of the next instruction.
    pub r: [u32; 16],
    /// N, Z, C, V (bits 31 to 28), T (bit 24), exception number (bits 5 to 0).
    pub xpsr: u32,
    /// PRIMASK.
    pub primask: bool,
    /// CONTROL.SPSEL: Thread mode uses PSP.
    pub spsel: bool,
    /// Main stack pointer.
    pub msp: u32,
    /// Process stack pointer.
    pub psp: u32,
}
