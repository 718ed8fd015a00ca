//! Addresses, reset values and codes of the BNO055's register map (data sheet rev. 1.4, 4.2-4.4).

/// Register addresses of page 0.
pub(crate) mod page0 {
    /// Chip id, 0xA0.
    pub(crate) const CHIP_ID: u8 = 0x00;
    /// Accelerometer id, 0xFB.
    pub(crate) const ACC_ID: u8 = 0x01;
    /// Magnetometer id, 0x32.
    pub(crate) const MAG_ID: u8 = 0x02;
    /// Gyroscope id, 0x0F.
    pub(crate) const GYR_ID: u8 = 0x03;
    /// Firmware revision, low byte first.
    pub(crate) const SW_REV_ID: u8 = 0x04;
    /// Bootloader revision.
    pub(crate) const BL_REV_ID: u8 = 0x06;
    /// Page select, on both pages.
    pub(crate) const PAGE_ID: u8 = 0x07;
    /// First byte of the accelerometer's three words; all data words are little endian.
    pub(crate) const ACC_DATA: u8 = 0x08;
    /// Magnetometer, three words.
    pub(crate) const MAG_DATA: u8 = 0x0E;
    /// Gyroscope, three words.
    pub(crate) const GYR_DATA: u8 = 0x14;
    /// Heading, roll, pitch.
    pub(crate) const EUL_DATA: u8 = 0x1A;
    /// Quaternion w, x, y, z.
    pub(crate) const QUA_DATA: u8 = 0x20;
    /// Linear acceleration, three words.
    pub(crate) const LIA_DATA: u8 = 0x28;
    /// Gravity, three words.
    pub(crate) const GRV_DATA: u8 = 0x2E;
    /// Temperature, i8.
    pub(crate) const TEMP: u8 = 0x34;
    /// Calibration status: system, gyroscope, accelerometer, magnetometer, two bits each.
    pub(crate) const CALIB_STAT: u8 = 0x35;
    /// Self-test result.
    pub(crate) const ST_RESULT: u8 = 0x36;
    /// Interrupt status.
    pub(crate) const INT_STA: u8 = 0x37;
    /// Bit 0: the clock source must not be changed now.
    pub(crate) const SYS_CLK_STATUS: u8 = 0x38;
    /// System status code.
    pub(crate) const SYS_STATUS: u8 = 0x39;
    /// System error code.
    pub(crate) const SYS_ERR: u8 = 0x3A;
    /// Units of the outputs.
    pub(crate) const UNIT_SEL: u8 = 0x3B;
    /// Operating mode.
    pub(crate) const OPR_MODE: u8 = 0x3D;
    /// Power mode.
    pub(crate) const PWR_MODE: u8 = 0x3E;
    /// Self-test, resets, clock source.
    pub(crate) const SYS_TRIGGER: u8 = 0x3F;
    /// Source of the temperature.
    pub(crate) const TEMP_SOURCE: u8 = 0x40;
    /// Which sensor axis each output axis shows.
    pub(crate) const AXIS_MAP_CONFIG: u8 = 0x41;
    /// Sign of each output axis.
    pub(crate) const AXIS_MAP_SIGN: u8 = 0x42;
    /// Soft-iron matrix, nine words.
    pub(crate) const SIC_MATRIX: u8 = 0x43;
    /// First byte of the 22 bytes of offsets and radii.
    pub(crate) const ACC_OFFSET: u8 = 0x55;
    /// Last register of the page.
    pub(crate) const MAG_RADIUS_MSB: u8 = 0x6A;
}

/// Register addresses of page 1.
pub(crate) mod page1 {
    /// Accelerometer range, bandwidth, power.
    pub(crate) const ACC_CONFIG: u8 = 0x08;
    /// Magnetometer rate, operation, power.
    pub(crate) const MAG_CONFIG: u8 = 0x09;
    /// Gyroscope range and bandwidth.
    pub(crate) const GYR_CONFIG_0: u8 = 0x0A;
    /// Gyroscope power.
    pub(crate) const GYR_CONFIG_1: u8 = 0x0B;
    /// Accelerometer sleep.
    pub(crate) const ACC_SLEEP_CONFIG: u8 = 0x0C;
    /// Gyroscope sleep.
    pub(crate) const GYR_SLEEP_CONFIG: u8 = 0x0D;
    /// Interrupt mask.
    pub(crate) const INT_MSK: u8 = 0x0F;
    /// Interrupt enable.
    pub(crate) const INT_EN: u8 = 0x10;
    /// Last of the interrupt settings.
    pub(crate) const GYR_AM_SET: u8 = 0x1F;
    /// First of the 16 bytes of the unique id.
    pub(crate) const UNIQUE_ID: u8 = 0x50;
}

/// Values of SYS_STATUS.
pub(crate) mod status {
    /// Idle, in CONFIG.
    pub(crate) const IDLE: u8 = 0;
    /// Error, see SYS_ERR.
    pub(crate) const ERROR: u8 = 1;
    /// Bringing up peripherals.
    pub(crate) const INIT_PERIPHERALS: u8 = 2;
    /// Bringing up the system.
    pub(crate) const INIT_SYSTEM: u8 = 3;
    /// Self-test running.
    pub(crate) const SELF_TEST: u8 = 4;
    /// Running with fusion.
    pub(crate) const FUSION: u8 = 5;
    /// Running without fusion.
    pub(crate) const NO_FUSION: u8 = 6;
}

