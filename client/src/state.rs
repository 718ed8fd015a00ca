//! The firmware's states and reasons as they come over the link: HEARTBEAT's `custom_mode` is a
//! [`StateCode`].

use mavlink::dialects::common::MavMessage;
use tvc_nano::failsafe::{ReasonKind, StateCode, StateKind};

use crate::text;

/// The state in a `custom_mode`; `None` for one that this version of the firmware's library does
/// not have.
pub fn state_of(custom_mode: u32) -> Option<StateKind> {
    StateKind::try_from(custom_mode as u8).ok()
}

/// The reason of the failsafe in a `custom_mode`; `None` in any other state.
pub fn reason_of(custom_mode: u32) -> Option<ReasonKind> {
    match StateCode::try_from(custom_mode) {
        Ok(StateCode::Failsafe(reason)) => Some(reason),
        _ => None,
    }
}

/// The state in a `custom_mode` in words.
pub fn state_name(custom_mode: u32) -> String {
    state_of(custom_mode)
        .map_or_else(|| format!("unknown ({})", custom_mode as u8), |state| state.to_string())
}

/// Armed, in control or in failsafe: only an order to disarm leads back to standby.
pub fn is_in_operation(state: StateKind) -> bool {
    state.is_armed() || state == StateKind::Failsafe
}

/// The state and the vehicle's words about it.
#[derive(Clone, Debug, Default)]
pub struct StateTracker {
    code: Option<u32>,
    reason: String,
    /// The next text explains the newest state.
    explains: bool,
}

impl StateTracker {
    /// Takes in a message of the vehicle: a new state is followed by a text that explains it.
    pub fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(beat) => {
                self.explains = self.code.replace(beat.custom_mode) != Some(beat.custom_mode);
            }
            MavMessage::STATUSTEXT(words) if core::mem::take(&mut self.explains) => {
                text(&words.text).clone_into(&mut self.reason);
            }
            _ => {}
        }
    }

    /// The vehicle's words about its state; empty before it said any.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// The state and the kind of reason for it; `None` before the first heartbeat, or for one that
    /// this version of the firmware's library does not have.
    pub fn code(&self) -> Option<StateCode> {
        self.code.and_then(|code| StateCode::try_from(code).ok())
    }

    /// The state; `None` before the first heartbeat, or for an unknown one.
    pub fn state(&self) -> Option<StateKind> {
        self.code.and_then(state_of)
    }

    /// The state in words.
    pub fn name(&self) -> String {
        state_name(self.code.unwrap_or(u32::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{HEARTBEAT_DATA, STATUSTEXT_DATA};

    #[test]
    fn states_and_reasons_are_those_of_the_firmware() {
        let failsafe = StateCode::Failsafe(ReasonKind::HostSilent).number();
        assert_eq!(state_of(failsafe), Some(StateKind::Failsafe));
        assert_eq!(reason_of(failsafe), Some(ReasonKind::HostSilent));
        assert_eq!(reason_of(StateCode::Armed.number()), None);
        assert_eq!(state_name(StateCode::SelfTest(None).number()), "self-test");
        assert_eq!(state_of(200), None);
        assert_eq!(state_name(200), "unknown (200)");
    }

    #[test]
    fn the_text_behind_a_new_state_is_its_reason() {
        let mut tracker = StateTracker::default();
        assert_eq!(tracker.state(), None);
        assert_eq!(tracker.name(), "unknown (255)");
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: StateCode::Failsafe(ReasonKind::Tilt).number(),
            ..HEARTBEAT_DATA::default()
        });
        for message in [
            &beat,
            &said("failsafe: tilt beyond 60 deg"),
            &said("arm refused: in failsafe"),
            &beat,
            &said("something else"),
        ] {
            tracker.take(message);
        }
        assert_eq!(tracker.state(), Some(StateKind::Failsafe));
        assert_eq!(tracker.reason(), "failsafe: tilt beyond 60 deg");
    }

    fn said(words: &str) -> MavMessage {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA { text: words.into(), ..STATUSTEXT_DATA::default() })
    }
}
