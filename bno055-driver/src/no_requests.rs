//! What a driver without the feature `requests` has in place of questions to the chip, calibration
//! profile and soft-iron matrix: a type that has no value, so that the compiler leaves out all that
//! would handle one.

use crate::config::Sensors;
use crate::mode::Mode;
use tvc_imu::Transfer;

/// A question to the chip, its answer, a calibration profile, a soft-iron matrix: there is none
/// without the feature `requests`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Absent {}

pub use self::{Absent as Answer, Absent as Profile, Absent as Request, Absent as SoftIron};

impl Absent {
    pub(crate) const fn needs_config(self) -> bool {
        match self {}
    }

    pub(crate) const fn is_self_test(self) -> bool {
        match self {}
    }

    pub(crate) const fn read(self) -> Transfer {
        match self {}
    }

    pub(crate) fn decode(self, _bytes: &[u8]) -> Option<Self> {
        match self {}
    }

    pub(crate) fn registers(self) -> [u8; 22] {
        match self {}
    }

    pub(crate) fn wrong_register(self, _mode: Mode, _sensors: &Sensors) -> Option<u8> {
        match self {}
    }
}
