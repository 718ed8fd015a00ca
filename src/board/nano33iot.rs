//! Arduino Nano 33 IoT: which pin and which peripheral does what. Another SAMD21 board is another
//! file like this one.

use atsamd_hal::clock::{GClock, GenericClockController, Tcc0Tcc1Clock};
use atsamd_hal::pac;
use tvc_nano::Axis;
use tvc_nano::bringup::words;

use super::pin::{Function, Pin};

/// A4: the sensor's SDA, SERCOM4 pad 0.
pub(super) const SDA: Pin = Pin::b(8);
/// A5: the sensor's SCL, SERCOM4 pad 1.
pub(super) const SCL: Pin = Pin::b(9);
/// SERCOM-ALT on both.
pub(super) const I2C_FUNCTION: Function = Function::D;

/// A compare channel of TCC0.
#[derive(Clone, Copy)]
pub(super) enum Channel {
    Cc0,
    Cc1,
    Cc2,
    Cc3,
}

/// The servos' signals, by axis. D3: output 5 of TCC0, which follows compare channel 1. D2: output
/// 4, which follows compare channel 0.
pub(super) const SERVOS: [Pin; Axis::COUNT] = [Pin::b(11), Pin::b(10)];
/// TCC on them.
pub(super) const SERVO_FUNCTION: Function = Function::F;
/// The compare channels whose outputs the servos are on.
pub(super) const SERVO_CHANNELS: [Channel; Axis::COUNT] = [Channel::Cc1, Channel::Cc0];
/// Compare channel without a pin, for the last tick of a frame.
pub(super) const LAST_TICK_CHANNEL: Channel = Channel::Cc3;
/// The same for the ticks before it, one after the other.
pub(super) const EARLY_TICK_CHANNEL: Channel = Channel::Cc2;

/// D2 again, while one axis is steered: `tvc bringup` times the servo's signal here, which a jumper
/// leads to it.
pub(super) const FEEDBACK: Pin = Pin::b(10);
/// D4: high while a step runs.
pub(super) const PROBE: Pin = Pin::a(7);
/// D13: the orange LED.
pub(super) const LED: Pin = Pin::a(17);
/// RESETN of the radio module, which stays off.
pub(super) const RADIO_RESET: Pin = Pin::a(8);

/// USB's D- and D+, the chip's only pair.
pub(super) const USB_PADS: [Pin; 2] = [Pin::a(24), Pin::a(25)];
/// USB on them.
pub(super) const USB_FUNCTION: Function = Function::G;

/// USB numbers: the board's own, so that the host's drivers and rules for it apply.
pub(super) const USB_VENDOR: u16 = 0x2341;
/// See [`USB_VENDOR`].
pub(super) const USB_PRODUCT: u16 = 0x8057;

/// The word of RAM in which the bootloader looks for a second tap, and what it wants to find there.
pub(super) const BOOTLOADER_WORD: *mut u32 = 0x2000_7FFC as *mut u32;
/// See [`BOOTLOADER_WORD`]: Arduino's bootloader, and UF2's.
pub(super) const BOOTLOADER_MAGIC: [u32; 2] = [words::ARDUINO, words::UF2];
/// Where a bootloader is.
pub(super) const BOOTLOADER_FLASH: core::ops::Range<usize> = 0..words::BOOTLOADER_END as usize;

/// Interrupts of the servo frame and of the sensor bus.
pub(super) const FRAME_INTERRUPT: pac::Interrupt = pac::Interrupt::TCC0;
/// See [`FRAME_INTERRUPT`].
pub(super) const I2C_INTERRUPT: pac::Interrupt = pac::Interrupt::SERCOM4;

/// The sensor bus.
pub(super) fn i2c_registers() -> &'static pac::sercom0::I2cm {
    // SAFETY: the block is always mapped; only `i2c` uses it.
    unsafe { (*pac::Sercom4::ptr()).i2cm() }
}

/// The servo timer.
pub(super) fn frame_registers() -> &'static pac::tcc0::RegisterBlock {
    // SAFETY: the block is always mapped; only `frame` uses it.
    unsafe { &*pac::Tcc0::ptr() }
}

/// Switch on the bus clocks of both.
pub(super) fn enable_bus_clocks(pm: &mut pac::Pm) {
    pm.apbcmask()
        .modify(|_, w| w.sercom4_().set_bit().tcc0_().set_bit());
}

/// Clock of the servo timer.
pub(super) type FrameClock = Tcc0Tcc1Clock;

/// Clock both from the generator `main`; `None` if either has been clocked before.
pub(super) fn clock(controller: &mut GenericClockController, main: &GClock) -> Option<FrameClock> {
    controller.sercom4_core(main)?;
    controller.tcc0_tcc1(main)
}

/// Clock the servo timer once more, from generator 0, should a register have lost that.
pub(super) fn clock_frame_again() {
    // SAFETY: as start-up has set it.
    unsafe {
        let mut chip = pac::Peripherals::steal();
        enable_bus_clocks(&mut chip.pm);
        chip.gclk
            .clkctrl()
            .write(|w| w.id().tcc0_tcc1().r#gen().gclk0().clken().set_bit());
    }
}

/// Makes a function the handler of [`FRAME_INTERRUPT`].
macro_rules! on_frame_interrupt {
    ($handler:path) => {
        const _: () = {
            use atsamd_hal::pac::interrupt;

            #[interrupt]
            fn TCC0() {
                $handler();
            }
        };
    };
}

/// Makes a function the handler of [`I2C_INTERRUPT`].
macro_rules! on_i2c_interrupt {
    ($handler:path) => {
        const _: () = {
            use atsamd_hal::pac::interrupt;

            #[interrupt]
            fn SERCOM4() {
                $handler();
            }
        };
    };
}

pub(super) use {on_frame_interrupt, on_i2c_interrupt};
