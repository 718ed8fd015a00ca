//! The clamp that holds the drone by its body, tilts it, releases it and catches it.

use plant::Drone;
use samd21::board::Ticks;

/// Rate at which the clamped drone is tilted by hand, rad/s.
const TILT_RATE_RAD_S: f64 = 0.5;

/// A clamp that is closed on the drone or open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clamp {
    /// Pitch to which a held drone is being tilted, rad.
    wanted_rad: f64,
    /// When it opened; `None` while it holds.
    released: Option<Ticks>,
}

impl Clamp {
    /// Closes on the drone at this pitch, rad.
    pub(super) fn closed(drone: &mut Drone, pitch_rad: f64) -> Self {
        drone.clamp(pitch_rad);
        Self {
            wanted_rad: pitch_rad,
            released: None,
        }
    }

    /// Begins to tilt a held drone to this pitch, rad.
    pub(super) fn tilt_to(&mut self, pitch_rad: f64) {
        self.wanted_rad = pitch_rad;
    }

    /// True when it holds the drone at the pitch to which it was to tilt it.
    pub(super) fn rests(&self, drone: &Drone) -> bool {
        drone.held() && drone.pitch_rad() == self.wanted_rad
    }

    /// Opens; the drone leaves it with a rate, rad/s.
    pub(super) fn open(&mut self, now: Ticks, drone: &mut Drone, rate_rad_s: f64) {
        drone.release(rate_rad_s);
        self.released.get_or_insert(now);
    }

    /// Time since it opened; `None` while it holds.
    pub(super) fn open_for(&self, now: Ticks) -> Option<Ticks> {
        self.released.map(|released| now.saturating_sub(released))
    }

    /// Moves a held drone towards the wanted pitch; returns the rate of this motion, rad/s.
    pub(super) fn tilt(&self, drone: &mut Drone, dt_s: f64) -> f64 {
        let missing = self.wanted_rad - drone.pitch_rad();
        if missing == 0.0 || !drone.held() {
            return 0.0;
        }
        let most = TILT_RATE_RAD_S * dt_s;
        if missing.abs() <= most {
            drone.clamp(self.wanted_rad);
        } else {
            drone.clamp(drone.pitch_rad() + most.copysign(missing));
        }
        missing.clamp(-most, most) / dt_s
    }
}
