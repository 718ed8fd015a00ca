//! Values as words of 32 bits, of which [what a flight remembers](crate::Flight::memory) consists.

use tvc_imu::Micros;
use tvc_pid::Q16;

/// A number in fixed point among the words.
pub(crate) fn fixed(value: Q16, each: &mut impl FnMut(i32) -> i32) -> Q16 {
    Q16::from_bits(each(value.to_bits()))
}

/// A time among the words: two of them.
pub(crate) fn time(value: Micros, each: &mut impl FnMut(i32) -> i32) -> Micros {
    let low = each(value.0 as i32) as u32;
    let high = each((value.0 >> 32) as i32) as u32;
    Micros(u64::from(high) << 32 | u64::from(low))
}
