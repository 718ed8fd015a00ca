//! Whether the estimated vertical agrees with the accelerations.
//!
//! The gains that smooth the accelerations of a motion are slow. An estimate that garbage has
//! turned over needs half a minute to come back, or longer near half a turn, where the correction
//! is nearly none. But over some seconds the mean acceleration along the true vertical is gravity,
//! however the body turns. With a vertical that is wrong by an angle, that mean is gravity times
//! the angle's cosine at most, and the estimate begins anew.

use crate::config::GRAVITY;
use crate::real::Real;
use crate::vector::dot;

/// Time of the running mean, s.
pub(crate) const MEAN_S: f32 = 4.0;

/// The least mean of a right estimate, in parts of gravity: the cosine of 37 deg. A fall that gains
/// 8 m/s within [`MEAN_S`] has less, too.
pub(crate) const LEAST: f32 = 0.8;

/// The mean takes the acceleration of one step of this many.
const EVERY: u8 = 8;

/// The running mean of the acceleration along the estimated vertical, beyond gravity, m/s^2.
#[derive(Clone, Debug)]
pub(crate) struct Consistency<T> {
    mean: T,
    /// Since the mean took an acceleration, s.
    elapsed: T,
    steps: u8,
}

impl<T: Real> Consistency<T> {
    pub(crate) fn new() -> Self {
        Self { mean: T::from_f32(0.0), elapsed: T::from_f32(0.0), steps: 0 }
    }

    /// Takes the specific force of a step of `dt` seconds and half the vertical, body frame. False
    /// if they have disagreed for so long that the estimate is wrong.
    #[inline(never)]
    pub(crate) fn holds(&mut self, dt: T, half_down: &[T; 3], acc: &[T; 3]) -> bool {
        let real = T::from_f32;
        self.elapsed += dt;
        self.steps = (self.steps + 1) % EVERY;
        if self.steps != 0 {
            return true;
        }
        let dt = core::mem::replace(&mut self.elapsed, real(0.0));
        let half_up = -dot(half_down, acc);
        // A blow of many g says no more than a fall or twice gravity.
        let beyond = (half_up + half_up - real(GRAVITY)).limited(real(GRAVITY));
        let share = (dt * real(1.0 / MEAN_S)).limited(real(1.0));
        self.mean += (beyond - self.mean) * share;
        let holds = self.mean > real((LEAST - 1.0) * GRAVITY);
        if !holds {
            *self = Self::new();
        }
        holds
    }
}
