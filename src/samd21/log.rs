//! What a debug probe shows (feature `probe`, `DEFMT_LOG=info` to see all of it). Without the
//! feature these functions do nothing.

#![cfg_attr(not(feature = "probe"), allow(unused_variables))]

use tvc_nano::failsafe::{BootReport, State};

/// The board is up.
pub(crate) fn started(report: &BootReport) {
    #[cfg(feature = "probe")]
    match &report.crash {
        Some(crash) => defmt::error!("after {}", defmt::Display2Format(crash)),
        None => defmt::info!("started"),
    }
}

/// The flight has changed its state.
pub(crate) fn state(state: &State) {
    #[cfg(feature = "probe")]
    defmt::info!("{}", defmt::Display2Format(state));
}

/// The sensor bus had to be repaired, this many times so far.
pub(crate) fn bus_repaired(count: u16) {
    #[cfg(feature = "probe")]
    defmt::warn!("sensor bus repaired, {} times", count);
}
