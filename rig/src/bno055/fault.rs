//! Faults of the sensor and its cable that can be switched on and off while it runs.

use super::registers::{AXIS_MAP_RESET, AXIS_MAP_SWAPPED, UNIT_SEL_RESET, error, page0};
use super::{Bno055, Fault, FaultKind, Power};
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

/// The faults that are on; one of a kind.
#[derive(Clone, Debug, Default)]
pub(super) struct Faults(pub(super) Vec<Fault>);

impl Faults {
    /// Switches a fault on; one of its kind that was on ends.
    fn set(&mut self, fault: Fault) {
        self.clear(FaultKind::of(&fault));
        self.0.push(fault);
    }

    pub(super) fn clear(&mut self, kind: FaultKind) {
        self.0.retain(|on| FaultKind::of(on) != kind);
    }

    pub(super) fn get(&self, kind: FaultKind) -> Option<Fault> {
        self.0.iter().copied().find(|on| FaultKind::of(on) == kind)
    }

    pub(super) fn has(&self, kind: FaultKind) -> bool {
        self.get(kind).is_some()
    }
}

impl Bno055 {
    /// Switches a fault on.
    pub fn inject(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        match fault {
            Fault::ConfigReset => self.reset_registers(),
            // Without a cable there is no power to come back.
            Fault::PowerDip if self.faults.has(FaultKind::Unplugged) => {}
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

    /// Lets the gyroscope's bias about y grow from now on, by rad/s a second.
    pub fn drift(&mut self, now: Ticks, rad_s2: f64) {
        self.signals.ramp = Some((now, rad_s2));
    }

    /// Switches a fault off, whatever its parameters.
    pub fn clear(&mut self, now: Ticks, fault: Fault) {
        self.run(now);
        let kind = FaultKind::of(&fault);
        let was_on = self.faults.has(kind);
        self.faults.clear(kind);
        let cuts_power =
            matches!(kind, FaultKind::Unplugged | FaultKind::Hung | FaultKind::ClockHang);
        if was_on && cuts_power && matches!(self.power, Power::Off | Power::Hung) {
            self.boot(now);
        }
    }
}
