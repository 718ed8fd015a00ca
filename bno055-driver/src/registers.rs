//! Register addresses and values (data sheet rev 1.4, section 4.2).

/// First register of the identity block: CHIP_ID, ACC_ID, MAG_ID, GYR_ID, SW_REV (2), BL_REV,
/// PAGE_ID.
pub const CHIP_ID: u8 = 0x00;
/// Identification of the magnetometer.
pub const MAG_ID: u8 = 0x02;
/// Register page, on both pages.
pub const PAGE_ID: u8 = 0x07;
/// First byte of the accelerometer's data; magnetometer and gyroscope follow.
pub const ACC_DATA: u8 = 0x08;
/// First byte of the magnetometer's data.
pub const MAG_DATA: u8 = 0x0E;
/// First byte of the gyroscope's data.
pub const GYR_DATA: u8 = 0x14;
/// First byte of the fusion outputs: Euler angles, quaternion, linear acceleration, gravity.
pub const EUL_DATA: u8 = 0x1A;
/// Temperature.
pub const TEMP: u8 = 0x34;
/// Calibration status of system, gyroscope, accelerometer and magnetometer.
pub const CALIB_STAT: u8 = 0x35;
/// Self-test result; INT_STA, SYS_CLK_STATUS, SYS_STATUS and SYS_ERR follow.
pub const ST_RESULT: u8 = 0x36;
/// Clock status: bit 0 set while the clock source must not be changed.
pub const SYS_CLK_STATUS: u8 = 0x38;
/// System status; SYS_ERR follows.
pub const SYS_STATUS: u8 = 0x39;
/// Unit selection.
pub const UNIT_SEL: u8 = 0x3B;
/// Operating mode (low nibble).
pub const OPR_MODE: u8 = 0x3D;
/// Power mode.
pub const PWR_MODE: u8 = 0x3E;
/// Reset, self-test and clock source.
pub const SYS_TRIGGER: u8 = 0x3F;
/// Axis map; AXIS_MAP_SIGN follows.
pub const AXIS_MAP_CONFIG: u8 = 0x41;
/// Axis signs.
pub const AXIS_MAP_SIGN: u8 = 0x42;
/// Soft-iron matrix, nine words.
pub const SIC_MATRIX: u8 = 0x43;
/// Calibration profile: offsets of the three sensors and two radii, 22 bytes.
pub const ACC_OFFSET: u8 = 0x55;

/// Page 1: ACC_CONFIG; MAG_CONFIG, GYR_CONFIG_0 and GYR_CONFIG_1 follow.
pub const ACC_CONFIG: u8 = 0x08;
/// Page 1: unique identification, 16 bytes.
pub const UNIQUE_ID: u8 = 0x50;

/// CHIP_ID, ACC_ID, MAG_ID and GYR_ID of every BNO055 (data sheet table 3-1).
pub const IDS: [u8; 4] = [0xA0, 0xFB, 0x32, 0x0F];

/// SYS_TRIGGER: use the external 32 kHz crystal.
pub const CLK_SEL: u8 = 0x80;
/// SYS_TRIGGER: reset the whole chip.
pub const RST_SYS: u8 = 0x20;
/// SYS_TRIGGER: run the self-test.
pub const SELF_TEST: u8 = 0x01;
