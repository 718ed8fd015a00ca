//! Seeed XIAO M0: an SAMD21G18A whose port is only in part led out, with UF2's bootloader.

use atsamd_hal::gpio::{D, F, PA07, PA08, PA09, PA10, PA11, PA17};
use tvc_nano::bringup::words::UF2;

use crate::samd21::wiring::Led;
use crate::samd21::{Output, Pin, SensorBus, Wiring, bus_interrupt};

/// The sensor on D4 and D5, the servos on D2 and D3, the probe pin D8; the yellow LED lights while
/// its pin is low.
pub(crate) const WIRING: Wiring = Wiring {
    bus: SensorBus::of::<PA08, PA09, D>(),
    servos: [Output::of::<PA10, F>(2), Output::of::<PA11, F>(3)],
    probe: Pin::of::<PA07>(),
    led: Some(Led { pin: Pin::of::<PA17>(), is_inverted: true }),
    held_low: &[],
    usb_vendor: 0x2886,
    usb_product: 0x802F,
    bootloader_magic: &[UF2],
};

bus_interrupt!(SERCOM2);
