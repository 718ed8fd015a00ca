//! A vehicle at its port and the person who holds it: prompts, samples, progress, questions.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use calibration::prompt::Prompt;
use calibration::{Readings, Sample};
use client::Parameter;
use client::StateKind;
use client::request::status_text;
use client::status::angles;
use indicatif::{ProgressBar, ProgressStyle};
use mavlink::dialects::common::MavMessage;

use super::keyboard::{Keyboard, Typed};
use super::options::Calibrate;
use super::readings;
use super::write::write;
use crate::out::exit::Verdict;
use crate::out::file::print;
use crate::signals;
use crate::vehicle::link::Vehicle;
use crate::vehicle::watch::Watched;

/// How much of the vehicle's time passes between two looks at its samples, s.
const LOOK_S: f64 = 0.2;
/// Silence of the sensor after which waiting has no use.
const SILENCE: Duration = Duration::from_secs(10);
/// How long the vehicle may take to standby.
const STANDBY: Duration = Duration::from_secs(20);

/// What the vehicle last reported of its tilt and rudder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Right side down, rad.
    pub roll_rad: f64,
    /// Nose up, rad.
    pub pitch_rad: f64,
    /// Pulse, us.
    pub pulse_us: u16,
}

impl Seen {
    fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::ATTITUDE_QUATERNION(q) => {
                let [roll, pitch, _] = angles([q.q1, q.q2, q.q3, q.q4].map(f64::from));
                (self.roll_rad, self.pitch_rad) = (roll, pitch);
            }
            MavMessage::SERVO_OUTPUT_RAW(servo) => self.pulse_us = servo.servo1_raw,
            _ => {}
        }
    }
}

/// A calibration, or another step of the set-up, under way: begun with [`Session::connect`], and at
/// its end what was found is written with [`Session::write_if_agreed`].
pub struct Session {
    /// The vehicle.
    pub vehicle: Watched,
    /// Set when the person pressed Ctrl-C.
    pub stop: &'static AtomicBool,
    readings: Readings,
    seen: Seen,
    keyboard: Option<Keyboard>,
    bar: ProgressBar,
    /// Yes to every question.
    yes: bool,
}

impl Session {
    /// Connects to the vehicle that the options name.
    ///
    /// # Errors
    /// It does not answer, or it is armed.
    pub fn connect(options: &Calibrate) -> Result<Self> {
        let stop = signals::on_signal()?;
        let vehicle = Watched::new(Vehicle::connect(&options.port.port())?);
        if vehicle.state().is_some_and(StateKind::is_armed) {
            bail!("the vehicle is armed: `tvc disarm` first");
        }
        let bar = ProgressBar::new(1000);
        if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Ok(Self {
            vehicle,
            stop,
            readings: Readings::default(),
            seen: Seen::default(),
            keyboard: None,
            bar,
            yes: options.yes,
        })
    }

    /// Samples so far.
    pub fn readings(&self) -> &Readings {
        &self.readings
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
        let begun = Instant::now();
        while self.vehicle.state() != Some(StateKind::Standby) {
            self.pump()?;
            if begun.elapsed() > STANDBY {
                bail!(
                    "the vehicle does not come to standby: {}",
                    self.vehicle.reason()
                );
            }
        }
        Ok(())
    }

    /// Roll and pitch, rad, and the pulse, us, as the vehicle reported them last.
    pub fn seen(&self) -> Seen {
        self.seen
    }

    /// Asks the person for a step, on the screen and down the link.
    ///
    /// # Errors
    /// The port went away.
    pub fn ask(&mut self, prompt: Prompt, words: &str) -> Result<()> {
        self.say(words);
        let message = status_text(&prompt.text());
        readings::take(&mut self.readings, &message);
        self.vehicle.link().send(&message)
    }

    /// Shows how far the step is, 0 to 1, and in words.
    pub fn progress(&self, share: f64, words: String) {
        if self.bar.is_finished() {
            self.bar.reset();
        }
        self.bar
            .set_position((share.clamp(0.0, 1.0) * 1000.0) as u64);
        self.bar.set_message(words);
    }

