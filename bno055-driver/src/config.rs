//! Settings of the chip: modes, ranges, bandwidths, units, axis map, power.

use core::num::NonZeroU8;

use tvc_imu::Description;
use tvc_imu::judge::Rules;

pub use crate::axes::{Axis, AxisMap, AxisMapError, Signed};
pub use crate::mode::{Mode, Power};
use crate::profile::{Profile, SoftIron};
use crate::sample;
pub use crate::sensors::{
    AccBandwidth, AccRange, GyrBandwidth, GyrRange, MagEffort, MagRate, Sensors,
};
pub use crate::units::{AccUnit, AngleUnit, GyrUnit, MAG_UT, Orientation, TemperatureUnit, Units};

/// Shortest standstill of a dead sensor's words, us, and the same at 12 Hz bandwidth. There the
/// gyroscope's noise is one count, and one refresh in 23 repeats its rates.
const STILL_US: u32 = 65_000;
/// See [`STILL_US`].
const QUIET_STILL_US: u32 = 90_000;

/// Largest jump of a rate that is not held: 250 deg/s, about the same counts in all units.
const RATE_JUMP: u16 = 4_000;
/// Largest jump that is not held after a failed transfer: 16 deg/s.
const DISTURBED_JUMP: u16 = 256;

/// Accelerations that jump by more show a blow: 5 m/s^2 or 0.5 g.
const BLOW: u16 = 500;

/// A board that rattles turns slower than this: 330 deg/s.
const RATTLE: u16 = 5_300;

/// Words of 0 or -1 are plausible this near to the last good ones. For accelerometer, magnetometer
/// and gyroscope: 2 m/s^2 or 0.2 g, 5 uT, 4 deg/s (about the same counts in all units).
const NEAR: [u16; 3] = [200, 80, 64];

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
    pub const fn value(self) -> u8 {
        self as u8
    }

    /// The other address.
    pub const fn other(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }
}

/// Whether the driver may reset the chip by command.
///
/// After a soft reset, some parts never answer until their power is cycled. The default is never.
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
    /// Whether the driver tries the other address in turn while nobody answers. Only for a bus
    /// without a second BNO055.
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
    /// nothing is a fault. Otherwise its field reads zero.
    pub needs_mag: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// The defaults, for constants.
    pub const DEFAULT: Self = Self {
        address: Address::Low,
        either_address: false,
        mode: Mode::Amg,
        sensors: Sensors::DEFAULT,
        units: Units::DEFAULT,
        axes: AxisMap::IDENTITY,
        power: Power::Normal,
        external_crystal: false,
        profile: None,
        soft_iron: None,
        reset: ResetPolicy::Never,
        needs_mag: true,
    };

    /// The description of a chip with these settings, for a control loop.
    pub const fn description(&self) -> Description {
        let first_hz = self.sensors.gyr_bandwidth.hz();
        Description {
            scale: self.units.scale(),
            has_mag: self.mode.has_mag(),
            gyr_lag_s: 1.0 / (2.0 * core::f32::consts::PI * first_hz),
            acc_range: self.acc_range_counts(),
            gyr_range: self.gyr_range_counts(),
            refresh_us: 10_000,
            burst_bytes: sample::burst(self.mode).answer_len() as u32,
            rates_at: sample::rates_at(self.mode),
            // As measured by users.
            stretch_us: 180,
            // Some bytes are stretched by 0.4 ms.
            reserve_us: 1_000,
        }
    }

    /// What is sound in a burst.
    pub(crate) fn rules(&self) -> Rules {
        let mode = self.mode;
        // The modes of a fusion fix the bandwidth.
        let is_quiet = self.sensors.gyr_bandwidth == GyrBandwidth::Hz12;
        Rules {
            acc_range: self.acc_range_counts(),
            gyr_range: self.gyr_range_counts(),
            near: NEAR,
            jump: RATE_JUMP,
            disturbed_jump: DISTURBED_JUMP,
            blow: BLOW,
            rattle: RATTLE,
            still_us: if is_quiet { QUIET_STILL_US } else { STILL_US },
            has_acc_and_gyr: mode.has_acc() && mode.has_gyr(),
            // A sleeping sensor has no noise.
            has_noisy_gyr: mode.has_gyr() && !mode.is_fusion() && self.power == Power::Normal,
            may_rest: mode.is_fusion(),
            needs_mag: self.needs_mag && mode.has_mag(),
        }
    }

    /// The accelerometer's range, counts.
    pub(crate) const fn acc_range_counts(&self) -> u16 {
        let g = match self.units.acc {
            AccUnit::MetrePerSecondSquared => 981,
            AccUnit::MilliG => 1000,
        };
        self.sensors.acc_range.g() as u16 * g
    }

    /// The gyroscope's range, counts: 16 for 1 deg/s; 900 for 1 rad/s are 2 % fewer.
    pub(crate) const fn gyr_range_counts(&self) -> u16 {
        self.sensors.gyr_range_in(self.mode).dps() * 16
    }
}
