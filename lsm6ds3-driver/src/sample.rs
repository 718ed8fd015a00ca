//! The bursts and their words.

use tvc_imu::judge::{Inspector, Words};
use tvc_imu::{SensorFault, Transfer};

use crate::registers as reg;

/// Temperature, rates and accelerations: 14 bytes, 0.39 ms at 400 kHz.
pub(crate) const BURST: Transfer = Transfer::read(reg::OUT_TEMP_L, 14);

/// The rates alone: 6 bytes.
pub(crate) const RATES: Transfer = Transfer::read(reg::OUTX_L_G, 6);

/// Fills in the words of a burst, and gives the temperature's count if the burst is whole. The last
/// good burst completes rates alone.
///
/// # Errors
/// [`SensorFault::Protocol`] for another length than that of a burst.
pub(crate) fn read(
    words: &mut Words,
    inspector: &Inspector,
    bytes: &[u8],
) -> Result<Option<i16>, SensorFault> {
    let Words([acc, _, gyr]) = words;
    if let Some((temperature, outputs)) = bytes.split_at_checked(2)
        && bytes.len() == BURST.answer_len()
    {
        decode(gyr, outputs);
        decode(acc, outputs.get(6..).unwrap_or_default());
        let mut count = [0];
        decode(&mut count, temperature);
        return Ok(Some(count[0]));
    }
    decode(gyr, bytes);
    if bytes.len() == RATES.answer_len() && inspector.complete(words) {
        Ok(None)
    } else {
        Err(SensorFault::Protocol)
    }
}

/// Fills `words` from a block of registers, as far as both go; the low byte is first.
fn decode(words: &mut [i16], registers: &[u8]) {
    for (to, pair) in words.iter_mut().zip(registers.as_chunks::<2>().0) {
        *to = i16::from_le_bytes(*pair);
    }
}
