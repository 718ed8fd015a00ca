//! A vehicle at its port and the person who holds it: what is asked, what comes, what is shown.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use client::StateKind;
use client::status::angles;
use indicatif::{ProgressBar, ProgressStyle};
use mavlink::dialects::common::MavMessage;
use rig::instruction::Instruction;
use tvc_nano::calibration::rest::Moment;

use super::keyboard::{Keyboard, Typed};
use super::readings::Readings;
use crate::vehicle::link::Vehicle;

/// How much of the vehicle's time passes between two looks at its samples, s.
const LOOK_S: f64 = 0.2;
/// Silence of the sensor after which there is no use in waiting.
const SILENCE: Duration = Duration::from_secs(10);

/// How long the vehicle may take to standby.
const STANDBY: Duration = Duration::from_secs(20);

/// What the vehicle tells of tilt and rudder.
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

/// A calibration under way.
pub struct Session<'a> {
    /// The vehicle.
    pub vehicle: Vehicle,
    readings: Readings,
    seen: Seen,
    keyboard: Option<Keyboard>,
    bar: ProgressBar,
    stop: &'a AtomicBool,
}

impl<'a> Session<'a> {
    /// At a vehicle that is not flying.
    ///
    /// # Errors
    /// It is armed.
    pub fn begin(vehicle: Vehicle, stop: &'a AtomicBool) -> Result<Self> {
        if vehicle.state().is_some_and(StateKind::is_armed) {
            bail!("the vehicle is armed: `tvc disarm` first");
        }
        let bar = ProgressBar::new(1000);
        if let Ok(style) = ProgressStyle::with_template("{prefix}\n[{bar:40}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Ok(Self {
            vehicle,
            readings: Readings::default(),
            seen: Seen::default(),
            keyboard: None,
            bar,
            stop,
        })
    }

    /// Samples so far.
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// Their moments.
    pub fn moments(&self) -> &[Moment] {
        &self.readings.moments
    }

    /// Waits until the vehicle has passed its self-test.
    ///
    /// # Errors
    /// It does not, with what it waits for.
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

    /// Roll and pitch, rad, and the pulse, us, as the vehicle told them last.
    pub fn seen(&self) -> Seen {
        self.seen
    }

    /// Asks the person for a step, on the screen and down the link.
    ///
    /// # Errors
    /// The port went away.
    pub fn ask(&mut self, instruction: Instruction, words: &str) -> Result<()> {
        self.bar.set_message("");
        self.bar.set_position(0);
        self.bar.set_prefix(words.to_owned());
        if self.bar.is_hidden() {
            eprintln!("{words}");
        }
        let message = instruction.message();
        self.readings.take(&message);
        self.vehicle.link().send(&message)
    }

    /// How far the step is, 0 to 1, and in words.
    pub fn progress(&self, share: f64, words: String) {
        self.bar
            .set_position((share.clamp(0.0, 1.0) * 1000.0) as u64);
        self.bar.set_message(words);
    }

    /// Something that stays on the screen.
    pub fn say(&self, words: &str) {
        self.bar.suspend(|| eprintln!("{words}"));
    }

    /// Nothing more is shown.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// Reads along until the vehicle's clock is a bit further.
    ///
    /// # Errors
    /// The port went away, the sensor is silent, or the person has had enough.
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

    /// Reads what has come.
    ///
    /// # Errors
    /// The port went away, or the person has had enough.
    pub fn pump(&mut self) -> Result<()> {
        for frame in self.vehicle.receive()? {
            self.readings.take(&frame.message);
            self.seen.take(&frame.message);
        }
        self.go_on()
    }

    /// Whether the person has not had enough.
    ///
    /// # Errors
    /// They have.
    pub fn go_on(&self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            self.end();
            bail!("stopped by the operator; nothing was changed");
        }
        Ok(())
    }

    /// What the person types next; the vehicle is listened to meanwhile, and `each` runs every now and then. `None` where
    /// nobody answers.
    ///
    /// # Errors
    /// As [`Self::pump`], or those of `each`.
    pub fn question(
        &mut self,
        words: &str,
        each: &mut dyn FnMut(&mut Vehicle) -> Result<()>,
    ) -> Result<Option<String>> {
        self.bar.suspend(|| eprint!("{words} "));
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

    /// Whether the person agrees; nobody there is a no.
    ///
    /// # Errors
    /// As [`Self::pump`].
    pub fn agrees(&mut self, words: &str) -> Result<bool> {
        let answer = self.question(&format!("{words} [y/N]"), &mut |_| Ok(()))?;
        Ok(answer.is_some_and(|answer| matches!(answer.to_lowercase().as_str(), "y" | "yes")))
    }
}
