//! Misuse that the real chip silently ignores, noted so that tests can fail on it.

use crate::board::Ticks;
use std::fmt;

/// Violations kept; later ones are only counted.
const KEPT: usize = 64;

/// A firmware error that the chip answers by silently doing nothing, or the wrong thing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// When.
    pub at: Ticks,
    /// In which peripheral.
    pub peripheral: &'static str,
    /// What was done.
    pub what: &'static str,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.at, self.peripheral, self.what)
    }
}

/// The first violations since power-on.
#[derive(Clone, Debug, Default)]
pub struct Violations {
    /// The first 64.
    pub first: Vec<Violation>,
    /// How many there were.
    pub count: u64,
}

impl Violations {
    /// Notes one.
    pub(crate) fn note(&mut self, at: Ticks, peripheral: &'static str, what: &'static str) {
        self.count += 1;
        if self.first.len() < KEPT {
            self.first.push(Violation { at, peripheral, what });
        }
    }
}
