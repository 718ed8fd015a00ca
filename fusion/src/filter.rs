//! Filters of your own: their input and output.
//!
//! A type that implements [`Filter`] runs in an [`Estimator`](crate::Estimator). This filter
//! corrects the tilt alone, as Mahony's does:
//!
//! ```
//! use tvc_fusion::filter::{Real, View};
//! use tvc_fusion::{Config, ConfigError, Estimator, Filter, Sample};
//!
//! struct Tilt<T>(T);
//!
//! impl<T: Real> Filter for Tilt<T> {
//!     type Real = T;
//!     type Gains = f32; // 1/s
//!
//!     fn new(per_s: &f32) -> Result<Self, ConfigError> {
//!         Ok(Self(T::from_f32(per_s / tvc_fusion::GRAVITY)))
//!     }
//!
//!     fn correction(&mut self, view: &View<T>, _bias: &mut [T; 3]) -> [T; 3] {
//!         let ([x, y, z], Some([a, b, c])) = (view.rows.down, view.acc) else {
//!             return [T::ZERO; 3];
//!         };
//!         let gain = view.gain(self.0, T::from_f32(1.0 / tvc_fusion::GRAVITY)) * view.dt;
//!         [y * c - z * b, z * a - x * c, x * b - y * a].map(|half| half * gain)
//!     }
//! }
//!
//! let mut estimator = Estimator::<Tilt<f32>>::new(&Config::with_gains(0.2))?;
//! let tilted = Sample { gyr: [0.0; 3], acc: [0.0, -1.7, -9.66], mag: None };
//! for _ in 0..300 {
//!     estimator.update(0.01, &tilted);
//! }
//! let roll_rad = estimator.attitude().orientation.euler().roll_rad;
//! assert!((roll_rad - 0.174).abs() < 2e-3);
//! # Ok::<(), ConfigError>(())
//! ```

use crate::error::ConfigError;
pub use crate::field::HeadingError;
pub use crate::quaternion::HalfRows;
pub use crate::real::Real;

/// The input of a filter, after the rates have been integrated up to the present sample.
#[derive(Clone, Debug)]
pub struct View<T> {
    /// Time step, s.
    pub dt: T,
    /// Rotation rate less the offset, body frame, rad/s.
    pub rate: [T; 3],
    /// The earth's axes in the body frame, at half length.
    pub rows: HalfRows<T>,
    /// Specific force, m/s^2, when it has passed the gate.
    pub acc: Option<[T; 3]>,
    /// Heading error of a fresh and undisturbed field.
    pub heading: Option<HeadingError<T>>,
    /// Time since the last field sample, s.
    pub mag_dt: T,
    /// Least correction rate, 1/s: a running mean's in start-up and after trouble, else 0.
    pub floor: T,
    /// The first averaging is not over yet.
    pub starting: bool,
}

impl<T: Real> View<T> {
    /// The larger of a gain and the floor, both times `unit`.
    #[inline(always)]
    pub fn gain(&self, gain: T, unit: T) -> T {
        if self.floor.within(T::ZERO) {
            return gain;
        }
        let floor = self.floor * unit;
        if floor.within(gain) { gain } else { floor }
    }

    /// The share of the heading error to correct at a gain (1/s) or the floor, for the time since
    /// the last field, at most all of it.
    #[inline(always)]
    pub fn heading_share(&self, per_s: T) -> T {
        (self.gain(per_s, T::ONE) * self.mag_dt).at_most(T::ONE)
    }
}

/// A filter computes the correction of the estimate from the sensors. The
/// [`Estimator`](crate::Estimator) has integration, start-up, gates, offset at rest and recovery.
pub trait Filter: Sized {
    /// The scalar it runs on.
    type Real: Real;
    /// Its gains, in SI units.
    type Gains: Copy;

    /// Accelerometer and magnetometer correct the estimate after start-up.
    const CORRECTS: bool = true;

    /// Whether the filter finds the gyroscope's offset by itself while the body moves.
    #[doc(hidden)]
    const FINDS_BIAS: bool = false;

    /// Attitude and offset that the filter found are wrong: it begins anew, with an offset of zero.
    #[doc(hidden)]
    fn forget(&mut self) {}

    /// Whether the tilt follows the accelerometer with a response of second order.
    #[doc(hidden)]
    const IS_SECOND_ORDER: bool = false;

    /// The correction of the tilt, about north and east, rad/s, smoothed over a second or more. The
    /// deviations of a filter of second order grow by it; no other is asked.
    #[doc(hidden)]
    fn pull(&self) -> [Self::Real; 2] {
        [Self::Real::ZERO; 2]
    }

    /// Build the coefficients.
    ///
    /// # Errors
    /// A gain out of range, by name.
    fn new(gains: &Self::Gains) -> Result<Self, ConfigError>;

    /// Take other gains; the averages so far stay.
    ///
    /// # Errors
    /// The name of a gain out of range; nothing changes then.
    fn retune(&mut self, gains: &Self::Gains) -> Result<(), ConfigError> {
        *self = Self::new(gains)?;
        Ok(())
    }

    /// The correction, a rotation vector in the body frame **at half its length** (rad). A filter
    /// that estimates the gyroscope's offset (rad/s) corrects it.
    fn correction(
        &mut self,
        view: &View<Self::Real>,
        bias: &mut [Self::Real; 3],
    ) -> [Self::Real; 3];
}
