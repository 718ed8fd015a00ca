//! What the sensors of the rig share: from the physical truth to a sample.
//!
//! A sensor's model gives the signal chain the truth in small steps, and takes a sample at each
//! refresh of its registers.

mod imperfections;
mod magnetometer;
mod replay;
mod signal;

pub use imperfections::{ImuErrors, WarmUp};
pub use magnetometer::{Magnetometer, MagnetometerHealth};
pub(crate) use replay::Playback;
pub use signal::Stimulus;
pub(crate) use signal::{STANDARD_GRAVITY_M_S2, Sample, Settings, SignalChain};

use samd21::board::Ticks;

/// The last refresh of the data registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refresh {
    /// When the registers were written.
    pub at: Ticks,
    /// Index of the newest recorded sample that they show, while a recording plays.
    pub recorded: Option<usize>,
}
