//! The thread that owns the port: it publishes what the vehicle tells and gives the page's requests
//! to the client. It waits for no answer, so that nothing is sent before a STOP that was pressed
//! first.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::{Duration, Instant};

use anyhow::{Error, Result, anyhow, bail};
use client::request::{self, Order};
use client::state::is_in_operation;
use client::status::sick;
use client::{Frame, Parameter, Request, ServoMap, StateKind, StatusTracker, Ticket, text};
use mavlink::dialects::common::{MavMessage, SYS_STATUS_DATA};
use tvc_nano::Params;

use super::logs;
use super::model::{Model, Motion, ParameterRow, VehicleStatus};
use crate::vehicle::link::Link;
use crate::vehicle::port::PortOptions;

/// Time between two attempts to open a port that went away.
const RETRY: Duration = Duration::from_millis(500);
/// Time between two status objects, if nothing changes.
const STATUS: Duration = Duration::from_millis(250);
/// Time between two measurements of the round trip.
const ROUND_TRIP: Duration = Duration::from_secs(1);
/// Without a heartbeat for so long the vehicle counts as absent; it sends one a second.
const SILENCE: Duration = Duration::from_secs(3);

/// What the page's threads ask for, and where the answer goes.
pub enum Ask {
    /// A request to the vehicle, which the flag forbids once it is set.
    Request(Request, Option<Arc<AtomicBool>>, Sender<Result<()>>),
    /// A log of this kind from now on; the answer is its path.
    Record(&'static str, Sender<Result<PathBuf>>),
    /// The end of the log.
    EndRecording(Sender<Result<()>>),
}

impl Ask {
    fn refuse(self, why: &str) {
        // Who asked may be gone.
        let _ = match self {
            Self::Request(.., reply) | Self::EndRecording(reply) => {
                reply.send(Err(anyhow!("{why}"))).is_ok()
            }
            Self::Record(_, reply) => reply.send(Err(anyhow!("{why}"))).is_ok(),
        };
    }
}

/// A handle to ask by, for any thread. Every method waits for the answer.
#[derive(Clone)]
pub struct Handle(Sender<Ask>);

impl Handle {
    /// A handle, and the queue from which the port's thread takes what is asked.
    pub fn new() -> (Self, Receiver<Ask>) {
        let (sender, receiver) = mpsc::channel();
        (Self(sender), receiver)
    }

    /// Asks the vehicle.
    ///
    /// # Errors
    /// The vehicle's reason, silence, or a port that went away.
    pub fn request(&self, request: Request) -> Result<()> {
        self.ask(|reply| Ask::Request(request, None, reply))
    }

    /// Gives an order.
    ///
    /// # Errors
    /// As [`Handle::request`].
    pub fn order(&self, order: Order) -> Result<()> {
        self.request(Request::Order(order))
    }

    /// Gives an order, unless the flag is set when its turn comes.
    ///
    /// # Errors
    /// As [`Handle::request`], or the flag is set.
    pub fn guarded(&self, forbidden: &Arc<AtomicBool>, order: Order) -> Result<()> {
        let forbidden = Some(forbidden.clone());
        self.ask(|reply| Ask::Request(Request::Order(order), forbidden, reply))
    }

    /// Begins a log of this kind; its path.
    ///
    /// # Errors
    /// Another log is being written, the folder takes no file, or there is no port.
    pub fn record(&self, kind: &'static str) -> Result<PathBuf> {
        self.ask(|reply| Ask::Record(kind, reply))
    }

    /// Ends the log.
    ///
    /// # Errors
    /// It cannot be written, or there is no port.
    pub fn end_recording(&self) -> Result<()> {
        self.ask(Ask::EndRecording)
    }

