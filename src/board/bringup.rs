//! The board shows what it is like: see [`tvc_nano::bringup`].

use tvc_nano::bringup::{Order, Pulse, What, is_readable};

use super::i2c::Bus;
use super::pin::Pin;
use super::time::now;

/// D2, to which a jumper leads the servo's signal.
const FEEDBACK: Pin = Pin::b(10);
/// PORT.PINCFG of D2: its input buffer on, and a pull-down, so that it reads low without a jumper.
const FEEDBACK_CONFIG: *mut u8 = 0x4100_44CA as *mut u8;
const INPUT_PULLED: u8 = 0x06;

/// A little longer than the longest servo frame, us.
const FRAME_US: u32 = 22_000;

/// SYSCTRL.DFLLSYNC, whose READREQ has DFLLVAL brought up to date.
const DFLLSYNC: *mut u8 = 0x4000_0830 as *mut u8;
const READREQ: u8 = 1 << 7;

/// Does what is ordered and gives the answer's value; `None` for what there is not.
pub(super) fn obey(order: Order, bus: &Bus) -> Option<u32> {
    const PEEK: u8 = What::Peek as u8;
    const HANG: u8 = What::Hang as u8;
    const PANIC: u8 = What::Panic as u8;
    const PULSE: u8 = What::Pulse as u8;
    const BUS: u8 = What::Bus as u8;
    const COUNT: u8 = What::Count as u8;
    match order.what {
        PEEK if is_readable(order.number) => Some(peek(order.number)),
        HANG => loop {
            cortex_m::asm::nop();
        },
        PANIC => panic!("ordered"),
        PULSE => time_pulse(),
        BUS => Some(bus.summary()),
        COUNT => {
            count_slow_clock();
            Some(0)
        }
        _ => None,
    }
}

/// The word at a readable address.
fn peek(address: u32) -> u32 {
    // SAFETY: the register takes any write at any time; the word is aligned, there, and changed by
    // no read.
    unsafe {
        DFLLSYNC.write_volatile(READREQ);
        (address as *const u32).read_volatile()
    }
}

/// The next whole pulse at D2. Holds up the main loop for a frame at most.
fn time_pulse() -> Option<u32> {
    // SAFETY: the pin's own configuration; nothing else uses it.
    unsafe { FEEDBACK_CONFIG.write_volatile(INPUT_PULLED) };
    edge(false)?;
    let rise_us = edge(true)?;
    let width_us = edge(false)?.wrapping_sub(rise_us);
    Some(Pulse { rise_us, width_us }.word())
}

/// When D2 is first seen `high`, or low, us. `None` if it does not get there within a frame.
#[inline(never)]
fn edge(high: bool) -> Option<u32> {
    let us = || now().0 as u32;
    let began = us();
    loop {
        let now = us();
        if FEEDBACK.is_high() == high {
            return Some(now);
        }
        if now.wrapping_sub(began) > FRAME_US {
            return None;
        }
    }
}

/// Has TC5 count generator 4, which clocks the watchdog.
fn count_slow_clock() {
    const APBCMASK: *mut u32 = 0x4000_0420 as *mut u32;
    const APBC_TC5: u32 = 1 << 13;
    const CLKCTRL: *mut u16 = 0x4000_0C02 as *mut u16;
    /// CLKEN, generator 4, for TC4 and TC5.
    const GENERATOR_4: u16 = 1 << 14 | 4 << 8 | 0x1C;
    const CTRLA: *mut u16 = 0x4200_3400 as *mut u16;
    const ENABLE: u16 = 1 << 1;
    const READREQ: *mut u16 = 0x4200_3402 as *mut u16;
    /// RREQ and RCONT for COUNT: it is kept up to date.
    const COUNT: u16 = 3 << 14 | 0x10;
    // SAFETY: registers of a timer that nothing else uses, and its clocks.
    unsafe {
        APBCMASK.write_volatile(APBCMASK.read_volatile() | APBC_TC5);
        CLKCTRL.write_volatile(GENERATOR_4);
        CTRLA.write_volatile(ENABLE);
        READREQ.write_volatile(COUNT);
    }
}
