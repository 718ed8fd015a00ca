//! The desk at which pages give their orders: what each order does, and when it is refused.
//!
//! | order | what it does |
//! |---|---|
//! | `stop` | disarms, whatever its age, and ends a test or a step of the set-up |
//! | `arm`, `release`, `calibrate`, `save`, `reload`, `reset` | the order is given |
//! | `set` with `name` and `value` | a parameter is set |
//! | `write-file` | the note in the answer is the text of a parameter file |
//! | `read-file` with `text` | the note is the file's parameters, a name and a value a line |
//! | `record`, `end-record` | a log begins, ends |
//! | `step`, `hold`, `chirp` | a test begins, of so many `seconds` if they are given |
//! | `rig` with `action` | something is done by hand to the virtual rig |
//! | `set-up` with `step` | a step of the set-up begins |
//! | `answer` with `question` and `reply` | its question is answered |
//! | `cancel` | it ends |
//!
//! A page sends with each order the newest time of this program that it has received. Whatever a
//! network or a busy browser has held back for more than [`FRESH`] is refused, but a `stop` is not.
//!
//! When the last page has been gone for [`ALONE`] and the vehicle was armed from a page, it is
//! disarmed: nobody is left who can press STOP.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, bail, ensure};
use client::request::{self, DISARM};
use client::{Parameter, Request};
use serde::Deserialize;

use super::auth::{Once, Token};
use super::handle::{Answer, Condition, Handle};
use super::model::set_up::Step;
use super::model::{Model, ParameterRow, State, Test};
use super::rig::{self, RigControl};
use super::strangers::Strangers;
use super::vehicle_thread::guard;
use super::{manoeuvre, report, set_up};
use crate::vehicle::test::Manoeuvre;
use flights::param_file;

/// Age from which on an order is refused.
pub const FRESH: Duration = Duration::from_secs(1);
/// How long the vehicle stays armed without a page.
const ALONE: Duration = Duration::from_secs(1);
/// Time until a STOP of this program's own that was not answered is repeated.
const AGAIN: Duration = Duration::from_millis(200);
/// Most pages at the same time.
const PAGES: usize = 32;

/// An order, as a page sends it.
#[derive(Debug, Deserialize)]
pub struct Message {
    /// The page's number for it, which stands in the answer.
    pub id: u64,
    /// The newest time that the page has received, [`Desk::now_ms`].
    heard_ms: u64,
    #[serde(flatten)]
    order: Order,
}

impl Message {
    /// Whether it changes nothing, or is a STOP.
    pub fn is_for_everybody(&self) -> bool {
        matches!(self.order, Order::Stop | Order::WriteFile | Order::ReadFile { .. })
    }

    /// Whether it is a STOP.
    pub fn is_stop(&self) -> bool {
        matches!(self.order, Order::Stop)
    }
}

#[derive(Debug, Deserialize)]
#[serde(tag = "order", rename_all = "kebab-case")]
enum Order {
    Stop,
    Arm,
    Release,
    Calibrate,
    Save,
    Reload,
    Reset,
    Set { name: String, value: f32 },
    WriteFile,
    ReadFile { text: String },
    Record,
    EndRecord,
    Step { seconds: Option<f64> },
    Hold { seconds: Option<f64> },
    Chirp { seconds: Option<f64> },
    Rig { action: String },
    SetUp { step: Step },
    Answer { question: u64, reply: String },
    Cancel,
}

impl Order {
    /// Whether it disturbs no step of the set-up.
    fn goes_with_set_up(&self) -> bool {
        matches!(
            self,
            Self::Stop
                | Self::Answer { .. }
                | Self::Cancel
                | Self::EndRecord
                | Self::WriteFile
                | Self::ReadFile { .. }
                | Self::Rig { .. }
        )
    }
}

/// What becomes of an order: something to know about it, or nothing.
pub type Outcome = Pin<Box<dyn Future<Output = Result<Option<String>>> + Send>>;

/// What the pages share.
pub struct Desk {
    /// Who may give orders.
    pub token: Token,
    /// What the browser that this program opens has instead.
    pub once: Once,
    /// What is known of the vehicle.
    pub model: Arc<Model>,
    /// Connections that have not shown the token.
    pub strangers: Strangers,
    vehicle: Handle,
    rig: RigControl,
    /// Where logs are.
    pub logs: PathBuf,
    /// The program that makes reports.
    reporter: PathBuf,
    /// One report at a time.
    reporting: Mutex<()>,
    /// The program is about to end.
    ending: AtomicBool,
    /// Ends the test, or the step of the set-up, that is under way.
    test_stop: &'static AtomicBool,
    pages: AtomicUsize,
    /// A page has armed the vehicle.
    armed: AtomicBool,
    begun: Instant,
}

