//! The words of the data registers, in the units of UNIT_SEL.

use super::registers::unit;
use crate::inertial::{STANDARD_GRAVITY_M_S2, Sample, Settings};

/// The word nearest to `value`, saturated.
fn word(value: f64) -> i16 {
    value.round() as i16
}

/// Counts of magnetic field for 1 uT.
pub(super) const MAG_PER_UT: f64 = 16.0;

/// Words of a sample in the units of UNIT_SEL, along the package axes, saturated at the ranges: of
/// accelerometer, magnetometer and gyroscope.
pub(super) fn words(sample: &Sample, units: u8, settings: &Settings) -> [[i16; 3]; 3] {
    let acc_range = settings.acc_range_g * STANDARD_GRAVITY_M_S2;
    let gyr_range = settings.gyr_range_dps.to_radians();
    [
        sample.acc_m_s2.map(|a| word(a.clamp(-acc_range, acc_range) * acc_per_m_s2(units))),
        sample.mag_ut.map(|m| word(m * MAG_PER_UT)),
        sample.gyr_rad_s.map(|w| word(w.clamp(-gyr_range, gyr_range) * gyr_per_rad_s(units))),
    ]
}

/// Counts of acceleration for 1 m/s^2.
pub(super) fn acc_per_m_s2(units: u8) -> f64 {
    if units & unit::ACC_MG == 0 { 100.0 } else { 1000.0 / STANDARD_GRAVITY_M_S2 }
}

/// Counts of rate for 1 rad/s.
pub(super) fn gyr_per_rad_s(units: u8) -> f64 {
    per_rad(units & unit::GYR_RPS != 0)
}

/// Counts for 1 rad or 1 rad/s, with the output in radians or in degrees.
fn per_rad(in_radians: bool) -> f64 {
    if in_radians { 900.0 } else { 16.0 * 180.0 / core::f64::consts::PI }
}

/// The further outputs of the fusion modes: Euler angles, quaternion, linear acceleration, gravity.
///
/// The chip's fusion itself is not modelled: the attitude is the true one.
pub(super) struct FusionWords {
    pub(super) euler: [i16; 3],
    pub(super) quaternion: [i16; 4],
    pub(super) linear: [i16; 3],
    pub(super) gravity: [i16; 3],
}

impl FusionWords {
    pub(super) fn of(sample: &Sample, units: u8) -> Self {
        let [w, x, y, z] = sample.attitude;
        let up = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z];
        let gravity = up.map(|u| u * STANDARD_GRAVITY_M_S2);
        let roll = up[0].clamp(-1.0, 1.0).asin();
        let pitch = up[1].atan2(up[2]);
        let yaw = (2.0 * (x * y + w * z)).atan2(w * w + x * x - y * y - z * z);
        let heading = (-yaw).rem_euclid(core::f64::consts::TAU);
        let pitch = if units & unit::ANDROID == 0 { pitch } else { -pitch };
        let angle = per_rad(units & unit::EUL_RAD != 0);
        let lsb = acc_per_m_s2(units);
        Self {
            euler: [heading, roll, pitch].map(|a| word(a * angle)),
            quaternion: sample.attitude.map(|c| word(c * 16384.0)),
            linear: [0, 1, 2].map(|i| word((sample.acc_m_s2[i] - gravity[i]) * lsb)),
            gravity: gravity.map(|g| word(g * lsb)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bno055::Mode;

    #[test]
    fn words_saturate_at_the_range() {
        let settings = crate::bno055::settings::decode(Mode::Amg, 0x0D, 0x0B, 0x38);
        let sample = Sample {
            acc_m_s2: [100.0, -100.0, 9.81],
            gyr_rad_s: [50.0, -1.0, 0.0],
            mag_ut: [50.0, -0.0625, 0.03],
            attitude: [1.0, 0.0, 0.0, 0.0],
        };
        let counts = words(&sample, 0, &settings);
        assert_eq!(counts, [[3923, -3923, 981], [800, -1, 0], [32000, -917, 0]]);
        let [acc, _, gyr] = words(&sample, unit::ACC_MG | unit::GYR_RPS, &settings);
        assert_eq!(acc, [4000, -4000, 1000]);
        assert_eq!(gyr, [31416, -900, 0]);
    }

    #[test]
    fn level_fusion_words() {
        let words = FusionWords::of(
            &Sample {
                acc_m_s2: [0.0, 0.0, STANDARD_GRAVITY_M_S2],
                attitude: [1.0, 0.0, 0.0, 0.0],
                ..Sample::default()
            },
            0,
        );
        assert_eq!(words.quaternion, [16384, 0, 0, 0]);
        assert_eq!(words.gravity, [0, 0, 981]);
        assert_eq!(words.linear, [0, 0, 0]);
        assert_eq!(words.euler, [0, 0, 0]);
    }
}
