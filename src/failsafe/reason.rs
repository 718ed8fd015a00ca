//! Why control was given up.

use core::fmt;

use tvc_imu::SensorFault;

use crate::config::{FAILSAFE_TILT_DEG, HOST_SILENCE_US};
use crate::numbered::detailed;

// The words name these limits.
const _: () = assert!(FAILSAFE_TILT_DEG == 60 && HOST_SILENCE_US.div_ceil(1_000_000) == 3);

detailed! {
    /// Why control was given up.
    Reason,
    /// A [`Reason`] without its details.
    ReasonKind {
        /// The sensor gave nothing usable for too long, or lost its configuration.
        Sensor(SensorFault) = 1, "sensor fault";
        /// Steps came without samples being asked for, or samples too old to use.
        StaleData = 2, "sensor data too old";
        /// The attitude is not a rotation: not a number, or not of unit length.
        InvalidAttitude = 3, "attitude invalid";
        /// Tilted beyond the limit.
        Tilt = 4, "tilt beyond 60 deg";
        /// The host fell silent, where `FS_HOST` asks for it.
        HostSilent = 5, "host silent for 3 s";
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reason::Sensor(fault) => fault.fmt(f),
            _ => self.kind().fmt(f),
        }
    }
}
