//! The clamp that holds the drone by its body, tilts it, releases it and catches it.

use super::Vehicle;
use samd21::board::Ticks;
use tvc_nano::Axis;

/// Rate at which the clamped drone is tilted by hand, rad/s.
const TILT_RATE_RAD_S: f64 = 0.5;

/// A clamp that is closed on the drone or open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clamp {
    /// Tilt at which it holds or held the drone, rad.
    held_rad: [f64; Axis::COUNT],
    /// Tilt to which a held drone is being brought, rad.
    pub(super) wanted_rad: [f64; Axis::COUNT],
    /// When it opened; `None` while it holds.
    pub(super) released: Option<Ticks>,
}

impl Clamp {
    /// Closes on the drone at this tilt, rad.
    pub(super) fn closed(drone: &mut Vehicle, tilt_rad: [f64; Axis::COUNT]) -> Self {
        drone.clamp(tilt_rad);
        Self { held_rad: tilt_rad, wanted_rad: tilt_rad, released: None }
    }

    /// True when it holds the drone at the tilt to which it was to bring it.
    pub(super) fn rests(&self, drone: &Vehicle) -> bool {
        drone.held() && self.held_rad == self.wanted_rad
    }

    /// Time since it opened; `None` while it holds.
    pub(super) fn open_for(&self, now: Ticks) -> Option<Ticks> {
        self.released.map(|released| now.saturating_sub(released))
    }

    /// Moves a held drone towards the wanted tilt; returns the rates of this motion, rad/s.
    pub(super) fn tilt(&mut self, drone: &mut Vehicle, dt_s: f64) -> [f64; Axis::COUNT] {
        if self.held_rad == self.wanted_rad || !drone.held() {
            return [0.0; Axis::COUNT];
        }
        let most = TILT_RATE_RAD_S * dt_s;
        let mut rates = [0.0; Axis::COUNT];
        let tilts = self.held_rad.iter_mut().zip(self.wanted_rad);
        for ((held, wanted), rate) in tilts.zip(&mut rates) {
            let missing = wanted - *held;
            if missing.abs() <= most {
                *held = wanted;
            } else {
                *held += most.copysign(missing);
            }
            *rate = missing.clamp(-most, most) / dt_s;
        }
        drone.clamp(self.held_rad);
        rates
    }
}
