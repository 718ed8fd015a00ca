//! What tests of both judges see of a flight: a second of it, behind a fault at 0.

use client::StateKind;
use samd21::board::Ticks;

use crate::ground_station::Heartbeat;
use crate::observe::ground_truth::{Asked, Motion, Pulse};

pub(crate) const ACTIVE: f64 = 1600.0;
pub(crate) const NEUTRAL: f64 = 1523.6;
pub(crate) const FRAME: Ticks = Ticks::from_ms(20);

pub(crate) fn ms(ms: u64) -> Ticks {
    Ticks::from_ms(ms)
}

/// The drone at rest at a pitch.
pub(crate) fn motion(pitch_rad: f64) -> Vec<Motion> {
    let at = |time| Motion { time: ms(time), tilt_rad: [pitch_rad, 0.0], ..Motion::default() };
    (0..1000).map(at).collect()
}

pub(crate) fn beat(at: u64, state: StateKind) -> Heartbeat {
    Heartbeat { at: ms(at), state: Some(state), reason: 0 }
}

/// As wide as it was asked for.
pub(crate) fn pulse(rise: Ticks, width_us: f64) -> Pulse {
    let width = Ticks::from_secs_f64(width_us * 1e-6);
    Pulse { rise, fall: rise + width, asked: Asked([width; 2]) }
}

/// The same, cut to a width.
pub(crate) fn cut(pulse: Pulse, width_us: f64) -> Pulse {
    Pulse { fall: pulse.rise + Ticks::from_secs_f64(width_us * 1e-6), ..pulse }
}
