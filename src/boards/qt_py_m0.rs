//! Adafruit QT Py M0: an SAMD21E18A, which is the G without port B and SERCOM4 and 5, with UF2's
//! bootloader. Its only light is addressed bit by bit and stays dark.

use atsamd_hal::gpio::{C, E, PA04, PA05, PA07, PA16, PA17};
use tvc_nano::bringup::words::UF2;

use crate::samd21::{Output, Pin, SensorBus, Wiring, bus_interrupt};

/// The sensor on SDA and SCL, which the STEMMA QT connector has too; the servos on A2 and A3, the
/// probe pin RX.
pub(crate) const WIRING: Wiring = Wiring {
    bus: SensorBus::of::<PA16, PA17, C>(),
    servos: [Output::of::<PA04, E>(0), Output::of::<PA05, E>(1)],
    probe: Pin::of::<PA07>(),
    led: None,
    held_low: &[],
    usb_vendor: 0x239A,
    usb_product: 0x80CB,
    bootloader_magic: &[UF2],
};

bus_interrupt!(SERCOM1);
