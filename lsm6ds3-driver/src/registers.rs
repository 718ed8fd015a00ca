//! Registers of the family (data sheet DocID026899 of the LSM6DS3, section 9).

/// Access to the embedded functions' registers, which lie over the others.
pub const FUNC_CFG_ACCESS: u8 = 0x01;
/// The identification.
pub const WHO_AM_I: u8 = 0x0F;
/// Rate and range of the accelerometer; the first of ten control registers.
pub const CTRL1_XL: u8 = 0x10;
/// Resets, byte order, address increment.
pub const CTRL3_C: u8 = 0x12;
/// The temperature, behind the control and status registers.
pub const OUT_TEMP_L: u8 = 0x20;
/// The first byte of the rates; the accelerations follow.
pub const OUTX_L_G: u8 = 0x22;

/// Number of control registers from [`CTRL1_XL`] on.
pub const CONTROLS: usize = 10;

/// CTRL3_C: software reset.
pub const SW_RESET: u8 = 0x01;
/// CTRL3_C: the address of a transfer increments.
pub const IF_INC: u8 = 0x04;
/// CTRL3_C: a word changes only after both of its bytes were read.
pub const BDU: u8 = 0x40;