    fn ask<T>(&self, ask: impl FnOnce(Sender<Result<T>>) -> Ask) -> Result<T> {
        let (reply, answer) = mpsc::channel();
        let ended = || anyhow!("the program is about to end");
        self.0.send(ask(reply)).map_err(|_| ended())?;
        answer.recv().map_err(|_| ended())?
    }
}

/// Talks to the vehicle until `stop`; a port that goes away is waited for. Logs go to the folder
/// `logs`.
///
/// # Errors
/// A log that cannot be ended.
pub fn run(
    first: Link,
    port: &PortOptions,
    asks: Receiver<Ask>,
    model: &Model,
    logs: &Path,
    stop: &AtomicBool,
) -> Result<()> {
    let mut link = Some(first);
    while !stop.load(Ordering::Relaxed) {
        let problem = match link.take().map_or_else(|| Link::open(port), Ok) {
            Ok(link) => {
                let mut session = Session::new(link, model, logs);
                let ended = session.run(&asks, stop);
                let closed = session.close();
                match ended {
                    Ok(()) => return closed,
                    Err(gone) => gone,
                }
            }
            Err(error) => error,
        };
        let problem = format!("{problem:#}");
        publish_absence(model, &problem);
        let next = Instant::now() + RETRY;
        while let Some(rest) = next.checked_duration_since(Instant::now()) {
            if let Ok(ask) = asks.recv_timeout(rest) {
                ask.refuse(&problem);
            }
        }
    }
    Ok(())
}

/// Publishes that there is no port.
fn publish_absence(model: &Model, problem: &str) {
    let mut state = model.lock();
    if state.status().connected || state.status().problem != problem {
        let status = VehicleStatus {
            port: state.status().port.clone(),
            parameters: state.status().parameters,
            problem: problem.to_owned(),
            state: "not connected".into(),
            ..VehicleStatus::default()
        };
        state.set_status(status);
    }
}

/// One port from opening until it goes away.
struct Session<'a> {
    link: Link,
    model: &'a Model,
    logs: &'a Path,
    tracker: StatusTracker,
    state: Option<StateKind>,
    /// Attitudes that have come.
    attitudes: u64,
    health: SYS_STATUS_DATA,
    latency_ms: f64,
    /// Time of the newest pulse's control step, us, low 32 bits.
    step_us: u32,
    params: Params,
    /// The parameters that the page has.
    published: Vec<Parameter>,
    /// The list that has been asked for.
    list: Option<Ticket>,
    pending: Vec<(Ticket, Sender<Result<()>>)>,
    recording: Option<PathBuf>,
    round_trip_ms: Option<f64>,
    round_trip_due: Duration,
    status_due: Duration,
}

impl<'a> Session<'a> {
    fn new(mut link: Link, model: &'a Model, logs: &'a Path) -> Self {
        let mut status = model.lock().status().clone();
        status.port = link.name().to_owned();
        status.problem = "waiting for the vehicle's heartbeat".into();
        status.connected = false;
        model.lock().set_status(status);
        let params = Params::default();
        Self {
            model,
            logs,
            tracker: StatusTracker::new(ServoMap::of(&params)),
            state: link.client().state(),
            attitudes: 0,
            health: SYS_STATUS_DATA::default(),
            latency_ms: 0.0,
            step_us: 0,
            params,
            published: Vec::new(),
            list: None,
            pending: Vec::new(),
            recording: None,
            round_trip_ms: None,
            round_trip_due: Duration::ZERO,
            status_due: Duration::ZERO,
            link,
        }
    }

