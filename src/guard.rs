//! Guards the flight's memory against flipped bits.
//!
//! The flight consists of settings, which only orders change, and a state, which every step
//! changes. The guard keeps a checksum of each. It compares the checksum before the value is
//! changed or used, and computes it anew when the change is over.
//!
//! | what | its checksum is compared |
//! |---|---|
//! | state | before a step, before a packet of the host, before parameters are loaded |
//! | settings | behind the write of a step's pulses and before their edge, before a packet, before a save |

use crate::flight::Flight;

/// Checksums of a flight as it was left.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guard {
    /// `None` while it is being changed.
    state: Option<u32>,
    settings: Option<u32>,
}

/// A value differs from what it was left as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Changed;

/// Makes a number that changes with any bit of the memory that a value lies in.
pub trait Sum {
    /// The number.
    fn sum<T>(&self, value: &T) -> u32;
}

impl Guard {
    /// Before the state is changed.
    ///
    /// # Errors
    /// It has changed by itself.
    pub fn open_state(&mut self, flight: &Flight, sum: &impl Sum) -> Result<(), Changed> {
        let left = self.state.take();
        is_as_left(left, || sum.sum(flight.state_in_memory()))
    }

    /// Before the settings are used.
    ///
    /// # Errors
    /// They have changed by themselves.
    pub fn check_settings(&self, flight: &Flight, sum: &impl Sum) -> Result<(), Changed> {
        is_as_left(self.settings, || sum.sum(flight.settings_in_memory()))
    }

    /// Before the settings are changed, behind [a check](Self::check_settings).
    pub fn open_settings(&mut self) {
        self.settings = None;
    }

    /// Nothing changes until the next call of `open_state` or `open_settings`.
    pub fn close(&mut self, flight: &Flight, sum: &impl Sum) {
        self.state.get_or_insert_with(|| sum.sum(flight.state_in_memory()));
        self.settings.get_or_insert_with(|| sum.sum(flight.settings_in_memory()));
    }
}

fn is_as_left(left: Option<u32>, sum: impl FnOnce() -> u32) -> Result<(), Changed> {
    match left {
        Some(left) if left != sum() => Err(Changed),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failsafe::BootReport;
    use crate::params::Params;
    use core::cell::Cell;

    /// The checksum of everything.
    struct Told(Cell<u32>);

    impl Sum for Told {
        fn sum<T>(&self, _value: &T) -> u32 {
            self.0.get()
        }
    }

    #[test]
    fn what_changes_between_close_and_open_is_noticed_and_what_changes_while_open_is_not() {
        let flight = Flight::new(Params::default(), BootReport::default()).unwrap();
        let (mut guard, sum) = (Guard::default(), Told(Cell::new(1)));
        assert_eq!(guard.open_state(&flight, &sum), Ok(()), "nothing known");
        guard.close(&flight, &sum);
        assert_eq!(guard.check_settings(&flight, &sum), Ok(()));
        assert_eq!(guard.open_state(&flight, &sum), Ok(()));
        guard.open_settings();
        sum.0.set(2);
        assert_eq!(guard.check_settings(&flight, &sum), Ok(()));
        guard.close(&flight, &sum);
        sum.0.set(3);
        assert_eq!(guard.check_settings(&flight, &sum), Err(Changed));
        assert_eq!(guard.open_state(&flight, &sum), Err(Changed));
        // From here on it is being changed.
        assert_eq!(guard.open_state(&flight, &sum), Ok(()));
    }
}
