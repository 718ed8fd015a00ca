//! The firmware's states and reasons as they come over the link: HEARTBEAT's `custom_mode` is a
//! [`StateCode`].

use tvc_nano::failsafe::{ReasonKind, StateCode, StateKind};

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

#[cfg(test)]
mod tests {
    use super::*;

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
}
