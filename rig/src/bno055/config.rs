//! What is fixed about one sensor and its place on the bus.

use super::bus::BusTiming;
use crate::inertial::{ImuErrors, Magnetometer};
use samd21::board::Ticks;

/// What is fixed about one sensor and its place on the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Seed of everything random about it.
    pub seed: u64,
    /// 7-bit address: 0x28 or 0x29.
    pub address: u8,
    /// Imperfections of the sensors.
    pub errors: ImuErrors,
    /// How long it holds the clock line.
    pub bus: BusTiming,
    /// Largest deviation of the chip's clock, relative; drawn uniformly.
    pub clock_error: f64,
    /// How long a write takes to act: until then its register reads as before. PAGE_ID acts at
    /// once, since it says which register the bus means.
    pub late_registers: Ticks,
    /// A write is lost, all bytes of it, when its first byte comes sooner than this after the last
    /// byte of the write before.
    pub lost_within: Ticks,
    /// Refreshes of each sensor's data registers in the modes without fusion; `None` refreshes all
    /// of them together at 100 Hz.
    pub refresh: Option<RefreshRates>,
    /// The magnetometer.
    pub magnetometer: Magnetometer,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            address: 0x28,
            errors: ImuErrors::default(),
            bus: BusTiming::default(),
            clock_error: 0.01,
            late_registers: Ticks::ZERO,
            lost_within: Ticks::ZERO,
            refresh: None,
            magnetometer: Magnetometer::default(),
        }
    }
}

/// Refreshes a second of each sensor's data registers, by the chip's own clock and each with a
/// phase of its own; the data sheet gives none for the modes without fusion.
///
/// Every refresh of the magnetometer is a conversion of its own, whatever MAG_CONFIG says. Without
/// effect in the fusion modes, whose rates are known (data sheet table 3-14), and while a recording
/// plays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefreshRates {
    /// Accelerometer, Hz, above 0.
    pub acc_hz: f64,
    /// Gyroscope, Hz, above 0.
    pub gyr_hz: f64,
    /// Magnetometer, Hz, above 0.
    pub mag_hz: f64,
}
