//! Clocks and supply supervision.
//!
//! No crystal is needed. The DFLL makes 48 MHz, disciplined by USB's start-of-frame where
//! there is a host. Where there is none, it keeps what a host disciplined it to last, or starts
//! with what the parameter `CLK_FINE` has kept from there; without either it is off by up to 3 %.
//!
//! The HAL sets it up and waits for its oscillators without a limit. That wait comes before the
//! first pulse and before the watchdog runs. A chip whose oscillator does not start could make
//! neither pulses nor USB anyway.

use core::ops::RangeInclusive;

use atsamd_hal::clock::{ClockGenId, ClockSource, GenericClockController, Tcc0Tcc1Clock, UsbClock};
use atsamd_hal::pac;

use super::i2c;
use super::time::{soon, within};

/// Proof that the clocks run which USB's controller and the frame ask for.
pub(crate) struct Clocks {
    pub(crate) usb: UsbClock,
    pub(crate) frame: Tcc0Tcc1Clock,
}

/// 48 MHz for the CPU, USB, the servo timer and the sensor bus; 1,024 Hz for the watchdog. `None`
/// if one of them has been set up before.
pub(crate) fn start(
    gclk: pac::Gclk,
    pm: &mut pac::Pm,
    sysctrl: &mut pac::Sysctrl,
    nvmctrl: &mut pac::Nvmctrl,
) -> Option<Clocks> {
    let mut controller = GenericClockController::with_internal_32kosc(gclk, pm, sysctrl, nvmctrl);
    let main = controller.gclk0();
    // The watchdog's own oscillator runs whatever becomes of the others: 32,768 Hz / 32. One
    // flipped bit of the generator's number gives a generator that does not run: with 0 or 2 the
    // watchdog would reset the chip at once.
    let slow = controller.configure_gclk_divider_and_source(
        ClockGenId::Gclk7,
        32,
        ClockSource::Osculp32k,
        false,
    )?;
    controller.wdt(&slow)?;
    let clocks = Clocks { usb: controller.usb(&main)?, frame: controller.tcc0_tcc1(&main)? };
    clock_bus();
    Some(clocks)
}

/// Clock the sensor bus's SERCOM, whose number the HAL has in names alone, from generator 0.
fn clock_bus() {
    /// CLKCTRL.CLKEN.
    const ENABLED: u16 = 1 << 14;
    // SAFETY: start-up alone writes it here.
    unsafe {
        (*pac::Gclk::ptr()).clkctrl().write(|w| w.bits(ENABLED | u16::from(i2c::CLOCK_ID)));
    }
}

/// Switch on the bus clocks of the servo timer and of the sensor bus's SERCOM.
pub(crate) fn enable_buses(pm: &pac::Pm) {
    // SAFETY: masks of peripherals that the chip has.
    pm.apbcmask().modify(|r, w| unsafe { w.bits(r.bits() | i2c::BUS_CLOCK).tcc0_().set_bit() });
}

/// Clock the servo timer once more, from generator 0, should a register have lost that.
pub(crate) fn clock_frame_again() {
    // SAFETY: as start-up has set it.
    unsafe {
        let chip = pac::Peripherals::steal();
        enable_buses(&chip.pm);
        chip.gclk.clkctrl().write(|w| w.id().tcc0_tcc1().r#gen().gclk0().clken().set_bit());
    }
}

/// What start-of-frame has disciplined the DFLL to: its FINE, `None` while it is not locked.
pub(crate) fn locked_fine() -> Option<u16> {
    let sysctrl = sysctrl();
    if sysctrl.pclksr().read().dflllckf().bit_is_clear() {
        return None;
    }
    sysctrl.dfllsync().write(|w| w.readreq().set_bit());
    soon(|| sysctrl.pclksr().read().dfllrdy().bit_is_set())
        .then(|| sysctrl.dfllval().read().fine().bits())
}

/// DFLLCTRL as the HAL sets it: enabled, in closed loop (MODE), tuned by start-of-frame (USBCRM),
/// without chill cycles (CCDIS) and coarse lock (BPLCKC).
pub(crate) const DFLL_CONTROL: u16 = 1 << 1 | 1 << 2 | 1 << 5 | 1 << 8 | 1 << 10;
/// DFLLCTRL.MODE.
const DFLL_CLOSED: u16 = 1 << 2;

/// The factory's calibration of the DFLL: the upper word of the two that hold it, and where COARSE
/// begins there (data sheet table 10-5, bits 58 to 63).
const CALIBRATION: *const u32 = 0x0080_6024 as *const u32;
const COARSE_AT: u32 = 26;
/// The HAL takes this COARSE if all bits of the calibration are set, which a chip without one has.
const COARSE_WITHOUT: u8 = 0x1F;

/// COARSE as the factory has measured it.
pub(crate) fn calibrated_coarse() -> u8 {
    // SAFETY: a row of calibration that is always mapped.
    match (unsafe { CALIBRATION.read_volatile() } >> COARSE_AT) as u8 {
        0x3F => COARSE_WITHOUT,
        coarse => coarse,
    }
}

/// FINE that 48 MHz can ask for: the middle is up to 3 % off, which is some 130 steps.
const FINES: RangeInclusive<u16> = 255..=767;

/// Sets the DFLL to the factory's COARSE and this FINE, in open loop, since the loop would write
/// them. Another FINE than 48 MHz can ask for is damage and changes nothing.
pub(crate) fn set_fine(fine: u16) {
    if !FINES.contains(&fine) {
        return;
    }
    let sysctrl = sysctrl();
    let ready = || soon(|| sysctrl.pclksr().read().dfllrdy().bit_is_set());
    // SAFETY: bits that exist.
    let control = |bits| sysctrl.dfllctrl().write(|w| unsafe { w.bits(bits) });
    control(DFLL_CONTROL & !DFLL_CLOSED);
    let _ = ready();
    let coarse = calibrated_coarse();
    // SAFETY: six and ten bits, as the row of calibration and the parameter's range have them.
    sysctrl.dfllval().write(|w| unsafe { w.coarse().bits(coarse).fine().bits(fine) });
    let _ = ready();
    control(DFLL_CONTROL);
    let _ = ready();
}

/// BOD33 threshold: the supply's fall below some 2.77 V resets the chip, above the 2.7 V that flash
/// at one wait state and 48 MHz needs. A step is 34 mV, and the data sheet's table 37-22 states the
/// rising threshold, which the hysteresis puts some 70 mV above the falling one: two steps more
/// than the table has at 2.77 V.
const BROWN_OUT_LEVEL: u8 = 39;

/// Reset the chip when its supply falls too low to run right.
///
/// The detector is first turned on without an action: if it sees a low supply already, resetting
/// would go round in circles, and two resets within half a second strand the board in its
/// bootloader.
pub(crate) fn watch_supply(sysctrl: &pac::Sysctrl) {
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

/// Oscillators and the brown-out detector, once start-up is over.
pub(crate) fn sysctrl() -> &'static pac::sysctrl::RegisterBlock {
    // SAFETY: always mapped; only this module and its check touch it then.
    unsafe { &*pac::Sysctrl::ptr() }
}
