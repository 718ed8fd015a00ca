//! The rig in real time, its USB port behind a pseudo-terminal or served to another kernel
//! ([`usbip`](super::usbip)).
//!
//! The emulated laptop takes from the image only what the program at the pseudo-terminal reads: a
//! program that stops reading stops the laptop, and the image's packets wait, as on a real cable. A
//! program that opens the pseudo-terminal sets DTR, one that closes it clears DTR, and the rate
//! that it asks for is the port's. While the cable is out there is no pseudo-terminal.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::fly::attended::Attended;
use crate::fly::control::Control;
use crate::fly::gdb;
use crate::fly::pty::Pty;
use crate::fly::usbip::Server;
use crate::observe::measure::LoopTiming;
use crate::rig::{Rig, RigError};
use samd21::board::Ticks;
use thiserror::Error;

/// How long the rig runs between two looks at the pseudo-terminal.
const SLICE: Ticks = Ticks::from_ms(1);
/// How far the rig may lag behind real time and still catch up; a longer lag is given up.
const MOST_LAG: Duration = Duration::from_millis(200);
/// How long a rig that a debugger holds waits before it looks again.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// Bytes waiting on the laptop's side at which it stops reading, like a serial driver's buffer.
const BUFFER: usize = 4096;
/// Timing is measured over windows of this length; the ground truth is cleared after each.
const WINDOW: Ticks = Ticks::from_ms(2000);

/// Why the rig stopped early.
#[derive(Debug, Error)]
pub enum RealTimeError {
    /// The rig stopped.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The pseudo-terminal failed.
    #[error("the pseudo-terminal failed: {0}")]
    Pty(#[from] io::Error),
}

/// Figures of the whole run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Time simulated, s.
    pub seconds: f64,
    /// Real time that was skipped because the machine was too slow, s.
    pub lost_s: f64,
    /// Largest deviation of the time between two bursts from its mean, us.
    pub jitter_us_max: f64,
    /// Control steps.
    pub steps: usize,
}

/// What is at the other end of the USB cable.
pub enum Cable {
    /// A pseudo-terminal, for programs that open a serial port.
    Terminal(Pty),
    /// A server of USB/IP, for a kernel with drivers of its own.
    Network(Server),
}

/// A rig, its pilot and what is at its port.
pub struct RealTime {
    attended: Attended,
    /// None while the cable is out.
    pty: Option<Pty>,
    network: Option<Server>,
    control: Option<Control>,
    debugger: Option<gdb::Server>,
    /// A program has the pseudo-terminal open.
    open: bool,
    /// The rate that it has asked for.
    baud: Option<u32>,
    /// What the image has sent and the program has not taken yet.
    outgoing: Vec<u8>,
    /// When the window that is measured next began.
    window_start: Ticks,
    /// Speed of the rig's clock, as a multiple of real time.
    speed: f64,
    summary: Summary,
}

impl RealTime {
    /// A rig whose port no program has opened yet, and whose clock runs `speed` times as fast as
    /// real time. With `control`, other programs act on it, and a debugger may look at it.
    pub fn new(
        mut attended: Attended,
        cable: Cable,
        control: Option<Control>,
        debugger: Option<gdb::Server>,
        speed: f64,
    ) -> Self {
        let (pty, network) = match cable {
            Cable::Terminal(pty) => (Some(pty), None),
            Cable::Network(server) => (None, Some(server)),
        };
        attended.rig.chip.usb_host.set_dtr(false);
        Self {
            window_start: attended.rig.now(),
            attended,
            pty,
            network,
            control,
            debugger,
            open: false,
            baud: None,
            outgoing: Vec::new(),
            speed,
            summary: Summary::default(),
        }
    }