    /// Prints a line that stays on the screen.
    pub fn say(&self, words: &str) {
        self.bar.suspend(|| eprintln!("{words}"));
    }

    /// Takes the progress bar off the screen.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// The same, and says down the link that nothing more is asked of the person.
    ///
    /// # Errors
    /// The port went away.
    pub fn done(&mut self) -> Result<()> {
        self.end();
        let message = status_text(&Prompt::Done.text());
        self.vehicle.link().send(&message)
    }

    /// Takes in messages until the vehicle's clock has advanced by [`LOOK_S`].
    ///
    /// # Errors
    /// The port went away, the sensor is silent, or Ctrl-C was pressed.
    pub fn look(&mut self) -> Result<()> {
        let (begun, from_s) = (Instant::now(), self.readings.length_s());
        while self.readings.length_s() - from_s < LOOK_S {
            self.pump()?;
            if begun.elapsed() > SILENCE {
                bail!("no samples from the sensor: {}", self.vehicle.reason());
            }
        }
        Ok(())
    }

    /// Takes in the messages that have arrived.
    ///
    /// # Errors
    /// The port went away, or Ctrl-C was pressed.
    pub fn pump(&mut self) -> Result<()> {
        for frame in self.vehicle.receive()? {
            readings::take(&mut self.readings, &frame.message);
            self.seen.take(&frame.message);
        }
        self.go_on()
    }

    /// Fails once Ctrl-C was pressed.
    ///
    /// # Errors
    /// Ctrl-C was pressed.
    pub fn go_on(&self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            self.end();
            bail!("stopped by the operator; nothing was changed");
        }
        Ok(())
    }

    /// What the person types next; until then messages are taken in, and `each` runs again and
    /// again. `None` where nobody answers.
    ///
    /// # Errors
    /// As [`Self::pump`], or those of `each`.
    pub fn question(
        &mut self,
        words: &str,
        each: &mut dyn FnMut(&mut Vehicle) -> Result<()>,
    ) -> Result<Option<String>> {
        // The bar is off the screen until the next step: the question stands on a line of its own.
        self.bar.finish_and_clear();
        eprint!("{words} ");
        let keyboard = self.keyboard.get_or_insert_with(Keyboard::listen);
        let mut typed = keyboard.poll();
        while typed == Typed::Nothing {
            self.pump()?;
            each(&mut self.vehicle)?;
            if let Some(keyboard) = &self.keyboard {
                typed = keyboard.poll();
            }
        }
        Ok(match typed {
            Typed::Line(line) => Some(line),
            Typed::Nothing | Typed::Nobody => None,
        })
    }

    /// Whether the person agrees; nobody there is a no. Not asked if the options have said yes.
    ///
    /// # Errors
    /// As [`Self::pump`].
    pub fn agrees(&mut self, words: &str) -> Result<bool> {
        if self.yes {
            return Ok(true);
        }
        let answer = self.question(&format!("{words} [y/N]"), &mut |_| Ok(()))?;
        Ok(answer.is_some_and(|answer| matches!(answer.to_lowercase().as_str(), "y" | "yes")))
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

    /// Whether a person has seen the rudder answer the right way, by the vehicle's parameter.
    ///
    /// # Errors
    /// The vehicle does not answer.
    pub fn is_polarity_checked(&mut self) -> Result<bool> {
        Ok(self.vehicle.parameter("SRV_POLARITY")? == 1.0)
    }
}

/// What to do before anything can be armed, as long as nobody has checked the polarity.
pub const NEXT_IS_POLARITY: &str = "next: tvc calibrate polarity, without which nothing is armed";

/// Prints figures that the person is asked about next: on standard output, unless that is kept for
/// JSON.
pub fn print_before_question(text: &str, json: bool) -> Result<()> {
    if json {
        eprint!("{text}");
        Ok(())
    } else {
        print(text)
    }
}

/// How a step ends that may have been refused, and why it was on standard error.
pub fn verdict(refused: Option<&str>) -> Verdict {
    match refused {
        None => Verdict::Met,
        Some(why) => {
            eprintln!("refused: {why}");
            Verdict::Missed
        }
    }
}
