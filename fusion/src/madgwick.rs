//! Madgwick's gradient-descent filter.
//!
//! S. Madgwick, A. Harrison, R. Vaidyanathan, "Estimation of IMU and MARG orientation using a
//! gradient descent algorithm", IEEE ICORR 2011, equations 25 to 44.
//!
//! Each second the estimate moves `beta` along the normalised gradient of the misfit between the
//! measured and the predicted directions. On the unit sphere that gradient is the rotation `a x v`
//! from the predicted to the measured direction, so the step is a rotation. The field's reference
//! is horizontal, the paper's compensation with `b = (1, 0, 0)`: the field turns the heading only.
//! A step never passes the minimum, because at zero misfit no direction can be normalised.

use crate::error::{ConfigError, in_range};
use crate::filter::{Filter, View};
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{add_scaled, cross, dot, scaled, zero};

settings! {
    /// Gain of [`Madgwick`].
    pub struct MadgwickGains {
        /// Rate of the quaternion along the gradient, 1/s: half the correcting rotation rate in
        /// rad/s.
        beta_per_s: f32 = 0.02,
    }
}

impl MadgwickGains {
    /// The setting of the thesis that this project began with: beta 0.5.
    pub const fn thesis() -> Self {
        Self { beta_per_s: 0.5 }
    }
}

/// Madgwick's filter.
#[derive(Clone, Debug)]
pub struct Madgwick<T = f32> {
    beta: T,
}

/// Misfit, as half the sine of the angle, below which the estimate stays.
const MIN_MISFIT: f32 = 1e-7;

impl<T: Real> Filter for Madgwick<T> {
    type Real = T;
    type Gains = MadgwickGains;

    fn new(gains: &MadgwickGains) -> Result<Self, ConfigError> {
        in_range(gains.beta_per_s, 0.0, 100.0, "beta_per_s")?;
        Ok(Self { beta: T::from_f32(gains.beta_per_s) })
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<T>, _bias: &mut [T; 3]) -> [T; 3] {
        // Half the rotations from the predictions to the measurements. They are at right angles,
        // and their sum is at most 1/2.
        let (mut tilt, mut heading) = (zero(), zero());
        let down = &view.rows.down;
        if let Some(acc) = view.acc {
            let k = dot(&acc, &acc).sqrt().recip();
            tilt = scaled(&cross(down, &acc), k);
        }
        if let Some(error) = &view.heading {
            heading = scaled(down, error.sin);
        }
        let misfit = (dot(&tilt, &tilt) + dot(&heading, &heading)).sqrt();
        if misfit.within(T::from_f32(MIN_MISFIT)) {
            return zero();
        }
        let rate = view.gain(self.beta * misfit.recip(), T::ONE);
        let share = |dt: T| (rate * dt).at_most(T::ONE);
        // A field from a slow magnetometer stands for all samples since the last field.
        let mut half_angle = scaled(&tilt, share(view.dt));
        add_scaled(&mut half_angle, &heading, share(view.mag_dt));
        half_angle
    }
}
