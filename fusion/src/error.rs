//! The error for a wrong configuration, and the checks that return it.

use core::fmt;

/// A configuration that cannot work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The named parameter is not finite or outside its range.
    OutOfRange(&'static str),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange(name) => write!(f, "{name} is out of range"),
        }
    }
}

impl core::error::Error for ConfigError {}

/// An error with the parameter's name unless `is_right`.
#[inline(always)]
pub(crate) fn require(is_right: bool, name: &'static str) -> Result<(), ConfigError> {
    is_right.then_some(()).ok_or(ConfigError::OutOfRange(name))
}

/// `value` is finite and above 0.
#[inline(always)]
pub(crate) fn positive(value: f32, name: &'static str) -> Result<(), ConfigError> {
    require(value > 0.0 && value.is_finite(), name)
}

/// `value` is in `low..=high`.
#[inline(always)]
pub(crate) fn in_range(
    value: f32,
    low: f32,
    high: f32,
    name: &'static str,
) -> Result<(), ConfigError> {
    require((low..=high).contains(&value), name)
}
