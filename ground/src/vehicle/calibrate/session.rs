//! A vehicle and the person who holds it: prompts, samples, progress, questions.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Result, bail};
use calibration::prompt::Prompt;
use calibration::{Readings, Sample};
use client::request::status_text;
use client::status::angles;
use client::{Parameter, StateKind};
use mavlink::dialects::common::MavMessage;
use tvc_nano::Axis;

use super::keyboard::{Typed, is_yes};
use super::options::Calibrate;
use super::person::{Person, Question};
use super::readings;
use super::terminal::Terminal;
use super::write::{CHECKED, write};
use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::watch::Watched;
use flights::param_file::{POLARITY, SECOND_POLARITY};

/// How much of the vehicle's time passes between two looks at its samples, s.
const LOOK_S: f64 = 0.2;
/// Silence of the sensor after which waiting has no use.
const SILENCE: Duration = Duration::from_secs(10);
/// How long the vehicle may take to standby.
const STANDBY: Duration = Duration::from_secs(20);

/// What the vehicle last reported of its tilt and rudder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Nose up and right side down, by axis, rad.
    pub tilts_rad: [f64; Axis::COUNT],
    /// Pulses, by axis, us.
    pub pulses_us: [u16; Axis::COUNT],
}

impl Seen {
    fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::ATTITUDE_QUATERNION(q) => {
                let [roll, pitch, _] = angles([q.q1, q.q2, q.q3, q.q4].map(f64::from));
                self.tilts_rad = [pitch, roll];
            }
            MavMessage::SERVO_OUTPUT_RAW(servo) => {
                self.pulses_us = [servo.servo1_raw, servo.servo2_raw];
            }
            _ => {}
        }
    }
}

/// A calibration, or another step of the set-up, under way.
pub struct Session {
    /// The vehicle.
    pub vehicle: Watched,
    /// The person who holds it.
    pub person: Box<dyn Person>,
    /// Set when the person wants an end.
    pub stop: &'static AtomicBool,
    /// Samples so far.
    pub readings: Readings,
    /// Tilt and pulses, as the vehicle reported them last.
    pub seen: Seen,
    /// The answer to every question is yes.
    pub yes: bool,
}

impl Session {
    /// Connects to the vehicle that the options name, with the person at the terminal.
    ///
    /// # Errors
    /// It does not answer, or it is armed.
    pub fn connect(options: &Calibrate) -> Result<Self> {
        let stop = signals::on_signal()?;
        let vehicle = Vehicle::connect(&options.vehicle.port)?;
        let terminal = Terminal::new(options.vehicle.json);
        Self::new(vehicle, Box::new(terminal), stop, options.yes)
    }

    /// A vehicle and a person, who answers yes to every question if `yes` says so.
    ///
    /// # Errors
    /// The vehicle is armed.
    pub fn new(
        vehicle: Vehicle,
        person: Box<dyn Person>,
        stop: &'static AtomicBool,
        yes: bool,
    ) -> Result<Self> {
        let vehicle = Watched::new(vehicle);
        if vehicle.state().is_some_and(StateKind::is_armed) {
            bail!("the vehicle is armed: `tvc disarm` first");
        }
        Ok(Self {
            vehicle,
            person,
            stop,
            readings: Readings::default(),
            seen: Seen::default(),
            yes,
        })
    }

    /// Whether somebody is there and is to be asked.
    pub fn is_attended(&self) -> bool {
        self.person.is_there() && !self.yes
    }

    /// The vehicle's time, s since the first sample.
    pub fn now_s(&self) -> f64 {
        self.readings.length_s()
    }

    /// The samples so far.
    pub fn samples(&self) -> &[Sample] {
        &self.readings.samples
    }

    /// Waits until the vehicle has passed its self-test.
    ///
    /// # Errors
    /// It does not; the error says what it waits for.
    pub fn await_standby(&mut self) -> Result<()> {
        let end = self.vehicle.now() + STANDBY;
        while self.vehicle.state() != Some(StateKind::Standby) {
            self.pump()?;
            if self.vehicle.now() > end {
                bail!("the vehicle does not come to standby: {}", self.vehicle.reason());
            }
        }
        Ok(())
    }

