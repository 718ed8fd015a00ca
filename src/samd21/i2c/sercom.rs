//! The SERCOM as I2C master (data sheet chapter 28), one register access at a time.
//!
//! What goes through to the bus's clock domain (commands, address, data, bus state) waits for the
//! one before to arrive, for a bounded time: a write on top of another would be lost.

use atsamd_hal::pac;
use atsamd_hal::pac::sercom0::i2cm;
use tvc_nano::bus::{Command, NotSynchronised, Signal, Wire};

use crate::boards::WIRING;
use crate::samd21::time::soon;

/// The SERCOM's number, from which its place in the chip's tables follows.
const NUMBER: usize = WIRING.bus.sercom;
/// Its line of the NVIC.
pub(crate) const INTERRUPT: u16 = 9 + NUMBER as u16;
/// CLKCTRL.ID of its clock.
pub(crate) const CLOCK_ID: u8 = 0x14 + NUMBER as u8;
/// Its bit of PM.APBCMASK.
pub(crate) const BUS_CLOCK: u32 = 1 << (2 + NUMBER);

/// MODE of CTRLA for an I2C master.
const MASTER_MODE: u8 = 5;
/// SDA holds for 300 to 600 ns after SCL falls, as slaves of either speed can rely on.
const SDA_HOLD: u8 = 2;
/// BUSSTATE of an idle bus.
const IDLE: u8 = 1;

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
    Baud { high: (counted - low) as u8, low: low as u8 }
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
    registers().ctrla().write(|w| w.swrst().set_bit());
    synchronised(|| registers().syncbusy().read().swrst().bit_is_clear())
}

/// Make it a master on a bus that is idle now: at 400 kHz, or at 100 kHz for any smaller `khz`.
pub(super) fn set_up(khz: u32) -> Result<(), NotSynchronised> {
    let registers = registers();
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
    registers.baud().write(|w| unsafe { w.baud().bits(baud.high).baudlow().bits(baud.low) });
    registers.ctrla().write(|w| {
        control(w, true);
        w
    });
    settled()?;
    // Until told, it does not know whether the bus is idle.
    // SAFETY: one of the field's values.
    registers.status().write(|w| unsafe { w.busstate().bits(IDLE) });
    settled()?;
    Sercom.wait_idle()
}

/// The board's SERCOM as the master of the sensor's bus.
#[derive(Debug)]
pub(super) struct Sercom;

impl Wire for Sercom {
    fn wait_idle(&mut self) -> Result<(), NotSynchronised> {
        synchronised(|| self.is_idle())
    }

    fn write_address(&mut self, address: u8) -> Result<(), NotSynchronised> {
        arrived()?;
        // SAFETY: eight bits in a field of eleven.
        registers().addr().write(|w| unsafe { w.addr().bits(u16::from(address)) });
        Ok(())
    }

    fn write_data(&mut self, byte: u8) -> Result<(), NotSynchronised> {
        arrived()?;
        // SAFETY: any byte is valid.
        registers().data().write(|w| unsafe { w.data().bits(byte) });
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<(), NotSynchronised> {
        arrived()?;
        write_command(command);
        Ok(())
    }

    fn next_byte(&mut self) -> Option<u8> {
        /// INTFLAG.SB.
        const BYTE: u8 = 1 << 1;
        /// STATUS.BUSERR and ARBLOST.
        const WRONG: u16 = 0b11;
        let registers = registers();
        let has_come = registers.intflag().read().bits() == BYTE
            && registers.status().read().bits() & WRONG == 0
            && registers.syncbusy().read().sysop().bit_is_clear();
        has_come.then(|| {
            let byte = read_data();
            write_command(Command::Continue);
            byte
        })
    }

    fn signal(&mut self) -> Signal {
        let registers = registers();
        let flags = registers.intflag().read();
        let status = registers.status().read();
        if flags.bits() == 0 {
            Signal::Nothing
        } else if flags.error().bit_is_set() || status.buserr().bit_is_set() {
            Signal::Error
        } else if status.arblost().bit_is_set() {
            Signal::Lost
        } else if flags.mb().bit_is_set() && status.rxnack().bit_is_set() {
            Signal::Refused
        } else if flags.sb().bit_is_set() {
            Signal::Byte(read_data())
        } else {
            Signal::Acknowledged
        }
    }

    fn listen(&mut self, on: bool) {
        let registers = registers();
        if on {
            registers.intenset().write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
        } else {
            registers.intenclr().write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
        }
    }

    fn is_idle(&self) -> bool {
        registers().status().read().busstate().bits() == IDLE
    }
}

/// The byte that has come. Reading it does nothing to the bus.
fn read_data() -> u8 {
    registers().data().read().data().bits()
}

fn write_command(command: Command) {
    let refuse = matches!(command, Command::Stop);
    // SAFETY: one of the field's values.
    registers().ctrlb().write(|w| unsafe { w.ackact().bit(refuse).cmd().bits(command as u8) });
}

/// The command, address or byte before has gone through.
fn arrived() -> Result<(), NotSynchronised> {
    synchronised(|| registers().syncbusy().read().sysop().bit_is_clear())
}

fn synchronised(ready: impl Fn() -> bool) -> Result<(), NotSynchronised> {
    soon(ready).then_some(()).ok_or(NotSynchronised)
}

fn registers() -> &'static pac::sercom0::I2cm {
    /// From one SERCOM to the next.
    const STRIDE: usize = 0x400;
    let block = pac::Sercom0::ptr()
        .cast::<u8>()
        .wrapping_add(NUMBER * STRIDE)
        .cast::<pac::sercom0::RegisterBlock>();
    // SAFETY: the block of a SERCOM that the chip has, as the HAL's types say; always mapped, and
    // used here alone.
    unsafe { (*block).i2cm() }
}
