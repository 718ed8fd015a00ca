//! The bursts and their words.

use tvc_imu::judge::{Inspector, Words};
use tvc_imu::{SensorFault, Transfer};

use crate::registers as reg;

/// Rates and accelerations: 12 bytes, 0.35 ms at 400 kHz.
pub(crate) const BURST: Transfer = Transfer::read(reg::OUTX_L_G, 12);

/// The rates alone: 6 bytes.
pub(crate) const RATES: Transfer = Transfer::read(reg::OUTX_L_G, 6);

/// Fills in the words of a burst; whether the burst is whole. The last good burst completes rates
/// alone.
///
/// # Errors
/// [`SensorFault::Protocol`] for another length than that of a burst.
pub(crate) fn read(
    words: &mut Words,
    inspector: &Inspector,
    bytes: &[u8],
) -> Result<bool, SensorFault> {
    let Words([acc, _, gyr]) = words;
    decode(gyr, bytes);
    if bytes.len() == BURST.answer_len() {
        decode(acc, bytes.get(6..).unwrap_or_default());
        return Ok(true);
    }
    if bytes.len() == RATES.answer_len() && inspector.complete(words) {
        Ok(false)
    } else {
        Err(SensorFault::Protocol)
    }
}

/// Fills `words` from a block of registers, as far as both go; the low byte is first.
pub(crate) fn decode(words: &mut [i16], registers: &[u8]) {
    for (to, pair) in words.iter_mut().zip(registers.as_chunks::<2>().0) {
        *to = i16::from_le_bytes(*pair);
    }
}
