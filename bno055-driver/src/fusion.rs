//! Outputs of the chip's own fusion, in its fusion modes.

use crate::config::Units;
use crate::registers as reg;
use crate::words;
use tvc_imu::{Micros, SensorFault, Transfer};

/// The burst that reads every fusion output: 26 bytes.
pub(crate) const BURST: Transfer = Transfer::read(reg::EUL_DATA, 26);

/// One count of a quaternion element.
pub const QUATERNION_UNIT: f32 = 1.0 / 16_384.0;

/// Square of a unit quaternion's norm in counts. Beyond 5 % either way in the norm, the words are
/// torn or corrupted.
const NORM: core::ops::RangeInclusive<i64> = {
    let one = 1_i64 << 28;
    one * 9025 / 10_000..=one * 11_025 / 10_000
};

/// Most words of -1 among the thirteen by chance. At rest, Euler angles and linear accelerations
/// are near zero, six words; the quaternion and gravity have a long axis each.
const ONES_MAX: usize = 8;

/// One reading of the fusion outputs, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FusionSample {
    /// Start of its burst.
    pub time: Micros,
    /// Heading, roll, pitch, counts. Users report wrong angles near +-90 deg of roll or pitch:
    /// prefer the quaternion.
    pub euler: [i16; 3],
    /// Quaternion w, x, y, z, counts of 2^-14.
    pub quaternion: [i16; 4],
    /// Acceleration without gravity, counts.
    pub linear_acc: [i16; 3],
    /// Gravity, counts.
    pub gravity: [i16; 3],
}

impl FusionSample {
    /// The sample in a burst, or its fault.
    pub(crate) fn judge(time: Micros, bytes: &[u8]) -> Result<Self, SensorFault> {
        let bytes: &[u8; 26] = bytes.try_into().map_err(|_| SensorFault::Protocol)?;
        let mut words = [0; 13];
        words::decode(&mut words, bytes);
        let [heading, roll, pitch, w, x, y, z, lx, ly, lz, gx, gy, gz] = words;
        let quaternion = [w, x, y, z];
        if quaternion == [0; 4] {
            return Err(SensorFault::AllZero);
        }
        if quaternion == [-1; 4] || words.iter().filter(|&&word| word == -1).count() > ONES_MAX {
            return Err(SensorFault::AllOnes);
        }
        let norm: i64 = quaternion.iter().map(|&q| i64::from(q) * i64::from(q)).sum();
        if !NORM.contains(&norm) {
            return Err(SensorFault::Implausible);
        }
        Ok(Self {
            time,
            euler: [heading, roll, pitch],
            quaternion,
            linear_acc: [lx, ly, lz],
            gravity: [gx, gy, gz],
        })
    }

    /// Heading, roll and pitch in rad.
    pub fn euler_rad(&self, units: &Units) -> [f32; 3] {
        self.euler.map(|count| f32::from(count) * units.angle_rad())
    }

    /// The quaternion w, x, y, z, of norm 1 within 5 %.
    pub fn quaternion(&self) -> [f32; 4] {
        self.quaternion.map(|count| f32::from(count) * QUATERNION_UNIT)
    }

    /// Acceleration without gravity in m/s^2, in the chip's mapped axes.
    pub fn linear_acc_m_s2(&self, units: &Units) -> [f32; 3] {
        self.linear_acc.map(|count| f32::from(count) * units.acc_m_s2())
    }

    /// Gravity in m/s^2, in the chip's mapped axes.
    pub fn gravity_m_s2(&self, units: &Units) -> [f32; 3] {
        self.gravity.map(|count| f32::from(count) * units.acc_m_s2())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(words: [i16; 13]) -> [u8; 26] {
        let mut bytes = [0; 26];
        for (to, word) in bytes.as_chunks_mut::<2>().0.iter_mut().zip(words) {
            *to = word.to_le_bytes();
        }
        bytes
    }

    #[test]
    fn a_reading_by_hand() {
        let words = [1440, -80, 16, 16384, 0, 0, 0, 100, -200, 0, 0, 0, 981];
        let sample = FusionSample::judge(Micros(7), &bytes(words)).unwrap();
        let units = Units::default();
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        close(sample.euler_rad(&units)[0], core::f32::consts::FRAC_PI_2);
        close(sample.quaternion()[0], 1.0);
        close(sample.linear_acc_m_s2(&units)[1], -2.0);
        close(sample.gravity_m_s2(&units)[2], 9.81);
        assert_eq!(sample.time, Micros(7));
    }

    #[test]
    fn bad_readings_are_named() {
        let good = [0, 0, 0, 16384, 0, 0, 0, 0, 0, 0, 0, 0, 981];
        let judge = |words| FusionSample::judge(Micros(0), &bytes(words)).map(|_| ());
        assert_eq!(judge(good), Ok(()));
        assert_eq!(judge([0; 13]), Err(SensorFault::AllZero));
        assert_eq!(judge([-1; 13]), Err(SensorFault::AllOnes));
        let quaternion = |w| {
            let mut words = good;
            words[3] = w;
            words
        };
        // 0.95 and 1.05 of 16384.
        assert_eq!(judge(quaternion(15_565)), Ok(()));
        assert_eq!(judge(quaternion(15_564)), Err(SensorFault::Implausible));
        assert_eq!(judge(quaternion(17_203)), Ok(()));
        assert_eq!(judge(quaternion(17_204)), Err(SensorFault::Implausible));
        assert_eq!(judge(quaternion(i16::MIN)), Err(SensorFault::Implausible));
        assert_eq!(FusionSample::judge(Micros(0), &[0; 25]), Err(SensorFault::Protocol));
    }
}
