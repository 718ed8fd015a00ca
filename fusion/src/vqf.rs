//! A filter of the VQF class: averages the acceleration in the earth frame, where it is nearly
//! constant.
//!
//! D. Laidig, T. Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and
//! magnetic disturbance rejection", Information Fusion 91, 2023, section 3. In a frame that turns
//! with the drift of the gyroscope only, gravity stands still and the acceleration of a motion has
//! a mean of zero. A second-order low pass separates them and gives the inclination at once.
//!
//! Here the same low pass closes a loop. With the tilt error `e` seen in the earth frame,
//!
//! ```text
//! z' = (e - z) / T          the smoothed error
//! correction rate = z / tau
//! ```
//!
//! has the response `1 / (tau T s^2 + tau s + 1)` from the accelerometer to the estimate: of second
//! order, and for `T = tau / 2` Butterworth with VQF's time constant `tau`. It takes two numbers of
//! state and no trigonometry. A smaller `tau` and a larger `T` (damping 0.53 instead of 0.71)
//! follow gyroscope errors sooner at the same smoothing. Heading has a time constant of its own.

use crate::config::GRAVITY;
use crate::error::{ConfigError, in_range, positive};
use crate::filter::{Filter, View};
use crate::real::Real;
use crate::settings::settings;
use crate::vector::dot;

settings! {
    /// Time constants of [`Vqf`].
    pub struct VqfGains {
        /// Tilt follows the smoothed acceleration with this, s.
        acc_tau_s: f32 = 2.0,
        /// The acceleration, in the earth frame, is smoothed with this, s.
        acc_smoothing_s: f32 = 1.75,
        /// Heading follows the magnetometer with this, s.
        mag_tau_s: f32 = 9.0,
    }
}

impl VqfGains {
    /// For [`offline`](crate#features) use: two passes smooth more than one.
    pub const fn offline() -> Self {
        Self { acc_tau_s: 2.4, acc_smoothing_s: 1.4, mag_tau_s: 18.0 }
    }

    /// The constants of the published filter: Butterworth with 3 s, heading 9 s.
    pub const fn published() -> Self {
        Self { acc_tau_s: 3.0, acc_smoothing_s: 1.5, mag_tau_s: 9.0 }
    }
}

/// The VQF-class filter.
#[derive(Clone, Debug)]
pub struct Vqf<T = f32> {
    acc_per_s: T,
    smoothing_s: T,
    /// `1 / smoothing_s`.
    smoothing_per_s: T,
    mag_per_s: T,
    /// Half of the smoothed horizontal acceleration, north and east, m/s^2.
    smooth: [T; 2],
}

impl<T: Real> Filter for Vqf<T> {
    type Real = T;
    type Gains = VqfGains;

    const IS_SECOND_ORDER: bool = true;

    fn new(gains: &VqfGains) -> Result<Self, ConfigError> {
        in_range(gains.acc_tau_s, 0.01, 1e4, "acc_tau_s")?;
        in_range(gains.acc_smoothing_s, 0.01, 1e4, "acc_smoothing_s")?;
        positive(gains.mag_tau_s, "mag_tau_s")?;
        Ok(Self {
            acc_per_s: T::from_f32(1.0 / gains.acc_tau_s),
            smoothing_s: T::from_f32(gains.acc_smoothing_s),
            smoothing_per_s: T::from_f32(1.0 / gains.acc_smoothing_s),
            mag_per_s: T::from_f32(1.0 / gains.mag_tau_s),
            smooth: [T::ZERO; 2],
        })
    }

    fn retune(&mut self, gains: &VqfGains) -> Result<(), ConfigError> {
        let smooth = self.smooth;
        *self = Self::new(gains)?;
        self.smooth = smooth;
        Ok(())
    }

    fn pull(&self) -> [T; 2] {
        // Half the acceleration.
        let per_s = self.acc_per_s * T::from_f32(2.0 / GRAVITY);
        let [north, east] = self.smooth;
        [-(east * per_s), north * per_s]
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<T>, _bias: &mut [T; 3]) -> [T; 3] {
        let rows = &view.rows;
        let per_g = T::from_f32(1.0 / GRAVITY);
        // Half angles about north, east and down.
        let (mut about_north, mut about_east, mut about_down) = (T::ZERO, T::ZERO, T::ZERO);
        if let Some(acc) = view.acc {
            let seen = [dot(&rows.north, &acc), dot(&rows.east, &acc)];
            let [north, east] = &mut self.smooth;
            let rate = if view.floor > self.acc_per_s {
                // A running mean is smooth enough; after it the low pass starts from rest.
                (*north, *east) = (T::ZERO, T::ZERO);
                about_north = -seen[1];
                about_east = seen[0];
                view.floor
            } else {
                // A step that is short beside T spares the division.
                let share = if view.dt.within(self.smoothing_s * T::from_f32(0.05)) {
                    view.dt * self.smoothing_per_s
                } else {
                    view.dt * (self.smoothing_s + view.dt).recip()
                };
                *north += (seen[0] - *north) * share;
                *east += (seen[1] - *east) * share;
                about_north = -*east;
                about_east = *north;
                self.acc_per_s
            };
            let k = rate * view.dt * per_g;
            about_north = about_north * k;
            about_east = about_east * k;
        }
        if let Some(heading) = &view.heading {
            about_down = heading.sin * view.heading_share(self.mag_per_s) * T::HALF;
        }
        // Into the body frame: twice the half rows.
        let body = |n: T, e: T, d: T| {
            let half = n * about_north + e * about_east + d * about_down;
            half + half
        };
        [
            body(rows.north[0], rows.east[0], rows.down[0]),
            body(rows.north[1], rows.east[1], rows.down[1]),
            body(rows.north[2], rows.east[2], rows.down[2]),
        ]
    }
}
