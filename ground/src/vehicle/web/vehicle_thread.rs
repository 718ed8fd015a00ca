//! The thread that owns the port: it publishes what the vehicle tells and gives the pages' requests
//! to the client. It waits for no answer, so that nothing is sent before a STOP that was pressed
//! first.

pub mod guard;
mod publish;
mod readiness;
mod stored;
#[cfg(all(test, unix))]
mod tests;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

use anyhow::{Error, Result, anyhow, bail};
use client::request::{self, DISARM, RELOAD, RESET, SAVE};
use client::state::is_in_operation;
use client::{Frame, Request, ServoMap, StateKind, StatusTracker, Ticket};
use mavlink::dialects::common::{MavMessage, SYS_STATUS_DATA};
use tvc_nano::{Axis, Params};

use super::handle::{Ask, Condition, Reply};
use super::logs;
use super::model::{Model, VehicleStatus};
use super::releases::Releases;
use crate::vehicle::link::Link;
use crate::vehicle::port::PortOptions;
use crate::vehicle::watch::FS_HOST;
use guard::HostWatch;
use readiness::Readiness;
use stored::Stored;

/// Time between two attempts to open a port that went away.
const RETRY: Duration = Duration::from_millis(500);
/// Time between two status objects, if nothing changes, and between two lists of parameters, even
/// if they do: a chirp changes one fifty times a second.
const STATUS: Duration = Duration::from_millis(250);
/// Time between two measurements of the round trip.
const ROUND_TRIP: Duration = Duration::from_secs(1);
/// Without a heartbeat for so long the vehicle counts as absent; it sends one a second.
const SILENCE: Duration = Duration::from_secs(3);

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
    // A vehicle whose cable alone was out keeps its watch.
    let mut host = HostWatch::default();
    // The port went away while the vehicle was armed.
    let mut left_armed = false;
    while !stop.load(Ordering::Relaxed) {
        let open = || Link::open_live(port).map(|(link, _)| link);
        let problem = match link.take().map_or_else(open, Ok) {
            Ok(link) => {
                let mut session = Session::new(link, model, logs);
                session.host = host.at_new_port();
                let Err(gone) = session.run(&asks, stop) else {
                    session.rest();
                    return session.close();
                };
                host = std::mem::take(&mut session.host);
                left_armed = session.is_in_operation();
                session.close()?;
                gone
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
    if left_armed {
        guard::say("the port went away while the vehicle was armed: it was not disarmed from here");
    }
    Ok(())
}

/// Takes what comes by this link into the model until the link ends; no page asks for anything.
pub fn hear(link: Link, model: &Model) {
    let (_keep, asks) = super::handle::Handle::new();
    let mut session = Session::new(link, model, Path::new("."));
    while session.turn(&asks).is_ok() {}
    session.publish_status();
}

/// Publishes that there is no port.
fn publish_absence(model: &Model, problem: &str) {
    let mut state = model.lock();
    if state.status.connected || state.status.problem != problem {
        let status = VehicleStatus {
            port: state.status.port.clone(),
            recording_failure: state.status.recording_failure.clone(),
            problem: problem.to_owned(),
            state: "not connected".into(),
            ..VehicleStatus::default()
        };
        *state.status = status;
    }
}

/// A request without its answer, and who waits for it.
struct Waiting {
    ticket: Ticket,
    condition: Condition,
    replies: Vec<Reply<()>>,
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
    stored: Stored,
    readiness: Readiness,
    releases: Releases,
    /// The list that has been asked for.
    list: Option<Ticket>,
    waiting: Vec<Waiting>,
    /// The STOP that waits for its answer: nothing else is ordered before.
    stopping: Option<Ticket>,
    /// The order about stored parameters that waits for its answer.
    storing: Option<Ticket>,
    host: HostWatch,
    /// Who hears every frame of the vehicle.
    listeners: Vec<Sender<Vec<u8>>>,
    /// Its newest heartbeat, in bytes.
    beat: Vec<u8>,
    recording: Option<PathBuf>,
    /// Why the last recording ended before its time.
    recording_failure: Option<String>,
    round_trip_ms: Option<f64>,
    round_trip_due: Duration,
    status_due: Duration,
    parameters_due: Duration,
}

impl<'a> Session<'a> {
    fn new(mut link: Link, model: &'a Model, logs: &'a Path) -> Self {
        let mut status = model.lock().status.clone();
        status.port = link.name().to_owned();
        let recording_failure = status.recording_failure.clone();
        status.problem = "waiting for the vehicle's heartbeat".into();
        status.connected = false;
        *model.lock().status = status;
        let params = Params::default();
        Self {
            model,
            logs,
            tracker: StatusTracker::new(Axis::ALL.map(|axis| ServoMap::of(&params, axis))),
            state: link.client().state(),
            attitudes: 0,
            health: SYS_STATUS_DATA::default(),
            latency_ms: 0.0,
            step_us: 0,
            params,
            stored: Stored::default(),
            readiness: Readiness::default(),
            releases: Releases::default(),
            list: None,
            waiting: Vec::new(),
            stopping: None,
            storing: None,
            host: HostWatch::default(),
            listeners: Vec::new(),
            beat: Vec::new(),
            recording: None,
            recording_failure,
            round_trip_ms: None,
            round_trip_due: Duration::ZERO,
            status_due: Duration::ZERO,
            parameters_due: Duration::ZERO,
            link,
        }
    }

    fn run(&mut self, asks: &Receiver<Ask>, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed) {
            self.turn(asks)?;
        }
        self.await_listeners(asks)
    }

    /// Does what is due, once.
    fn turn(&mut self, asks: &Receiver<Ask>) -> Result<()> {
        for ask in asks.try_iter() {
            self.take(ask)?;
        }
        let received = self.link.receive();
        let frames = self.without_log(received)?.unwrap_or_default();
        // Before any answer: who listens has heard what an answer speaks of.
        self.pass_on(&frames);
        self.on_frames(&frames);
        self.answer();
        self.ask_the_vehicle();
        self.watch_host();
        self.ask_readiness();
        self.ask_stored();
        self.publish_parameters();
        if self.link.now() >= self.status_due {
            self.publish_status();
        }
        Ok(())
    }

    fn pass_on(&mut self, frames: &[Frame]) {
        for frame in frames {
            if matches!(frame.message, MavMessage::HEARTBEAT(_)) {
                self.beat = frame.bytes.clone();
            }
            let listeners = &mut self.listeners;
            listeners.retain(|listener| listener.send(frame.bytes.clone()).is_ok());
        }
    }

    /// Whoever still waits learns that the port is gone; the log is ended.
    fn close(&mut self) -> Result<()> {
        self.link.client().close();
        self.answer();
        self.link.end_log()
    }

    fn is_in_operation(&mut self) -> bool {
        self.link.client().state().is_some_and(is_in_operation)
    }

    fn take(&mut self, ask: Ask) -> Result<()> {
        match ask {
            Ask::Request(request, condition, reply) => self.take_request(request, condition, reply),
            Ask::Record(test, reply) => {
                let begun = self.record(test);
                // Whoever is answered finds it in the status.
                self.publish_status();
                let _ = reply.send(begun);
            }
            Ask::EndRecording(reply) => {
                let ended = self.end_recording();
                self.publish_status();
                let _ = reply.send(ended);
            }
            Ask::Listen(listener) => {
                // Whoever listens knows the state at once.
                let _ = listener.send(self.beat.clone());
                self.listeners.push(listener);
            }
            Ask::Send(bytes) => {
                let sent = self.link.send_bytes(&bytes);
                self.without_log(sent)?;
            }
        }
        let flushed = self.link.flush();
        self.without_log(flushed).map(drop)
    }

    /// Gives a request to the client. Whoever presses STOP again waits for the same answer; nothing
    /// else is ordered until it has come.
    fn take_request(&mut self, request: Request, condition: Condition, reply: Reply<()>) {
        let is_stop = request == Request::Order(DISARM);
        let is_order = matches!(request, Request::Order(_));
        let refusal = match condition.refusal() {
            None if !is_stop && is_order && self.stopping.is_some() => {
                Some("a STOP waits for its answer")
            }
            refusal => refusal,
        };
        if let Some(why) = refusal {
            // Who asked may be gone.
            let _ = reply.send(Err(anyhow!("{why}")));
            return;
        }
        let stopping = self.stopping.filter(|_| is_stop);
        let mut waiting = self.waiting.iter_mut();
        if let Some(stop) = waiting.find(|waiting| Some(waiting.ticket) == stopping) {
            return stop.replies.push(reply);
        }
        self.host.before(&request);
        let stores = [SAVE, RELOAD, RESET].map(Request::Order);
        if request == stores[0] && self.host.is_on() {
            // What is stored is not this program's.
            self.link.request(guard::set(FS_HOST, 0.0));
        }
        let stores = stores.contains(&request);
        let ticket = self.link.request(request);
        if is_stop {
            self.stopping = Some(ticket);
            if let Some(end) = self.end_of_polarity_check() {
                self.link.request(end);
            }
        }
        if stores {
            self.storing = Some(ticket);
        }
        self.waiting.push(Waiting { ticket, condition, replies: vec![reply] });
    }

    fn record(&mut self, test: Option<&str>) -> Result<PathBuf> {
        if let Some(path) = &self.recording {
            bail!("{} is being recorded: end it first", path.display());
        }
        let (log, path) = logs::create(self.logs, test.unwrap_or("flight"))?;
        self.link.log_to(log);
        self.recording = Some(path.clone());
        self.recording_failure = None;
        // So that the log can be replayed: all parameters, and an estimate whose past is known; a
        // test begins it anew by itself. A refusal is a text of the vehicle, which the page shows.
        self.list = Some(self.link.request(Request::List));
        if test.is_none() && !self.is_in_operation() {
            self.link.request(Request::Order(request::CALIBRATE));
        }
        Ok(path)
    }

    fn end_recording(&mut self) -> Result<()> {
        match (self.recording.take(), &self.recording_failure) {
            (None, Some(why)) => bail!("{why}"),
            _ => self.link.end_log(),
        }
    }

    /// What was done at the link, where no more failed than the log: the vehicle has been told, and
    /// the link goes on without a log.
    fn without_log<T>(&mut self, done: Result<T>) -> Result<Option<T>> {
        match done {
            Err(error) if self.recording.is_some() && !self.link.is_logging() => {
                self.recording = None;
                self.recording_failure = Some(format!("the recording ended: {error:#}"));
                self.status_due = Duration::ZERO;
                Ok(None)
            }
            done => done.map(Some),
        }
    }

    /// Hands over the answers that have come.
    fn answer(&mut self) {
        let client = self.link.client();
        let mut told = false;
        for waiting in &mut self.waiting {
            if let Some(answer) = client.answer(waiting.ticket) {
                for reply in waiting.replies.drain(..) {
                    // Who asked may be gone.
                    told |= reply.send(answer.clone().map_err(Error::from)).is_ok();
                }
            } else if waiting.condition.is_over() {
                client.repeat_no_more(waiting.ticket);
            }
        }
        self.waiting.retain(|waiting| !waiting.replies.is_empty());
        let waits = |ticket: &Ticket| self.waiting.iter().any(|other| other.ticket == *ticket);
        self.stopping = self.stopping.filter(waits);
        let stored = self.storing.is_some();
        self.storing = self.storing.filter(waits);
        if stored && self.storing.is_none() {
            // Both may have changed.
            self.stored.read_anew();
            self.list = Some(self.link.request(Request::List));
        }
        let client = self.link.client();
        if self.list.is_some_and(|list| client.answer(list).is_some()) {
            self.list = None;
        }
        if told {
            self.status_due = Duration::ZERO;
        }
    }

    /// Asks for the parameters until all are known, and for the round trip now and then.
    fn ask_the_vehicle(&mut self) {
        let now = self.link.now();
        let client = self.link.client();
        if self.list.is_none() && client.heard().is_some() && !client.has_all_parameters() {
            self.list = Some(self.link.request(Request::List));
        }
        if now >= self.round_trip_due {
            self.round_trip_due = now + ROUND_TRIP;
            self.link.client().send(&request::time(now.as_nanos() as i64));
        }
    }
}
