//! The complementary filter, on quaternions.
//!
//! At each sample the estimate moves the share `dt / (tau + dt)` of the way to the attitude that
//! accelerometer and magnetometer show. That high-passes the rates and low-passes the directions
//! with the same time constant. The move is a rotation, so it has no singularity. The usual form
//! has weights `w` for the gyroscope and `1 - w` for the other sensors: `tau = dt w / (1 - w)`, see
//! [`ComplementaryGains::from_weight`].

use crate::error::{ConfigError, in_range};
use crate::filter::{Filter, View};
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{add_scaled, cross, dot, scaled, zero};

settings! {
    /// Time constants of [`Complementary`].
    pub struct ComplementaryGains {
        /// Tilt, s.
        acc_tau_s: f32 = 5.0,
        /// Heading, s.
        mag_tau_s: f32 = 9.0,
    }
}

impl ComplementaryGains {
    /// From the weight of the gyroscope, 0..1, at a sampling rate in Hz.
    pub fn from_weight(weight: f32, rate_hz: f32) -> Self {
        let tau_s = weight / ((1.0 - weight) * rate_hz);
        Self { acc_tau_s: tau_s, mag_tau_s: tau_s }
    }

    /// The setting of the thesis that this project began with: weights 0.95 and 0.05 at 100 Hz,
    /// so 0.19 s.
    pub fn thesis() -> Self {
        Self::from_weight(0.95, 100.0)
    }
}

/// The complementary filter.
#[derive(Clone, Debug)]
pub struct Complementary<T = f32> {
    acc_tau_s: T,
    mag_tau_s: T,
}

impl<T: Real> Complementary<T> {
    #[inline(always)]
    fn share(view: &View<T>, tau_s: T, dt: T) -> T {
        let own = dt * (tau_s + dt).recip();
        view.gain(own, dt)
    }
}

impl<T: Real> Filter for Complementary<T> {
    type Real = T;
    type Gains = ComplementaryGains;

    fn new(gains: &ComplementaryGains) -> Result<Self, ConfigError> {
        in_range(gains.acc_tau_s, 0.0, 1e4, "acc_tau_s")?;
        in_range(gains.mag_tau_s, 0.0, 1e4, "mag_tau_s")?;
        Ok(Self {
            acc_tau_s: T::from_f32(gains.acc_tau_s),
            mag_tau_s: T::from_f32(gains.mag_tau_s),
        })
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<T>, _bias: &mut [T; 3]) -> [T; 3] {
        let mut half_angle = zero();
        let down = &view.rows.down;
        if let Some(acc) = view.acc {
            let k = Self::share(view, self.acc_tau_s, view.dt) * dot(&acc, &acc).sqrt().recip();
            half_angle = scaled(&cross(down, &acc), k);
        }
        if let Some(heading) = &view.heading {
            let k = Self::share(view, self.mag_tau_s, view.mag_dt) * heading.sin;
            add_scaled(&mut half_angle, down, k);
        }
        half_angle
    }
}