    fn run(&mut self, asks: &Receiver<Ask>, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed) {
            for ask in asks.try_iter() {
                self.take(ask)?;
            }
            let frames = self.link.receive()?;
            self.on_frames(&frames);
            self.answer();
            self.ask_the_vehicle();
            if self.link.now() >= self.status_due {
                self.publish_status();
            }
        }
        Ok(())
    }

    /// Whoever still waits learns that the port is gone; the log is ended.
    fn close(&mut self) -> Result<()> {
        self.link.client().close();
        self.answer();
        self.link.end_log()
    }

    fn take(&mut self, ask: Ask) -> Result<()> {
        match ask {
            Ask::Request(_, Some(ref forbidden), _) if forbidden.load(Ordering::SeqCst) => {
                ask.refuse("stopped by the operator");
            }
            Ask::Request(request, _, reply) => {
                let ticket = self.request(request);
                self.pending.push((ticket, reply));
            }
            Ask::Record(kind, reply) => {
                let begun = self.record(kind);
                // Whoever is answered finds it in the status.
                self.publish_status();
                let _ = reply.send(begun);
            }
            Ask::EndRecording(reply) => {
                let ended = self.link.end_log();
                self.recording = None;
                self.publish_status();
                let _ = reply.send(ended);
            }
        }
        self.link.flush()
    }

    fn request(&mut self, request: Request) -> Ticket {
        let now = self.link.now();
        self.link.client().request(now, request)
    }

    fn record(&mut self, kind: &str) -> Result<PathBuf> {
        if let Some(path) = &self.recording {
            bail!("{} is being recorded: end it first", path.display());
        }
        let (log, path) = logs::create(self.logs, kind)?;
        self.link.log_to(log);
        self.recording = Some(path.clone());
        // So that the log can be replayed.
        self.list = Some(self.request(Request::List));
        Ok(path)
    }

    /// Hands over the answers that have come.
    fn answer(&mut self) {
        let client = self.link.client();
        let waiting = self.pending.len();
        self.pending
            .retain(|(ticket, reply)| match client.answer(*ticket) {
                Some(answer) => {
                    // Who asked may be gone.
                    let _ = reply.send(answer.map_err(Error::from));
                    false
                }
                None => true,
            });
        if self.list.is_some_and(|list| client.answer(list).is_some()) {
            self.list = None;
        }
        if self.pending.len() < waiting {
            self.status_due = Duration::ZERO;
        }
    }

    /// Asks for the parameters until all are known, and for the round trip now and then.
    fn ask_the_vehicle(&mut self) {
        let now = self.link.now();
        let client = self.link.client();
        if self.list.is_none() && client.heard().is_some() && !client.has_all_parameters() {
            self.list = Some(client.request(now, Request::List));
        }
        if now >= self.round_trip_due {
            self.round_trip_due = now + ROUND_TRIP;
            client.send(&request::time(now.as_nanos() as i64));
        }
    }

    fn on_frames(&mut self, frames: &[Frame]) {
        let mut moved = false;
        for frame in frames {
            self.tracker.take(&frame.message);
            moved |= self.on_message(&frame.message);
        }
        let state = self.link.client().state();
        if self.state != state {
            self.state = state;
            self.status_due = Duration::ZERO;
        }
        if moved {
            self.model.lock().motion = self.motion();
        }
    }

    /// Whether the page's frame has changed.
    fn on_message(&mut self, message: &MavMessage) -> bool {
        match message {
            MavMessage::ATTITUDE_QUATERNION(_) => {
                self.attitudes += 1;
                return true;
            }
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                self.step_us = m.time_usec;
                return true;
            }
            MavMessage::RAW_IMU(m) => {
                // Both are the vehicle's clock; the pulse's has 32 bits.
                let age_us = self.step_us.wrapping_sub(m.time_usec as u32);
                self.latency_ms = f64::from(age_us) * 1e-3;
                return true;
            }
            MavMessage::SYS_STATUS(m) => self.health = m.clone(),
            MavMessage::STATUSTEXT(m) => {
                let time_s = self.tracker.peek().timestamp;
                let words = text(&m.text).to_owned();
                self.model.lock().add_text(time_s, m.severity as u8, words);
                self.status_due = Duration::ZERO;
            }
            MavMessage::PARAM_VALUE(m) => {
                // The table is this tool's own: a value that it does not allow is shown as it is,
                // and not used.
                let _ = self.params.set(text(&m.param_id), m.param_value);
                self.publish_parameters();
            }
            MavMessage::TIMESYNC(m) if m.tc1 != 0 => {
                let ns = self.link.now().as_nanos() as i64 - m.ts1;
                self.round_trip_ms = (ns >= 0).then_some(rounded(ns as f64 * 1e-6));
            }
            _ => {}
        }
        false
    }

    /// Publishes the parameters, if all are known and one of them has changed.
    fn publish_parameters(&mut self) {
        let client = self.link.client();
        if client.has_all_parameters() && !client.parameters().eq(&self.published) {
            self.published = client.parameters().cloned().collect();
            let mut state = self.model.lock();
            state.parameters = self.published.iter().map(ParameterRow::of).collect();
            let mut status = state.status().clone();
            status.parameters += 1;
            state.set_status(status);
        }
    }

    fn motion(&self) -> Motion {
        let status = self.tracker.peek();
        let servo_rad = ServoMap::of(&self.params).angle_rad(status.pulse_us);
        Motion {
            time_s: rounded(status.timestamp),
            count: self.attitudes,
            attitude_deg: status.attitude_rad.map(|rad| rounded(rad.to_degrees())),
            rate_deg_s: rounded(f64::from(status.rate_rad_s[1]).to_degrees()),
            servo_deg: rounded(servo_rad.to_degrees()),
            pulse_us: status.pulse_us,
            set_deg: f64::from(self.params.pitch_set_deg()),
            latency_ms: rounded(self.latency_ms),
            load_pct: rounded(100.0 * status.health.load.unwrap_or_default()),
        }
    }

    fn publish_status(&mut self) {
        let now = self.link.now();
        self.status_due = now + STATUS;
        let status = self.tracker.next(self.link.client());
        let silence = self.link.client().heard().map(|at| now - at);
        let problem = match silence {
            Some(silence) if silence < SILENCE => String::new(),
            None => "waiting for the vehicle's heartbeat".into(),
            Some(silence) => format!(
                "nothing from the vehicle for {} s: does the firmware still run?",
                silence.as_secs()
            ),
        };
        let flight = self.link.client().state();
        let mut state = self.model.lock();
        let status = VehicleStatus {
            port: self.link.name().to_owned(),
            connected: problem.is_empty(),
            problem,
            flight,
            state: status.state,
            reason: status.reason,
            armed: status.armed,
            in_operation: flight.is_some_and(is_in_operation),
            can_release: flight == Some(StateKind::Armed),
            unhealthy: unhealthy(&self.health),
            health: status.health,
            round_trip_ms: self.round_trip_ms,
            recording: self
                .recording
                .as_ref()
                .map(|path| path.display().to_string()),
            parameters: state.status().parameters,
        };
        state.set_status(status);
    }
}

