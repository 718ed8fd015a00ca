//! The state of the board's parts, which the flight uses and SYS_STATUS sends.

use crate::ticks::BurstTimes;

/// How the board's parts do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardStatus {
    /// Share of time that the processor was awake, per mille.
    pub load_permille: u16,
    /// Transfers on the sensor's bus that failed.
    pub bus_errors: u16,
    /// Times that the bus had to be freed.
    pub bus_recoveries: u16,
    /// How long the newest bursts took.
    pub bursts: BurstTimes,
    /// How long the sensor holds up a STOP, us.
    pub stop_us: u32,
    /// What USB has disciplined the clock to, where it has been looked at: FINE of the DFLL, 0 to
    /// 1023.
    pub clock_fine: Option<u16>,
}
