//! The operator: a MAVLink client that reaches the image over USB only, as a laptop would.

use crate::link::{Link, LinkCounts};
use crate::request;
use crate::rig::{Rig, RigError};
use mavlink::dialects::common::{MavMessage, MavResult};
use samd21::board::Ticks;
use thiserror::Error;

pub use crate::received::{Attitude, FlightState, Heartbeat, RawImu, Received, ServoOutput, Text};

/// How often the operator looks at the port.
const SLICE: Ticks = Ticks::from_ms(1);
const HEARTBEAT: Ticks = Ticks::from_ms(1000);
/// How long an answer may take.
const PATIENCE: Ticks = Ticks::from_ms(1000);
/// How long the recorder's content may take.
const FETCH_PATIENCE: Ticks = Ticks::from_ms(2000);
/// How long the image may take until its first heartbeat.
const BOOT_PATIENCE: Ticks = Ticks::from_ms(5000);

/// Why the operator gives up.
#[derive(Debug, Error)]
pub enum OperatorError {
    /// The rig stopped.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// Nothing came.
    #[error("no {what} from the image within {seconds} s{last}")]
    Silence {
        /// What was waited for.
        what: String,
        /// How long.
        seconds: f64,
        /// What it said last.
        last: String,
    },
    /// The image did not obey.
    #[error("the image answered {command} with {result:?}{last}")]
    Refused {
        /// The command.
        command: &'static str,
        /// The answer.
        result: MavResult,
        /// What it said about it.
        last: String,
    },
    /// The image keeps another value.
    #[error("parameter {name}: {wanted} was sent, the image has {found}")]
    Parameter {
        /// Its name.
        name: String,
        /// What was sent.
        wanted: f32,
        /// What came back.
        found: f32,
    },
}

/// The person at the laptop.
#[derive(Clone, Debug, Default)]
pub struct Operator {
    link: Link,
    received: Received,
    next_heartbeat: Ticks,
}

impl Operator {
    /// Sits down.
    pub fn new() -> Self {
        Self::default()
    }

    /// What has arrived.
    pub fn received(&self) -> &Received {
        &self.received
    }

    /// Forgets attitudes, servo outputs, samples and link counts, as at the start of a measurement.
    pub fn begin_page(&mut self) {
        self.received.attitudes.clear();
        self.received.servos.clear();
        self.received.samples.clear();
        self.link.reset_counts();
    }

    /// What has been counted on the link.
    pub fn counts(&self) -> LinkCounts {
        self.link.counts()
    }

    /// Where the flight stands, by the last heartbeat.
    pub fn state(&self) -> Option<FlightState> {
        self.received.heartbeats.last().map(|beat| beat.state)
    }

    /// The last text.
    pub fn last_text(&self) -> Option<&str> {
        self.received.texts.last().map(|text| text.text.as_str())
    }

    /// Reads what has come and sends a heartbeat when it is time.
    pub fn poll(&mut self, rig: &mut Rig) {
        let now = rig.now();
        let bytes = rig.usb_read();
        for message in self.link.receive(&bytes) {
            self.received.take(now, message);
        }
        if rig.usb_host().is_configured() && now >= self.next_heartbeat {
            self.next_heartbeat = now + HEARTBEAT;
            self.send(rig, &request::heartbeat());
        }
    }

