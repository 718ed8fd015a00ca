//! The magnetometer's conversions.

use samd21::board::Ticks;

/// The magnetometer's conversions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Magnetometer {
    /// How old the field is that a conversion gives. While a recording plays, it is of no effect.
    pub age: Ticks,
    /// What the conversions are worth.
    pub health: MagnetometerHealth,
}

/// What the magnetometer's conversions are worth; its id and its self-test are right in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MagnetometerHealth {
    /// They give the field.
    #[default]
    Ok,
    /// They give zero on each axis.
    Dead,
    /// They give what the first one after power-on gave.
    Stuck,
}
