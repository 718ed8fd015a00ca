//! Everything the chip can be told, typed: modes, ranges, bandwidths, units, axis map, power.

use core::num::NonZeroU8;

use crate::profile::{Profile, SoftIron};

/// The chip's I2C address, chosen by its COM3 pin (data sheet section 4.6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Address {
    /// 0x28: COM3 low, as on most breakout boards.
    #[default]
    Low,
    /// 0x29: COM3 high.
    High,
}

impl Address {
    /// The 7-bit address.
    #[must_use]
    pub const fn value(self) -> u8 {
        match self {
            Self::Low => 0x28,
            Self::High => 0x29,
        }
    }
}

/// Operating mode (data sheet section 3.3); CONFIG is not among them, the driver passes through it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Mode {
    /// Accelerometer only.
    AccOnly = 0x1,
    /// Magnetometer only.
    MagOnly = 0x2,
    /// Gyroscope only.
    GyrOnly = 0x3,
    /// Accelerometer and magnetometer.
    AccMag = 0x4,
    /// Accelerometer and gyroscope.
    AccGyr = 0x5,
    /// Magnetometer and gyroscope.
    MagGyr = 0x6,
    /// All three sensors, uncompensated, no fusion: for those who run their own filter.
    #[default]
    Amg = 0x7,
    /// Fusion of accelerometer and gyroscope: relative heading.
    Imu = 0x8,
    /// Fusion of accelerometer and magnetometer: heading.
    Compass = 0x9,
    /// Like [`Mode::Imu`] with the magnetometer in the gyroscope's place.
    M4g = 0xA,
    /// Nine-axis fusion without fast magnetometer calibration.
    NdofFmcOff = 0xB,
    /// Nine-axis fusion.
    Ndof = 0xC,
}

impl Mode {
    /// Whether the chip's own fusion runs: its outputs are then live, and it sets the sensors itself
    /// (all but the accelerometer's range).
    #[must_use]
    pub const fn is_fusion(self) -> bool {
        self as u8 >= Self::Imu as u8
    }

    /// Whether accelerometer data are live.
    #[must_use]
    pub const fn has_acc(self) -> bool {
        !matches!(self, Self::MagOnly | Self::GyrOnly | Self::MagGyr)
    }

    /// Whether magnetometer data are live.
    #[must_use]
    pub const fn has_mag(self) -> bool {
        !matches!(
            self,
            Self::AccOnly | Self::GyrOnly | Self::AccGyr | Self::Imu
        )
    }

    /// Whether gyroscope data are live.
    #[must_use]
    pub const fn has_gyr(self) -> bool {
        !matches!(
            self,
            Self::AccOnly | Self::MagOnly | Self::AccMag | Self::Compass | Self::M4g
        )
    }
}

/// Accelerometer range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum AccRange {
    /// +-2 g.
    G2 = 0,
    /// +-4 g (the chip's default).
    G4 = 1,
    /// +-8 g.
    #[default]
    G8 = 2,
    /// +-16 g.
    G16 = 3,
}

impl AccRange {
    /// Full scale in g.
    #[must_use]
    pub const fn g(self) -> u8 {
        2 << self as u8
    }
}

/// Accelerometer bandwidth; the sensor updates at twice that rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum AccBandwidth {
    /// 7.81 Hz.
    Hz7_81 = 0,
    /// 15.63 Hz.
    Hz15_63 = 1,
    /// 31.25 Hz.
    Hz31_25 = 2,
    /// 62.5 Hz (the chip's default).
    #[default]
    Hz62_5 = 3,
    /// 125 Hz.
    Hz125 = 4,
    /// 250 Hz.
    Hz250 = 5,
    /// 500 Hz.
    Hz500 = 6,
    /// 1000 Hz.
    Hz1000 = 7,
}

/// Gyroscope range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum GyrRange {
    /// +-2000 deg/s (the chip's default).
    #[default]
    Dps2000 = 0,
    /// +-1000 deg/s.
    Dps1000 = 1,
    /// +-500 deg/s.
    Dps500 = 2,
    /// +-250 deg/s.
    Dps250 = 3,
    /// +-125 deg/s.
    Dps125 = 4,
}

impl GyrRange {
    /// Full scale in deg/s.
    #[must_use]
    pub const fn dps(self) -> u16 {
        2000 >> self as u8
    }
}

/// Gyroscope bandwidth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum GyrBandwidth {
    /// 523 Hz.
    Hz523 = 0,
    /// 230 Hz.
    Hz230 = 1,
    /// 116 Hz: about 1.4 ms of delay, against 5 ms at the chip's default of 32 Hz.
    #[default]
    Hz116 = 2,
    /// 47 Hz.
    Hz47 = 3,
    /// 23 Hz.
    Hz23 = 4,
    /// 12 Hz.
    Hz12 = 5,
    /// 64 Hz.
    Hz64 = 6,
    /// 32 Hz (the chip's default).
    Hz32 = 7,
}

