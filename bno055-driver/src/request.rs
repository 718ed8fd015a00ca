//! Requests to the chip besides its samples.

use crate::profile::{Profile, SoftIron};
use crate::registers as reg;
use crate::status::{CalibrationStatus, SelfTest, SystemError, SystemStatus};
use tvc_imu::Transfer;

/// A question to the chip, for [`Driver::request`](crate::Driver::request).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Request {
    /// Temperature; between two samples.
    Temperature,
    /// Calibration status of the chip's fusion; between two samples.
    CalibrationStatus,
    /// System status and error; between two samples.
    SystemStatus,
    /// Calibration profile; interrupts sampling, because it can only be read in CONFIG mode.
    Profile,
    /// Soft-iron matrix; interrupts sampling.
    SoftIron,
    /// Run the built-in self-test; interrupts sampling for about half a second.
    SelfTest,
}

impl Request {
    /// Whether the chip answers in CONFIG mode only.
    pub(crate) const fn needs_config(self) -> bool {
        matches!(self, Self::Profile | Self::SoftIron | Self::SelfTest)
    }

    /// Whether the chip is to test itself first.
    pub(crate) const fn is_self_test(self) -> bool {
        matches!(self, Self::SelfTest)
    }

    /// The read that gets the answer.
    pub(crate) const fn read(self) -> Transfer {
        match self {
            Self::Temperature => Transfer::read(reg::TEMP, 1),
            Self::CalibrationStatus => Transfer::read(reg::CALIB_STAT, 1),
            Self::SystemStatus => Transfer::read(reg::SYS_STATUS, 2),
            Self::Profile => Transfer::read(reg::ACC_OFFSET, Profile::REGISTERS_LEN as u8),
            Self::SoftIron => Transfer::read(reg::SIC_MATRIX, SoftIron::REGISTERS_LEN as u8),
            Self::SelfTest => Transfer::read(reg::ST_RESULT, 5),
        }
    }

    /// The answer in the bytes that were read; `None` if their number is wrong.
    pub(crate) fn decode(self, bytes: &[u8]) -> Option<Answer> {
        Some(match (self, bytes) {
            (Self::Temperature, &[byte]) => Answer::Temperature(byte as i8),
            (Self::CalibrationStatus, &[byte]) => {
                Answer::CalibrationStatus(CalibrationStatus::from_register(byte))
            }
            (Self::SystemStatus, &[status, error]) => Answer::SystemStatus(
                SystemStatus::from_register(status),
                SystemError::from_register(error),
            ),
            (Self::Profile, block) => {
                Answer::Profile(Profile::from_registers(block.try_into().ok()?))
            }
            (Self::SoftIron, block) => {
                Answer::SoftIron(SoftIron::from_registers(block.try_into().ok()?))
            }
            (Self::SelfTest, &[result, _, _, _, error]) => {
                Answer::SelfTest(SelfTest { result, error: SystemError::from_register(error) })
            }
            _ => return None,
        })
    }
}

/// The chip's answer to the [`Request`] of the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Temperature, counts: see [`Units::celsius`](crate::config::Units::celsius).
    Temperature(i8),
    /// Calibration status.
    CalibrationStatus(CalibrationStatus),
    /// System status, and the error if the status is one.
    SystemStatus(SystemStatus, SystemError),
    /// Calibration profile.
    Profile(Profile),
    /// Soft-iron matrix.
    SoftIron(SoftIron),
    /// Self-test.
    SelfTest(SelfTest),
}
