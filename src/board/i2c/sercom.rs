//! The SERCOM as I2C master (data sheet chapter 28), one register access at a time.
//!
//! What goes through to the bus's clock domain (commands, address, data, bus state) waits for the
//! one before to arrive, for a bounded time: a write on top of another would be lost.

use atsamd_hal::pac::sercom0::i2cm;

use crate::board::nano33iot::i2c_registers;
use crate::board::time::soon;

/// MODE of CTRLA for an I2C master.
const MASTER_MODE: u8 = 5;
/// SDA holds for 300 to 600 ns after SCL falls, as slaves of either speed can rely on.
const SDA_HOLD: u8 = 2;
/// BUSSTATE of an idle bus.
const IDLE: u8 = 1;

/// A register stayed in synchronisation.
pub(super) struct NotSynchronised;

/// What to answer to a byte that was read.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Command {
    /// Acknowledge it and fetch the next.
    Continue = 2,
    /// Refuse it and end with a STOP. After a write: just the STOP.
    Stop = 3,
}

/// Clock cycles of SCL's high and low phase, as BAUD takes them.
///
/// `f_scl = f_gclk / (10 + BAUD + BAUDLOW + f_gclk t_rise)` (data sheet 28.6.2.4); each phase lasts
/// its own value and 5 cycles.
struct Baud {
    high: u8,
    low: u8,
}

/// SCL's period is 120 or 480 cycles of 48 MHz. Fast mode asks for 1.3 us low and 0.6 us high, so
/// low is longer there. Rise times: 100 ns on a short bus, 300 ns on a long cable, which is what
/// the slow speed is for.
const fn baud(khz: u32, rise_ns: u32, low_percent: u32) -> Baud {
    let counted = 48_000 / khz - 10 - rise_ns * 48 / 1_000;
    let low = counted * low_percent / 100;
    assert!(low <= 255 && counted - low <= 255);
    Baud {
        high: (counted - low) as u8,
        low: low as u8,
    }
}

const FAST: Baud = baud(400, 100, 59);
const STANDARD: Baud = baud(100, 300, 50);

const _: () = {
    // 10 + 106 cycles and 4.8 of rise: 397 kHz, and 414 kHz with no rise at all; low 67 cycles =
    // 1.4 us.
    assert!(FAST.low == 62 && FAST.high == 44);
    assert!(STANDARD.low == 228 && STANDARD.high == 228);
};

/// Reset it: it lets go of the lines.
pub(super) fn reset() -> Result<(), NotSynchronised> {
    i2c_registers().ctrla().write(|w| w.swrst().set_bit());
    synchronised(|| i2c_registers().syncbusy().read().swrst().bit_is_clear())
}

/// Make it a master on a bus that is idle now: at 400 kHz, or at 100 kHz for any smaller `khz`.
pub(super) fn set_up(khz: u32) -> Result<(), NotSynchronised> {
    let registers = i2c_registers();
    let baud = if khz < 400 { STANDARD } else { FAST };
    let settled = || synchronised(|| registers.syncbusy().read().bits() == 0);
    // SAFETY: field values of this mode, from the data sheet.
    let control = |w: &mut i2cm::ctrla::W, enable| unsafe {
        w.mode().bits(MASTER_MODE).sdahold().bits(SDA_HOLD);
        w.enable().bit(enable);
    };
    registers.ctrla().write(|w| {
        control(w, false);
        w
    });
    // SAFETY: any two bytes are valid.
    registers
        .baud()
        .write(|w| unsafe { w.baud().bits(baud.high).baudlow().bits(baud.low) });
    registers.ctrla().write(|w| {
        control(w, true);
        w
    });
    settled()?;
    // Until told, it does not know whether the bus is idle.
    // SAFETY: one of the field's values.
    registers
        .status()
        .write(|w| unsafe { w.busstate().bits(IDLE) });
    settled()?;
    synchronised(is_idle)
}

/// Wait for the STOP before to have gone out, for a bounded time: a START on top of it would be a
/// repeated start.
pub(super) fn wait_idle() -> Result<(), NotSynchronised> {
    synchronised(is_idle)
}

/// START or repeated START and the address, its last bit set for a read.
pub(super) fn write_address(address: u8) -> Result<(), NotSynchronised> {
    arrived()?;
    // SAFETY: eight bits in a field of eleven.
    i2c_registers()
        .addr()
        .write(|w| unsafe { w.addr().bits(u16::from(address)) });
    Ok(())
}

/// Send a byte.
pub(super) fn write_data(byte: u8) -> Result<(), NotSynchronised> {
    arrived()?;
    // SAFETY: any byte is valid.
    i2c_registers()
        .data()
        .write(|w| unsafe { w.data().bits(byte) });
    Ok(())
}

/// The byte that has come. Reading it does nothing to the bus.
pub(super) fn read_data() -> u8 {
    i2c_registers().data().read().data().bits()
}

/// Answer the byte that has come, or end a write.
pub(super) fn command(command: Command) -> Result<(), NotSynchronised> {
    arrived()?;
    command_arrived(command);
    Ok(())
}

/// Whether a byte has come, nothing else has happened, and what went through to the bus before has
/// arrived there.
pub(super) fn has_brought_byte() -> bool {
    /// INTFLAG.SB.
    const BYTE: u8 = 1 << 1;
    /// STATUS.BUSERR and ARBLOST.
    const WRONG: u16 = 0b11;
    let registers = i2c_registers();
    registers.intflag().read().bits() == BYTE
        && registers.status().read().bits() & WRONG == 0
        && registers.syncbusy().read().sysop().bit_is_clear()
}

/// As [`command`], where the one before is known to have arrived.
pub(super) fn command_arrived(command: Command) {
    let refuse = matches!(command, Command::Stop);
    // SAFETY: one of the field's values.
    i2c_registers()
        .ctrlb()
        .write(|w| unsafe { w.ackact().bit(refuse).cmd().bits(command as u8) });
}

/// Enable the MB, SB and ERROR interrupts.
pub(super) fn listen() {
    i2c_registers()
        .intenset()
        .write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
}

/// Disable them.
pub(super) fn silence() {
    i2c_registers()
        .intenclr()
        .write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
}

/// The command, address or byte before has gone through.
fn arrived() -> Result<(), NotSynchronised> {
    synchronised(|| i2c_registers().syncbusy().read().sysop().bit_is_clear())
}

/// Whether nobody is on the bus: the STOP before has gone out.
pub(super) fn is_idle() -> bool {
    i2c_registers().status().read().busstate().bits() == IDLE
}

fn synchronised(ready: impl Fn() -> bool) -> Result<(), NotSynchronised> {
    soon(ready).then_some(()).ok_or(NotSynchronised)
}
