//! The vehicle's end: one thread owns the port, tells what it hears and asks what it is asked to. It never waits for
//! one answer alone, so that a STOP is never behind anything.

use crate::vehicle::port::PortOptions;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::{Duration, Instant};

use anyhow::Result;
use mavlink::dialects::common::{MavMessage, MavResult, SYS_STATUS_DATA};
use rig::link::Frame as Received;
use rig::operator::FlightState;
use rig::request::{self, Order};
use tvc_nano::Params;
use tvc_nano::params::{Change, Range};

use super::shared::{Condition, Frame, Listed, Shared};
use crate::logs::log::Writer;
use crate::vehicle::arm::state_name;
use crate::vehicle::link::{Link, Parameter};
use crate::vehicle::param::Row;
use crate::vehicle::status::{ServoMap, Standing, Tracker};

/// How long an answer may take.
const ANSWER: Duration = Duration::from_secs(3);
/// An order to disarm is said again until it is answered.
const INSIST: Duration = Duration::from_millis(100);
/// Between two looks for a port that went away.
const RETRY: Duration = Duration::from_millis(500);
/// Between two conditions, if nothing changes.
const CONDITION: Duration = Duration::from_millis(250);
/// Between two questions for the time, and for parameters that are missing.
const ASK: Duration = Duration::from_secs(1);
/// Without a heartbeat for so long the vehicle is not there; it sends one a second.
const SILENCE: Duration = Duration::from_secs(3);

/// What came of a request: why not, else.
pub type Answer = Result<(), String>;

/// What the page asks for.
pub enum What {
    /// A command, by its name.
    Order(&'static str, Order),
    /// A command that the flag forbids once it is set.
    Unless(Arc<AtomicBool>, &'static str, Order),
    /// A parameter's new value.
    Set(String, f32),
    /// Keep everything from now on.
    Record(Writer, PathBuf),
    /// End the log.
    EndRecord,
}

struct Ask {
    what: What,
    reply: Sender<Answer>,
}

/// Where requests go.
#[derive(Clone)]
pub struct Station(Sender<Ask>);

impl Station {
    /// The desk, and where its requests come out.
    pub fn new() -> (Self, Requests) {
        let (sender, receiver) = mpsc::channel();
        (Self(sender), Requests(receiver))
    }

    /// Asks and waits for the answer.
    ///
    /// # Errors
    /// The vehicle's reason, or that there was no answer.
    pub fn ask(&self, what: What) -> Answer {
        let (reply, answer) = mpsc::channel();
        let gone = || "the program is about to end".to_owned();
        self.0.send(Ask { what, reply }).map_err(|_| gone())?;
        answer.recv().map_err(|_| gone())?
    }
}

/// Requests that wait to be heard.
pub struct Requests(Receiver<Ask>);

/// What answers a request.
enum Key {
    Command(Order),
    Value(String, f32),
}

/// A request that waits for the vehicle.
struct Pending {
    name: String,
    key: Key,
    until: Instant,
    again: Option<Instant>,
    /// The vehicle's last words since it was asked.
    words: String,
    reply: Sender<Answer>,
}

impl Pending {
    fn end(&self, answer: Answer) {
        // Who asked may be gone.
        let _ = self.reply.send(answer);
    }
}

/// Talks to the vehicle until `stop`; a port that goes away is waited for.
///
/// # Errors
/// None that ends it before; a log that cannot be ended.
pub fn run(
    first: Link,
    port: &PortOptions,
    requests: Requests,
    shared: &Shared,
    stop: &AtomicBool,
) -> Result<()> {
    let mut link = Some(first);
    while !stop.load(Ordering::Relaxed) {
        let problem = match link.take().map_or_else(|| Link::open(port), Ok) {
            Ok(link) => {
                let mut session = Session::new(link, shared);
                let ended = session.run(&requests, stop);
                let closed = session.close();
                match ended {
                    Ok(()) => return closed,
                    Err(gone) => gone,
                }
            }
            Err(error) => error,
        };
        let problem = format!("{problem:#}");
        absent(shared, &problem);
        let next = Instant::now() + RETRY;
        while let Some(rest) = next.checked_duration_since(Instant::now()) {
            if let Ok(ask) = requests.0.recv_timeout(rest) {
                let _ = ask.reply.send(Err(problem.clone()));
            }
        }
    }
    Ok(())
}

/// Tells that nobody is there.
fn absent(shared: &Shared, problem: &str) {
    let mut state = shared.lock();
    if state.condition().connected || state.condition().problem != problem {
        let condition = Condition {
            port: state.condition().port.clone(),
            parameters: state.condition().parameters,
            problem: problem.to_owned(),
            state: "not connected".into(),
            ..Condition::default()
        };
        state.set_condition(condition);
    }
}

/// One port from opening until it goes away.
struct Session<'a> {
    link: Link,
    shared: &'a Shared,
    begun: Instant,
    tracker: Tracker,
    standing: Standing,
    heard: Option<Instant>,
    count: u64,
    health: SYS_STATUS_DATA,
    latency_ms: f64,
    /// The control step that the newest pulse belongs to, us, low half.
    step_us: u32,
    values: BTreeMap<u16, Parameter>,
    expected: Option<u16>,
    params: Params,
    pending: Vec<Pending>,
    recording: Option<PathBuf>,
    round_trip_ms: Option<f64>,
    condition_due: Instant,
    ask_due: Instant,
    list_due: Instant,
}

impl<'a> Session<'a> {
    fn new(link: Link, shared: &'a Shared) -> Self {
        let now = Instant::now();
        let mut condition = shared.lock().condition().clone();
        condition.port = link.name().to_owned();
        condition.problem = "waiting for the vehicle's heartbeat".into();
        condition.connected = false;
        shared.lock().set_condition(condition);
        let params = Params::default();
        Self {
            link,
            shared,
            begun: now,
            tracker: Tracker::new(servo(&params)),
            standing: Standing::default(),
            heard: None,
            count: 0,
            health: SYS_STATUS_DATA::default(),
            latency_ms: 0.0,
            step_us: 0,
            values: BTreeMap::new(),
            expected: None,
            params,
            pending: Vec::new(),
            recording: None,
            round_trip_ms: None,
            condition_due: now,
            ask_due: now,
            list_due: now,
        }
    }

