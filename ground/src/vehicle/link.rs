//! The vehicle at the other end of a port: MAVLink both ways, for every command that talks to it.

use crate::vehicle::port::PortOptions;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavResult};
use rig::link::{Frame, LinkCounts};
use rig::operator::FlightState;
use rig::request::{self, Order};

use crate::logs::log::Writer;
use crate::out::exit::BadInput;
use crate::vehicle::port::Port;
use crate::vehicle::status::Standing;

/// How long the vehicle may take until its first heartbeat; it sends one a second, and one at once when a port is opened.
const CONNECT: Duration = Duration::from_secs(5);
/// How long an answer may take.
const ANSWER: Duration = Duration::from_secs(5);
/// Silence in a list of parameters after which those that are missing are asked for again.
const LIST_SILENCE: Duration = Duration::from_secs(1);
/// How long a release under way takes until it is recorded.
const RECORDING: Duration = Duration::from_millis(1_500);
/// How often we say that we are there.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// What the vehicle says to a parameter's name that it does not know.
const UNKNOWN_PARAMETER: &str = "no such parameter";
/// Longest wait for bytes, so that heartbeats and deadlines are kept.
const SLICE: Duration = Duration::from_millis(20);

/// A port on which messages come and go.
pub struct Link {
    port: Port,
    wire: rig::link::Link,
    heartbeat: Option<Instant>,
    log: Option<Writer>,
}

impl Link {
    /// Opens the port that `options` mean.
    ///
    /// # Errors
    /// See [`Port::open`].
    pub fn open(options: &PortOptions) -> Result<Self> {
        Ok(Self {
            port: Port::open(options.port.as_deref())?,
            wire: rig::link::Link::default(),
            heartbeat: Some(Instant::now()),
            log: None,
        })
    }

    /// Sends no heartbeats of its own: another ground station does.
    pub fn without_heartbeat(mut self) -> Self {
        self.heartbeat = None;
        self
    }

    /// Keeps every frame, both ways, in a log.
    pub fn log_to(&mut self, log: Writer) {
        self.log = Some(log);
    }

    /// Ends the log.
    ///
    /// # Errors
    /// The log cannot be written.
    pub fn end_log(&mut self) -> Result<()> {
        self.log.take().map_or(Ok(()), Writer::end)
    }

    /// The port's name.
    pub fn name(&self) -> &str {
        self.port.name()
    }

    /// What has been counted.
    pub fn counts(&self) -> LinkCounts {
        self.wire.counts()
    }

    /// The frames that have come, waiting a short while for them.
    ///
    /// # Errors
    /// The port went away, or the log cannot be written.
    pub fn receive(&mut self) -> Result<Vec<Frame>> {
        if self.heartbeat.is_some_and(|due| Instant::now() >= due) {
            self.send(&request::heartbeat())?;
            self.heartbeat = Some(Instant::now() + HEARTBEAT);
        }
        let bytes = self.port.read(SLICE)?;
        let frames = self.wire.receive_frames(&bytes);
        if let Some(log) = &mut self.log {
            for frame in &frames {
                log.write(&frame.bytes)?;
            }
            log.flush()?;
        }
        Ok(frames)
    }

    /// Sends a message.
    ///
    /// # Errors
    /// The port went away or takes nothing, or the log cannot be written.
    pub fn send(&mut self, message: &MavMessage) -> Result<()> {
        let bytes = self.wire.frame(message);
        self.send_bytes(&bytes)
    }

    /// Sends a frame that another ground station has made.
    ///
    /// # Errors
    /// As [`Link::send`].
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<()> {
        if let Some(log) = &mut self.log {
            log.write(bytes)?;
        }
        self.port.write(bytes)
    }
}

/// A parameter as the vehicle has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f32,
}

/// A vehicle that has been heard.
pub struct Vehicle {
    link: Link,
    standing: Standing,
    words: String,
}