    /// Lets the rig run and reads along.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn run(&mut self, rig: &mut Rig, time: Ticks) -> Result<(), RigError> {
        let end = rig.now() + time;
        while rig.now() < end {
            rig.run_until((rig.now() + SLICE).min(end))?;
            self.poll(rig);
        }
        Ok(())
    }

    /// Lets the rig run until `done`, for at most `patience`.
    ///
    /// # Errors
    /// [`OperatorError::Silence`] naming `what`, or the rig stopped.
    pub fn wait(
        &mut self,
        rig: &mut Rig,
        patience: Ticks,
        what: &str,
        mut done: impl FnMut(&Received) -> bool,
    ) -> Result<(), OperatorError> {
        let end = rig.now() + patience;
        while !done(&self.received) {
            if rig.now() >= end {
                return Err(OperatorError::Silence {
                    what: what.to_owned(),
                    seconds: patience.as_secs_f64(),
                    last: self.last_words(),
                });
            }
            self.run(rig, SLICE)?;
        }
        Ok(())
    }

    /// Waits for the first heartbeat.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn connect(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        let before = self.received.heartbeats.len();
        self.wait(rig, BOOT_PATIENCE, "heartbeat", |received| {
            received.heartbeats.len() > before
        })
    }

    /// Waits until the flight is in `state`.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn wait_for_state(
        &mut self,
        rig: &mut Rig,
        patience: Ticks,
        state: FlightState,
    ) -> Result<(), OperatorError> {
        self.wait(rig, patience, &format!("state {state:?}"), |received| {
            received
                .heartbeats
                .last()
                .is_some_and(|beat| beat.state == state)
        })
    }

    /// Sets a parameter and checks what comes back.
    ///
    /// # Errors
    /// Silence, another value, or the rig stopped.
    pub fn set_parameter(
        &mut self,
        rig: &mut Rig,
        name: &str,
        value: f32,
    ) -> Result<(), OperatorError> {
        self.received.parameters.remove(name);
        self.send(rig, &request::set_parameter(name, value));
        let what = format!("echo of parameter {name}");
        self.wait(rig, PATIENCE, &what, |received| {
            received.parameters.contains_key(name)
        })?;
        let found = self.received.parameters[name];
        if found == value {
            Ok(())
        } else {
            Err(OperatorError::Parameter {
                name: name.to_owned(),
                wanted: value,
                found,
            })
        }
    }

    /// Asks for all parameters; [`Received::parameters`] has them then.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn list_parameters(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.received.parameters.clear();
        self.received.parameter_count = None;
        self.send(rig, &request::list_parameters());
        self.wait(rig, PATIENCE, "complete parameter list", |received| {
            received
                .parameter_count
                .is_some_and(|count| received.parameters.len() == usize::from(count))
        })
    }

    /// Arms.
    ///
    /// # Errors
    /// Refusal with the image's reason, silence, or the rig stopped.
    pub fn arm(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.command(rig, "arm", request::ARM)
    }

    /// Disarms, which also acknowledges a failsafe or a latched fault.
    ///
    /// # Errors
    /// As [`Operator::arm`].
    pub fn disarm(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.command(rig, "disarm", request::DISARM)
    }

    /// Asks for control and, as soon as the image agrees, opens the clamp; the drone leaves it
    /// with `rate_rad_s`.
    ///
    /// # Errors
    /// As [`Operator::arm`]; the clamp stays closed.
    pub fn release(&mut self, rig: &mut Rig, rate_rad_s: f64) -> Result<(), OperatorError> {
        self.command(rig, "release", request::RELEASE)?;
        rig.release(rate_rad_s);
        Ok(())
    }

    /// Stores the parameters.
    ///
    /// # Errors
    /// As [`Operator::arm`].
    pub fn save_parameters(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.command(rig, "save", request::SAVE)
    }

    /// Asks for the parameters to be stored, and does not wait.
    pub fn request_save(&mut self, rig: &mut Rig) {
        self.send(rig, &request::SAVE.message());
    }

    /// Goes back to the stored parameters.
    ///
    /// # Errors
    /// As [`Operator::arm`].
    pub fn reload_parameters(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.command(rig, "reload", request::RELOAD)
    }

    /// Goes back to the defaults.
    ///
    /// # Errors
    /// As [`Operator::arm`].
    pub fn reset_parameters(&mut self, rig: &mut Rig) -> Result<(), OperatorError> {
        self.command(rig, "reset", request::RESET)
    }

    /// Fetches the recorder's bytes: none if it holds no release.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn fetch_recording(&mut self, rig: &mut Rig) -> Result<Vec<u8>, OperatorError> {
        self.received.recorded = None;
        self.received.recording.clear();
        self.send(rig, &request::list_logs());
        self.wait(rig, PATIENCE, "size of the recording", |received| {
            received.recorded.is_some()
        })?;
        let size = self.received.recorded.unwrap_or(0);
        self.send(rig, &request::log_data(0, size));
        let mut bytes = Vec::new();
        self.wait(rig, FETCH_PATIENCE, "whole recording", |received| {
            bytes = received.recording.values().flatten().copied().collect();
            bytes.len() >= size as usize
        })?;
        Ok(bytes)
    }

    /// Sends a message.
    pub fn send(&mut self, rig: &mut Rig, message: &MavMessage) {
        let bytes = self.link.frame(message);
        rig.usb_write(&bytes);
    }

    fn command(
        &mut self,
        rig: &mut Rig,
        name: &'static str,
        order: request::Order,
    ) -> Result<(), OperatorError> {
        let before = self.received.acks.len();
        self.send(rig, &order.message());
        let mut result = None;
        let what = format!("answer to {name}");
        self.wait(rig, PATIENCE, &what, |received| {
            result = received.acks[before..]
                .iter()
                .find(|(_, answered, _)| *answered == order.command)
                .map(|(_, _, result)| *result);
            result.is_some()
        })?;
        match result {
            Some(MavResult::MAV_RESULT_ACCEPTED) | None => Ok(()),
            Some(result) => Err(OperatorError::Refused {
                command: name,
                result,
                last: self.last_words(),
            }),
        }
    }

    fn last_words(&self) -> String {
        self.last_text()
            .map_or(String::new(), |text| format!(" (it said last: {text})"))
    }
}
