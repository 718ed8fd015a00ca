//! Whether the estimated vertical agrees with the accelerations.
//!
//! The gains that smooth the accelerations of a motion are slow. A filter that garbage has turned
//! over needs half a minute to come back. Near half a turn the correction is nearly none.
//!
//! A body that does not fall has an acceleration of gravity or more along its vertical again and
//! again, however it moves. Where the estimated vertical is wrong by an angle, a calm body has
//! gravity times the angle's cosine along it. After [`LASTING_S`] of less than [`LEAST`] the
//! estimate begins anew.
//!
//! A mean would not do. Blows of many g reach beyond a sensor's range, and the mean of the rest is
//! too low for a sound estimate.

use crate::config::GRAVITY;
use crate::real::Real;
use crate::vector::dot;

/// Time without an acceleration of [`LEAST`] along the vertical after which the estimate is wrong,
/// s. Hands that throw a sensor about leave at most 0.7 s between two such accelerations.
pub(crate) const LASTING_S: f32 = 3.0;

/// The least acceleration along the vertical, in parts of gravity, that says nothing against the
/// estimate: the cosine of 32 deg.
pub(crate) const LEAST: f32 = 0.85;

/// Time since the first acceleration of less than [`LEAST`] along the estimated vertical that
/// none of as much has followed, s.
#[derive(Clone, Debug)]
pub(crate) struct Consistency<T>(Option<T>);

impl<T: Real> Consistency<T> {
    pub(crate) fn new() -> Self {
        Self(None)
    }

    /// Whether the last acceleration was less. While it is, [`Self::holds`] wants every step, since
    /// steps at a regular distance can meet a vibration at the same place of its period.
    #[inline(always)]
    pub(crate) fn is_in_doubt(&self) -> bool {
        self.0.is_some()
    }

    /// Takes half the vertical, body frame, and the specific force, `dt` seconds after the step
    /// before; none if it was rejected, which says nothing against the estimate. False if they have
    /// disagreed for so long that the estimate is wrong.
    #[inline(never)]
    pub(crate) fn holds(&mut self, dt: T, half_down: &[T; 3], acc: Option<&[T; 3]>) -> bool {
        let least = T::from_f32(-0.5 * LEAST * GRAVITY);
        let is_less = acc.is_some_and(|acc| dot(half_down, acc) > least);
        self.0 = is_less.then(|| self.0.unwrap_or(T::ZERO) + dt);
        let holds = self.0.is_none_or(|time| time.within(T::from_f32(LASTING_S)));
        if !holds {
            self.0 = None;
        }
        holds
    }
}