    fn run(&mut self, requests: &Requests, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed) {
            for ask in requests.0.try_iter() {
                self.take(ask)?;
            }
            let frames = self.link.receive()?;
            self.hear(&frames);
            self.keep_asking()?;
            if Instant::now() >= self.condition_due {
                self.tell_condition();
            }
        }
        Ok(())
    }

    /// Whoever still waits learns that the port is gone; the log is made whole.
    fn close(&mut self) -> Result<()> {
        for pending in self.pending.drain(..) {
            pending.end(Err(format!("{}: the port went away", pending.name)));
        }
        self.link.end_log()
    }

    fn take(&mut self, ask: Ask) -> Result<()> {
        match ask.what {
            What::Order(name, order) => self.order(name, order, ask.reply)?,
            What::Unless(forbidden, name, order) => {
                if forbidden.load(Ordering::SeqCst) {
                    let _ = ask.reply.send(Err("stopped by the operator".into()));
                } else {
                    self.order(name, order, ask.reply)?;
                }
            }
            What::Set(name, value) => {
                self.link.send(&request::set_parameter(&name, value))?;
                self.await_answer(name.clone(), Key::Value(name, value), ask.reply);
            }
            What::Record(writer, path) => {
                self.link.log_to(writer);
                self.recording = Some(path);
                // So that the log can be replayed.
                self.link.send(&request::list_parameters())?;
                // Whoever is answered finds it in the condition.
                self.tell_condition();
                let _ = ask.reply.send(Ok(()));
            }
            What::EndRecord => {
                let ended = self.link.end_log().map_err(|error| format!("{error:#}"));
                self.recording = None;
                self.tell_condition();
                let _ = ask.reply.send(ended);
            }
        }
        Ok(())
    }

    fn order(&mut self, name: &'static str, order: Order, reply: Sender<Answer>) -> Result<()> {
        self.link.send(&order.message())?;
        self.await_answer(name.into(), Key::Command(order), reply);
        Ok(())
    }

    fn await_answer(&mut self, name: String, key: Key, reply: Sender<Answer>) {
        let now = Instant::now();
        let insist = matches!(&key, Key::Command(order) if *order == request::DISARM);
        self.pending.push(Pending {
            name,
            key,
            until: now + ANSWER,
            again: insist.then_some(now + INSIST),
            words: String::new(),
            reply,
        });
    }