/// Magnetometer output rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum MagRate {
    /// 2 Hz.
    Hz2 = 0,
    /// 6 Hz.
    Hz6 = 1,
    /// 8 Hz.
    Hz8 = 2,
    /// 10 Hz.
    Hz10 = 3,
    /// 15 Hz.
    Hz15 = 4,
    /// 20 Hz.
    Hz20 = 5,
    /// 25 Hz.
    Hz25 = 6,
    /// 30 Hz.
    #[default]
    Hz30 = 7,
}

/// How often the magnetometer measures for one output: noise against current.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum MagEffort {
    /// Fewest repetitions.
    LowPower = 0,
    /// The usual compromise.
    #[default]
    Regular = 1,
    /// More repetitions.
    EnhancedRegular = 2,
    /// Most repetitions.
    HighAccuracy = 3,
}

/// Settings of the three sensors (page 1). In fusion modes the chip minds only the accelerometer's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sensors {
    /// Accelerometer range.
    pub acc_range: AccRange,
    /// Accelerometer bandwidth.
    pub acc_bandwidth: AccBandwidth,
    /// Gyroscope range.
    pub gyr_range: GyrRange,
    /// Gyroscope bandwidth.
    pub gyr_bandwidth: GyrBandwidth,
    /// Magnetometer output rate.
    pub mag_rate: MagRate,
    /// Magnetometer repetitions.
    pub mag_effort: MagEffort,
}

impl Sensors {
    /// ACC_CONFIG, MAG_CONFIG, GYR_CONFIG_0, GYR_CONFIG_1, all three sensors in their normal power mode
    /// (data sheet sections 3.5.2 to 3.5.4).
    #[must_use]
    pub const fn registers(&self) -> [u8; 4] {
        [
            (self.acc_bandwidth as u8) << 2 | self.acc_range as u8,
            (self.mag_effort as u8) << 3 | self.mag_rate as u8,
            (self.gyr_bandwidth as u8) << 3 | self.gyr_range as u8,
            0,
        ]
    }
}

/// Unit of acceleration, linear acceleration and gravity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AccUnit {
    /// 100 counts for 1 m/s^2.
    #[default]
    MetrePerSecondSquared,
    /// 1 count for 1 mg.
    MilliG,
}

/// Unit of angular rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum GyrUnit {
    /// 16 counts for 1 deg/s.
    #[default]
    DegreePerSecond,
    /// 900 counts for 1 rad/s.
    RadianPerSecond,
}

/// Unit of the Euler angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AngleUnit {
    /// 16 counts for 1 deg.
    #[default]
    Degree,
    /// 900 counts for 1 rad.
    Radian,
}

/// Unit of temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum TemperatureUnit {
    /// 1 count for 1 degree Celsius.
    #[default]
    Celsius,
    /// 1 count for 2 degrees Fahrenheit.
    Fahrenheit,
}

/// Sign convention of the Euler pitch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Pitch turns clockwise increasing, -180 to +180 deg.
    #[default]
    Windows,
    /// Pitch turns clockwise decreasing, +180 to -180 deg.
    Android,
}

/// Units that the chip's outputs are in (UNIT_SEL, data sheet section 3.6.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Units {
    /// Acceleration.
    pub acc: AccUnit,
    /// Angular rate.
    pub gyr: GyrUnit,
    /// Euler angles.
    pub angle: AngleUnit,
    /// Temperature.
    pub temperature: TemperatureUnit,
    /// Euler pitch.
    pub orientation: Orientation,
}

/// Standard gravity, m/s^2.
const STANDARD_GRAVITY: f32 = 9.806_65;

impl Units {
    /// The value of UNIT_SEL.
    #[must_use]
    pub const fn register(&self) -> u8 {
        self.acc as u8
            | (self.gyr as u8) << 1
            | (self.angle as u8) << 2
            | (self.temperature as u8) << 4
            | (self.orientation as u8) << 7
    }

    /// One count of acceleration in m/s^2.
    #[must_use]
    pub const fn acc_m_s2(&self) -> f32 {
        match self.acc {
            AccUnit::MetrePerSecondSquared => 0.01,
            AccUnit::MilliG => STANDARD_GRAVITY * 0.001,
        }
    }

    /// One count of angular rate in rad/s.
    #[must_use]
    pub const fn gyr_rad_s(&self) -> f32 {
        match self.gyr {
            GyrUnit::DegreePerSecond => core::f32::consts::PI / (180.0 * 16.0),
            GyrUnit::RadianPerSecond => 1.0 / 900.0,
        }
    }

    /// One count of an Euler angle in rad.
    #[must_use]
    pub const fn angle_rad(&self) -> f32 {
        match self.angle {
            AngleUnit::Degree => core::f32::consts::PI / (180.0 * 16.0),
            AngleUnit::Radian => 1.0 / 900.0,
        }
    }

    /// A temperature reading in degrees Celsius.
    #[must_use]
    pub fn celsius(&self, count: i8) -> f32 {
        match self.temperature {
            TemperatureUnit::Celsius => f32::from(count),
            TemperatureUnit::Fahrenheit => (f32::from(count) * 2.0 - 32.0) / 1.8,
        }
    }
}

