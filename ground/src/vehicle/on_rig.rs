//! The virtual rig in this process as a way to the vehicle (`--rig`): no pseudo-terminal, no second
//! program, and no waiting where nobody watches.

use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use ::rig::Ticks;
use ::rig::attended::Attended;
use anyhow::{Context, Result};
use clap::Parser;

use super::way::Way;
use crate::flight::rig::RigChoice;

/// How long the rig runs between two looks at its port.
const SLICE: Ticks = Ticks::from_ms(1);
/// Time from power-on until a command finds the vehicle: it has passed its self-test.
const WARM: Ticks = Ticks::from_ms(10_000);
/// How far the rig may lag behind real time and still catch up.
const MOST_LAG: Duration = Duration::from_millis(200);
/// Time in which a chip that was reset is back at its port.
const RETURN: Duration = Duration::from_secs(3);

/// The options of `tvc rig` in one word.
#[derive(Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Words {
    #[command(flatten)]
    choice: RigChoice,
}

/// The rig that options of `tvc rig` in one word describe.
///
/// # Errors
/// What is wrong with them.
pub fn choice(words: &str) -> Result<RigChoice, String> {
    let words = shlex::split(words).ok_or("a quotation mark is missing")?;
    let parsed = Words::try_parse_from(words).map_err(|error| {
        let words = error.to_string();
        let line = words.lines().next().unwrap_or_default();
        line.trim_start_matches("error: ").to_owned()
    });
    parsed.map(|words| words.choice)
}

/// An action that the rig is asked for, and who waits for the answer.
pub type Asked = (String, Sender<String>);

/// The rig.
pub struct OnRig {
    attended: Attended,
    choice: RigChoice,
    /// Times as fast as real time; without it as fast as it can.
    speed: Option<f64>,
    /// When the rig's clock is to have come to where it is.
    due: Instant,
    actions: Option<Receiver<Asked>>,
    /// Bytes that have not been sent yet.
    typed: Vec<u8>,
}

impl OnRig {
    /// A rig that was switched on ten seconds ago. It runs in real time where somebody watches.
    ///
    /// # Errors
    /// A choice that does not fit, or the rig stopped.
    pub fn new(choice: &RigChoice) -> Result<Self> {
        let mut attended = choice.attended()?;
        while attended.rig.now() < WARM {
            let told = attended.run_for(SLICE, &[], &mut |_, _| {});
            told.context("the rig")?;
        }
        let real_time = std::io::stderr().is_terminal().then_some(1.0);
        Ok(Self {
            attended,
            choice: choice.clone(),
            speed: choice.speed.or(real_time),
            due: Instant::now(),
            actions: None,
            typed: Vec::new(),
        })
    }

    /// As [`new`](Self::new), in real time in any case, and it does what the sender asks for.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn live(choice: &RigChoice) -> Result<(Self, Sender<Asked>)> {
        let (asker, actions) = channel();
        let mut rig = Self::new(choice)?;
        rig.speed.get_or_insert(1.0);
        rig.actions = Some(actions);
        Ok((rig, asker))
    }

    /// Runs for a slice; the bytes that the image has sent.
    fn slice(&mut self) -> Result<Vec<u8>> {
        let is_watched = self.speed.is_some();
        let report = &mut |at_s: f64, line: &str| {
            if is_watched {
                eprintln!("{at_s:9.3} s  {line}");
            }
        };
        for (line, answer) in self.actions.iter().flat_map(Receiver::try_iter) {
            // Who asked may be gone.
            let _ = answer.send(self.attended.act(&line, report));
        }
        let typed = std::mem::take(&mut self.typed);
        let sent = self.attended.run_for(SLICE, &typed, report);
        self.keep_time();
        sent.context("the rig")
    }

    /// Waits for real time.
    fn keep_time(&mut self) {
        let Some(speed) = self.speed else { return };
        self.due += Duration::from_micros(SLICE.as_us()).div_f64(speed);
        match self.due.checked_duration_since(Instant::now()) {
            Some(early) => std::thread::sleep(early),
            None if self.due.elapsed() > MOST_LAG => self.due = Instant::now(),
            None => {}
        }
    }
}

impl Way for OnRig {
    fn name(&self) -> &str {
        "the rig"
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.attended.rig.now().as_secs_f64())
    }

    fn read(&mut self, patience: Duration) -> Result<Vec<u8>> {
        let until = self.now() + patience;
        loop {
            let sent = self.slice()?;
            if !sent.is_empty() || self.now() >= until {
                return Ok(sent);
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.typed.extend_from_slice(bytes);
        Ok(())
    }

    fn reopen(&mut self) -> Result<()> {
        let until = self.now() + RETURN;
        while self.now() < until && !self.attended.rig.chip.usb_host.is_configured() {
            self.slice()?;
        }
        Ok(())
    }

    fn press_reset(&mut self) -> bool {
        self.attended.rig.press_reset();
        true
    }
}

impl Drop for OnRig {
    fn drop(&mut self) {
        // What was written last has reached the vehicle.
        let kept = self.slice().and_then(|_| self.choice.keep(&self.attended.rig));
        if let Err(error) = kept {
            eprintln!("{error:#}");
        }
    }
}
