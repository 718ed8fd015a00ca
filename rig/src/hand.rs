//! The hand at the clamp: it lets the drone go when the firmware says that it is in control, and takes it back to its
//! start when the firmware says that it is no longer.

use crate::link::Link;
use crate::operator::FlightState;
use crate::rig::Rig;
use mavlink::dialects::common::MavMessage;

/// Holds the clamp and reads what the image sends, as the person at the rig does.
#[derive(Clone, Debug)]
pub struct Hand {
    link: Link,
    start_rad: f64,
    rate_rad_s: f64,
    state: Option<FlightState>,
}

impl Hand {
    /// Lets go from the tilt `start_rad`, with a rate of `rate_rad_s`.
    pub fn new(start_rad: f64, rate_rad_s: f64) -> Self {
        Self {
            link: Link::default(),
            start_rad,
            rate_rad_s,
            state: None,
        }
    }

    /// Takes in what the image has sent; does what it says; gives what is worth telling a person.
    pub fn watch(&mut self, rig: &mut Rig, sent: &[u8]) -> Vec<String> {
        let mut news = Vec::new();
        for message in self.link.receive(sent) {
            match message {
                MavMessage::HEARTBEAT(beat) => self.follow(rig, FlightState::of(beat.custom_mode)),
                MavMessage::STATUSTEXT(text) => {
                    news.push(text.text.to_str().unwrap_or("(not UTF-8)").to_owned());
                }
                _ => {}
            }
        }
        news
    }

    /// A failsafe does not bring the hand back: the drone falls as it would.
    fn follow(&mut self, rig: &mut Rig, state: FlightState) {
        self.state = Some(state);
        let held = rig.world().drone().held();
        match state {
            FlightState::Active if held => rig.release(self.rate_rad_s),
            FlightState::Active | FlightState::Failsafe => {}
            _ if !held => {
                rig.world_mut().catch();
                rig.world_mut().tilt_clamp(self.start_rad);
            }
            _ => {}
        }
    }

    /// Where the flight stands, by the last heartbeat.
    pub fn state(&self) -> Option<FlightState> {
        self.state
    }
}
