//! Units of the chip's outputs, and their counts.

use tvc_imu::Scale;

use crate::register_enums::register_enums;

register_enums! {
    /// Unit of acceleration, linear acceleration and gravity.
    pub enum AccUnit {
        /// 100 counts for 1 m/s^2.
        #[default]
        MetrePerSecondSquared = 0,
        /// 1 count for 1 mg.
        MilliG = 1,
    }

    /// Unit of angular rate.
    pub enum GyrUnit {
        /// 16 counts for 1 deg/s.
        #[default]
        DegreePerSecond = 0,
        /// 900 counts for 1 rad/s.
        RadianPerSecond = 1,
    }

    /// Unit of the Euler angles.
    pub enum AngleUnit {
        /// 16 counts for 1 deg.
        #[default]
        Degree = 0,
        /// 900 counts for 1 rad.
        Radian = 1,
    }

    /// Unit of temperature.
    pub enum TemperatureUnit {
        /// 1 count for 1 degree Celsius.
        #[default]
        Celsius = 0,
        /// 1 count for 2 degrees Fahrenheit.
        Fahrenheit = 1,
    }

    /// Sign convention of the Euler pitch.
    pub enum Orientation {
        /// Pitch turns clockwise increasing, -180 to +180 deg.
        #[default]
        Windows = 0,
        /// Pitch turns clockwise decreasing, +180 to -180 deg.
        Android = 1,
    }
}

/// Units that the chip's outputs are in (UNIT_SEL, data sheet section 3.6.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Units {
    /// Acceleration.
    pub acc: AccUnit,
    /// Angular rate.
    pub gyr: GyrUnit,
    /// Euler angles.
    pub angle: AngleUnit,
    /// Temperature.
    pub temperature: TemperatureUnit,
    /// Euler pitch.
    pub orientation: Orientation,
}

/// Standard gravity, m/s^2.
const STANDARD_GRAVITY: f32 = 9.806_65;

impl Units {
    /// The chip's own: m/s^2, deg/s, deg, degrees Celsius, Windows.
    pub const DEFAULT: Self = Self {
        acc: AccUnit::MetrePerSecondSquared,
        gyr: GyrUnit::DegreePerSecond,
        angle: AngleUnit::Degree,
        temperature: TemperatureUnit::Celsius,
        orientation: Orientation::Windows,
    };

    /// Unit of each sensor's count.
    pub const fn scale(&self) -> Scale {
        Scale { acc_m_s2: self.acc_m_s2(), gyr_rad_s: self.gyr_rad_s(), mag_ut: MAG_UT }
    }

    /// The value of UNIT_SEL.
    pub const fn register(&self) -> u8 {
        self.acc as u8
            | (self.gyr as u8) << 1
            | (self.angle as u8) << 2
            | (self.temperature as u8) << 4
            | (self.orientation as u8) << 7
    }

    /// One count of acceleration in m/s^2.
    pub const fn acc_m_s2(&self) -> f32 {
        match self.acc {
            AccUnit::MetrePerSecondSquared => 0.01,
            AccUnit::MilliG => STANDARD_GRAVITY * 0.001,
        }
    }

    /// One count of angular rate in rad/s.
    pub const fn gyr_rad_s(&self) -> f32 {
        match self.gyr {
            GyrUnit::DegreePerSecond => core::f32::consts::PI / (180.0 * 16.0),
            GyrUnit::RadianPerSecond => 1.0 / 900.0,
        }
    }

    /// One count of an Euler angle in rad.
    pub const fn angle_rad(&self) -> f32 {
        match self.angle {
            AngleUnit::Degree => core::f32::consts::PI / (180.0 * 16.0),
            AngleUnit::Radian => 1.0 / 900.0,
        }
    }

    /// A temperature reading in degrees Celsius.
    pub fn celsius(&self, count: i8) -> f32 {
        match self.temperature {
            TemperatureUnit::Celsius => f32::from(count),
            TemperatureUnit::Fahrenheit => (f32::from(count) * 2.0 - 32.0) / 1.8,
        }
    }
}

/// One count of magnetic field in uT, in every unit selection.
pub const MAG_UT: f32 = 1.0 / 16.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn register_bits_are_where_the_data_sheet_has_them() {
        assert_eq!(Units::default().register(), 0x00);
        let all = Units {
            acc: AccUnit::MilliG,
            gyr: GyrUnit::RadianPerSecond,
            angle: AngleUnit::Radian,
            temperature: TemperatureUnit::Fahrenheit,
            orientation: Orientation::Android,
        };
        assert_eq!(all.register(), 0b1001_0111);
    }

    #[test]
    fn counts_convert_by_hand() {
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        let si = Units::default();
        close(si.acc_m_s2() * 981.0, 9.81);
        close(si.gyr_rad_s() * 16.0 * 180.0, core::f32::consts::PI);
        close(si.angle_rad() * 16.0 * 90.0, core::f32::consts::FRAC_PI_2);
        close(si.celsius(-7), -7.0);
        let other = Units {
            acc: AccUnit::MilliG,
            gyr: GyrUnit::RadianPerSecond,
            angle: AngleUnit::Radian,
            temperature: TemperatureUnit::Fahrenheit,
            ..si
        };
        close(other.acc_m_s2() * 1000.0, 9.80665);
        close(other.gyr_rad_s() * 900.0, 1.0);
        close(other.angle_rad() * 450.0, 0.5);
        close(other.celsius(34), 20.0);
    }
}