impl Vehicle {
    /// Opens the port and waits for the vehicle.
    ///
    /// # Errors
    /// No such port, or nobody there.
    pub fn connect(options: &PortOptions) -> Result<Self> {
        Self::at(Link::open(options)?)
    }

    /// Waits for the vehicle at a link.
    ///
    /// # Errors
    /// Nobody there.
    pub fn at(link: Link) -> Result<Self> {
        let mut vehicle = Self {
            link,
            standing: Standing::default(),
            words: String::new(),
        };
        let heard = vehicle.wait(CONNECT, |message| {
            matches!(message, MavMessage::HEARTBEAT(beat) if is_vehicle(beat)).then_some(())
        })?;
        match heard {
            Some(()) => Ok(vehicle),
            None => bail!(
                "no heartbeat on {} within {} s: is tvc-nano on the board (tvc flash), and is this its port (tvc ports)?",
                vehicle.link.name(),
                CONNECT.as_secs()
            ),
        }
    }

    /// Where the flight stands, by the last heartbeat.
    pub fn state(&self) -> FlightState {
        self.standing.state()
    }

    /// Where the flight stands, and why.
    pub fn standing(&self) -> &Standing {
        &self.standing
    }

    /// The link, to read along.
    pub fn link(&mut self) -> &mut Link {
        &mut self.link
    }

    /// The frames that have come, waiting a short while for them.
    ///
    /// # Errors
    /// The port went away.
    pub fn receive(&mut self) -> Result<Vec<Frame>> {
        let frames = self.link.receive()?;
        for frame in &frames {
            self.standing.take(&frame.message);
            if let MavMessage::STATUSTEXT(text) = &frame.message {
                self.words = text.text.to_str().unwrap_or("(not UTF-8)").to_owned();
            }
        }
        Ok(frames)
    }

