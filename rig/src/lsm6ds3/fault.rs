//! Faults of the LSM6DS3.

use super::Lsm6ds3;
use crate::inertial::Sample;
use samd21::board::Ticks;

/// A fault that can be switched on and off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The chip does not acknowledge.
    Silent,
    /// The outputs stand still.
    Frozen,
    /// It has reset itself once: all registers at their defaults.
    Reset,
    /// The gyroscope's offset about y grows from this moment on, rad/s a second.
    Drift {
        /// The moment.
        from: Ticks,
        /// rad/s^2.
        rad_s2: f64,
    },
}

impl Fault {
    /// What the fault makes of a sample.
    pub(super) fn distort(&self, now: Ticks, sample: &mut Sample) {
        if let Self::Drift { from, rad_s2 } = *self {
            sample.gyr_rad_s[1] += rad_s2 * now.saturating_sub(from).as_secs_f64();
        }
    }
}

impl Lsm6ds3 {
    /// Switches a fault on.
    pub fn inject(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        match fault {
            Fault::Reset => self.reset(),
            fault => self.faults.push(fault),
        }
    }

    /// Switches a fault off.
    pub fn clear(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        self.faults.retain(|other| *other != fault);
    }
}
