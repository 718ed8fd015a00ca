//! The states of the flight as stations know them: as modes, of which they can choose none.
//! HEARTBEAT, CURRENT_MODE and AVAILABLE_MODES carry the same numbers.

use heapless::Vec;
use mavlink::dialects::common::{AVAILABLE_MODES_DATA, CURRENT_MODE_DATA, MavModeProperty};

use super::queue::Priority;
use super::sending::line;
use super::{OVERHEAD, Telemetry};
use crate::failsafe::StateCode;

/// Longest name: the field ends with a zero.
const NAME: usize = 34;
const FRAME: usize = OVERHEAD + AVAILABLE_MODES_DATA::ENCODED_LEN;

impl Telemetry {
    /// CURRENT_MODE: the state, as HEARTBEAT has it.
    pub(super) fn current_mode(&mut self, code: u32) {
        self.send_payload::<CURRENT_MODE_DATA>(Priority::Event, &code.to_le_bytes());
    }

    /// Notes what to tell of: the mode with this number, from 1, or all of them for 0. Says whether
    /// there is one.
    pub(super) fn order_modes(&mut self, number: f32) -> bool {
        self.modes = match number as usize {
            0 => (0, StateCode::COUNT),
            number @ 1..=StateCode::COUNT => (number - 1, number),
            _ => return false,
        };
        true
    }

    /// Send the next mode that the host has asked for, when there is room for it.
    pub(super) fn continue_modes(&mut self) {
        let (next, end) = self.modes;
        if next == end || !self.queue.has_room(FRAME, Priority::Stream) {
            return;
        }
        self.modes = (next + 1, end);
        if let Some(mode) = StateCode::all().nth(next) {
            let properties = MavModeProperty::MAV_MODE_PROPERTY_NOT_USER_SELECTABLE.bits();
            let name = mode_name(mode);
            let mut payload: Vec<u8, { AVAILABLE_MODES_DATA::ENCODED_LEN }> = Vec::new();
            for field in [
                &mode.number().to_le_bytes()[..],
                &properties.to_le_bytes(),
                // How many there are, which one this is, and that it is no standard one.
                &[StateCode::COUNT as u8, next as u8 + 1, 0],
                name.get(..NAME).unwrap_or_default(),
            ] {
                // There is room for all of them.
                let _ = payload.extend_from_slice(field);
            }
            self.send_payload::<AVAILABLE_MODES_DATA>(Priority::Stream, &payload);
        }
    }
}

/// The words of the state, short enough for a mode.
fn mode_name(mode: StateCode) -> [u8; 50] {
    match mode {
        StateCode::Latched(latch) => line(format_args!("{latch}")),
        _ => line(format_args!("{mode}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_has_a_name_of_its_own_that_fits() {
        let mut names: std::vec::Vec<_> = StateCode::all().map(mode_name).collect();
        assert!(names.iter().all(|name| name[0] != 0 && name[NAME] == 0));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), StateCode::COUNT);
    }
}