    /// Asks the person for a step, in words and down the link.
    ///
    /// # Errors
    /// The port went away.
    pub fn ask(&mut self, prompt: Prompt, words: &str) -> Result<()> {
        self.person.instruct(words);
        let message = status_text(&prompt.text());
        readings::take(&mut self.readings, &message);
        self.vehicle.link().send(&message)
    }

    /// Shows how far the step is, 0 to 1, and in words.
    pub fn progress(&mut self, share: f64, words: &str) {
        self.person.progress(share, words, None);
    }

    /// Says something that stays in sight.
    pub fn say(&mut self, words: &str) {
        self.person.tell(words, None);
    }

    /// Takes the progress out of sight, and says down the link that nothing more is asked of the
    /// person.
    ///
    /// # Errors
    /// The port went away.
    pub fn done(&mut self) -> Result<()> {
        self.person.rest();
        let message = status_text(&Prompt::Done.text());
        self.vehicle.link().send(&message)
    }

    /// Takes in messages until the vehicle's clock has advanced by [`LOOK_S`].
    ///
    /// # Errors
    /// The port went away, the sensor is silent, or the person wants an end.
    pub fn look(&mut self) -> Result<()> {
        let (end, from_s) = (self.vehicle.now() + SILENCE, self.readings.length_s());
        while self.readings.length_s() - from_s < LOOK_S {
            self.pump()?;
            if self.vehicle.now() > end {
                bail!("no samples from the sensor: {}", self.vehicle.reason());
            }
        }
        Ok(())
    }

    /// Takes in the messages that have arrived.
    ///
    /// # Errors
    /// The port went away, or the person wants an end.
    pub fn pump(&mut self) -> Result<()> {
        for frame in self.vehicle.receive()? {
            readings::take(&mut self.readings, &frame.message);
            self.seen.take(&frame.message);
        }
        self.go_on()
    }

    /// Fails once the person wants an end.
    ///
    /// # Errors
    /// The person wants an end.
    pub fn go_on(&mut self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            self.person.rest();
            bail!("stopped by the operator; nothing was changed");
        }
        Ok(())
    }

    /// What the person answers; until then messages are taken in, and `each` runs again and again.
    /// `None` where nobody answers, or by an empty line.
    ///
    /// # Errors
    /// As [`Self::pump`], or those of `each`.
    pub fn question(
        &mut self,
        question: &Question,
        each: &mut dyn FnMut(&mut Vehicle) -> Result<()>,
    ) -> Result<Option<String>> {
        self.person.ask(question);
        loop {
            match self.person.poll() {
                Typed::Line(line) => return Ok((!line.is_empty()).then_some(line)),
                Typed::Nobody => return Ok(None),
                Typed::Nothing => {}
            }
            self.pump()?;
            each(&mut self.vehicle)?;
        }
    }

    /// Whether the person agrees; nobody there is a no. Not asked if the options have said yes.
    ///
    /// # Errors
    /// As [`Self::pump`].
    pub fn agrees(&mut self, words: &str) -> Result<bool> {
        if self.yes {
            return Ok(true);
        }
        let question = Question::new(words, "[y/N]", &[("Yes", "y"), ("No", "n")]);
        let answer = self.question(&question, &mut |_| Ok(()))?;
        Ok(answer.is_some_and(|answer| is_yes(&answer)))
    }

    /// Writes the parameters into the vehicle and its flash, if the person agrees; how many were
    /// changed, `None` if nothing was written.
    ///
    /// # Errors
    /// As [`Self::pump`] and [`write()`].
    pub fn write_if_agreed(&mut self, rows: &[Parameter]) -> Result<Option<usize>> {
        if self.agrees("Write this to the vehicle, and into its flash?")? {
            write(&mut self.vehicle, rows).map(Some)
        } else {
            Ok(None)
        }
    }

    /// Whether a person has seen every rudder answer the right way, by the vehicle's parameters.
    ///
    /// # Errors
    /// The vehicle does not answer.
    pub fn is_polarity_checked(&mut self) -> Result<bool> {
        let axes = self.vehicle.parameter("AXES")? as usize;
        for polarity in [POLARITY, SECOND_POLARITY].into_iter().take(axes) {
            if self.vehicle.parameter(polarity)? != CHECKED {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// What has become of the vehicle where the person did not agree.
pub const UNCHANGED: &str = "the vehicle is as it was";
