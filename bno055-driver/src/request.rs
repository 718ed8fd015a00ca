//! What the chip can be asked besides its samples.

use crate::profile::{Profile, SoftIron};
use crate::registers as reg;
use crate::status::{CalibrationStatus, SelfTest, SystemError, SystemStatus};
use crate::transfer::Transfer;

/// A question, for [`Driver::request`](crate::Driver::request).
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
    /// The transfer that asks while sampling; `None` for what needs CONFIG mode.
    pub(crate) const fn transfer(self) -> Option<Transfer> {
        match self {
            Self::Temperature => Some(Transfer::read(reg::TEMP, 1)),
            Self::CalibrationStatus => Some(Transfer::read(reg::CALIB_STAT, 1)),
            Self::SystemStatus => Some(Transfer::read(reg::SYS_STATUS, 2)),
            Self::Profile | Self::SoftIron | Self::SelfTest => None,
        }
    }

    /// The answer in the bytes that the transfer read; `None` if their number is wrong.
    pub(crate) const fn decode(self, bytes: &[u8]) -> Option<Answer> {
        match (self, bytes) {
            (Self::Temperature, &[byte]) => Some(Answer::Temperature(byte as i8)),
            (Self::CalibrationStatus, &[byte]) => Some(Answer::CalibrationStatus(
                CalibrationStatus::from_register(byte),
            )),
            (Self::SystemStatus, &[status, error]) => Some(Answer::SystemStatus(
                SystemStatus::from_register(status),
                SystemError::from_register(error),
            )),
            _ => None,
        }
    }
}

/// What the chip answered to the [`Request`] of the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Temperature, counts: see [`Units::celsius`](crate::config::Units::celsius).
    Temperature(i8),
    /// Calibration status.
    CalibrationStatus(CalibrationStatus),
    /// System status, and the error that it means if it is one.
    SystemStatus(SystemStatus, SystemError),
    /// Calibration profile.
    Profile(Profile),
    /// Soft-iron matrix.
    SoftIron(SoftIron),
    /// Self-test.
    SelfTest(SelfTest),
}
