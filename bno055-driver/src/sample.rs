//! The sampling burst: what it reads, and what it gives.

mod judge;
mod still;

use crate::config::{MAG_UT, Mode, Units};
use crate::registers;
use crate::transfer::{Micros, Transfer};
use crate::words;

pub use judge::STEP_AGE_US;
pub(crate) use judge::{Evidence, Inspector, Judged};

/// One sample as the chip gave it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawSample {
    /// Start of its burst.
    pub time: Micros,
    /// Acceleration, counts; zero in modes without accelerometer.
    pub acc: [i16; 3],
    /// Magnetic field, counts of 1/16 uT; zero in modes without magnetometer, and from one that
    /// measures nothing where that is no fault.
    pub mag: [i16; 3],
    /// Angular rate, counts; zero in modes without gyroscope.
    pub gyr: [i16; 3],
}

impl RawSample {
    /// Acceleration in m/s^2, in the chip's mapped axes.
    #[must_use]
    pub fn acc_m_s2(&self, units: &Units) -> [f32; 3] {
        self.acc.map(|count| f32::from(count) * units.acc_m_s2())
    }

    /// Angular rate in rad/s, in the chip's mapped axes.
    #[must_use]
    pub fn gyr_rad_s(&self, units: &Units) -> [f32; 3] {
        self.gyr.map(|count| f32::from(count) * units.gyr_rad_s())
    }

    /// Magnetic field in uT, in the chip's mapped axes.
    #[must_use]
    pub fn mag_ut(&self) -> [f32; 3] {
        self.mag.map(|count| f32::from(count) * MAG_UT)
    }
}

/// First register and length of the one burst that reads all that `mode` measures.
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

/// The burst that reads all that `mode` measures: 18 bytes in AMG mode.
pub(crate) const fn burst(mode: Mode) -> Transfer {
    let (first, len) = span(mode);
    Transfer::read(first, len)
}

/// Bytes of the rates.
pub(crate) const RATES: u8 = registers::EUL_DATA - registers::GYR_DATA;

/// The burst that reads the rates alone, where `mode` measures more than them.
pub(crate) const fn rates_burst(mode: Mode) -> Option<Transfer> {
    let (_, len) = span(mode);
    if mode.has_gyr() && len > RATES {
        Some(Transfer::read(registers::GYR_DATA, RATES))
    } else {
        None
    }
}

/// Accelerometer, magnetometer and gyroscope words of a burst. In whole machine words, by which
/// small cores copy faster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(4))]
struct Words([[i16; 3]; 3]);

impl Words {
    const fn acc(&self) -> [i16; 3] {
        self.0[0]
    }

    const fn mag(&self) -> [i16; 3] {
        self.0[1]
    }

    const fn gyr(&self) -> [i16; 3] {
        self.0[2]
    }
}

/// The words of a burst, zero for sensors that `mode` does not run; `None` if its length is wrong.
fn words(mode: Mode, bytes: &[u8]) -> Option<Words> {
    let (first, len) = span(mode);
    if bytes.len() != usize::from(len) {
        return None;
    }
    let mut words = [[0; 3]; 3];
    let skipped = usize::from(first - registers::ACC_DATA) / 2;
    words::decode(words.as_flattened_mut().get_mut(skipped..)?, bytes);
    Some(Words(words))
}

#[cfg(test)]
mod tests;
