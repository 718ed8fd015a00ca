//! Faults of the sensor and its cable that can be switched on and off while it runs.

use super::registers::{AXIS_MAP_RESET, AXIS_MAP_SWAPPED, UNIT_SEL_RESET, error, page0};
use super::{Bno055, Fault, Power};
use samd21::board::Ticks;

impl Fault {
    /// Share of words or bytes that it strikes, 0 to 1; `None` for a fault that strikes all.
    pub fn probability(mut self) -> Option<f64> {
        self.probability_mut().copied()
    }

    /// Share of words or bytes that it strikes, to change it.
    pub fn probability_mut(&mut self) -> Option<&mut f64> {
        match self {
            Self::BitFlips { probability }
            | Self::Naks { probability }
            | Self::BusErrors { probability }
            | Self::ArbitrationLosses { probability }
            | Self::CorruptWords { probability }
            | Self::TornWords { probability }
            | Self::LongStretch { probability, .. }
            | Self::Spikes { probability } => Some(probability),
            _ => None,
        }
    }
}

/// The faults that are on.
#[derive(Clone, Debug, Default)]
pub struct Faults(pub(super) Vec<Fault>);

impl Faults {
    /// Switches a fault on; one of its kind that was on ends.
    pub fn set(&mut self, fault: Fault) {
        self.clear(fault);
        self.0.push(fault);
    }

    /// Switches off the fault of the kind of `fault`, whatever its parameters.
    pub fn clear(&mut self, fault: Fault) {
        let kind = core::mem::discriminant(&fault);
        self.0.retain(|on| core::mem::discriminant(on) != kind);
    }

    /// The fault that is on of the kind of `fault`, whatever the parameters of either.
    pub fn get(&self, fault: Fault) -> Option<Fault> {
        let kind = core::mem::discriminant(&fault);
        let mut faults = self.0.iter().copied();
        faults.find(|on| core::mem::discriminant(on) == kind)
    }

    /// True if a fault of the kind of `fault` is on.
    pub fn has(&self, fault: Fault) -> bool {
        self.get(fault).is_some()
    }
}

impl Bno055 {
    /// Switches a fault on.
    pub fn inject(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        match fault {
            Fault::ConfigReset => {
                self.reset_registers();
                self.power = Power::On;
            }
            // Without a cable there is no power to come back.
            Fault::PowerDip if self.faults.has(Fault::Unplugged) => {}
            Fault::PowerDip => self.boot(now),
            Fault::RevertedAxisMap => {
                self.set(page0::AXIS_MAP_CONFIG, AXIS_MAP_RESET);
                self.set(page0::AXIS_MAP_SIGN, 0);
                self.set(page0::SYS_ERR, error::SYSTEM_INIT);
            }
            Fault::AllZero => {
                self.clear_data();
                self.faults.set(fault);
            }
            Fault::SwappedAxes => self.set(page0::AXIS_MAP_CONFIG, AXIS_MAP_SWAPPED),
            Fault::RevertedUnits => self.set(page0::UNIT_SEL, UNIT_SEL_RESET),
            Fault::Unplugged => {
                self.power = Power::Off;
                self.faults.set(fault);
            }
            Fault::Hung => {
                self.power = Power::Hung;
                self.faults.set(fault);
            }
            _ => self.faults.set(fault),
        }
    }

    /// Switches a fault off, whatever its parameters.
    pub fn clear(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        let was_on = self.faults.has(fault);
        self.faults.clear(fault);
        let cuts_power = matches!(fault, Fault::Unplugged | Fault::Hung | Fault::ClockHang);
        if was_on && cuts_power && matches!(self.power, Power::Off | Power::Hung) {
            self.boot(now);
        }
    }
}
