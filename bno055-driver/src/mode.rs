//! Operating modes (which sensors run, and whether the chip fuses them) and power modes.

use crate::register_enums::register_enums;
use crate::status::SystemStatus;

register_enums! {
    /// Operating mode (data sheet section 3.3), without CONFIG, which the driver uses for the
    /// set-up.
    pub enum Mode {
        /// Accelerometer only.
        AccOnly = 0x1,
        /// Magnetometer only.
        MagOnly = 0x2,
        /// Gyroscope only.
        GyrOnly = 0x3,
        /// Accelerometer and magnetometer.
        AccMag = 0x4,
        /// Accelerometer and gyroscope.
        AccGyr = 0x5,
        /// Magnetometer and gyroscope.
        MagGyr = 0x6,
        /// All three sensors, uncompensated, no fusion: for a filter of your own.
        #[default]
        Amg = 0x7,
        /// Fusion of accelerometer and gyroscope: relative heading.
        Imu = 0x8,
        /// Fusion of accelerometer and magnetometer: heading.
        Compass = 0x9,
        /// Like [`Mode::Imu`] with the magnetometer in the gyroscope's place.
        M4g = 0xA,
        /// Nine-axis fusion without fast magnetometer calibration.
        NdofFmcOff = 0xB,
        /// Nine-axis fusion.
        Ndof = 0xC,
    }

    /// Power mode while sampling (data sheet section 3.2); see
    /// [`Driver::suspend`](crate::Driver::suspend) for the third.
    pub enum Power {
        /// All sensors of the mode run.
        #[default]
        Normal = 0,
        /// After 5 s without motion, all sensors except the accelerometer sleep, and their data
        /// stand still.
        Low = 1,
    }
}

impl Mode {
    /// Whether the chip's own fusion runs. Its outputs are then live, and it sets the sensors
    /// itself, except the accelerometer's range.
    pub const fn is_fusion(self) -> bool {
        self as u8 >= Self::Imu as u8
    }

    /// The system status while it runs.
    pub(crate) const fn status(self) -> SystemStatus {
        if self.is_fusion() { SystemStatus::Fusion } else { SystemStatus::NoFusion }
    }

    /// Whether accelerometer data are live.
    pub const fn has_acc(self) -> bool {
        !matches!(self, Self::MagOnly | Self::GyrOnly | Self::MagGyr)
    }

    /// Whether magnetometer data are live.
    pub const fn has_mag(self) -> bool {
        !matches!(self, Self::AccOnly | Self::GyrOnly | Self::AccGyr | Self::Imu)
    }

    /// Whether gyroscope data are live.
    pub const fn has_gyr(self) -> bool {
        !matches!(self, Self::AccOnly | Self::MagOnly | Self::AccMag | Self::Compass | Self::M4g)
    }
}
