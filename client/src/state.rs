//! The firmware's states, causes and refusals as they come over the link.
//!
//! HEARTBEAT's `custom_mode` carries [`State::code`]; a refusal comes as STATUSTEXT before its COMMAND_ACK. Both are
//! read by what the firmware's own types give, so no number and no text stands here a second time.

use core::fmt;

use mavlink::dialects::common::MavMessage;
use tvc_nano::failsafe::{Crash, Latch, Reason, Refusal, State};
use tvc_nano::self_test::SelfTest;
use tvc_nano::{Micros, RawSample, SensorFault};

use crate::text;

/// A state of the flight: [`State`] without what the link does not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the firmware's own names")]
pub enum FlightState {
    Boot,
    SelfTest,
    Standby,
    Armed,
    Active,
    Failsafe,
    Latched,
    Unknown(u8),
}

impl FlightState {
    /// The state in HEARTBEAT's `custom_mode`.
    pub fn of(custom_mode: u32) -> Self {
        let sample = RawSample {
            time: Micros(0),
            acc: [0; 3],
            gyr: [0; 3],
            mag: [0; 3],
        };
        let known = [
            (State::Boot, Self::Boot),
            (
                State::SelfTest(SelfTest::new(&sample, None)),
                Self::SelfTest,
            ),
            (State::Standby, Self::Standby),
            (State::Armed, Self::Armed),
            (
                State::Active {
                    over_tilt_since: None,
                },
                Self::Active,
            ),
            (State::Failsafe(Reason::Tilt), Self::Failsafe),
            (State::Latched(Latch::Crash(Crash::Watchdog)), Self::Latched),
        ];
        let code = custom_mode as u8;
        known
            .iter()
            .find(|(state, _)| state.code() as u8 == code)
            .map_or(Self::Unknown(code), |(_, state)| *state)
    }

    /// Armed or in control: what HEARTBEAT's armed flag says.
    pub fn is_armed(self) -> bool {
        matches!(self, Self::Armed | Self::Active)
    }

    /// Armed, in control or in failsafe: back to standby by an order to disarm alone.
    pub fn is_in_operation(self) -> bool {
        self.is_armed() || self == Self::Failsafe
    }
}

impl fmt::Display for FlightState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Boot => "boot",
            Self::SelfTest => "self-test",
            Self::Standby => "standby",
            Self::Armed => "armed",
            Self::Active => "active",
            Self::Failsafe => "failsafe",
            Self::Latched => "latched fault",
            Self::Unknown(code) => return write!(f, "unknown ({code})"),
        })
    }
}

/// Why control was given up: [`Reason`] without the sensor's fault, which the link does not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the firmware's own names")]
pub enum Cause {
    Sensor,
    StaleData,
    InvalidAttitude,
    Tilt,
    HostSilent,
}

impl Cause {
    /// The cause of the failsafe in HEARTBEAT's `custom_mode`; `None` in any other state.
    pub fn of(custom_mode: u32) -> Option<Self> {
        let known = [
            (Reason::Sensor(SensorFault::Nak), Self::Sensor),
            (Reason::StaleData, Self::StaleData),
            (Reason::InvalidAttitude, Self::InvalidAttitude),
            (Reason::Tilt, Self::Tilt),
            (Reason::HostSilent, Self::HostSilent),
        ];
        let mut known = known.into_iter();
        known
            .find(|(reason, _)| State::Failsafe(*reason).code() == custom_mode)
            .map(|(_, cause)| cause)
    }
}

/// The refusal in the words that the vehicle sends with it, cut to the length of a STATUSTEXT. `None` for one that says
/// more than its kind: the wrong state, or a fault that persists.
pub fn refusal(words: &str) -> Option<Refusal> {
    let (_, why) = words.split_once(" refused: ")?;
    [
        Refusal::Tilt,
        Refusal::Sensor,
        Refusal::Settling,
        Refusal::Polarity,
        Refusal::BiasUnknown,
        Refusal::HostSilent,
    ]
    .into_iter()
    .find(|refusal| !why.is_empty() && refusal.to_string().starts_with(why))
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

    /// What the vehicle said about its state; empty before it did.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// The state; unknown before the first heartbeat.
    pub fn state(&self) -> FlightState {
        self.code
            .map_or(FlightState::Unknown(u8::MAX), FlightState::of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{HEARTBEAT_DATA, STATUSTEXT_DATA};

    #[test]
    fn states_and_causes_are_those_of_the_firmware() {
        let failsafe = State::Failsafe(Reason::HostSilent).code();
        assert_eq!(FlightState::of(failsafe), FlightState::Failsafe);
        assert_eq!(Cause::of(failsafe), Some(Cause::HostSilent));
        let sensor = State::Failsafe(Reason::Sensor(SensorFault::Frozen)).code();
        assert_eq!(Cause::of(sensor), Some(Cause::Sensor));
        let latched = State::Latched(Latch::ParametersLost).code();
        assert_eq!(FlightState::of(latched), FlightState::Latched);
        assert_eq!(Cause::of(latched), None);
        assert_eq!(FlightState::of(200), FlightState::Unknown(200));
        assert_eq!(FlightState::of(200).to_string(), "unknown (200)");
    }

    #[test]
    fn a_refusal_is_known_by_its_words_even_where_they_are_cut() {
        for (words, known) in [
            (
                "arm refused: run tvc calibrate polarity first",
                Some(Refusal::Polarity),
            ),
            (
                "release refused: gyro offset unknown: hold sti",
                Some(Refusal::BiasUnknown),
            ),
            ("arm refused: in failsafe: tilt beyond 60 deg", None),
            ("arm refused: ", None),
            ("standby", None),
        ] {
            assert_eq!(refusal(words), known, "{words}");
        }
    }

    #[test]
    fn the_text_behind_a_new_state_is_its_reason() {
        let mut tracker = StateTracker::default();
        assert_eq!(tracker.state(), FlightState::Unknown(255));
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: State::Failsafe(Reason::Tilt).code(),
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
        assert_eq!(tracker.state(), FlightState::Failsafe);
        assert_eq!(tracker.reason(), "failsafe: tilt beyond 60 deg");
    }

    fn said(words: &str) -> MavMessage {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            text: words.into(),
            ..STATUSTEXT_DATA::default()
        })
    }
}
