//! Mahony's explicit complementary filter.
//!
//! R. Mahony, T. Hamel, J.-M. Pflimlin, "Nonlinear complementary filters on the special orthogonal
//! group", IEEE Trans. Automatic Control 53(5), 2008, equations 32 and 48.
//!
//! The rotation from the predicted to the measured vertical, `a x v`, is fed back in proportion.
//! Its integral is the gyroscope's offset. Two points differ from the paper. The magnetometer turns
//! the estimate about the vertical only, with a gain of its own. The acceleration is scaled by
//! standard gravity and not normalised: the acceleration of a motion has a mean of zero as a
//! vector, but not as a direction.

use crate::config::GRAVITY;
use crate::error::{ConfigError, in_range};
use crate::filter::{Filter, View};
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{add_scaled, cross, scaled, zero};

settings! {
    /// Gains of [`Mahony`].
    pub struct MahonyGains {
        /// Rate at which tilt follows the accelerometer, 1/s: 1 over the time constant.
        acc_per_s: f32 = 0.2,
        /// Rate at which heading follows the magnetometer, 1/s.
        mag_per_s: f32 = 0.11,
        /// Integral gain: offset learned from the tilt error, 1/s^2; 0 if offsets are learned at
        /// rest.
        integral_per_s2: f32 = 0.0,
    }
}

impl MahonyGains {
    /// The setting of the thesis that this project began with: its library's defaults,
    /// Kp 0.5 and Ki 0.
    pub const fn thesis() -> Self {
        Self { acc_per_s: 0.5, mag_per_s: 0.5, integral_per_s2: 0.0 }
    }
}

/// Mahony's filter.
#[derive(Clone, Debug)]
pub struct Mahony<T = f32> {
    /// Per m/s^2.
    acc: T,
    acc_per_gain: T,
    mag: T,
    integral: Option<T>,
}

impl<T: Real> Filter for Mahony<T> {
    type Real = T;
    type Gains = MahonyGains;

    fn new(gains: &MahonyGains) -> Result<Self, ConfigError> {
        in_range(gains.acc_per_s, 0.0, 100.0, "acc_per_s")?;
        in_range(gains.mag_per_s, 0.0, 100.0, "mag_per_s")?;
        in_range(gains.integral_per_s2, 0.0, 10.0, "integral_per_s2")?;
        Ok(Self {
            acc: T::from_f32(gains.acc_per_s / GRAVITY),
            acc_per_gain: T::from_f32(1.0 / GRAVITY),
            mag: T::from_f32(gains.mag_per_s),
            integral: (gains.integral_per_s2 > 0.0)
                .then(|| T::from_f32(2.0 * gains.integral_per_s2 / GRAVITY)),
        })
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<T>, bias: &mut [T; 3]) -> [T; 3] {
        let mut half_angle = zero();
        let down = &view.rows.down;
        if let Some(acc) = view.acc {
            let half_error = cross(down, &acc);
            if let Some(integral) = self.integral {
                add_scaled(bias, &half_error, -(integral * view.dt));
            }
            let k = view.gain(self.acc, self.acc_per_gain) * view.dt;
            half_angle = scaled(&half_error, k);
        }
        if let Some(heading) = &view.heading {
            let k = view.heading_share(self.mag) * heading.sin;
            add_scaled(&mut half_angle, down, k);
        }
        half_angle
    }
}
