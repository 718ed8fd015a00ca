//! How often the messages of a step are sent: every step, until the host asks for less (MAV_CMD_SET_MESSAGE_INTERVAL).

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_QUATERNION_DATA, NAMED_VALUE_FLOAT_DATA, RAW_IMU_DATA, SERVO_OUTPUT_RAW_DATA,
};

/// The messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stream {
    /// ATTITUDE_QUATERNION.
    Attitude,
    /// SERVO_OUTPUT_RAW.
    Servo,
    /// RAW_IMU.
    Raw,
    /// NAMED_VALUE_FLOAT.
    Crank,
}

/// Their numbers, in the same order.
const IDS: [u32; 4] = [
    ATTITUDE_QUATERNION_DATA::ID,
    SERVO_OUTPUT_RAW_DATA::ID,
    RAW_IMU_DATA::ID,
    NAMED_VALUE_FLOAT_DATA::ID,
];

/// Steps between two of a kind, 0 for none at all, and how many have gone by.
#[derive(Clone, Debug)]
pub(super) struct Rates([(u16, u16); IDS.len()]);

impl Default for Rates {
    fn default() -> Self {
        Self([(1, 0); IDS.len()])
    }
}

impl Rates {
    /// Another interval for the message with this number, us: 0 is the default again, -1 none at all. Says whether it
    /// was understood. A step comes every `step_us`.
    pub(super) fn set(&mut self, id: f32, interval_us: f32, step_us: u32) -> bool {
        let every = if interval_us == -1.0 {
            0
        } else if interval_us >= 0.0 {
            // The conversion saturates.
            ((interval_us / step_us as f32 + 0.5) as u16).max(1)
        } else {
            return false;
        };
        let found = self
            .0
            .iter_mut()
            .zip(IDS)
            .find(|(_, known)| *known as f32 == id);
        match found {
            Some((rate, _)) => {
                *rate = (every, 0);
                true
            }
            None => false,
        }
    }

    /// Another step: whether the message is due in it.
    pub(super) fn due(&mut self, stream: Stream) -> bool {
        let Some((every, gone)) = self.0.get_mut(stream as usize) else {
            return false;
        };
        *gone += 1;
        let due = *gone >= *every && *every > 0;
        if due || *every == 0 {
            *gone = 0;
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent_in_a_second(rates: &mut Rates, stream: Stream) -> usize {
        (0..100).filter(|_| rates.due(stream)).count()
    }

    #[test]
    fn intervals_are_whole_steps_and_other_messages_keep_theirs() {
        let mut rates = Rates::default();
        for (interval_us, count) in [
            (20_000.0, 50),
            (100_000.0, 10),
            (1.0, 100),
            (0.0, 100),
            (-1.0, 0),
            (1e9, 0),
        ] {
            assert!(rates.set(31.0, interval_us, 10_000));
            assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), count);
            assert_eq!(sent_in_a_second(&mut rates, Stream::Raw), 100);
        }
    }

    #[test]
    fn nonsense_changes_nothing() {
        let mut rates = Rates::default();
        for (id, interval_us) in [(31.0, f32::NAN), (31.0, -2.0), (33.0, 1e5), (f32::NAN, 1e5)] {
            assert!(!rates.set(id, interval_us, 10_000));
        }
        assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), 100);
    }
}