impl Desk {
    /// A desk in front of a vehicle, whose logs go to a folder, and which may be a rig. A
    /// `reporter` is this program.
    pub fn new(
        (token, once): (Token, Once),
        vehicle: Handle,
        rig: RigControl,
        logs: PathBuf,
        reporter: PathBuf,
        model: Arc<Model>,
    ) -> Self {
        Self {
            token,
            once,
            model,
            strangers: Strangers::default(),
            vehicle,
            rig,
            logs,
            reporter,
            reporting: Mutex::new(()),
            ending: AtomicBool::new(false),
            // It lives as long as the program, as that of the signals does.
            test_stop: Box::leak(Box::default()),
            pages: AtomicUsize::new(0),
            armed: AtomicBool::new(false),
            begun: Instant::now(),
        }
    }

    /// Time since the start of this program, ms.
    pub fn now_ms(&self) -> u64 {
        self.begun.elapsed().as_millis() as u64
    }

    /// Takes in a page; nothing if there are too many.
    pub fn enter(self: &Arc<Self>) -> Option<Presence> {
        let presence = Presence(self.clone());
        (self.pages.fetch_add(1, Ordering::SeqCst) < PAGES).then_some(presence)
    }

    /// Gives an order to the vehicle at once; what becomes of it comes later.
    pub fn give(&self, message: Message) -> Outcome {
        if message.is_stop() {
            return self.stop();
        }
        let given = self.begin(message.order, message.heard_ms);
        given.unwrap_or_else(|refusal| Box::pin(async { Err(refusal) }))
    }

    /// Ends what is under way, without an order to disarm: that is of who moves the rudder.
    fn end(&self) {
        self.test_stop.store(true, Ordering::SeqCst);
    }

    /// Ends what is under way, since the program is about to end.
    pub fn close(&self) {
        self.ending.store(true, Ordering::SeqCst);
        self.end();
    }

    /// The page of a recording's report.
    ///
    /// # Errors
    /// The vehicle is in operation, another report is being made, or there is none.
    pub fn report(&self, log: &Path) -> Result<Vec<u8>> {
        let Ok(_one) = self.reporting.try_lock() else {
            bail!("another report is being made: try again when it is there");
        };
        report::page(&self.reporter, log, &|| {
            if self.model.lock().status.in_operation {
                return Some("the vehicle is in operation: reports are made when it is disarmed");
            }
            let ending = self.ending.load(Ordering::SeqCst);
            ending.then_some("the program is about to end")
        })
    }

    /// Disarms. A fault that stays is no reason to press again: the rudder rests.
    pub fn stop(&self) -> Outcome {
        self.end();
        let answer = self.vehicle.request(Request::Order(DISARM), Condition::default());
        Box::pin(async {
            let Err(error) = answer.come().await else {
                return Ok(None);
            };
            match error.downcast_ref().and_then(guard::fault_that_stays) {
                Some(fault) => Ok(Some(fault)),
                None => Err(error),
            }
        })
    }

    fn begin(&self, order: Order, heard_ms: u64) -> Result<Outcome> {
        let condition = self.condition(heard_ms)?;
        if !order.goes_with_set_up() {
            not_set_up(&self.model.lock())?;
        }
        let order = match order {
            Order::Stop => request::DISARM,
            Order::Arm => request::ARM,
            Order::Release => request::RELEASE,
            Order::Calibrate => request::CALIBRATE,
            Order::Save => request::SAVE,
            Order::Reload => request::RELOAD,
            Order::Reset => request::RESET,
            Order::Set { name, value } => return self.set(name, value, condition),
            Order::WriteFile => return Ok(done(Some(self.parameter_file()?))),
            Order::ReadFile { text } => return Ok(done(Some(read_file(&text)?))),
            Order::Record => {
                idle(&self.model.lock())?;
                return Ok(once_done(self.vehicle.record(None)));
            }
            Order::EndRecord => return Ok(once_done(self.vehicle.end_recording())),
            Order::Step { seconds } => return self.test(Manoeuvre::STEP.lasting(seconds)?),
            Order::Hold { seconds } => return self.test(Manoeuvre::HOLD.lasting(seconds)?),
            Order::Chirp { seconds } => return self.test(Manoeuvre::CHIRP.lasting(seconds)?),
            Order::Rig { action } => {
                rig::admit(&action)?;
                let rig = self.rig.clone();
                return Ok(Box::pin(async move { rig.act(&action).await.map(|_| None) }));
            }
            Order::SetUp { step } => return self.set_up(step),
            Order::Answer { question, reply } => {
                return self.model.lock().set_up.answer(question, reply).map(|()| done(None));
            }
            Order::Cancel => {
                ensure!(self.model.lock().set_up.running, "nothing is under way");
                self.end();
                return Ok(done(None));
            }
        };
        if order == request::ARM || order == request::RELEASE {
            self.armed.store(true, Ordering::SeqCst);
        }
        Ok(once_done(self.vehicle.request(Request::Order(order), condition)))
    }

