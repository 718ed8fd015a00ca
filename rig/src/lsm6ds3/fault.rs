//! Faults of the LSM6DS3.

use super::Lsm6ds3;
use crate::named_enum::named_enum;
use samd21::board::Ticks;

named_enum! {
    /// A fault that can be switched on and off.
    Fault, "fault";
    /// The chip does not acknowledge.
    Silent = "onboard-silent",
    /// The outputs stand still.
    Frozen = "onboard-frozen",
    /// It has reset itself once: all registers at their defaults. There is nothing to clear.
    Reset = "onboard-reset",
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

    /// Lets the gyroscope's bias about y grow from now on, by rad/s a second.
    pub fn drift(&mut self, now: Ticks, rad_s2: f64) {
        self.signals.ramp = Some((now, rad_s2));
    }
}
