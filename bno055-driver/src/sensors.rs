//! Ranges and bandwidths of the three sensors (page 1).

use crate::mode::Mode;
use crate::register_enums::register_enums;

register_enums! {
    /// Accelerometer range.
    pub enum AccRange {
        /// +-2 g.
        G2 = 0,
        /// +-4 g (the chip's default).
        G4 = 1,
        /// +-8 g.
        #[default]
        G8 = 2,
        /// +-16 g.
        G16 = 3,
    }

    /// Accelerometer bandwidth; the sensor updates at twice that rate.
    pub enum AccBandwidth {
        /// 7.81 Hz.
        Hz7_81 = 0,
        /// 15.63 Hz.
        Hz15_63 = 1,
        /// 31.25 Hz.
        Hz31_25 = 2,
        /// 62.5 Hz (the chip's default).
        #[default]
        Hz62_5 = 3,
        /// 125 Hz.
        Hz125 = 4,
        /// 250 Hz.
        Hz250 = 5,
        /// 500 Hz.
        Hz500 = 6,
        /// 1000 Hz.
        Hz1000 = 7,
    }

    /// Gyroscope range.
    pub enum GyrRange {
        /// +-2000 deg/s (the chip's default).
        #[default]
        Dps2000 = 0,
        /// +-1000 deg/s.
        Dps1000 = 1,
        /// +-500 deg/s.
        Dps500 = 2,
        /// +-250 deg/s.
        Dps250 = 3,
        /// +-125 deg/s.
        Dps125 = 4,
    }

    /// Gyroscope bandwidth.
    pub enum GyrBandwidth {
        /// 523 Hz.
        Hz523 = 0,
        /// 230 Hz.
        Hz230 = 1,
        /// 116 Hz: about 1.4 ms of delay, against 5 ms at the chip's default of 32 Hz.
        #[default]
        Hz116 = 2,
        /// 47 Hz.
        Hz47 = 3,
        /// 23 Hz.
        Hz23 = 4,
        /// 12 Hz.
        Hz12 = 5,
        /// 64 Hz.
        Hz64 = 6,
        /// 32 Hz (the chip's default).
        Hz32 = 7,
    }

    /// Magnetometer output rate.
    pub enum MagRate {
        /// 2 Hz.
        Hz2 = 0,
        /// 6 Hz.
        Hz6 = 1,
        /// 8 Hz.
        Hz8 = 2,
        /// 10 Hz.
        Hz10 = 3,
        /// 15 Hz.
        Hz15 = 4,
        /// 20 Hz.
        Hz20 = 5,
        /// 25 Hz.
        Hz25 = 6,
        /// 30 Hz.
        #[default]
        Hz30 = 7,
    }

    /// How often the magnetometer measures for one output: noise against current.
    pub enum MagEffort {
        /// Fewest repetitions.
        LowPower = 0,
        /// The usual compromise.
        #[default]
        Regular = 1,
        /// More repetitions.
        EnhancedRegular = 2,
        /// Most repetitions.
        HighAccuracy = 3,
    }
}

impl AccRange {
    /// Full scale in g.
    pub const fn g(self) -> u8 {
        2 << self as u8
    }
}

impl GyrRange {
    /// Full scale in deg/s.
    pub const fn dps(self) -> u16 {
        2000 >> self as u8
    }
}

/// Settings of the three sensors (page 1). In fusion modes only the
/// accelerometer's range counts; the chip chooses the rest itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sensors {
    /// Accelerometer range.
    pub acc_range: AccRange,
    /// Accelerometer bandwidth.
    pub acc_bandwidth: AccBandwidth,
    /// Gyroscope range.
    pub gyr_range: GyrRange,
    /// Gyroscope bandwidth.
    pub gyr_bandwidth: GyrBandwidth,
    /// Magnetometer output rate.
    pub mag_rate: MagRate,
    /// Magnetometer repetitions.
    pub mag_effort: MagEffort,
}

impl GyrBandwidth {
    /// In Hz.
    pub const fn hz(self) -> f32 {
        match self {
            Self::Hz523 => 523.0,
            Self::Hz230 => 230.0,
            Self::Hz116 => 116.0,
            Self::Hz47 => 47.0,
            Self::Hz23 => 23.0,
            Self::Hz12 => 12.0,
            Self::Hz64 => 64.0,
            Self::Hz32 => 32.0,
        }
    }
}

impl Sensors {
    /// The defaults, for constants.
    pub const DEFAULT: Self = Self {
        acc_range: AccRange::G8,
        acc_bandwidth: AccBandwidth::Hz62_5,
        gyr_range: GyrRange::Dps2000,
        gyr_bandwidth: GyrBandwidth::Hz116,
        mag_rate: MagRate::Hz30,
        mag_effort: MagEffort::Regular,
    };

    /// The gyroscope's range in effect: fusion modes set the widest themselves.
    pub(crate) const fn gyr_range_in(&self, mode: Mode) -> GyrRange {
        if mode.is_fusion() { GyrRange::Dps2000 } else { self.gyr_range }
    }

    /// ACC_CONFIG, MAG_CONFIG, GYR_CONFIG_0, GYR_CONFIG_1, all three sensors in their normal power
    /// mode (data sheet sections 3.5.2 to 3.5.4).
    pub const fn registers(&self) -> [u8; 4] {
        [
            (self.acc_bandwidth as u8) << 2 | self.acc_range as u8,
            (self.mag_effort as u8) << 3 | self.mag_rate as u8,
            (self.gyr_bandwidth as u8) << 3 | self.gyr_range as u8,
            0,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chips_own_defaults_by_the_data_sheet() {
        let sensors = Sensors {
            acc_range: AccRange::G4,
            acc_bandwidth: AccBandwidth::Hz62_5,
            gyr_range: GyrRange::Dps2000,
            gyr_bandwidth: GyrBandwidth::Hz32,
            mag_rate: MagRate::Hz20,
            mag_effort: MagEffort::Regular,
        };
        // The chip's MAG_CONFIG is 0x6D: the same, in forced power mode.
        assert_eq!(sensors.registers(), [0x0D, 0x0D, 0x38, 0x00]);
        assert_eq!((sensors.acc_range.g(), sensors.gyr_range.dps()), (4, 2000));
    }

    #[test]
    fn the_widest_codes_stay_in_their_fields() {
        let sensors = Sensors {
            acc_range: AccRange::G16,
            acc_bandwidth: AccBandwidth::Hz1000,
            gyr_range: GyrRange::Dps125,
            gyr_bandwidth: GyrBandwidth::Hz32,
            mag_rate: MagRate::Hz30,
            mag_effort: MagEffort::HighAccuracy,
        };
        assert_eq!(sensors.registers(), [0x1F, 0x1F, 0x3C, 0x00]);
        assert_eq!((sensors.acc_range.g(), sensors.gyr_range.dps()), (16, 125));
    }
}
