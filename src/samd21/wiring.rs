//! What a board connects to the chip, as its file states it in the HAL's types: the compiler
//! refuses pins that the chip does not have, and pads that are not those of one SERCOM.

use atsamd_hal::gpio::{self, Alternate, AlternateConfig, DynAlternate, PinId};
use atsamd_hal::sercom::{IsI2cPad, IsPad, Pad0, Pad1, Sercom};
use tvc_nano::Axis;

use super::frame::CHANNELS;
use super::pin::Pin;

/// What a board connects to the chip.
pub(crate) struct Wiring {
    /// The sensor's bus.
    pub(crate) bus: SensorBus,
    /// The servos' signals, by axis. `tvc bringup` times the first one's at the second one's pin,
    /// to which a jumper leads it, while one axis is steered.
    pub(crate) servos: [Output; Axis::COUNT],
    /// High while a step runs.
    pub(crate) probe: Pin,
    /// The light that shows the state, if there is one.
    pub(crate) led: Option<Led>,
    /// What is held low for good.
    pub(crate) held_low: &'static [Pin],
    /// USB's numbers: the board's own, so that the host's drivers and rules for it apply.
    pub(crate) usb_vendor: u16,
    /// See `usb_vendor`.
    pub(crate) usb_product: u16,
    /// What the board's bootloader, or each of those that it may have, looks for in RAM.
    pub(crate) bootloader_magic: &'static [u32],
}

/// The SERCOM that is the sensor bus's master, and its lines.
#[derive(Clone, Copy)]
pub(crate) struct SensorBus {
    pub(crate) sercom: usize,
    pub(crate) sda: Pin,
    pub(crate) scl: Pin,
    pub(crate) function: DynAlternate,
}

impl SensorBus {
    /// On these pins, whose function leads both to one SERCOM.
    pub(crate) const fn of<Sda, Scl, Function>() -> Self
    where
        Sda: PinId,
        Scl: PinId,
        Function: AlternateConfig,
        gpio::Pin<Sda, Alternate<Function>>: IsI2cPad<PadNum = Pad0>,
        gpio::Pin<Scl, Alternate<Function>>:
            IsI2cPad<PadNum = Pad1, Sercom = SercomOf<Sda, Function>>,
    {
        Self {
            sercom: SercomOf::<Sda, Function>::NUM,
            sda: Pin::of::<Sda>(),
            scl: Pin::of::<Scl>(),
            function: Function::DYN,
        }
    }
}

/// The SERCOM to which a function leads a pin.
type SercomOf<Id, Function> = <gpio::Pin<Id, Alternate<Function>> as IsPad>::Sercom;

/// A pin to which the servos' timer, TCC0, leads one of its outputs.
#[derive(Clone, Copy)]
pub(crate) struct Output {
    pub(crate) pin: Pin,
    pub(crate) function: DynAlternate,
    /// The compare channel that the output follows.
    pub(crate) channel: usize,
}

impl Output {
    /// Output `number` of the timer, which this function leads to the pin (data sheet, table 7-1).
    pub(crate) const fn of<Id: PinId, Function: AlternateConfig>(number: usize) -> Self {
        Self { pin: Pin::of::<Id>(), function: Function::DYN, channel: number % CHANNELS }
    }
}

/// A light.
#[derive(Clone, Copy)]
pub(crate) struct Led {
    /// Its pin.
    pub(crate) pin: Pin,
    /// It is lit while the pin is low.
    pub(crate) is_inverted: bool,
}

impl Led {
    /// Turns it on or off.
    pub(crate) fn set(self, lit: bool) {
        if lit == self.is_inverted {
            self.pin.low();
        } else {
            self.pin.high();
        }
    }
}