/// What is enabled and not healthy, in words.
fn unhealthy(status: &SYS_STATUS_DATA) -> Vec<String> {
    let words = |name: &str| {
        let name = name.trim_start_matches("MAV_SYS_STATUS_");
        name.trim_start_matches("SENSOR_")
            .replace('_', " ")
            .to_lowercase()
    };
    sick(status)
        .iter_names()
        .map(|(name, _)| words(name))
        .collect()
}

/// Three decimals are enough to look at.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::vehicle::port::Port;
    use serialport::TTYPort;

    /// The vehicle's end of a cable, and a session at the other.
    fn session<'a>(model: &'a Model, logs: &'a Path) -> (TTYPort, Session<'a>) {
        let (vehicle, port) = TTYPort::pair().unwrap();
        let link = Link::at(Port::at(Box::new(port), "cable".into()));
        (vehicle, Session::new(link, model, logs))
    }

    #[test]
    fn a_stop_pressed_as_the_cable_goes_is_told_that_the_port_is_gone() {
        let model = Model::default();
        let (vehicle, mut session) = session(&model, Path::new("."));
        drop(vehicle);
        let (reply, answer) = mpsc::channel();
        let stop = Request::Order(request::DISARM);
        let gone = session.take(Ask::Request(stop, None, reply)).unwrap_err();
        assert!(gone.to_string().contains("went away"), "{gone}");
        session.close().unwrap();
        let failure = answer.recv().unwrap().unwrap_err();
        assert_eq!(failure.to_string(), "disarm: the port went away");
    }

    #[test]
    fn of_two_pages_that_record_one_does_and_it_ends_though_the_vehicle_is_silent() {
        let folder = tempfile::tempdir().unwrap();
        let model = Model::default();
        let (_vehicle, mut session) = session(&model, folder.path());
        let mut record = || {
            let (reply, answer) = mpsc::channel();
            session.take(Ask::Record("flight", reply)).unwrap();
            answer.recv().unwrap()
        };
        let path = record().unwrap();
        let refusal = record().unwrap_err().to_string();
        assert!(refusal.contains("end it first"), "{refusal}");
        let files = std::fs::read_dir(folder.path()).unwrap();
        assert_eq!(files.count(), 1, "a refused recording leaves no file");
        let recording = model.lock().status().recording.clone();
        assert_eq!(recording.as_deref(), path.to_str());
        let (reply, answer) = mpsc::channel();
        session.take(Ask::EndRecording(reply)).unwrap();
        answer.recv().unwrap().unwrap();
        assert_eq!(model.lock().status().recording, None);
        // What was asked for at its beginning is in it.
        assert!(std::fs::metadata(path).unwrap().len() > 0);
    }
}
