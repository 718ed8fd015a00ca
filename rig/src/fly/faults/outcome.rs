//! How a run ended, in words and figures.

use client::StateKind;
use samd21::board::Ticks;
use thiserror::Error;

use super::{Alarms, Case, DEADLINE};

/// How a run ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Ending {
    /// The vehicle goes on with what it did; in control, as a rule, and on course.
    #[default]
    Recovered,
    /// It does not (it is in failsafe, as a rule), with the rudder at neutral.
    Neutral,
    /// The same behind a reset of the chip.
    Restarted,
    /// Neither, or too late.
    Unsafe(Unsafe),
    /// The program, as the fault had left it, did what the emulated chip does not model: this.
    Unmodelled(String),
    /// Nothing was wrong with the vehicle, and these alarms came.
    Alarmed(Alarms),
}

/// What was unsafe.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Unsafe {
    /// The rudder was off neutral without valid data for too long.
    #[error("rudder off neutral without valid data for more than {} ms", DEADLINE.as_us() / 1000)]
    Unguarded,
    /// No pulse for this time.
    #[error("no pulse for {:.1} ms", ms(.0))]
    NoPulse(Ticks),
    /// A pulse of a width, us, that the servo must never see.
    #[error("a pulse of {0:.1} us")]
    WildPulse(f64),
    /// A pulse that was cut to this width, us.
    #[error("cut pulse of {0:.0} us")]
    CutPulse(f64),
    /// A pulse of this width, us, which is neither neutral nor what the program had asked for.
    #[error("a pulse of {0:.0} us that nobody asked for")]
    StrayPulse(f64),
    /// A pin that is high for this time, to the end.
    #[error("a pin high for {:.0} ms", ms(.0))]
    High(Ticks),
    /// A pulse off neutral, of this width, us, after the firmware had reported its failsafe.
    #[error("a pulse of {0:.1} us in failsafe")]
    PulseInFailsafe(f64),
    /// The chip was reset.
    #[error("the chip was reset")]
    Reset,
    /// Behind a reset, no burst of the sensor for this time.
    #[error("no burst of the sensor for {:.0} ms behind a reset", ms(.0))]
    NoSensor(Ticks),
    /// In control, but the drone is this far from the flight without the fault, rad.
    #[error("in control, but {0:.2} rad off course")]
    OffCourse(f64),
    /// The firmware ended in a state that is neither control nor failsafe.
    #[error("{}", ended(.0))]
    State(Option<StateKind>),
    /// A rudder was driven wrongly for this time.
    #[error("a rudder driven wrongly for {:.0} ms", ms(.0))]
    Driven(Ticks),
    /// Armed or in control, and nobody had ordered it.
    #[error("in state {0:?} without an order")]
    Unordered(StateKind),
    /// The flash has a set of parameters at the end that nobody had stored.
    #[error("other parameters are stored than anybody has set")]
    StoredOthers,
    /// At the end, in no control, a pulse of this width, us, which is not neutral.
    #[error("at the end a pulse of {0:.1} us")]
    NotNeutral(f64),
}

fn ms(time: &Ticks) -> f64 {
    time.as_us_f64() / 1e3
}

fn ended(state: &Option<StateKind>) -> String {
    let named = state.map(|state| format!("ended in state {state:?}"));
    named.unwrap_or("no word from the firmware".into())
}

/// What became of a run.
#[derive(Clone, Debug, Default)]
pub struct Verdict {
    /// How it ended.
    pub ending: Ending,
    /// Longest time for which a rudder was off neutral without valid data; zero beyond the sensor.
    pub unguarded: Ticks,
    /// Longest time for which a rudder was driven wrongly; zero for faults of the sensor.
    pub wrong: Ticks,
    /// Longest time without a pulse behind one that was not neutral; zero for faults of the sensor.
    pub silent: Ticks,
    /// Pulses that were neither neutral nor what the program had asked for.
    pub strays: usize,
    /// At the end of the run a rudder was still driven wrongly, or had no pulses.
    pub for_ever: bool,
    /// The firmware has told, or restarted with a reason.
    pub noticed: bool,
    /// Nothing was noticed, and no pulse was another than without the fault.
    pub harmless: bool,
}

impl Verdict {
    /// With nothing but its ending.
    pub(super) fn new(ending: Ending) -> Self {
        Self { ending, ..Self::default() }
    }
}

/// A run and what became of it.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The run's kind and number.
    pub case: Case,
    /// When the fault began, s after the release or the phase's begin.
    pub at_s: f64,
    /// How long it lasted, s.
    pub lasted_s: f64,
    /// What was switched on, in words.
    pub fault: String,
    /// What became of it.
    pub verdict: Verdict,
    /// The firmware's last text.
    pub said: String,
    /// What was watched of a sound vehicle.
    pub watched: Watched,
}

/// How much of a sound vehicle's run was watched.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Watched {
    /// Emulated time, s.
    pub flown_s: f64,
    /// Frames that the host sent.
    pub frames: u64,
    /// Bursts that the sensor was asked for.
    pub bursts: usize,
}