    /// Runs until `stop` is set or `longest` is over. `report` gets lines to show to a person, with
    /// the rig's time, s. `plugged` gets the path of the pseudo-terminal each time that the cable
    /// is put in.
    ///
    /// # Errors
    /// The rig stopped, or the pseudo-terminal failed.
    pub fn run(
        &mut self,
        longest: Option<Duration>,
        stop: &AtomicBool,
        report: &mut dyn FnMut(f64, &str),
        plugged: &mut dyn FnMut(&Path) -> io::Result<()>,
    ) -> Result<Summary, RealTimeError> {
        let begun = Instant::now();
        let mut due = begun;
        while !stop.load(Ordering::Relaxed) && longest.is_none_or(|most| begun.elapsed() < most) {
            let debugger = self.debugger.as_mut();
            if debugger.map_or(Ok(false), |debugger| debugger.poll(&mut self.attended))? {
                std::thread::sleep(LOOK_EVERY);
                due = Instant::now();
                continue;
            }
            self.slice(report)?;
            if let Some(control) = &mut self.control {
                control.poll(|line| self.attended.act(line, report));
            }
            self.plug(plugged)?;
            due += Duration::from_micros(SLICE.as_us()).div_f64(self.speed);
            match due.checked_duration_since(Instant::now()) {
                Some(early) => std::thread::sleep(early),
                None if due.elapsed() > MOST_LAG => {
                    self.summary.lost_s += due.elapsed().as_secs_f64();
                    due = Instant::now();
                }
                None => {}
            }
        }
        self.measure_window();
        self.summary.seconds = self.attended.rig.now().as_secs_f64();
        Ok(self.summary)
    }

    /// The rig.
    pub fn rig(&self) -> &Rig {
        &self.attended.rig
    }

    fn slice(&mut self, report: &mut dyn FnMut(f64, &str)) -> Result<(), RealTimeError> {
        self.watch_port();
        if let Some(network) = &mut self.network {
            network.poll(&mut self.attended.rig.chip.usb_host);
        }
        let pty = self.pty.as_ref().filter(|_| self.open);
        let typed = pty.map_or(Ok(Vec::new()), Pty::read)?;
        let sent = self.attended.run_for(SLICE, &typed, report)?;
        if let Some(pty) = pty {
            self.outgoing.extend_from_slice(&sent);
            let count = pty.write(&self.outgoing)?;
            self.outgoing.drain(..count);
        }
        self.attended.rig.chip.usb_host.pause_reading(self.outgoing.len() >= BUFFER);
        if self.attended.rig.now() - self.window_start >= WINDOW {
            self.measure_window();
        }
        Ok(())
    }

    /// Takes the pseudo-terminal away with the cable, and makes another one when it is back.
    fn plug(
        &mut self,
        plugged: &mut dyn FnMut(&Path) -> io::Result<()>,
    ) -> Result<(), RealTimeError> {
        match (self.attended.rig.chip.usb_host.is_attached(), &self.pty) {
            (false, Some(_)) => self.pty = None,
            (true, None) if self.network.is_none() => {
                plugged(self.pty.insert(Pty::open()?).path())?
            }
            _ => {}
        }
        Ok(())
    }

    /// Passes opening, closing and the rate of the port on to the USB host, as a serial driver
    /// does.
    fn watch_port(&mut self) {
        let open = self.pty.as_ref().is_some_and(Pty::is_open);
        let host = &mut self.attended.rig.chip.usb_host;
        if let Some(pty) = self.pty.as_ref().filter(|_| open) {
            let baud = pty.baud();
            if baud != self.baud {
                self.baud = baud;
                host.set_line_coding(baud.unwrap_or(0));
            }
        }
        if open != self.open {
            self.open = open;
            self.outgoing.clear();
            host.set_open(open);
        }
    }

    fn measure_window(&mut self) {
        let timing =
            LoopTiming::over(self.attended.rig.truth(), self.window_start..self.attended.rig.now());
        self.summary.steps += timing.steps;
        // Until the sensor has started, bursts come irregularly, and after a reset, too.
        let is_reset = |(at, _): &(Ticks, _)| *at >= self.window_start;
        if self.attended.pilot.state().is_some() && !self.attended.rig.resets().iter().any(is_reset)
        {
            self.summary.jitter_us_max = self.summary.jitter_us_max.max(timing.jitter_us_max);
        }
        self.window_start = self.attended.rig.now();
        self.attended.rig.environment.truth.clear();
    }
}
