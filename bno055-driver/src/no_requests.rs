//! What a driver without the feature `requests` has in place of questions to the chip, calibration
//! profile and soft-iron matrix: types that have no value, so that the compiler leaves out all that
//! would handle one.

use crate::config::Sensors;
use crate::mode::Mode;
use tvc_imu::Transfer;

/// A question to the chip: there is none without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Request {}

/// An answer of the chip: there is none without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {}

/// A calibration profile: there is none without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {}

/// A soft-iron matrix: there is none without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SoftIron {}

/// Why a profile cannot be written: there is none without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ProfileError {
    /// A value out of its range.
    Range {
        /// Register of the value's low byte.
        register: u8,
        /// The value.
        value: i16,
    },
}

impl Request {
    pub(crate) const fn needs_config(self) -> bool {
        match self {}
    }

    pub(crate) const fn is_self_test(self) -> bool {
        match self {}
    }

    pub(crate) const fn read(self) -> Transfer {
        match self {}
    }

    pub(crate) fn decode(self, _bytes: &[u8]) -> Option<Answer> {
        match self {}
    }
}

impl Profile {
    pub(crate) fn registers(&self) -> [u8; 22] {
        match *self {}
    }

    pub(crate) fn check(&self, _mode: Mode, _sensors: &Sensors) -> Result<(), ProfileError> {
        match *self {}
    }
}

impl SoftIron {
    pub(crate) fn registers(&self) -> [u8; 18] {
        match *self {}
    }
}
