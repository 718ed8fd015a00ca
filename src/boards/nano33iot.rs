//! Arduino Nano 33 IoT. It has no crystal.

use atsamd_hal::gpio::{D, F, PA07, PA08, PA17, PB08, PB09, PB10, PB11};
use tvc_nano::bringup::words::{ARDUINO, UF2};

use crate::samd21::wiring::Led;
use crate::samd21::{Output, Pin, SensorBus, Wiring, bus_interrupt};

/// The sensor on A4 and A5, the servos on D3 and D2, the probe pin D4, the orange LED of D13. The
/// radio module, whose RESETN is PA08, stays off.
pub(crate) const WIRING: Wiring = Wiring {
    bus: SensorBus::of::<PB08, PB09, D>(),
    servos: [Output::of::<PB11, F>(5), Output::of::<PB10, F>(4)],
    probe: Pin::of::<PA07>(),
    led: Some(Led { pin: Pin::of::<PA17>(), is_inverted: false }),
    held_low: &[Pin::of::<PA08>()],
    usb_vendor: 0x2341,
    usb_product: 0x8057,
    bootloader_magic: &[ARDUINO, UF2],
};

bus_interrupt!(SERCOM4);
