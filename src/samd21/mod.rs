//! The chip: clocks, sensor bus, servo frame, USB, flash, watchdog, and what is left after a crash.
//! The only place that names a register. Which pins a board leads to it, [`wiring`] says.
//!
//! # Interrupts
//! | priority | interrupt | does |
//! |---|---|---|
//! | 0 (highest) | SysTick, 1 kHz | counts time; resets a program that hangs, between two pulses |
//! | 0 | WDT | early warning: the servo to neutral, unless SysTick's own handler hangs. Reads no clock |
//! | 1 | TCC0 | the tick: starts the armed burst, wakes the main loop |
//! | 1 | SERCOM of the sensor's bus | the sensor bus, a byte at a time; wakes the main loop behind the last |
//! | 3 | USB | masks itself; wakes the main loop |
//!
//! Nothing above the main loop takes more than some 10 us, so a tick's burst starts within a few
//! microseconds of its compare match. The main loop holds off those of priority 1 while it has hold
//! of what they share, for some microseconds. All are held off for a few instructions at most: the
//! watchdog alone ends a program that hangs so, and may cut a pulse.
//!
//! # No endless waits
//! Every wait for hardware is bounded but one, at start-up before the first pulse and before the
//! watchdog runs: the HAL's for the oscillators (see [`clocks`]).
//!
//! # No panics
//! What cannot go on stops with a reason ([`crash::stop`]): the servo goes to neutral, the chip is
//! reset, and the next run tells why. No call of a panic is linked into the image, which tests hold
//! (`tests/image/symbols.rs`): what could divide by zero, index out of bounds or unwrap nothing is
//! written so that it cannot.

pub(crate) mod bringup;
pub(crate) mod clocks;
pub(crate) mod crash;
pub(crate) mod dfll;
pub(crate) mod engine;
pub(crate) mod flash;
pub(crate) mod frame;
pub(crate) mod i2c;
pub(crate) mod image_check;
pub(crate) mod interrupts;
mod last_frames;
pub(crate) mod log;
mod pin;
pub(crate) mod registers;
pub(crate) mod stack;
pub(crate) mod time;
#[cfg(feature = "embedded-hal")]
pub(crate) mod traits;
pub(crate) mod usb;
mod wake;
pub(crate) mod watchdog;
pub(crate) mod wiring;

pub(crate) use i2c::bus_interrupt;
pub(crate) use pin::Pin;
pub(crate) use wiring::{Output, SensorBus, Wiring};
