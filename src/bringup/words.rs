//! Where the words are that `tvc bringup` looks at, and what some of them hold. Addresses are those
//! of the SAM D21's data sheet, where they stand under the register's name.

/// The chip's serial number.
pub const SERIAL: [u32; 4] = [0x0080_A00C, 0x0080_A040, 0x0080_A044, 0x0080_A048];
/// The first word of the NVM user row: the fuses.
pub const USER_ROW: u32 = 0x0080_4000;
/// PM.RCAUSE: what has reset the chip.
pub const RESET_CAUSE: u32 = 0x4000_0438;
/// SYSCTRL.PCLKSR: which clocks are ready, and what the brown-out detector sees.
pub const CLOCK_STATUS: u32 = 0x4000_080C;
/// SYSCTRL.DFLLVAL: what the DFLL runs with.
pub const DFLL_VALUE: u32 = 0x4000_0828;
/// SYSCTRL.BOD33: the brown-out detector.
pub const BROWN_OUT: u32 = 0x4000_0834;
/// WDT.CTRL and the three registers behind it.
pub const WATCHDOG: u32 = 0x4000_1000;
/// DSU.DID: which chip this is.
pub const DEVICE_ID: u32 = 0x4100_2018;
/// PORT.IN of group B, in which the sensor's lines are.
pub const PORT_IN: u32 = 0x4100_44A0;
/// USB.FNUM: the number of the newest start-of-frame.
pub const USB_FRAME: u32 = 0x4100_5010;
/// TC5.COUNT, 16 bits, where [`What::Count`](super::What::Count) counts.
pub const SLOW_COUNT: u32 = 0x4200_3410;

/// The word that Arduino's bootloader looks for in RAM, and so holds in its program.
pub const ARDUINO: u32 = 0x0773_8135;
/// The word that UF2's bootloader looks for.
pub const UF2: u32 = 0xF016_69EF;
/// Where Arduino's bootloader, as it is shipped, holds [`ARDUINO`].
pub const ARDUINO_AT: u32 = 0x724;
/// Where a bootloader ends in flash and the image begins.
pub const BOOTLOADER_END: u32 = 0x2000;

/// Start of RAM.
pub const RAM: u32 = 0x2000_0000;
/// Where the stack begins, growing down (memory.x).
pub const STACK_TOP: u32 = 0x2000_7800;
/// What unused stack is painted with.
pub const STACK_PAINT: u32 = 0x5AC5_5AC5;