/// One count of magnetic field in uT, in every unit selection.
pub const MAG_UT: f32 = 1.0 / 16.0;

/// A sensor axis as printed on the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Axis {
    /// The chip's x.
    X = 0,
    /// The chip's y.
    Y = 1,
    /// The chip's z.
    Z = 2,
}

/// Which of the chip's axes, and which way, an output axis shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Signed {
    /// The chip's axis.
    pub axis: Axis,
    /// Whether it is turned round.
    pub negative: bool,
}

impl Signed {
    /// Along the chip's axis.
    #[must_use]
    pub const fn plus(axis: Axis) -> Self {
        Self {
            axis,
            negative: false,
        }
    }

    /// Against the chip's axis.
    #[must_use]
    pub const fn minus(axis: Axis) -> Self {
        Self {
            axis,
            negative: true,
        }
    }
}

/// Why an axis map is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisMapError {
    /// Two outputs show the same axis: the chip would ignore the map without a word.
    Repeated,
    /// The map turns a right-handed frame into a left-handed one, in which rates have the wrong sign.
    Mirrored,
}

impl core::fmt::Display for AxisMapError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Repeated => "axis map shows an axis twice",
            Self::Mirrored => "axis map is left-handed",
        })
    }
}

impl core::error::Error for AxisMapError {}

/// A rotation by right angles between the chip's frame and its outputs (data sheet section 3.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AxisMap {
    config: u8,
    sign: u8,
}

impl AxisMap {
    /// Placements P0 to P7 of the data sheet; P1 is the chip's default.
    pub const PLACEMENTS: [Self; 8] = [
        Self {
            config: 0x21,
            sign: 0x04,
        },
        Self::IDENTITY,
        Self {
            config: 0x24,
            sign: 0x06,
        },
        Self {
            config: 0x21,
            sign: 0x02,
        },
        Self {
            config: 0x24,
            sign: 0x03,
        },
        Self {
            config: 0x21,
            sign: 0x01,
        },
        Self {
            config: 0x21,
            sign: 0x07,
        },
        Self {
            config: 0x24,
            sign: 0x05,
        },
    ];

    /// Outputs as printed on the chip (P1, the default).
    pub const IDENTITY: Self = Self {
        config: 0x24,
        sign: 0x00,
    };

    /// The map that shows `x`, `y` and `z` on the output axes of these names.
    ///
    /// # Errors
    /// An axis shown twice, or a left-handed frame.
    pub const fn new(x: Signed, y: Signed, z: Signed) -> Result<Self, AxisMapError> {
        let (i, j, k) = (x.axis as u8, y.axis as u8, z.axis as u8);
        if i == j || j == k || k == i {
            return Err(AxisMapError::Repeated);
        }
        // x y z, y z x and z x y are rotations, the other orders mirror; so does each sign.
        let even = (j + 3 - i) % 3 == 1;
        let mirrored = !even ^ x.negative ^ y.negative ^ z.negative;
        if mirrored {
            return Err(AxisMapError::Mirrored);
        }
        Ok(Self {
            config: k << 4 | j << 2 | i,
            sign: (x.negative as u8) << 2 | (y.negative as u8) << 1 | z.negative as u8,
        })
    }

    /// AXIS_MAP_CONFIG and AXIS_MAP_SIGN.
    #[must_use]
    pub const fn registers(&self) -> [u8; 2] {
        [self.config, self.sign]
    }
}

impl Default for AxisMap {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// Power mode while sampling (data sheet section 3.2); see [`Driver::suspend`](crate::Driver::suspend) for the third.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Power {
    /// All sensors of the mode run.
    #[default]
    Normal = 0,
    /// All but the accelerometer sleep after 5 s without motion: their data then stand still.
    Low = 1,
}

/// Whether the driver may reset the chip by command.
///
/// Some parts never answer again after a soft reset until their power is cycled, so that the default is never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ResetPolicy {
    /// Rewrite every register instead.
    #[default]
    Never,
    /// Reset when so many attempts in a row to set up an answering chip have failed.
    AfterFailures(NonZeroU8),
}

/// What the chip is to be, and how the driver judges it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// I2C address.
    pub address: Address,
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
    /// So many equal bursts in a row are a frozen chip. The chip refreshes at its own 100 Hz, so that two equal ones
    /// are normal at a 100 Hz tick; allow more if you sample faster or with little bandwidth.
    pub frozen_after: NonZeroU8,
    /// A word that moves by more counts than this within [`STEP_AGE_US`](crate::STEP_AGE_US), and does not stay there,
    /// is a transmission error; `None` switches the test off. In all units 4000 counts are about 4 g, 250 deg/s or 250 uT.
    pub step_limit: Option<u16>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            address: Address::default(),
            mode: Mode::default(),
            sensors: Sensors::default(),
            units: Units::default(),
            axes: AxisMap::default(),
            power: Power::default(),
            external_crystal: false,
            profile: None,
            soft_iron: None,
            reset: ResetPolicy::default(),
            frozen_after: const { NonZeroU8::new(5).unwrap() },
            step_limit: Some(4000),
        }
    }
}
