//! What the rig sees of the stack: how deep it goes, and which priorities the interrupts have.

use anyhow::{Result, ensure};
use rig::profile::advance;
use rig::{Image, Rig, ServoKind, Setup, prepare};
use samd21::chip::EXCEPTIONS;

use super::Stack;
use ground::flight::fly::flights::START_RATE_RAD_S;
use ground::flight::fly::live::Live;

/// What was seen.
pub struct Seen {
    /// Deepest stack, bytes.
    pub bytes: u32,
    /// Priorities of the exceptions, by number.
    pub priorities: [i8; EXCEPTIONS],
}

/// Flies the image, or runs it for a time.
///
/// # Errors
/// It does not run, or changes priorities while it flies.
pub fn on_the_rig(options: &Stack, image: &Image) -> Result<Seen> {
    let setup = Setup::with_polarity(ServoKind::S3003, options.seed);
    if let Some(after) = options.after {
        let mut rig = Rig::new(image, &setup.rig)?;
        let live = Live::begin(format!("running the image for {after} s"));
        advance(&mut rig, after, &mut |now| live.played(now, after))?;
        live.end();
        return Ok(Seen { bytes: rig.stack_high_water(), priorities: rig.chip.priorities() });
    }
    let live = Live::begin(format!("boot and flight from {} rad", options.start));
    let ready = prepare(image, &setup, &mut |progress| live.flight(progress))?;
    let priorities = ready.rig.chip.priorities();
    let rate = START_RATE_RAD_S.copysign(options.start);
    let record = ready.fly(options.start, rate, options.seconds, &mut |progress| {
        live.flight(progress);
    })?;
    live.end();
    ensure!(
        record.priorities == priorities,
        "the image changes the priorities of interrupts while it flies, and which nest is not known"
    );
    Ok(Seen { bytes: record.stack_high_water, priorities })
}
