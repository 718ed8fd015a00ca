//! Freeing an I2C bus whose data line a slave holds low, because this chip was reset in mid-byte.
//!
//! The slave lets go once it has been clocked through its byte and finds it not acknowledged: nine
//! clocks at most. A healthy bus is not clocked (a BNO055 has been seen to hang from that), and a
//! clock line held low cannot be. Bounded: half a millisecond for a clock that is being stretched,
//! then 0.2 ms.

use crate::samd21::pin::Pin;
use crate::samd21::time::delay_us;

/// Half a clock period, for 100 kHz.
const HALF_US: u32 = 5;
/// How long a slave may stretch the clock: the longest that a BNO055 has been measured to, without
/// a fault.
const STRETCH_US: u32 = 500;

/// Take both lines as GPIO and look at them, clocking the data line free if it is low. Says whether
/// both are high.
///
/// The lines stay GPIO inputs.
pub(super) fn free(sda: Pin, scl: Pin) -> bool {
    for line in [sda, scl] {
        line.release();
        line.gpio();
    }
    delay_us(HALF_US);
    if !rises(scl, STRETCH_US) {
        return false;
    }
    if sda.is_high() {
        return true;
    }
    for _ in 0..9 {
        scl.low();
        delay_us(HALF_US);
        scl.release();
        if !rises(scl, HALF_US) {
            return false;
        }
        delay_us(HALF_US);
        if sda.is_high() {
            break;
        }
    }
    stop(sda, scl);
    sda.is_high() && scl.is_high()
}

/// SDA rises while SCL is high.
fn stop(sda: Pin, scl: Pin) {
    scl.low();
    delay_us(HALF_US);
    sda.low();
    delay_us(HALF_US);
    scl.release();
    delay_us(HALF_US);
    sda.release();
    delay_us(HALF_US);
}

/// Wait for a line to go high, at most `limit_us`.
#[inline(never)]
fn rises(line: Pin, limit_us: u32) -> bool {
    (0..=limit_us).any(|_| {
        let high = line.is_high();
        if !high {
            delay_us(1);
        }
        high
    })
}