    fn hear(&mut self, frames: &[Received]) {
        let mut moved = false;
        for frame in frames {
            let before = self.standing.state();
            self.tracker.take(&frame.message);
            self.standing.take(&frame.message);
            if before != self.standing.state() || matches!(frame.message, MavMessage::STATUSTEXT(_))
            {
                self.condition_due = Instant::now();
            }
            moved |= self.hear_one(&frame.message);
        }
        if moved {
            self.shared.lock().frame = self.frame();
        }
    }

    /// Whether the frame for the page is another one now.
    fn hear_one(&mut self, message: &MavMessage) -> bool {
        match message {
            MavMessage::HEARTBEAT(_) => self.heard = Some(Instant::now()),
            MavMessage::ATTITUDE_QUATERNION(_) => {
                self.count += 1;
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
                let text = m.text.to_str().unwrap_or("(not UTF-8)");
                for pending in &mut self.pending {
                    text.clone_into(&mut pending.words);
                }
                let time_s = self.tracker.peek().timestamp;
                let severity = m.severity as u8;
                self.shared.lock().say(time_s, severity, text.to_owned());
            }
            MavMessage::COMMAND_ACK(ack) => {
                self.answer(|pending| match &pending.key {
                    Key::Command(order) if order.command == ack.command => {
                        Some(judged(pending, ack.result))
                    }
                    _ => None,
                });
            }
            MavMessage::PARAM_VALUE(m) => {
                let name = m.param_id.to_str().unwrap_or("(not UTF-8)").to_owned();
                let value = m.param_value;
                self.answer(|pending| match &pending.key {
                    Key::Value(asked, wanted) if *asked == name => set(pending, value, *wanted),
                    _ => None,
                });
                self.keep(m.param_index, m.param_count, Parameter { name, value });
            }
            MavMessage::TIMESYNC(m) if m.tc1 != 0 => {
                let ns = self.begun.elapsed().as_nanos() as i64 - m.ts1;
                self.round_trip_ms = (ns >= 0).then_some(rounded(ns as f64 * 1e-6));
            }
            _ => {}
        }
        false
    }

    /// Ends the first request that `by` answers: the vehicle answers in order.
    fn answer(&mut self, by: impl Fn(&Pending) -> Option<Answer>) {
        let mut found = self.pending.iter().enumerate();
        if let Some((index, answer)) = found.find_map(|(index, p)| Some((index, by(p)?))) {
            self.pending.remove(index).end(answer);
            self.condition_due = Instant::now();
        }
    }

    /// Keeps a parameter's value and tells it once all are known.
    fn keep(&mut self, index: u16, count: u16, parameter: Parameter) {
        self.expected = Some(count);
        self.list_due = Instant::now() + ASK;
        if self.values.get(&index) == Some(&parameter) {
            return;
        }
        // The table is this tool's own: a value that it does not allow is shown as it is, and not used.
        let _ = self.params.set(&parameter.name, parameter.value);
        self.values.insert(index, parameter);
        if self.complete() {
            let rows = self.values.values().map(listed).collect();
            let mut state = self.shared.lock();
            state.parameters = rows;
            let mut condition = state.condition().clone();
            condition.parameters += 1;
            state.set_condition(condition);
        }
    }

    fn complete(&self) -> bool {
        self.expected == u16::try_from(self.values.len()).ok()
    }

    fn keep_asking(&mut self) -> Result<()> {
        let now = Instant::now();
        if !self.complete() && now >= self.list_due && self.heard.is_some() {
            self.list_due = now + ASK;
            self.link.send(&request::list_parameters())?;
        }
        if now >= self.ask_due {
            self.ask_due = now + ASK;
            let ns = self.begun.elapsed().as_nanos() as i64;
            self.link.send(&request::time(ns))?;
        }
        for pending in &mut self.pending {
            if let (Some(again), Key::Command(order)) = (&mut pending.again, &pending.key)
                && now >= *again
            {
                *again = now + INSIST;
                self.link.send(&order.message())?;
            }
        }
        let silent =
            |pending: &Pending| format!("no answer about {} from the vehicle", pending.name);
        self.pending.retain(|pending| {
            let waits = now < pending.until;
            if !waits {
                pending.end(Err(silent(pending)));
            }
            waits
        });
        Ok(())
    }

