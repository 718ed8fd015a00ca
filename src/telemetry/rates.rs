//! How often the messages of a step are sent, until the host asks for another interval
//! (MAV_CMD_SET_MESSAGE_INTERVAL), and which of all that come by themselves it wants once more
//! (MAV_CMD_REQUEST_MESSAGE).

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA,
    NAMED_VALUE_FLOAT_DATA, RAW_IMU_DATA, SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA,
    V2_EXTENSION_DATA,
};

use crate::config::HEARTBEAT_PERIOD_US;
use crate::params::whole;

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
    /// HEARTBEAT.
    Heartbeat,
    /// SYS_STATUS.
    Status,
    /// V2_EXTENSION.
    Memory,
}

/// Their numbers, and the steps between two by default, in the same order; `None` for what comes
/// once a second. Whoever wants DEBUG_VECT waits for it: it tells of a whole second.
const STREAMS: [(u32, Option<u16>); 9] = [
    (ATTITUDE_QUATERNION_DATA::ID, Some(1)),
    (SERVO_OUTPUT_RAW_DATA::ID, Some(1)),
    (RAW_IMU_DATA::ID, Some(1)),
    (NAMED_VALUE_FLOAT_DATA::ID, Some(1)),
    (ATTITUDE_DATA::ID, Some(0)),
    (HEARTBEAT_DATA::ID, None),
    (SYS_STATUS_DATA::ID, None),
    (V2_EXTENSION_DATA::ID, None),
    (DEBUG_VECT_DATA::ID, None),
];

/// What the host has chosen for a message.
#[derive(Clone, Copy, Debug)]
struct Rate {
    /// Steps between two of a kind, 0 for none at all.
    every: u16,
    /// How many have gone by.
    gone: u16,
    /// The next step sends it in any case.
    wanted: bool,
}

/// The rates of all.
#[derive(Clone, Debug)]
pub(super) struct Rates([Rate; STREAMS.len()]);

impl Rates {
    #[inline(never)]
    pub(super) const fn new() -> Self {
        let mut rates = [Rate { every: 0, gone: 0, wanted: false }; STREAMS.len()];
        let (mut places, mut streams): (&mut [Rate], &[_]) = (&mut rates, &STREAMS);
        while let ([rate, other_places @ ..], [(_, default), others @ ..]) = (places, streams) {
            if let Some(every) = default {
                rate.every = *every;
            }
            (places, streams) = (other_places, others);
        }
        Self(rates)
    }

    /// Another interval for the message with this number, us: 0 is the default again, -1 none at
    /// all. Says whether it was understood. A step comes every `step_us`.
    pub(super) fn set(&mut self, id: u32, interval_us: f32, step_us: u32) -> bool {
        let Some((Rate { every, gone, .. }, Some(default))) = self.find(id) else {
            return false;
        };
        *every = if interval_us == -1.0 {
            0
        } else if interval_us == 0.0 {
            default
        } else if interval_us > 0.0 {
            whole(interval_us / step_us as f32 + 0.5).clamp(1, u16::MAX.into()) as u16
        } else {
            return false;
        };
        *gone = 0;
        true
    }

    /// The interval of the message with this number, as MESSAGE_INTERVAL has it: us, -1 for a
    /// message that does not come, 0 for one that there is not.
    pub(super) fn interval_us(&mut self, id: u32, step_us: u32) -> i32 {
        match self.find(id) {
            None => 0,
            Some((_, None)) => HEARTBEAT_PERIOD_US as i32,
            Some((rate, Some(_))) => match rate.every {
                0 => -1,
                every => (u32::from(every) * step_us) as i32,
            },
        }
    }

    /// Send the message with this number in the next step. Says whether there is one.
    pub(super) fn want(&mut self, id: u32) -> bool {
        self.find(id).map(|(rate, _)| rate.wanted = true).is_some()
    }

    /// Another step: whether the message is due in it.
    pub(super) fn due(&mut self, stream: Stream) -> bool {
        let Some(rate) = self.0.get_mut(stream as usize) else {
            return false;
        };
        let wanted = core::mem::take(&mut rate.wanted);
        // Nearly all are at one or the other.
        let is_due = match rate.every {
            0 => false,
            1 => true,
            every => {
                rate.gone += 1;
                let is_due = rate.gone >= every;
                if is_due {
                    rate.gone = 0;
                }
                is_due
            }
        };
        is_due || wanted
    }

    fn find(&mut self, id: u32) -> Option<(&mut Rate, Option<u16>)> {
        let mut rates = self.0.iter_mut().zip(STREAMS);
        let (rate, (_, default)) = rates.find(|(_, (known, _))| *known == id)?;
        Some((rate, default))
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
        for (interval_us, count) in
            [(20_000.0, 50), (100_000.0, 10), (1.0, 100), (0.0, 100), (-1.0, 0), (1e9, 0)]
        {
            assert!(rates.set(31, interval_us, 10_000));
            assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), count);
            assert_eq!(sent_in_a_second(&mut rates, Stream::Raw), 100);
        }
    }

    #[test]
    fn angles_come_on_request_only() {
        let mut rates = Rates::new();
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 0);
        assert!(rates.set(30, 20_000.0, 10_000));
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 50);
        assert!(rates.set(30, 0.0, 10_000));
        assert_eq!(sent_in_a_second(&mut rates, Stream::Angles), 0);
    }

    #[test]
    fn what_is_wanted_comes_once_and_leaves_the_rate_alone() {
        let mut rates = Rates::new();
        for id in [30, 31, 0, 1, 250] {
            assert!(rates.want(id), "{id}");
        }
        assert!(!rates.want(33));
        for stream in [Stream::Angles, Stream::Heartbeat, Stream::Status] {
            assert_eq!(sent_in_a_second(&mut rates, stream), 1);
        }
        assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), 100);
    }

    #[test]
    fn intervals_are_told_as_they_are() {
        let mut rates = Rates::new();
        assert!(rates.set(27, 50_000.0, 10_000));
        for (id, interval_us) in [(31, 10_000), (27, 50_000), (30, -1), (0, 1_000_000), (33, 0)] {
            assert_eq!(rates.interval_us(id, 10_000), interval_us, "{id}");
        }
    }

    #[test]
    fn nonsense_changes_nothing() {
        let mut rates = Rates::new();
        for (id, interval_us) in [(31, f32::NAN), (31, -2.0), (33, 1e5), (0, 1e5)] {
            assert!(!rates.set(id, interval_us, 10_000));
        }
        assert_eq!(sent_in_a_second(&mut rates, Stream::Attitude), 100);
    }
}
