//! The judgement of a sensor by its driver: its bursts, its registers and its silence.

mod inspector;
mod still;
mod trust;

pub use inspector::{Evidence, Inspector, Judged, Rules, STEP_AGE_US, Words};
pub use trust::{GLITCH_US, Trust, Verdict, received};
