//! How often the messages of a step are sent, until the host asks for another interval
//! (MAV_CMD_SET_MESSAGE_INTERVAL).

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, NAMED_VALUE_FLOAT_DATA, RAW_IMU_DATA,
    SERVO_OUTPUT_RAW_DATA,
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
    /// ATTITUDE.
    Angles,
}

/// Their numbers, and the steps between two by default, in the same order.
const STREAMS: [(u32, u16); 5] = [
    (ATTITUDE_QUATERNION_DATA::ID, 1),
    (SERVO_OUTPUT_RAW_DATA::ID, 1),
    (RAW_IMU_DATA::ID, 1),
    (NAMED_VALUE_FLOAT_DATA::ID, 1),
    (ATTITUDE_DATA::ID, 0),
];

/// What the host has chosen for a message.
#[derive(Clone, Copy, Debug)]
struct Rate {
    /// Steps between two of a kind, 0 for none at all; nothing chosen is the default.
    every: Option<u16>,
    /// How many have gone by.
    gone: u16,
}

/// The rates of all.
#[derive(Clone, Debug)]
pub(super) struct Rates([Rate; STREAMS.len()]);

impl Rates {
    pub(super) const fn new() -> Self {
        let default = Rate {
            every: None,
            gone: 0,
        };
        Self([default; STREAMS.len()])
    }

    /// Another interval for the message with this number, us: 0 is the default again, -1 none at
    /// all. Says whether it was understood. A step comes every `step_us`.
    pub(super) fn set(&mut self, id: f32, interval_us: f32, step_us: u32) -> bool {
        let every = if interval_us == -1.0 {
            Some(0)
        } else if interval_us == 0.0 {
            None
        } else if interval_us > 0.0 {
            // The conversion saturates.
            Some(((interval_us / step_us as f32 + 0.5) as u16).max(1))
        } else {
            return false;
        };
        let mut rates = self.0.iter_mut().zip(STREAMS);
        match rates.find(|(_, (known, _))| *known as f32 == id) {
            Some((rate, _)) => {
                *rate = Rate { every, gone: 0 };
                true
            }
            None => false,
        }
    }

    /// Another step: whether the message is due in it.
    pub(super) fn due(&mut self, stream: Stream) -> bool {
        let index = stream as usize;
        let (Some(rate), Some((_, default))) = (self.0.get_mut(index), STREAMS.get(index)) else {
            return false;
        };
        let every = rate.every.unwrap_or(*default);
        rate.gone += 1;
        let due = rate.gone >= every && every > 0;
        if due || every == 0 {
            rate.gone = 0;
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
        let mut rates = Rates::new();
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
    fn angles_come_on_request_only() {
        let mut rates = Rates::new();
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 0);
        assert!(rates.set(30.0, 20_000.0, 10_000));
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 50);
        assert!(rates.set(30.0, 0.0, 10_000));
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 0);
    }

    #[test]
    fn nonsense_changes_nothing() {
        let mut rates = Rates::new();
        for (id, interval_us) in [(31.0, f32::NAN), (31.0, -2.0), (33.0, 1e5), (f32::NAN, 1e5)] {
            assert!(!rates.set(id, interval_us, 10_000));
        }
        assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), 100);
    }
}
