//! The vehicle at the other end of a port, for every command that talks to it.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::Duration;

use anyhow::{Error, Result, anyhow, bail};
use client::request::Order;
use client::{Client, Failure, Frame, Parameter, Request, StateKind, Ticket, request};
use mavlink::dialects::common::MavMessage;

use crate::cli::TOOL;
use crate::vehicle::on_rig::{Asked, OnRig};
use crate::vehicle::port::{Port, PortOptions};
use crate::vehicle::way::Way;
use flights::log::Writer;
use report::exit::BadInput;

/// How long the vehicle may take until its first heartbeat; it sends one a second, and one at once
/// when a port is opened.
const CONNECT: Duration = Duration::from_secs(5);
/// How long a release under way takes until it is recorded.
const RECORDING: Duration = Duration::from_millis(1_500);
/// Time between two looks at the recorder meanwhile.
const LOOK: Duration = Duration::from_millis(150);
/// Longest wait for bytes, so that heartbeats and deadlines are kept.
const SLICE: Duration = Duration::from_millis(20);

/// A [`Client`] at a port or at the rig, on the clock of the vehicle.
pub struct Link {
    way: Box<dyn Way>,
    client: Client,
    log: Option<Writer>,
}

impl Link {
    /// Opens the port that `options` mean, or switches the rig on.
    ///
    /// # Errors
    /// See [`Port::open`] and [`OnRig::new`].
    pub fn open(options: &PortOptions) -> Result<Self> {
        Ok(match &options.rig {
            Some(choice) => Self::at(OnRig::new(choice)?),
            None => Self::at(Port::open(options.port.as_deref())?),
        })
    }

    /// As [`open`](Self::open), in real time in any case, since other programs listen; with the
    /// sender of actions to the rig.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_live(options: &PortOptions) -> Result<(Self, Option<Sender<Asked>>)> {
        let Some(choice) = &options.rig else {
            return Ok((Self::open(options)?, None));
        };
        let (rig, asker) = OnRig::live(choice)?;
        Ok((Self::at(rig), Some(asker)))
    }

    /// A client at an open port.
    pub fn at(way: impl Way + 'static) -> Self {
        Self { way: Box::new(way), client: Client::default(), log: None }
    }

    /// Sends no heartbeats of its own: another ground station does.
    pub fn without_heartbeat(mut self) -> Self {
        self.client = Client::without_heartbeat();
        self
    }

    /// Keeps every frame, both ways, in a log, which begins with the builds of tool and vehicle.
    pub fn log_to(&mut self, log: Writer) {
        self.log = Some(log);
        self.client.send(&request::status_text(TOOL));
        // Its answer is for the log alone.
        self.request(Request::Order(request::VERSION));
    }

    /// Whether a log is kept; not after one could not be written.
    pub fn is_logging(&self) -> bool {
        self.log.is_some()
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
        self.way.name()
    }

    /// The client. What it is asked to send goes out with the next [`Link::flush`].
    pub fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// Asks the vehicle; the [client](Self::client) has the answer later.
    pub fn request(&mut self, request: Request) -> Ticket {
        let now = self.now();
        self.client.request(now, request)
    }

    /// The time by the clock of client and vehicle.
    pub fn now(&self) -> Duration {
        self.way.now()
    }

    /// The board resets: waits until it is back, if it comes back, and knows nothing of it then.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn reopen(&mut self) -> Result<()> {
        self.client = Client::default();
        self.way.reopen()
    }

    /// The way, for what is no message.
    pub fn way(&mut self) -> &mut dyn Way {
        &mut *self.way
    }

    /// The frames that have come, waiting a short while for them.
    ///
    /// # Errors
    /// The port went away, or the log cannot be written.
    pub fn receive(&mut self) -> Result<Vec<Frame>> {
        self.client.poll(self.now());
        self.flush()?;
        let bytes = self.way.read(SLICE)?;
        let frames = self.client.receive(self.now(), &bytes);
        self.log(|log| {
            for frame in &frames {
                log.write(&frame.bytes)?;
            }
            log.flush()
        })?;
        Ok(frames)
    }

    /// Sends what the client has to send.
    ///
    /// # Errors
    /// The port went away or takes nothing, or the log cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        while let Some(frame) = self.client.outgoing() {
            self.send_bytes(&frame)?;
        }
        Ok(())
    }

    /// Sends a message that asks for no answer.
    ///
    /// # Errors
    /// As [`Link::flush`].
    pub fn send(&mut self, message: &MavMessage) -> Result<()> {
        self.client.send(message);
        self.flush()
    }

    /// Sends a frame that another ground station has made.
    ///
    /// # Errors
    /// As [`Link::flush`].
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<()> {
        self.way.write(bytes)?;
        self.log(|log| log.write(bytes))
    }

    /// Writes to the log, if there is one. After an error there is none any more: what is sent
    /// next, an order to disarm perhaps, does not fail because of it.
    fn log(&mut self, write: impl FnOnce(&mut Writer) -> Result<()>) -> Result<()> {
        let written = self.log.as_mut().map_or(Ok(()), write);
        if written.is_err() {
            self.log = None;
        }
        written
    }
}

/// A vehicle that has been heard; its requests wait for their answers.
pub struct Vehicle {
    link: Link,
    /// Ends every wait once it is set.
    stop: Option<&'static AtomicBool>,
}

