//! The ground station: the MAVLink client at the image's USB port, on the rig's clock.

use crate::rig::{Rig, RigError};
use client::client::ANSWER;
use client::request::{self, Order};
use client::{Client, Failure, LinkCounts, Parameter, Request, StateKind};
use samd21::board::Ticks;
use std::time::Duration;
use thiserror::Error;

pub use crate::received::{Attitude, BusReport, Heartbeat, RawImu, Received, ServoOutput};

/// How often the ground station looks at the port.
const SLICE: Ticks = Ticks::from_ms(1);
/// How long the image may take until its first heartbeat.
const BOOT_PATIENCE: Ticks = Ticks::from_ms(5000);

/// Why the ground station gives up.
#[derive(Debug, Error)]
pub enum GroundStationError {
    /// The rig stopped.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// What was waited for did not arrive in time.
    #[error("no {what} from the image within {seconds} s{last}")]
    Silence {
        /// What was waited for.
        what: String,
        /// How long it was waited for, s.
        seconds: f64,
        /// The image's last text.
        last: String,
    },
    /// The image refused a request or did not answer it.
    #[error("{failure}{last}")]
    Request {
        /// Why.
        failure: Failure,
        /// The image's last text.
        last: String,
    },
}

/// What the image answers, or why there is no answer.
pub type Answer<T = ()> = Result<T, GroundStationError>;

/// A ground station with everything that it has received.
#[derive(Clone, Debug, Default)]
pub struct GroundStation {
    client: Client,
    received: Received,
}

impl GroundStation {
    /// What has arrived.
    pub fn received(&self) -> &Received {
        &self.received
    }

    /// Starts a measurement: forgets attitudes, servo outputs, samples and link counts.
    pub fn begin_measurement(&mut self) {
        self.received.attitudes.clear();
        self.received.servos.clear();
        self.received.samples.clear();
        self.client.reset_counts();
    }

    /// Frames and errors counted on the link.
    pub fn counts(&self) -> LinkCounts {
        self.client.counts()
    }

    /// The state of the flight by the last heartbeat.
    pub fn state(&self) -> Option<StateKind> {
        self.received.heartbeats.last()?.state
    }

    /// The last text.
    pub fn last_text(&self) -> Option<&str> {
        self.received.texts.last().map(String::as_str)
    }

    /// Reads what has arrived and sends what is due.
    pub fn poll(&mut self, rig: &mut Rig) {
        let now = rig.now();
        let bytes = rig.usb_read();
        for frame in self.client.receive(duration(now), &bytes) {
            self.received.take(now, frame.message);
        }
        if rig.chip.usb_host.is_configured() {
            self.client.poll(duration(now));
            self.flush(rig);
        }
    }

    /// Lets the rig run for `time` and reads what arrives.
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
    /// [`GroundStationError::Silence`] naming `what`, or the rig stopped.
    pub fn wait(
        &mut self,
        rig: &mut Rig,
        patience: Ticks,
        what: &str,
        mut done: impl FnMut(&Received) -> bool,
    ) -> Answer {
        let end = rig.now() + patience;
        while !done(&self.received) {
            if rig.now() >= end {
                return Err(GroundStationError::Silence {
                    what: what.to_owned(),
                    seconds: patience.as_secs_f64(),
                    last: self.last_text_note(),
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
    pub fn connect(&mut self, rig: &mut Rig) -> Answer {
        let before = self.received.heartbeats.len();
        self.wait(rig, BOOT_PATIENCE, "heartbeat", |received| received.heartbeats.len() > before)
    }

    /// Waits until the flight is in `state`.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn wait_for_state(&mut self, rig: &mut Rig, patience: Ticks, state: StateKind) -> Answer {
        self.wait(rig, patience, &format!("state {state:?}"), |received| {
            let mut heartbeats = received.heartbeats.iter();
            heartbeats.next_back().is_some_and(|beat| beat.state == Some(state))
        })
    }

    /// Sets a parameter and checks the value that the image reports back.
    ///
    /// # Errors
    /// Silence, another value, or the rig stopped.
    pub fn set_parameter(&mut self, rig: &mut Rig, name: &str, value: f32) -> Answer {
        self.request(rig, Request::Set(Parameter::new(name, value)))
    }

    /// Asks for all parameters, which are in [`Received::parameters`] afterwards.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn list_parameters(&mut self, rig: &mut Rig) -> Answer {
        self.received.parameters.clear();
        self.request(rig, Request::List)
    }

    /// Arms.
    ///
    /// # Errors
    /// Refusal with the image's reason, silence, or the rig stopped.
    pub fn arm(&mut self, rig: &mut Rig) -> Answer {
        self.order(rig, request::ARM)
    }

    /// Disarms, which also ends a failsafe and acknowledges a latched fault.
    ///
    /// # Errors
    /// As [`GroundStation::arm`].
    pub fn disarm(&mut self, rig: &mut Rig) -> Answer {
        self.order(rig, request::DISARM)
    }

    /// Asks for control and, as soon as the image agrees, opens the clamp; the drone leaves it
    /// with `rate_rad_s`.
    ///
    /// # Errors
    /// As [`GroundStation::arm`]; the clamp stays closed then.
    pub fn release(&mut self, rig: &mut Rig, rate_rad_s: f64) -> Answer {
        self.order(rig, request::RELEASE)?;
        rig.release(rate_rad_s);
        Ok(())
    }

    /// Asks for the parameters to be stored, without waiting for the answer.
    pub fn request_save(&mut self, rig: &mut Rig) {
        self.client.send(&request::SAVE.message());
        self.flush(rig);
    }

    /// Fetches the recorder's bytes: none if it holds no release.
    ///
    /// # Errors
    /// Silence, or the rig stopped.
    pub fn fetch_recording(&mut self, rig: &mut Rig) -> Answer<Vec<u8>> {
        self.request(rig, Request::Download)?;
        Ok(self.client.recording().to_vec())
    }

    /// Sends an order and waits until it is acknowledged.
    ///
    /// # Errors
    /// As [`GroundStation::arm`].
    pub fn order(&mut self, rig: &mut Rig, order: Order) -> Answer {
        self.request(rig, Request::Order(order))
    }

    fn request(&mut self, rig: &mut Rig, request: Request) -> Answer {
        let ticket = self.client.request(duration(rig.now()), request);
        self.flush(rig);
        let end = rig.now() + Ticks::from_us(ANSWER.as_micros() as u64);
        loop {
            // Without a port `poll` does not poll the client, whose time limit would never end
            // then.
            if rig.now() >= end && !rig.chip.usb_host.is_configured() {
                self.client.close();
            }
            if let Some(answer) = self.client.answer(ticket) {
                return answer.map_err(|failure| GroundStationError::Request {
                    failure,
                    last: self.last_text_note(),
                });
            }
            self.run(rig, SLICE)?;
        }
    }

    fn flush(&mut self, rig: &mut Rig) {
        while let Some(frame) = self.client.outgoing() {
            rig.usb_write(&frame);
        }
    }

    /// The image's last text, to be appended to an error.
    fn last_text_note(&self) -> String {
        self.last_text().map_or(String::new(), |text| format!(" (it said last: {text})"))
    }
}

/// The rig's clock as the client takes it.
fn duration(time: Ticks) -> Duration {
    let ns = u128::from(time.0) * 1_000_000 / u128::from(Ticks::from_ms(1).0);
    Duration::from_nanos(ns as u64)
}
