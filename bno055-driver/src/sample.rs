//! The sampling burst: its registers and its words.

use crate::config::{Config, Mode};
use crate::registers;
use crate::words;
use tvc_imu::judge::{Inspector, Words};
use tvc_imu::{SensorFault, Transfer};

/// First register and length of the burst that reads all measurements of `mode`.
const fn span(mode: Mode) -> (u8, u8) {
    let first = if mode.has_acc() {
        registers::ACC_DATA
    } else if mode.has_mag() {
        registers::MAG_DATA
    } else {
        registers::GYR_DATA
    };
    let end = if mode.has_gyr() {
        registers::EUL_DATA
    } else if mode.has_mag() {
        registers::GYR_DATA
    } else {
        registers::MAG_DATA
    };
    (first, end - first)
}

/// The burst that reads all measurements of `mode`: 18 bytes in AMG mode.
pub(crate) const fn burst(mode: Mode) -> Transfer {
    let (first, len) = span(mode);
    Transfer::read(first, len)
}

/// Bytes of the rates.
pub(crate) const RATES: u8 = registers::EUL_DATA - registers::GYR_DATA;

/// The burst that reads the rates alone, if `mode` measures more.
pub(crate) const fn rates_burst(mode: Mode) -> Option<Transfer> {
    let (_, len) = span(mode);
    if mode.has_gyr() && len > RATES {
        Some(Transfer::read(registers::GYR_DATA, RATES))
    } else {
        None
    }
}

/// Bytes of a whole burst in front of the rates.
pub(crate) const fn rates_at(mode: Mode) -> u32 {
    let (first, _) = span(mode);
    (registers::GYR_DATA - first) as u32
}

/// Fills in the `words` of a burst; whether the burst is whole. The last good burst completes rates
/// alone.
///
/// # Errors
/// [`SensorFault::Protocol`] for another length than that of a burst.
#[inline]
pub(crate) fn read(
    words: &mut Words,
    config: &Config,
    inspector: &Inspector,
    bytes: &[u8],
) -> Result<bool, SensorFault> {
    let (first, len) = span(config.mode);
    if bytes.len() == usize::from(len) {
        let skipped = usize::from(first - registers::ACC_DATA) / 2;
        words::decode(words.0.as_flattened_mut().get_mut(skipped..).unwrap_or_default(), bytes);
        return Ok(true);
    }
    let [_, _, gyr] = &mut words.0;
    words::decode(gyr, bytes);
    let is_rates = bytes.len() == usize::from(RATES) && config.mode.has_gyr();
    if is_rates && inspector.complete(words) { Ok(false) } else { Err(SensorFault::Protocol) }
}

#[cfg(test)]
mod tests;
