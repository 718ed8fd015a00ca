//! Status and identity of the chip.

use core::fmt;

use crate::register_enums::register_enums;
use tvc_imu::Hex;

register_enums! {
    /// System status (SYS_STATUS).
    pub enum SystemStatus {
        /// Idle: CONFIG mode.
        Idle = 0,
        /// Error: see [`SystemError`].
        Error = 1,
        /// Initialising peripherals.
        InitPeripherals = 2,
        /// Initialising the system.
        InitSystem = 3,
        /// Running the self-test.
        SelfTest = 4,
        /// Running with fusion.
        Fusion = 5,
        /// Running without fusion.
        NoFusion = 6,
        _ => Unknown
    }

    /// System error (SYS_ERR), meaningful while the status is [`SystemStatus::Error`].
    pub enum SystemError {
        /// No error.
        None = 0,
        /// Peripheral initialisation.
        Peripherals = 1,
        /// System initialisation.
        System = 2,
        /// Self-test failed.
        SelfTest = 3,
        /// A register was written with a value out of range.
        Value = 4,
        /// A register's address out of range.
        Address = 5,
        /// A register could not be written.
        Write = 6,
        /// Low-power mode not available in the operating mode.
        LowPower = 7,
        /// Accelerometer power mode not available.
        AccPower = 8,
        /// Fusion configuration.
        Fusion = 9,
        /// Sensor configuration.
        Sensor = 10,
        _ => Unknown
    }
}

impl SystemStatus {
    /// Whether the chip is becoming ready.
    pub const fn is_starting(self) -> bool {
        // Peripherals, system, self-test.
        matches!(self.code(), 2..=4)
    }
}

impl fmt::Display for SystemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Peripherals => "peripheral start",
            Self::System => "system start",
            Self::SelfTest => "self-test failed",
            Self::Value => "register value",
            Self::Address => "register address",
            Self::Write => "register write",
            Self::LowPower => "low power unavailable",
            Self::AccPower => "acc power unavailable",
            Self::Fusion => "fusion configuration",
            Self::Sensor => "sensor configuration",
            Self::Unknown(code) => return write!(f, "code {}", Hex(*code)),
        })
    }
}

/// Identity of the chip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Identity {
    /// Firmware revision, as 0x0311 for 3.11.
    pub software: u16,
    /// Bootloader revision.
    pub bootloader: u8,
    /// Unique identification of the individual chip.
    pub unique_id: [u8; 16],
}

/// Result of the self-test (ST_RESULT) and the error with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SelfTest {
    /// ST_RESULT.
    pub result: u8,
    /// SYS_ERR at its end.
    pub error: SystemError,
}

impl SelfTest {
    /// Whether the accelerometer passed.
    pub const fn acc(&self) -> bool {
        self.result & 1 != 0
    }

    /// Whether the magnetometer passed.
    pub const fn mag(&self) -> bool {
        self.result & 2 != 0
    }

    /// Whether the gyroscope passed.
    pub const fn gyr(&self) -> bool {
        self.result & 4 != 0
    }

    /// Whether the controller passed.
    pub const fn controller(&self) -> bool {
        self.result & 8 != 0
    }

    /// Whether everything passed.
    pub const fn passed(&self) -> bool {
        self.result & 0x0F == 0x0F
    }
}

/// How far fusion has calibrated itself (CALIB_STAT): 0 not at all, 3 fully.
///
/// The figures fall during motion. The system's can be 3 while the magnetometer's is 0, so do not
/// rely on it alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CalibrationStatus {
    /// The whole.
    pub system: u8,
    /// Gyroscope.
    pub gyr: u8,
    /// Accelerometer.
    pub acc: u8,
    /// Magnetometer.
    pub mag: u8,
}

impl CalibrationStatus {
    /// The status of CALIB_STAT's value.
    pub const fn from_register(value: u8) -> Self {
        Self { system: value >> 6, gyr: value >> 4 & 3, acc: value >> 2 & 3, mag: value & 3 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_keeps_its_code() {
        for code in 0..=u8::MAX {
            assert_eq!(SystemError::from_register(code).code(), code);
        }
    }

    #[test]
    fn statuses_by_the_data_sheet() {
        assert_eq!(SystemStatus::from_register(5), SystemStatus::Fusion);
        assert_eq!(SystemStatus::from_register(6), SystemStatus::NoFusion);
        assert_eq!(SystemStatus::from_register(7), SystemStatus::Unknown(7));
        let starting: u32 = (0..=u8::MAX)
            .map(|value| u32::from(SystemStatus::from_register(value).is_starting()))
            .sum();
        assert_eq!(starting, 3);
    }
}
