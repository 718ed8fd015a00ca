//! The board shows what it is like: see [`tvc_nano::bringup`].

use atsamd_hal::pac;
use tvc_nano::SelfCheck;
use tvc_nano::bringup::{Order, Pulse, What, is_readable};

use super::crash;
use super::i2c::Bus;
use super::pin::Pin;
use super::time::now;
use crate::boards::WIRING;

/// Where the servo's signal is timed: at the second servo's pin.
const FEEDBACK: Pin = WIRING.servos[1].pin;

/// A little longer than the longest servo frame, us.
const FRAME_US: u32 = 22_000;

/// Does what is ordered and gives the answer's value; `None` for what there is not. No servo's
/// signal is timed where D2 is a servo's itself. `engine_us` is of [`What::Image`].
pub(crate) fn obey(order: Order, bus: &Bus, engine_us: u32, d2_is_servo: bool) -> Option<u32> {
    const PEEK: u8 = What::Peek as u8;
    const HANG: u8 = What::Hang as u8;
    const FAIL_CHECK: u8 = What::FailCheck as u8;
    const PULSE: u8 = What::Pulse as u8;
    const BUS: u8 = What::Bus as u8;
    const COUNT: u8 = What::Count as u8;
    const IMAGE: u8 = What::Image as u8;
    match order.what {
        PEEK if is_readable(order.number) => Some(peek(order.number)),
        HANG => crash::hang(),
        FAIL_CHECK => crash::stop(SelfCheck::Ordered),
        PULSE if !d2_is_servo => time_pulse(),
        BUS => Some(bus.summary()),
        COUNT => {
            count_slow_clock();
            Some(0)
        }
        IMAGE => Some(engine_us),
        _ => None,
    }
}

/// The word at a readable address; SYSCTRL.DFLLVAL's is brought up to date for the next look.
fn peek(address: u32) -> u32 {
    // SAFETY: DFLLSYNC takes any write at any time; the word is aligned, there, and changed by no
    // read.
    unsafe {
        let sysctrl = &*pac::Sysctrl::ptr();
        sysctrl.dfllsync().write(|w| w.readreq().set_bit());
        (address as *const u32).read_volatile()
    }
}

/// The next whole pulse at D2. Holds up the main loop for 66 ms at most.
fn time_pulse() -> Option<u32> {
    FEEDBACK.pull_down();
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

/// Has TC5 count generator 7, which clocks the watchdog.
fn count_slow_clock() {
    // SAFETY: a timer that nothing else uses, and its clocks; the main loop alone changes those.
    let (pm, gclk, timer) =
        unsafe { (&*pac::Pm::ptr(), &*pac::Gclk::ptr(), (*pac::Tc5::ptr()).count16()) };
    /// The address of COUNT, which is kept up to date.
    const COUNT: u8 = 0x10;
    pm.apbcmask().modify(|_, w| w.tc5_().set_bit());
    gclk.clkctrl().write(|w| w.id().tc4_tc5().r#gen().gclk7().clken().set_bit());
    timer.ctrla().write(|w| w.enable().set_bit());
    // SAFETY: a register's address within the timer.
    timer.readreq().write(|w| unsafe { w.addr().bits(COUNT).rcont().set_bit().rreq().set_bit() });
}
