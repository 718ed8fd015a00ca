//! Ranges and bandwidths in force.

use super::registers::Mode;
use crate::inertial::Settings;

/// Decodes the three configuration registers. The fusion modes take the accelerometer's range
/// from them and choose the rest themselves (20 Hz magnetometer, data sheet table 3-14).
pub(super) fn decode(mode: Mode, acc: u8, mag: u8, gyr: u8) -> Settings {
    const ACC_BANDWIDTH_HZ: [f64; 8] = [7.81, 15.63, 31.25, 62.5, 125.0, 250.0, 500.0, 1000.0];
    const GYR_RANGE_DPS: [f64; 8] = [2000.0, 1000.0, 500.0, 250.0, 125.0, 2000.0, 2000.0, 2000.0];
    const GYR_BANDWIDTH_HZ: [f64; 8] = [523.0, 230.0, 116.0, 47.0, 23.0, 12.0, 64.0, 32.0];
    const MAG_RATE_HZ: [f64; 8] = [2.0, 6.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0];
    let bits = |value: u8, shift: u32| usize::from(value >> shift & 7);
    let raw = Settings {
        acc_range_g: f64::from(2u8 << (acc & 3)),
        acc_bandwidth_hz: ACC_BANDWIDTH_HZ[bits(acc, 2)],
        gyr_range_dps: GYR_RANGE_DPS[bits(gyr, 0)],
        gyr_bandwidth_hz: GYR_BANDWIDTH_HZ[bits(gyr, 3)],
        mag_rate_hz: MAG_RATE_HZ[bits(mag, 0)],
    };
    if !mode.is_fusion() {
        return raw;
    }
    Settings {
        acc_range_g: raw.acc_range_g,
        acc_bandwidth_hz: 62.5,
        gyr_range_dps: 2000.0,
        gyr_bandwidth_hz: 32.0,
        mag_rate_hz: mode.refresh_hz().min(if mode == Mode::M4g { 50.0 } else { 20.0 }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reset_values_mean_what_the_data_sheet_says() {
        let s = decode(Mode::Amg, 0x0D, 0x0B, 0x38);
        assert_eq!((s.acc_range_g, s.acc_bandwidth_hz), (4.0, 62.5));
        assert_eq!((s.gyr_range_dps, s.gyr_bandwidth_hz), (2000.0, 32.0));
        assert_eq!(s.mag_rate_hz, 10.0);
    }
}
