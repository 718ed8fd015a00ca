//! Counters of samples, faults and set-ups.

use crate::{Micros, SensorFault};

/// Counters since the driver was made; they wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// Good samples.
    pub good: u32,
    /// Bursts whose data differ from the burst before: they show the chip's refresh rate.
    pub fresh: u32,
    /// Transfers without acknowledge.
    pub nak: u32,
    /// Transfers that missed their deadline.
    pub timeout: u32,
    /// Transfers with a bus line held low.
    pub stuck: u32,
    /// Arbitration losses, protocol errors and wrong lengths.
    pub protocol: u32,
    /// Samples with words of 0xFFFF.
    pub all_ones: u32,
    /// Samples that were all zero.
    pub all_zero: u32,
    /// Frozen chips.
    pub frozen: u32,
    /// Samples out of range.
    pub implausible: u32,
    /// Samples in which the words of a sensor became 0.
    pub torn: u32,
    /// Samples withheld: a register did not read as written, or too many bursts were wrong.
    pub withheld: u32,
    /// Ticks without a burst.
    pub late: u32,
    /// Registers verified while sampling.
    pub verified: u32,
    /// Verifications that read something else than was written.
    pub mismatched: u32,
    /// Times the chip was found to have reset itself.
    pub resets: u32,
    /// Failed attempts to set up a chip that answered.
    pub failed_setups: u32,
    /// Times the chip went into sampling.
    pub starts: u32,
    /// Time of the last good sample.
    pub last_good: Option<Micros>,
    /// Time of the last set-up, from its beginning to sampling, microseconds.
    pub setup_us: u64,
}

impl Health {
    /// Counts a fault.
    pub fn count(&mut self, fault: SensorFault) {
        let counter = match fault {
            SensorFault::Nak => &mut self.nak,
            SensorFault::Timeout => &mut self.timeout,
            SensorFault::Stuck => &mut self.stuck,
            SensorFault::Arbitration | SensorFault::Protocol => &mut self.protocol,
            SensorFault::AllOnes => &mut self.all_ones,
            SensorFault::AllZero | SensorFault::Reset => &mut self.all_zero,
            SensorFault::Frozen => &mut self.frozen,
            SensorFault::Implausible => &mut self.implausible,
            SensorFault::Torn => &mut self.torn,
            SensorFault::Late => &mut self.late,
            _ => &mut self.withheld,
        };
        *counter = counter.wrapping_add(1);
    }
}
