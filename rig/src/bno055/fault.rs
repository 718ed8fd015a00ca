//! Faults of the sensor and its cable that can be switched on and off while it runs.

use super::registers::{AXIS_MAP_RESET, AXIS_MAP_SWAPPED, UNIT_SEL_RESET, error, page0};
use super::{Bno055, Power};
use samd21::board::Ticks;

/// A fault of the sensor, its supply or its cable ([`Bno055::inject`], [`Bno055::clear`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The cable is off: no power, no acknowledge. Clearing plugs it in again, and the chip boots.
    Unplugged,
    /// The chip has power and does not acknowledge, as some do after a reset by command or after
    /// unexpected clocks. Clearing cuts its power, and it boots.
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
    /// The chip was interrupted inside a byte and holds the data line; the first clock pulse hangs
    /// it: the line is free then, and nothing acknowledges. Clearing cuts the power of a chip that
    /// hangs, and it boots.
    ClockHang,
    /// At once: every register returns to its reset value, mode CONFIG, without the time of a boot.
    /// There is nothing to clear.
    ConfigReset,
    /// At once: the supply dips, and the chip boots again. There is nothing to clear.
    PowerDip,
    /// Every byte reads 0xFF though the chip acknowledges.
    AllOnes,
    /// The data registers read zero in a mode that is kept; SYS_STATUS and SYS_ERR read 1, as with
    /// a grounded BL_IND pin.
    AllZero,
    /// A single bit of some bytes read is inverted.
    BitFlips {
        /// Share of bytes with a wrong bit, 0 to 1.
        probability: f64,
    },
    /// The acknowledge of some addresses and bytes written is lost.
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
    /// Some words of the data registers read 0xFFFF.
    CorruptWords {
        /// Share of words, 0 to 1.
        probability: f64,
    },
    /// The high byte of some data words is that of the refresh before: the shadowing fails.
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
    /// The most significant bit of some data words is inverted.
    Spikes {
        /// Share of words, 0 to 1.
        probability: f64,
    },
    /// The gyroscope and its id read zero, and its self-test fails.
    GyroDead,
    /// At once: the axis map returns to its reset value, and SYS_ERR reads 2. There is nothing to
    /// clear.
    RevertedAxisMap,
    /// At once: the axis map swaps X and Y, a valid map that nobody wrote. There is nothing to
    /// clear.
    SwappedAxes,
    /// At once: UNIT_SEL returns to its reset value. There is nothing to clear.
    RevertedUnits,
    /// The data that users saw around crashes: acceleration 19.62, 5.68, 0 m/s^2; field 0, 320,
    /// 240.19 uT; rate zero.
    FixedPattern,
}

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
pub struct Faults(Vec<Fault>);

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
