//! Faults of the sensor and its cable that can be switched on and off while it runs.

use super::registers::{AXIS_MAP_RESET, AXIS_MAP_SWAPPED, UNIT_SEL_RESET, error, page0};
use super::{Bno055, Power};
use samd21::board::Ticks;

/// A fault of the sensor, its supply or its cable (`Bno055::inject`, `Bno055::clear`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The cable is off: no power, no acknowledge. Clearing plugs it in again, and the chip boots.
    Unplugged,
    /// The chip does not acknowledge any more though it has power, as some do after a reset by
    /// command or after clocks that it did not expect. Clearing cuts its power, and it boots.
    Hung,
    /// Something holds the data line low.
    SdaStuck,
    /// Something holds the clock line low.
    SclStuck,
    /// The chip was interrupted inside a byte and holds the data line until it has seen this many
    /// clock pulses.
    SdaHeld {
        /// Pulses until it lets go, 1 to 9.
        clocks: u8,
    },
    /// The chip was interrupted inside a byte, and clocks that it did not expect hang it: the data line
    /// is free then, and nothing acknowledges. Clearing cuts the power of a chip that hangs, and it
    /// boots.
    ClockHang,
    /// Every register falls back to its reset value at once, mode CONFIG, without the time of a boot.
    /// Nothing to clear.
    ConfigReset,
    /// The supply dips at once and the chip boots again. Nothing to clear.
    PowerDip,
    /// Every byte reads 0xFF though the chip acknowledges.
    AllOnes,
    /// The data registers read zero though the mode is kept, SYS_STATUS tells 1 and SYS_ERR 1, as
    /// with a grounded BL_IND pin.
    AllZero,
    /// Single bits of the bytes read are inverted.
    BitFlips {
        /// Share of bytes with a wrong bit, 0 to 1.
        probability: f64,
    },
    /// The acknowledge of an address or of a byte written gets lost.
    Naks {
        /// Share of those bytes, 0 to 1.
        probability: f64,
    },
    /// A START or STOP lies inside some bytes: the master sees a bus error.
    BusErrors {
        /// Share of bytes, 0 to 1.
        probability: f64,
    },
    /// Another master pulls the data line low while some bytes are sent.
    ArbitrationLosses {
        /// Share of bytes, 0 to 1.
        probability: f64,
    },
    /// Single words of the data registers read 0xFFFF.
    CorruptWords {
        /// Share of words, 0 to 1.
        probability: f64,
    },
    /// The high byte of single data words is that of the refresh before: the shadowing fails.
    TornWords {
        /// Share of words, 0 to 1.
        probability: f64,
    },
    /// The data registers are no longer refreshed.
    Frozen,
    /// Long clock stretching on some bytes.
    LongStretch {
        /// How long.
        stretch: Ticks,
        /// Share of bytes, 0 to 1.
        probability: f64,
    },
    /// The most significant bit of single data words is inverted.
    Spikes {
        /// Share of words, 0 to 1.
        probability: f64,
    },
    /// The gyroscope reads zero, its id too, its self-test fails.
    GyroDead,
    /// At once: the axis map falls back to its reset value and SYS_ERR tells 2. Nothing to clear.
    RevertedAxisMap,
    /// At once: the axis map shows Y as x and X as y, a valid map that nobody wrote. Nothing to clear.
    SwappedAxes,
    /// At once: UNIT_SEL falls back to its reset value. Nothing to clear.
    RevertedUnits,
    /// The pattern seen around crashes: acceleration 19.62, 5.68, 0 m/s^2; field 0, 320, 240.19 uT;
    /// rate zero.
    FixedPattern,
}

impl Fault {
    /// The share of words or bytes that it strikes, where it strikes some only.
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
pub struct Faults(Vec<Fault>);

impl Faults {
    /// Switches a fault on, in place of one of its kind.
    pub fn set(&mut self, fault: Fault) {
        self.clear(fault);
        self.0.push(fault);
    }

    /// Switches off whatever is of the kind of `fault`.
    pub fn clear(&mut self, fault: Fault) {
        let kind = core::mem::discriminant(&fault);
        self.0.retain(|on| core::mem::discriminant(on) != kind);
    }

    /// A fault of the kind of `fault` is on.
    pub fn has(&self, fault: Fault) -> bool {
        let kind = core::mem::discriminant(&fault);
        self.0.iter().any(|on| core::mem::discriminant(on) == kind)
    }

    /// The faults that are on.
    pub fn iter(&self) -> impl Iterator<Item = &Fault> {
        self.0.iter()
    }

    /// The faults that are on, to change their parameters.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Fault> {
        self.0.iter_mut()
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

    /// The faults that are on.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }
}
