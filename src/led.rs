//! What the LED shows: the state, from across the room.

use tvc_imu::Micros;

use crate::failsafe::StateKind;

/// Whether the LED is lit: always while armed or active, slowly blinking in standby, fast in a
/// fault, in short flashes before that.
pub fn is_lit(state: StateKind, now: Micros) -> bool {
    // Units of 8 ms.
    let phase = (now.0 >> 13) as u32 % 128;
    match state {
        StateKind::Armed | StateKind::Active => true,
        StateKind::Standby => phase < 64,
        StateKind::Failsafe | StateKind::Latched => phase % 16 < 8,
        StateKind::Boot | StateKind::SelfTest => phase < 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Milliseconds lit and changes in the pattern's 1,048 ms.
    fn pattern(state: StateKind) -> (usize, usize) {
        let lit: std::vec::Vec<_> =
            (0..1_048).map(|ms| is_lit(state, Micros(ms * 1_000))).collect();
        let changes = lit.windows(2).filter(|pair| pair[0] != pair[1]).count();
        (lit.iter().filter(|lit| **lit).count(), changes)
    }

    #[test]
    fn each_kind_of_state_has_its_pattern() {
        assert_eq!(pattern(StateKind::Armed), (1_048, 0));
        assert_eq!(pattern(StateKind::Active), (1_048, 0));
        let (lit, changes) = pattern(StateKind::Standby);
        assert!(lit.abs_diff(524) <= 1 && changes == 1);
        for state in [StateKind::Failsafe, StateKind::Latched] {
            let (lit, changes) = pattern(state);
            assert!(lit.abs_diff(524) <= 8 && changes == 15);
        }
        for state in [StateKind::Boot, StateKind::SelfTest] {
            let (lit, changes) = pattern(state);
            assert!(lit.abs_diff(65) <= 1 && changes == 1);
        }
    }
}