    /// Until when an order of a page may be given that has heard of this time.
    fn condition(&self, heard_ms: u64) -> Result<Condition> {
        let heard = Duration::from_millis(heard_ms);
        let age = self
            .begun
            .elapsed()
            .checked_sub(heard)
            .context("this page is of another start of tvc web: load it again")?;
        ensure!(
            age <= FRESH,
            "the order was {:.1} s old and was not given: press again",
            age.as_secs_f64()
        );
        Ok(Condition { until: Some(self.begun + heard + FRESH), unless: None })
    }

    /// Sets a parameter that the vehicle has, to a value that it can have.
    fn set(&self, name: String, value: f32, condition: Condition) -> Result<Outcome> {
        let state = self.model.lock();
        let Some(known) = state.parameters.iter().find(|known| known.row.name == name) else {
            bail!("the vehicle has no parameter of this name");
        };
        known.admit(value)?;
        drop(state);
        let set = Request::Set(Parameter { name, value });
        Ok(once_done(self.vehicle.request(set, condition)))
    }

    /// The text of a parameter file, as `tvc param dump` writes it.
    fn parameter_file(&self) -> Result<String> {
        let state = self.model.lock();
        let rows = state.parameters.iter().map(|ParameterRow { row, .. }| row);
        let rows: Vec<_> = rows.map(|row| Parameter::new(&*row.name, row.value)).collect();
        ensure!(!rows.is_empty(), "the vehicle's parameters are not known yet");
        Ok(param_file::text(&rows))
    }

    /// Begins a test.
    fn test(&self, manoeuvre: Manoeuvre) -> Result<Outcome> {
        let mut state = self.model.lock();
        self.take_rudder(&state)?;
        *state.test = Test { manoeuvre: manoeuvre.name(), running: true, ..Test::default() };
        drop(state);
        let (vehicle, model) = (self.vehicle.clone(), self.model.clone());
        let stop = self.test_stop;
        std::thread::spawn(move || manoeuvre::run(manoeuvre, &vehicle, &model, stop));
        Ok(done(None))
    }

    /// Begins a step of the set-up.
    fn set_up(&self, step: Step) -> Result<Outcome> {
        let mut state = self.model.lock();
        self.take_rudder(&state)?;
        state.set_up.begin(step);
        let (vehicle, model, logs) = (self.vehicle.clone(), self.model.clone(), self.logs.clone());
        let stop = self.test_stop;
        std::thread::spawn(move || set_up::run(step, &vehicle, &model, &logs, stop));
        Ok(done(None))
    }

    /// Something begins that moves the rudder by itself.
    fn take_rudder(&self, state: &State) -> Result<()> {
        idle(state)?;
        ensure!(
            !state.status.in_operation && state.status.connected,
            "the vehicle is not in standby: disarm first"
        );
        self.armed.store(true, Ordering::SeqCst);
        // Cleared before it is shown as running: a STOP after that counts.
        self.test_stop.store(false, Ordering::SeqCst);
        Ok(())
    }

    /// Disarms what pages have armed, if none of them comes back.
    async fn rest_alone(&self) {
        tokio::time::sleep(ALONE).await;
        while self.pages.load(Ordering::SeqCst) == 0 && self.is_flown() {
            if self.stop().await.is_ok() {
                let words = "the last page was closed: disarmed";
                self.model.lock().say(4, words);
                let _ = writeln!(std::io::stderr(), "{words}");
                return;
            }
            tokio::time::sleep(AGAIN).await;
        }
    }

    /// Whether something is under way that a page has begun.
    fn is_flown(&self) -> bool {
        let state = self.model.lock();
        let busy = state.status.in_operation || state.test.running || state.set_up.running;
        self.armed.fetch_and(busy, Ordering::SeqCst) && busy
    }
}

/// A page that is open.
pub struct Presence(Arc<Desk>);

impl Drop for Presence {
    fn drop(&mut self) {
        if self.0.pages.fetch_sub(1, Ordering::SeqCst) == 1 {
            let desk = self.0.clone();
            tokio::spawn(async move { desk.rest_alone().await });
        }
    }
}

/// What a parameter file of any form says, in the form that the page reads.
fn read_file(text: &str) -> Result<String> {
    let file = param_file::parse(text).map_err(Error::msg)?;
    let mut text = param_file::text(&file.rows);
    if file.names_polarity {
        text += &format!("# {}\n", param_file::NO_POLARITY);
    }
    Ok(text)
}

/// What becomes of an order once the answer comes.
fn once_done<T: Send + 'static>(answer: Answer<T>) -> Outcome {
    Box::pin(async { answer.come().await.map(|_| None) })
}

/// An outcome that is there already.
fn done(note: Option<String>) -> Outcome {
    Box::pin(async { Ok(note) })
}

/// Nothing is being recorded or tested.
fn idle(state: &State) -> Result<()> {
    ensure!(!state.test.running, "a test is under way");
    not_set_up(state)?;
    match &state.status.recording {
        Some(path) => bail!("{path} is being recorded: end it first"),
        None => Ok(()),
    }
}

/// No step of the set-up is under way.
fn not_set_up(state: &State) -> Result<()> {
    ensure!(!state.set_up.running, "a step of the set-up is under way: end it first");
    Ok(())
}