/// Values of SYS_ERR.
pub(crate) mod error {
    /// Peripheral initialisation error.
    pub(crate) const PERIPHERAL_INIT: u8 = 1;
    /// System initialisation error.
    pub(crate) const SYSTEM_INIT: u8 = 2;
    /// Fusion configuration error.
    pub(crate) const FUSION_CONFIG: u8 = 9;
}

/// Bits of UNIT_SEL.
pub(crate) mod unit {
    /// Acceleration in mg instead of m/s^2.
    pub(crate) const ACC_MG: u8 = 0x01;
    /// Rate in rad/s instead of deg/s.
    pub(crate) const GYR_RPS: u8 = 0x02;
    /// Euler angles in rad instead of degrees.
    pub(crate) const EUL_RAD: u8 = 0x04;
    /// Temperature in Fahrenheit.
    pub(crate) const TEMP_F: u8 = 0x10;
    /// Android's sign of pitch.
    pub(crate) const ANDROID: u8 = 0x80;
    /// The bits that exist.
    pub(crate) const MASK: u8 = ACC_MG | GYR_RPS | EUL_RAD | TEMP_F | ANDROID;
}

/// Bits of SYS_TRIGGER.
pub(crate) mod trigger {
    /// Start the self-test.
    pub(crate) const SELF_TEST: u8 = 0x01;
    /// Reset the chip.
    pub(crate) const RST_SYS: u8 = 0x20;
    /// Reset the interrupt status.
    pub(crate) const RST_INT: u8 = 0x40;
    /// Take the external crystal.
    pub(crate) const CLK_SEL: u8 = 0x80;
}

/// Axis map after reset: X, Y, Z.
pub(super) const AXIS_MAP_RESET: u8 = 0x24;
/// Axis map that shows Y, X, Z.
pub(super) const AXIS_MAP_SWAPPED: u8 = 0x21;
/// UNIT_SEL after reset: m/s^2, deg/s, degrees, Celsius, Android's pitch.
pub(super) const UNIT_SEL_RESET: u8 = unit::ANDROID;

/// Operating mode (OPR_MODE, data sheet table 3-5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs, reason = "the data sheet's own names")]
pub enum Mode {
    Config = 0x0,
    AccOnly = 0x1,
    MagOnly = 0x2,
    GyroOnly = 0x3,
    AccMag = 0x4,
    AccGyro = 0x5,
    MagGyro = 0x6,
    Amg = 0x7,
    Imu = 0x8,
    Compass = 0x9,
    M4g = 0xA,
    NdofFmcOff = 0xB,
    Ndof = 0xC,
}

impl Mode {
    /// The mode of a code, `None` for the codes that do not exist.
    pub fn from_code(code: u8) -> Option<Self> {
        use Mode::*;
        [
            Config, AccOnly, MagOnly, GyroOnly, AccMag, AccGyro, MagGyro, Amg, Imu, Compass, M4g,
            NdofFmcOff, Ndof,
        ]
        .get(usize::from(code))
        .copied()
    }

    /// The accelerometer runs.
    pub fn has_acc(self) -> bool {
        !matches!(self, Self::Config | Self::MagOnly | Self::GyroOnly | Self::MagGyro)
    }

    /// The magnetometer runs.
    pub fn has_mag(self) -> bool {
        !matches!(self, Self::Config | Self::AccOnly | Self::GyroOnly | Self::AccGyro | Self::Imu)
    }

    /// The gyroscope runs.
    pub fn has_gyr(self) -> bool {
        use Mode::*;
        !matches!(self, Config | AccOnly | MagOnly | AccMag | Compass | M4g)
    }

    /// The chip's own fusion runs.
    pub fn is_fusion(self) -> bool {
        self as u8 >= Self::Imu as u8
    }

    /// Refreshes of the data registers a second (data sheet table 3-14; 100 Hz in the modes
    /// without fusion).
    pub fn refresh_hz(self) -> f64 {
        match self {
            Self::Compass => 20.0,
            Self::M4g => 50.0,
            _ => 100.0,
        }
    }
}

/// Contents of both pages after a reset, fixed values included.
pub(super) fn reset_pages(unique_id: [u8; 16]) -> [[u8; 128]; 2] {
    let mut pages = [[0; 128]; 2];
    for (address, value) in [
        (page0::CHIP_ID, 0xA0),
        (page0::ACC_ID, 0xFB),
        (page0::MAG_ID, 0x32),
        (page0::GYR_ID, 0x0F),
        (page0::SW_REV_ID, 0x11),
        (page0::SW_REV_ID + 1, 0x03),
        (page0::BL_REV_ID, 0x15),
        (page0::ST_RESULT, 0x0F),
        (page0::UNIT_SEL, UNIT_SEL_RESET),
        (page0::AXIS_MAP_CONFIG, AXIS_MAP_RESET),
        // Unity in 1.14 on the diagonal.
        (page0::SIC_MATRIX + 1, 0x40),
        (page0::SIC_MATRIX + 9, 0x40),
        (page0::SIC_MATRIX + 17, 0x40),
    ] {
        pages[0][usize::from(address)] = value;
    }
    for (address, value) in
        [(page1::ACC_CONFIG, 0x0D), (page1::MAG_CONFIG, 0x0B), (page1::GYR_CONFIG_0, 0x38)]
    {
        pages[1][usize::from(address)] = value;
    }
    let id = usize::from(page1::UNIQUE_ID);
    pages[1][id..id + 16].copy_from_slice(&unique_id);
    pages
}