    fn frame(&self) -> Frame {
        let status = self.tracker.peek();
        Frame {
            time_s: rounded(status.timestamp),
            count: self.count,
            attitude_deg: status.attitude_rad.map(|rad| rounded(rad.to_degrees())),
            rate_deg_s: rounded(f64::from(status.rate_rad_s[1]).to_degrees()),
            servo_deg: rounded(servo(&self.params).angle_rad(status.pulse_us).to_degrees()),
            pulse_us: status.pulse_us,
            set_deg: f64::from(self.params.pitch_set_deg()),
            latency_ms: rounded(self.latency_ms),
            load_pct: rounded(100.0 * status.load),
        }
    }

    fn tell_condition(&mut self) {
        self.condition_due = Instant::now() + CONDITION;
        let status = self.tracker.next(&self.standing, self.link.counts());
        let connected = self.heard.is_some_and(|at| at.elapsed() < SILENCE);
        let problem = match (connected, self.heard) {
            (true, _) => String::new(),
            (false, None) => "waiting for the vehicle's heartbeat".into(),
            (false, Some(at)) => format!(
                "nothing from the vehicle for {} s: does the firmware still run?",
                at.elapsed().as_secs()
            ),
        };
        let mut state = self.shared.lock();
        let condition = Condition {
            port: self.link.name().to_owned(),
            connected,
            problem,
            state: state_name(self.standing.state()),
            reason: status.reason,
            armed: status.armed,
            unhealthy: unhealthy(&self.health),
            attitude_hz: rounded(status.attitude_hz),
            messages: status.messages,
            lost: status.lost,
            crc_errors: status.crc_errors,
            dropped: status.dropped,
            missed: status.missed,
            bus_errors: status.bus_errors,
            round_trip_ms: self.round_trip_ms,
            recording: self
                .recording
                .as_ref()
                .map(|path| path.display().to_string()),
            parameters: state.condition().parameters,
        };
        state.set_condition(condition);
    }
}

/// What an acknowledgement says, with the vehicle's reason.
fn judged(pending: &Pending, result: MavResult) -> Answer {
    match result {
        MavResult::MAV_RESULT_ACCEPTED => Ok(()),
        _ if !pending.words.is_empty() => Err(pending.words.clone()),
        _ => Err(format!("{} refused ({result:?})", pending.name)),
    }
}

/// What a value says to the wish for another. The old one without a reason answers an earlier question.
fn set(pending: &Pending, found: f32, wanted: f32) -> Option<Answer> {
    if found == wanted {
        return Some(Ok(()));
    }
    let name = &pending.name;
    let words = &pending.words;
    (!words.is_empty()).then(|| Err(format!("{name} stays at {found}: {words}")))
}

fn servo(params: &Params) -> ServoMap {
    crate::logs::report::servo_map(params)
}

fn listed(parameter: &Parameter) -> Listed {
    let index = Params::index_of(&parameter.name);
    let info = index.and_then(|index| tvc_nano::params::TABLE.get(index));
    Listed {
        row: Row::of(parameter),
        between: info.and_then(|info| match info.range {
            Range::Between(low, high) => Some([low, high]),
            Range::OneOf(_) => None,
        }),
        choices: info.and_then(|info| match info.range {
            Range::Between(..) => None,
            Range::OneOf(choices) => Some(choices.to_vec()),
        }),
        live: info.is_none_or(|info| info.change == Change::Live),
    }
}

/// What is enabled and not healthy, in words.
fn unhealthy(status: &SYS_STATUS_DATA) -> Vec<String> {
    let enabled = status.onboard_control_sensors_enabled;
    let sick = enabled.difference(status.onboard_control_sensors_health);
    let words = |name: &str| {
        let name = name.trim_start_matches("MAV_SYS_STATUS_");
        name.trim_start_matches("SENSOR_")
            .replace('_', " ")
            .to_lowercase()
    };
    sick.iter_names().map(|(name, _)| words(name)).collect()
}

/// Three decimals are enough to look at.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// Whether the vehicle moves its rudder or is about to.
pub fn is_armed(state: &str) -> bool {
    [
        FlightState::Armed,
        FlightState::Active,
        FlightState::Failsafe,
    ]
    .into_iter()
    .any(|armed| state_name(armed) == state)
}