impl Vehicle {
    /// Opens the port and waits for the vehicle.
    ///
    /// # Errors
    /// No such port, or no heartbeat.
    pub fn connect(options: &PortOptions) -> Result<Self> {
        Self::at(Link::open(options)?)
    }

    /// Waits for the vehicle at a link.
    ///
    /// # Errors
    /// No heartbeat.
    pub fn at(mut link: Link) -> Result<Self> {
        let end = link.now() + CONNECT;
        while link.client.heard().is_none() {
            if link.now() > end {
                bail!(
                    "no heartbeat on {} within {} s: is tvc-nano on the board (tvc flash), and is this its port (tvc info --ports)?",
                    link.name(),
                    CONNECT.as_secs()
                );
            }
            link.receive()?;
        }
        Ok(Self { link, stop: None })
    }

    /// From now on every wait for the vehicle ends with an error once `stop` is set.
    pub fn heed(&mut self, stop: Option<&'static AtomicBool>) {
        self.stop = stop;
    }

    /// The state of the flight by the last heartbeat; `None` for an unknown one.
    pub fn state(&self) -> Option<StateKind> {
        self.link.client.state()
    }

    /// The vehicle's words about its state.
    pub fn reason(&self) -> &str {
        self.link.client.reason()
    }

    /// The time by the vehicle's clock.
    pub fn now(&self) -> Duration {
        self.link.now()
    }

    /// Takes in what comes for so long.
    ///
    /// # Errors
    /// As [`Self::receive`].
    pub fn wait(&mut self, time: Duration) -> Result<()> {
        let until = self.now() + time;
        while self.now() < until {
            self.receive()?;
        }
        Ok(())
    }

    /// The link, to read along.
    pub fn link(&mut self) -> &mut Link {
        &mut self.link
    }

    /// The frames that have come, waiting a short while for them.
    ///
    /// # Errors
    /// The port went away, or the operator wants an end.
    pub fn receive(&mut self) -> Result<Vec<Frame>> {
        if self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            bail!("stopped by the operator");
        }
        self.link.receive()
    }

    /// Gives an order and waits until it is obeyed.
    ///
    /// # Errors
    /// A [`Failure`]: the vehicle refuses, with its reason, or does not answer.
    pub fn command(&mut self, order: Order) -> Result<()> {
        self.request(Request::Order(order), &mut |_| {})
    }

    /// Changes a parameter.
    ///
    /// # Errors
    /// [`BadInput`] with the vehicle's reason if it keeps another value; silence.
    pub fn set_parameter(&mut self, name: &str, value: f32) -> Result<()> {
        self.request(Request::Set(Parameter::new(name, value)), &mut |_| {})
    }

    /// One parameter's value.
    ///
    /// # Errors
    /// [`BadInput`] if the vehicle does not know it; silence.
    pub fn parameter(&mut self, name: &str) -> Result<f32> {
        self.request(Request::Read(name.to_owned()), &mut |_| {})?;
        let value = self.link.client.parameter(name);
        value.ok_or_else(|| anyhow!("no value of {name}"))
    }

    /// Every parameter, in the vehicle's order.
    ///
    /// # Errors
    /// Silence.
    pub fn parameters(&mut self) -> Result<Vec<Parameter>> {
        self.request(Request::List, &mut |_| {})?;
        Ok(self.link.client.parameters().cloned().collect())
    }

    /// Keeps every frame, both ways, in a new log; also asks for every parameter, so that the log
    /// can be replayed.
    ///
    /// # Errors
    /// The log cannot be written; silence.
    pub fn keep_log(&mut self, path: &Path) -> Result<()> {
        self.link.log_to(Writer::create(path, TOOL)?);
        self.parameters().map(drop)
    }

    /// What the vehicle's recorder holds of the last release; nothing if it holds none.
    ///
    /// # Errors
    /// Silence.
    pub fn recording(&mut self) -> Result<Vec<u8>> {
        let whole = self.now() + RECORDING;
        loop {
            self.request(Request::Download, &mut |_| {})?;
            let bytes = self.link.client.recording().to_vec();
            if !bytes.is_empty() || self.now() >= whole {
                return Ok(bytes);
            }
            self.wait(LOOK)?;
        }
    }

    /// Asks and waits for the answer; `each` is called again and again meanwhile, with the time.
    ///
    /// # Errors
    /// As [`Self::command`].
    pub fn request(&mut self, request: Request, each: &mut dyn FnMut(Duration)) -> Result<()> {
        if let Some(mut waited) = self.link.way.request(&request, self.stop) {
            loop {
                // What the vehicle told before its answer has come by then.
                let answer = waited();
                self.receive()?;
                each(self.now());
                if let Some(answer) = answer {
                    return answer
                        .map_err(|refusal| refusal.downcast().map_or_else(|other| other, error));
                }
            }
        }
        let ticket = self.link.request(request);
        loop {
            self.receive()?;
            each(self.now());
            if let Some(answer) = self.link.client.answer(ticket) {
                return answer.map_err(error);
            }
        }
    }
}

/// A failure as the tool tells it: what the person asked for may be what is wrong.
fn error(failure: Failure) -> Error {
    match failure {
        Failure::UnknownParameter(_) => {
            BadInput::new(format!("{failure}; `tvc param list` shows them")).into()
        }
        Failure::Kept { .. } => BadInput::new(failure.to_string()).into(),
        _ => failure.into(),
    }
}
