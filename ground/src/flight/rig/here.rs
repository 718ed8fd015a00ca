//! The virtual rig in this process as a way to the vehicle (`--rig`): no pseudo-terminal, no second
//! program, and no waiting where nobody watches.

use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use ::rig::Ticks;
use ::rig::attended::Attended;
use anyhow::{Context, Result};
use clap::Parser;

use super::RigChoice;
use crate::vehicle::way::Way;

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
    match Words::try_parse_from(words) {
        Ok(words) => Ok(words.choice),
        Err(error) => {
            let words = error.to_string();
            let line = words.lines().next().unwrap_or_default();
            Err(line.trim_start_matches("error: ").to_owned())
        }
    }
}

/// An order to the rig, and who waits for the answer.
pub type Order = (String, Sender<String>);

/// The rig.
pub struct OnRig {
    attended: Attended,
    choice: RigChoice,
    /// Times as fast as real time; without it as fast as it can.
    speed: Option<f64>,
    /// When the rig's clock is to have come to where it is.
    due: Instant,
    orders: Option<Receiver<Order>>,
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
            orders: None,
            typed: Vec::new(),
        })
    }

    /// Runs in real time, whoever watches: other programs listen.
    pub fn in_real_time(mut self) -> Self {
        self.speed.get_or_insert(1.0);
        self
    }

    /// Does what the sender orders.
    pub fn orderer(&mut self) -> Sender<Order> {
        let (orderer, orders) = channel();
        self.orders = Some(orders);
        orderer
    }

    /// Runs for a slice; the bytes that the image has sent.
    fn slice(&mut self) -> Result<Vec<u8>> {
        let is_watched = self.speed.is_some();
        let report = &mut |at_s: f64, line: &str| {
            if is_watched {
                eprintln!("{at_s:9.3} s  {line}");
            }
        };
        for (line, answer) in self.orders.iter().flat_map(Receiver::try_iter) {
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
        while self.now() < until && !self.attended.rig.usb_host().is_configured() {
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
        let kept = self
            .slice()
            .and_then(|_| self.choice.keep(&self.attended.rig));
        if let Err(error) = kept {
            eprintln!("{error:#}");
        }
    }
}
