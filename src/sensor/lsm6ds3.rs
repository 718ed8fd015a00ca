//! The LSM6DS3 of the Nano 33 IoT, on the same bus.

use lsm6ds3_driver::Config;
pub(super) use lsm6ds3_driver::Driver;
use tvc_imu::{Description, RawSample};

use super::SCALE;

/// The driver's settings: +-8 g and +-1000 deg/s as of the BNO055, 833 Hz.
const CONFIG: Config = Config::DEFAULT;

/// What it is like, in the units of [`SCALE`].
pub(super) const DESCRIPTION: Description = {
    let own = CONFIG.description();
    Description {
        scale: SCALE,
        acc_range: (own.acc_range as u32 * ACC >> 16) as u16,
        gyr_range: (own.gyr_range as u32 * GYR >> 16) as u16,
        ..own
    }
};

/// Counts of [`SCALE`] in one of the chip's, times 65,536: less than one.
const ACC: u32 = (CONFIG.scale().acc_m_s2 / SCALE.acc_m_s2 * 65_536.0 + 0.5) as u32;
/// See [`ACC`].
const GYR: u32 = (CONFIG.scale().gyr_rad_s / SCALE.gyr_rad_s * 65_536.0 + 0.5) as u32;
const _: () = assert!(ACC < 65_536 && GYR < 65_536);

/// The driver with the settings.
pub(super) fn new() -> Driver {
    Driver::new(CONFIG)
}

/// A sample of the chip in the units of [`SCALE`]. The chip's noise is some two of those counts.
pub(super) fn scaled(mut raw: RawSample) -> RawSample {
    let scale = |words: &mut [i16; 3], share: u32| {
        for word in words {
            *word = ((i32::from(*word) * share as i32 + 0x8000) >> 16) as i16;
        }
    };
    scale(&mut raw.acc, ACC);
    scale(&mut raw.gyr, GYR);
    raw
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 g are 4098 counts of 0.244 mg, and 981 of 0.01 m/s^2; 100 deg/s are 2857 of 35 mdeg/s,
    /// and 1600 of 1/16 deg/s.
    #[test]
    fn a_sample_by_hand() {
        let raw = RawSample {
            acc: [4_098, -4_098, 32_767],
            gyr: [2_857, -2_857, 0],
            ..RawSample::default()
        };
        let RawSample { acc, gyr, .. } = scaled(raw);
        assert_eq!((acc, gyr), ([981, -981, 7_841], [1_600, -1_600, 0]));
        assert_eq!((DESCRIPTION.acc_range, DESCRIPTION.gyr_range), (7_824, 15_679));
    }
}
