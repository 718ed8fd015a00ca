//! Profiles: where the image's cycles go, in flight or for a time after power-on.

use samd21::board::Ticks;
use samd21::chip::Profile;

use super::flight::{FlightError, Mark, Progress, Ready, Stage};
use crate::rig::{Rig, RigError};

/// A window of time in which cycles were counted by address.
#[derive(Clone, Debug)]
pub struct Window {
    /// Cycles awake, by exception and address.
    pub profile: Profile,
    /// Growth of the chip's own counter of cycles.
    pub cycles: u64,
    /// Length, s.
    pub seconds: f64,
    /// Time asleep of it, s.
    pub asleep_s: f64,
    /// Control steps that the image began in it.
    pub steps: usize,
}

impl Ready {
    /// As [`Ready::fly`], with the profile from the release on in place of a record.
    ///
    /// # Errors
    /// The rig stopped, or the image refuses.
    pub fn profile(
        &self,
        start_rad: f64,
        rate_rad_s: f64,
        seconds: f64,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Window, FlightError> {
        let mut fork = self.armed([start_rad, 0.0], progress)?;
        fork.station.release(&mut fork.rig, rate_rad_s)?;
        let begin = begin(&mut fork.rig);
        let until = begin.at + Ticks::from_secs_f64(seconds);
        fork.watch_until(Stage::Flight, begin.at, until, progress)?;
        Ok(end(begin, &mut fork.rig))
    }
}

/// Runs any image for `seconds` from now on. `progress` gets the time since power-on, s.
///
/// # Errors
/// The rig stopped.
pub fn run(rig: &mut Rig, seconds: f64, progress: &mut dyn FnMut(f64)) -> Result<Window, RigError> {
    let begin = begin(rig);
    advance(rig, seconds, progress)?;
    Ok(end(begin, rig))
}

/// Runs any image for `seconds` without a profile. `progress` gets the time since power-on, s.
///
/// # Errors
/// The rig stopped.
pub fn advance(rig: &mut Rig, seconds: f64, progress: &mut dyn FnMut(f64)) -> Result<(), RigError> {
    let end = rig.now() + Ticks::from_secs_f64(seconds);
    while rig.now() < end {
        rig.run_for(Ticks::from_ms(20).min(end - rig.now()))?;
        progress(rig.now().as_secs_f64());
    }
    Ok(())
}

fn begin(rig: &mut Rig) -> Mark {
    rig.chip.begin_profile();
    Mark::of(rig)
}

fn end(begin: Mark, rig: &mut Rig) -> Window {
    let now = Mark::of(rig);
    let window = begin.at..now.at;
    let steps = rig.truth().steps.iter();
    Window {
        cycles: now.counters.cycles - begin.counters.cycles,
        seconds: (now.at - begin.at).as_secs_f64(),
        asleep_s: Ticks(now.counters.sleep_ticks - begin.counters.sleep_ticks).as_secs_f64(),
        steps: steps.filter(|step| window.contains(&step.start)).count(),
        profile: rig.chip.end_profile(),
    }
}
