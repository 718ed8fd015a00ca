//! Requests without the feature `requests`: a type without values, so that the compiler leaves out
//! the code for requests, calibration profile and soft-iron matrix.

use crate::config::Sensors;
use crate::mode::Mode;
use tvc_imu::Transfer;

/// A request, its answer, a calibration profile or a soft-iron matrix: without the feature
/// `requests` no such value exists.
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