    /// Reads until `find` has found something, for at most `patience`.
    fn wait<T>(
        &mut self,
        patience: Duration,
        mut find: impl FnMut(&MavMessage) -> Option<T>,
    ) -> Result<Option<T>> {
        let end = Instant::now() + patience;
        while Instant::now() < end {
            let frames = self.receive()?;
            if let Some(found) = frames.iter().find_map(|frame| find(&frame.message)) {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// Gives an order, called `name`, and waits until it is obeyed.
    ///
    /// # Errors
    /// The vehicle refuses (its reason is in the error) or does not answer.
    pub fn command(&mut self, name: &str, order: Order) -> Result<()> {
        self.words.clear();
        self.link.send(&order.message())?;
        let result = self.wait(ANSWER, |message| match message {
            MavMessage::COMMAND_ACK(ack) if ack.command == order.command => Some(ack.result),
            _ => None,
        })?;
        match result {
            Some(MavResult::MAV_RESULT_ACCEPTED) => Ok(()),
            Some(MavResult::MAV_RESULT_UNSUPPORTED) => {
                bail!("this firmware does not know the command to {name}")
            }
            Some(_) if self.words.contains("refused") => bail!("{}", self.words),
            Some(result) => bail!("{name} refused ({result:?})"),
            None => Err(self.silence(name)),
        }
    }

    /// Changes a parameter.
    ///
    /// # Errors
    /// [`BadInput`] with the vehicle's reason if it keeps another value; silence.
    pub fn set_parameter(&mut self, name: &str, value: f32) -> Result<()> {
        self.link.send(&request::set_parameter(name, value))?;
        let mut reason = None;
        // The old value comes as an answer behind a reason; without one it answers an earlier request.
        let found = self.wait(ANSWER, |message| match message {
            MavMessage::STATUSTEXT(text) => {
                reason = text.text.to_str().ok().map(str::to_owned);
                (text.text.to_str() == Ok(UNKNOWN_PARAMETER)).then_some(None)
            }
            MavMessage::PARAM_VALUE(row) if row.param_id.to_str() == Ok(name) => {
                (row.param_value == value || reason.is_some()).then_some(Some(row.param_value))
            }
            _ => None,
        })?;
        match found {
            Some(Some(found)) if found == value => Ok(()),
            Some(Some(found)) => Err(BadInput::new(format!(
                "{name} stays at {found}: {}",
                reason.unwrap_or_default()
            ))
            .into()),
            Some(None) => Err(unknown_parameter(name)),
            None => Err(self.silence(name)),
        }
    }

    /// One parameter's value.
    ///
    /// # Errors
    /// [`BadInput`] if the vehicle does not know it; silence.
    pub fn parameter(&mut self, name: &str) -> Result<f32> {
        self.link.send(&request::read_parameter(name))?;
        let found = self.wait(ANSWER, |message| match message {
            MavMessage::PARAM_VALUE(row) if row.param_id.to_str() == Ok(name) => {
                Some(Some(row.param_value))
            }
            MavMessage::STATUSTEXT(text) if text.text.to_str() == Ok(UNKNOWN_PARAMETER) => {
                Some(None)
            }
            _ => None,
        })?;
        match found {
            Some(Some(value)) => Ok(value),
            Some(None) => Err(unknown_parameter(name)),
            None => Err(self.silence(name)),
        }
    }

    /// Every parameter, in the vehicle's order.
    ///
    /// # Errors
    /// Silence.
    pub fn parameters(&mut self) -> Result<Vec<Parameter>> {
        let end = Instant::now() + ANSWER;
        let mut rows = BTreeMap::new();
        let mut count = None;
        while Instant::now() < end {
            self.link.send(&request::list_parameters())?;
            let complete = self.wait(LIST_SILENCE, |message| {
                if let MavMessage::PARAM_VALUE(row) = message {
                    let name = row.param_id.to_str().unwrap_or("(not UTF-8)").to_owned();
                    let value = row.param_value;
                    rows.insert(row.param_index, Parameter { name, value });
                    count = Some(usize::from(row.param_count));
                }
                (count == Some(rows.len())).then_some(())
            })?;
            if complete.is_some() {
                return Ok(rows.into_values().collect());
            }
        }
        Err(self.silence("the list of parameters"))
    }

    /// What the vehicle's recorder holds of the last release; nothing if it holds none.
    ///
    /// # Errors
    /// Silence.
    pub fn recording(&mut self) -> Result<Vec<u8>> {
        let whole = Instant::now() + RECORDING;
        let size = loop {
            self.link.send(&request::list_logs())?;
            let size = self.wait(ANSWER, |message| match message {
                MavMessage::LOG_ENTRY(entry) => Some(entry.size as usize),
                _ => None,
            })?;
            match size {
                None => return Err(self.silence("the recording")),
                Some(0) if Instant::now() < whole => {
                    self.wait(RECORDING / 10, |_| None::<()>)?;
                }
                Some(size) => break size,
            }
        };
        let mut bytes = Vec::with_capacity(size);
        let end = Instant::now() + ANSWER;
        while bytes.len() < size {
            if Instant::now() >= end {
                return Err(self.silence("the recording"));
            }
            // From the first byte that is missing.
            let from = bytes.len();
            self.link
                .send(&request::log_data(from as u32, (size - from) as u32))?;
            self.wait(LIST_SILENCE, |message| {
                let MavMessage::LOG_DATA(part) = message else {
                    return None;
                };
                if part.ofs as usize == bytes.len() {
                    bytes.extend(part.data.iter().take(part.count.into()));
                }
                (bytes.len() >= size || part.ofs as usize > bytes.len()).then_some(())
            })?;
        }
        Ok(bytes)
    }

    fn silence(&self, what: &str) -> anyhow::Error {
        anyhow!(
            "no answer about {what} on {} within {} s",
            self.link.name(),
            ANSWER.as_secs()
        )
    }
}

fn unknown_parameter(name: &str) -> anyhow::Error {
    BadInput::new(format!(
        "the vehicle has no parameter {name}; `tvc param list` shows them"
    ))
    .into()
}

/// Another ground station's heartbeat is not the vehicle's.
fn is_vehicle(beat: &HEARTBEAT_DATA) -> bool {
    beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
}
