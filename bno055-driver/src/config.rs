//! Everything that the chip can be set to: modes, ranges, bandwidths, units, axis map, power.

use core::num::NonZeroU8;

pub use crate::axes::{Axis, AxisMap, AxisMapError, Signed};
pub use crate::mode::{Mode, Power};
use crate::profile::{Profile, SoftIron};
pub use crate::sensors::{
    AccBandwidth, AccRange, GyrBandwidth, GyrRange, MagEffort, MagRate, Sensors,
};
pub use crate::units::{AccUnit, AngleUnit, GyrUnit, MAG_UT, Orientation, TemperatureUnit, Units};

/// The chip's I2C address, chosen by its COM3 pin (data sheet section 4.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Address {
    /// 0x28: COM3 low, as on Adafruit's breakout.
    #[default]
    Low = 0x28,
    /// 0x29: COM3 high, as on many other breakouts with their address pin open.
    High = 0x29,
}

impl Address {
    /// The 7-bit address.
    #[must_use]
    pub const fn value(self) -> u8 {
        self as u8
    }

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }
}

/// Whether the driver may reset the chip by command.
///
/// Some parts never answer again after a soft reset until their power is cycled, so that the
/// default is never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ResetPolicy {
    /// Rewrite every register instead.
    #[default]
    Never,
    /// Reset after this many failed attempts in a row to set up a chip that answers.
    AfterFailures(NonZeroU8),
}

/// The chip's settings, and the limits by which the driver judges its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// I2C address.
    pub address: Address,
    /// Whether the other address is tried in turn while nobody answers: only where no second
    /// BNO055 is on the bus.
    pub either_address: bool,
    /// Operating mode.
    pub mode: Mode,
    /// Ranges and bandwidths.
    pub sensors: Sensors,
    /// Units of the outputs.
    pub units: Units,
    /// Axis map.
    pub axes: AxisMap,
    /// Power mode.
    pub power: Power,
    /// Run on the external 32 kHz crystal; only for boards that have one.
    pub external_crystal: bool,
    /// Calibration profile to restore, for fusion modes; `None` leaves the chip's own.
    pub profile: Option<Profile>,
    /// Soft-iron matrix to write, for fusion modes; `None` leaves the chip's own.
    pub soft_iron: Option<SoftIron>,
    /// Whether the chip may be reset.
    pub reset: ResetPolicy,
    /// Whether a magnetometer that does not identify itself, fails its self-test or measures
    /// nothing is a fault. Where it is none, its field reads zero.
    pub needs_mag: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            address: Address::default(),
            either_address: false,
            mode: Mode::default(),
            sensors: Sensors::default(),
            units: Units::default(),
            axes: AxisMap::default(),
            power: Power::default(),
            external_crystal: false,
            profile: None,
            soft_iron: None,
            reset: ResetPolicy::default(),
            needs_mag: true,
        }
    }
}
