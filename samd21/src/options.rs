//! What may be chosen when a chip is made.

use crate::board::Ticks;

/// How a chip is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Flash wait states.
    pub wait_states: WaitStates,
    /// How long registers stay in synchronisation after a write.
    pub syncbusy_hold: SyncHold,
    /// The 128-bit serial number, word 0 first (0x0080_A00C, 0x0080_A040, 44, 48).
    pub serial_number: [u32; 4],
    /// Decides what is random in a chip: the noise in SRAM at power-on.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            wait_states: WaitStates::AsConfigured,
            syncbusy_hold: SyncHold::Instant,
            serial_number: [0x5D21_0001, 0x5D21_0002, 0x5D21_0003, 0x5D21_0004],
            seed: 0,
        }
    }
}

/// Flash wait states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitStates {
    /// What the firmware writes to NVMCTRL.CTRLB.RWS.
    AsConfigured,
    /// This many, whatever the firmware writes: to measure what they cost.
    Forced(u8),
}

/// How long a SYNCBUSY flag stays set after a write to a synchronised register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyncHold {
    /// Not at all: the write takes effect at once.
    Instant,
    /// This long: shows code that does not wait.
    For(Ticks),
}
