//! Clocks and supply supervision.
//!
//! The Nano 33 IoT has no crystal. The DFLL makes 48 MHz, disciplined by USB's start-of-frame where
//! there is a host, and off by up to a few percent where there is none. The HAL sets it up and
//! waits for its oscillators without a limit: that is left as it is. It happens before the first
//! pulse and before the watchdog runs, and a chip whose oscillator does not start could make
//! neither pulses nor USB whatever this code did.

use atsamd_hal::clock::{ClockGenId, ClockSource, GenericClockController, UsbClock};
use atsamd_hal::pac;

use super::nano33iot::{self, FrameClock};
use super::time::within;

/// Proof that the clocks run which USB's controller and the frame ask for.
pub(super) struct Clocks {
    pub(super) usb: UsbClock,
    pub(super) frame: FrameClock,
}

/// 48 MHz for the CPU, USB, the servo timer and the sensor bus; 1,024 Hz for the watchdog.
pub(super) fn start(
    gclk: pac::Gclk,
    pm: &mut pac::Pm,
    sysctrl: &mut pac::Sysctrl,
    nvmctrl: &mut pac::Nvmctrl,
) -> Clocks {
    let mut controller = GenericClockController::with_internal_32kosc(gclk, pm, sysctrl, nvmctrl);
    let main = controller.gclk0();
    // The watchdog's own oscillator runs whatever becomes of the others: 32,768 Hz / 32.
    let slow = controller
        .configure_gclk_divider_and_source(ClockGenId::Gclk4, 32, ClockSource::Osculp32k, false)
        .expect("generator 4 is free");
    controller.wdt(&slow).expect("clocked once");
    Clocks {
        usb: controller.usb(&main).expect("clocked once"),
        frame: nano33iot::clock(&mut controller, &main),
    }
}

/// BOD33 threshold: about 2.77 V typical (data sheet table 37-22, 34 mV a step), above the 2.7 V
/// that flash at one wait state and 48 MHz needs, with hysteresis below the 3.3 V rail's ripple.
const BROWN_OUT_LEVEL: u8 = 37;

/// Reset the chip when its supply falls too low to run right.
///
/// The detector is first turned on without an action: if it sees a low supply already, resetting
/// would go round in circles, and two resets within half a second strand the board in its
/// bootloader.
pub(super) fn watch_supply(sysctrl: &pac::Sysctrl) {
    /// The detector runs from a 32 kHz clock: some cycles of it, many times over.
    const LIMIT_US: u64 = 2_000;
    let write = |enable: bool, reset: bool| {
        sysctrl.bod33().write(|w| {
            // SAFETY: the level is a six-bit number.
            unsafe { w.level().bits(BROWN_OUT_LEVEL) };
            if reset {
                w.action().reset();
            }
            w.hyst().set_bit().enable().bit(enable)
        });
        within(LIMIT_US, || sysctrl.pclksr().read().b33srdy().bit_is_set())
    };
    let ready = write(false, false)
        && write(true, false)
        && within(LIMIT_US, || sysctrl.pclksr().read().bod33rdy().bit_is_set());
    if ready && sysctrl.pclksr().read().bod33det().bit_is_clear() {
        // A detector that is slow to restart is still on.
        let _ = write(false, false) && write(true, true);
    }
}
