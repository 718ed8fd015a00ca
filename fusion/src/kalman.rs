//! A multiplicative extended Kalman filter of attitude and gyroscope offset.
//!
//! F. L. Markley, "Attitude error representations for Kalman filtering", J. Guidance, Control and
//! Dynamics 26(2), 2003. The filter's state is the error of the attitude, as a rotation vector, and
//! the error of the offset. Each step moves both errors into quaternion and offset, which leaves a
//! state of zero. Here the rotation vector stands in the earth frame, where it does not turn with
//! the body. With `R` body to earth,
//!
//! ```text
//! d theta/dt = -R db + noise      true = exp(theta) estimated, true offset = estimated + db
//! db/dt      = noise
//! R a / g    = (theta_east, -theta_north, -1) + noise     what the accelerometer shows
//! heading error = theta_down + noise
//! ```
//!
//! The noise of the rates grows with the rates, by the errors of a gyroscope's scale and alignment.
//! The acceleration is not normalised, and the field turns the heading only.

use crate::config::GRAVITY;
use crate::error::{ConfigError, in_range, positive};
use crate::filter::{Filter, View};
use crate::quaternion::HalfRows;
use crate::real::Real;
use crate::settings::settings;
use crate::vector::{
    Matrix, add, add_diagonal, add_outer, add_scaled, diagonal, dot, scaled, zero,
};

settings! {
    /// Noise of [`Kalman`], as densities: variance times correlation time.
    pub struct KalmanGains {
        /// Of the rates at rest, rad^2/s.
        gyr_rad2_s: f32 = 3e-4,
        /// Growth of that noise with the rate, s: rad^2/s per (rad/s)^2.
        gyr_scale_s: f32 = 3e-5,
        /// Of the offset's random walk, (rad/s)^2/s.
        bias_rad2_s3: f32 = 1e-10,
        /// Deviation of an offset that is not known yet, per axis, rad/s.
        bias_rad_s: f32 = 0.03,
        /// Of the vertical that the accelerometer shows, rad^2 s.
        acc_rad2_s: f32 = 0.03,
        /// Of the heading that the field shows, rad^2 s.
        mag_rad2_s: f32 = 0.05,
    }
}

/// The Kalman filter.
#[derive(Clone, Debug)]
pub struct Kalman<T = f32> {
    gyr: T,
    gyr_scale: T,
    bias_walk: T,
    /// Variance of an offset that is not known, (rad/s)^2.
    unknown: T,
    acc: T,
    mag: T,
    /// Covariance of the attitude's error, rad^2.
    attitude: Matrix<T>,
    /// Of the attitude's (rows) and the offset's error, rad^2/s.
    mixed: Matrix<T>,
    /// Of the offset's error, (rad/s)^2.
    offset: Matrix<T>,
    /// The offset after the last step, rad/s.
    bias: [T; 3],
    /// The errors found in this step, rad and rad/s.
    found: ([T; 3], [T; 3]),
}

/// Deviation of an offset that was learned at rest, rad/s.
const AT_REST_RAD_S: f32 = 5e-4;

/// The largest part of an error that one sample corrects.
const MOST_SHARE: f32 = 0.95;

impl<T: Real> Filter for Kalman<T> {
    type Real = T;
    type Gains = KalmanGains;

    const FINDS_BIAS: bool = true;

    fn new(gains: &KalmanGains) -> Result<Self, ConfigError> {
        in_range(gains.gyr_rad2_s, 0.0, 1.0, "gyr_rad2_s")?;
        in_range(gains.gyr_scale_s, 0.0, 1.0, "gyr_scale_s")?;
        in_range(gains.bias_rad2_s3, 0.0, 1.0, "bias_rad2_s3")?;
        in_range(gains.bias_rad_s, 0.0, 1.0, "bias_rad_s")?;
        positive(gains.acc_rad2_s, "acc_rad2_s")?;
        positive(gains.mag_rad2_s, "mag_rad2_s")?;
        let real = T::from_f32;
        Ok(Self {
            gyr: real(gains.gyr_rad2_s),
            gyr_scale: real(gains.gyr_scale_s),
            bias_walk: real(gains.bias_rad2_s3),
            unknown: real(gains.bias_rad_s * gains.bias_rad_s),
            acc: real(gains.acc_rad2_s),
            mag: real(gains.mag_rad2_s),
            attitude: diagonal(real(0.1)),
            mixed: [zero(); 3],
            offset: diagonal(real(gains.bias_rad_s * gains.bias_rad_s)),
            bias: zero(),
            found: (zero(), zero()),
        })
    }

    fn retune(&mut self, gains: &KalmanGains) -> Result<(), ConfigError> {
        let &mut Self { attitude, mixed, offset, bias, .. } = self;
        *self = Self { attitude, mixed, offset, bias, ..Self::new(gains)? };
        Ok(())
    }

    fn forget(&mut self) {
        (self.attitude, self.mixed) = (diagonal(T::from_f32(0.1)), [zero(); 3]);
        (self.offset, self.bias) = (diagonal(self.unknown), zero());
    }

    fn correction(&mut self, view: &View<T>, bias: &mut [T; 3]) -> [T; 3] {
        if self.bias != *bias {
            // A rest has shown it.
            self.mixed = [zero(); 3];
            self.offset = diagonal(T::from_f32(AT_REST_RAD_S * AT_REST_RAD_S));
        }
        self.predict(view);
        self.widen(view);
        self.found = (zero(), zero());
        if let Some(acc) = &view.acc {
            let seen = scaled(&view.rows.rotate(acc), T::from_f32(1.0 / GRAVITY));
            let variance = self.acc * view.dt.recip();
            self.observe(Axis::North, -seen[1], variance);
            self.observe(Axis::East, seen[0], variance);
        }
        if let Some(heading) = &view.heading {
            self.observe(Axis::Down, heading.sin, self.mag * view.mag_dt.recip());
        }
        let (attitude, offset) = self.found;
        add(bias, &offset);
        self.bias = *bias;
        let mut half_angle = scaled(&view.rows.north, attitude[0]);
        add_scaled(&mut half_angle, &view.rows.east, attitude[1]);
        add_scaled(&mut half_angle, &view.rows.down, attitude[2]);
        half_angle
    }
}

/// A component of a rotation vector in the earth frame.
#[derive(Clone, Copy)]
enum Axis {
    North,
    East,
    Down,
}

impl Axis {
    fn of<V>(self, [north, east, down]: [V; 3]) -> V {
        match self {
            Self::North => north,
            Self::East => east,
            Self::Down => down,
        }
    }
}

impl<T: Real> Kalman<T> {
    /// The covariance a step later.
    fn predict(&mut self, view: &View<T>) {
        let dt = view.dt;
        let HalfRows { north, east, down } = &view.rows;
        let rows = [north, east, down].map(|half| scaled(half, T::ONE + T::ONE));
        let before = self.mixed;
        for (mixed, row) in self.mixed.iter_mut().zip(&rows) {
            let [x, y, z] = &self.offset;
            add_scaled(mixed, x, -(row[0] * dt));
            add_scaled(mixed, y, -(row[1] * dt));
            add_scaled(mixed, z, -(row[2] * dt));
        }
        let [m0, m1, m2] = &self.mixed;
        let [r0, r1, r2] = &rows;
        for ((line, row), before) in self.attitude.iter_mut().zip(&rows).zip(&before) {
            let along = [dot(row, m0), dot(row, m1), dot(row, m2)];
            let back = [dot(before, r0), dot(before, r1), dot(before, r2)];
            add_scaled(line, &along, -dt);
            add_scaled(line, &back, -dt);
        }
        let gyr = self.gyr + self.gyr_scale * dot(&view.rate, &view.rate);
        add_diagonal(&mut self.attitude, gyr * dt);
        add_diagonal(&mut self.offset, self.bias_walk * dt);
    }

    /// In start-up and after trouble, the attitude's variance gives the gain of the running mean.
    fn widen(&mut self, view: &View<T>) {
        if view.floor.within(T::ZERO) {
            return;
        }
        let least = |density: T, dt: T| {
            let share = (view.floor * dt).at_most(T::from_f32(MOST_SHARE));
            // share = P / (P + density / dt)
            density * dt.recip() * share * (T::ONE - share).recip()
        };
        let tilt = least(self.acc, view.dt);
        let heading = least(self.mag, view.mag_dt);
        let [north, east, down] = &mut self.attitude;
        let variances = [&mut north[0], &mut east[1], &mut down[2]];
        for (variance, least) in variances.into_iter().zip([tilt, tilt, heading]) {
            if *variance < least {
                *variance = least;
            }
        }
    }

    /// The error about an axis is seen as `error`, with this variance, rad^2.
    fn observe(&mut self, axis: Axis, error: T, variance: T) {
        let along = self.attitude.each_ref().map(|line| axis.of(*line));
        let offset = axis.of(self.mixed);
        let inverse = (axis.of(along) + variance).recip();
        let k = (error - axis.of(self.found.0)) * inverse;
        add_scaled(&mut self.found.0, &along, k);
        add_scaled(&mut self.found.1, &offset, k);
        add_outer(&mut self.attitude, &along, &along, -inverse);
        add_outer(&mut self.mixed, &along, &offset, -inverse);
        add_outer(&mut self.offset, &offset, &offset, -inverse);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quaternion::Quaternion;
    use nalgebra::Vector3;

    fn still(dt: f64) -> View<f64> {
        View {
            dt,
            rate: Vector3::zeros().into(),
            rows: Quaternion::<f64>::IDENTITY.half_rows(),
            acc: Some(Vector3::new(0.0, 0.0, -f64::from(GRAVITY)).into()),
            heading: None,
            mag_dt: dt,
            floor: 0.0,
            starting: false,
        }
    }

    /// Without an offset, the variance P of an axis follows dP/dt = Q - P^2 / R and ends at the
    /// root of Q R. Nothing shows the heading: its variance is time times Q.
    #[test]
    fn the_covariance_is_that_of_the_riccati_equation() {
        let gains = KalmanGains { bias_rad_s: 0.0, bias_rad2_s3: 0.0, ..KalmanGains::default() };
        let mut kalman = Kalman::<f64>::new(&gains).expect("valid");
        for _ in 0..100_000 {
            let half_angle = kalman.correction(&still(0.001), &mut [0.0; 3]);
            assert!(Vector3::from(half_angle).norm() < 1e-9);
        }
        let (q, r) = (f64::from(gains.gyr_rad2_s), f64::from(gains.acc_rad2_s));
        let [north, east, down] = kalman.attitude;
        let expected = (q * r).sqrt();
        for tilt in [north[0], east[1]] {
            assert!((tilt - expected).abs() < 0.01 * expected, "{tilt} {expected}");
        }
        assert!((down[2] - 0.1 - 100.0 * q).abs() < 1e-4, "{}", down[2]);
        assert_eq!(kalman.offset, [[0.0; 3]; 3]);
    }

    /// The first correction is P / (P + R/dt) of the error, about the error's axis.
    #[test]
    fn a_tilt_is_corrected_about_its_axis() {
        let mut kalman = Kalman::<f64>::new(&KalmanGains::default()).expect("valid");
        let (dt, tilt) = (0.01, 0.02f64);
        // The true attitude is turned by `tilt` about north: up is seen at sin(tilt) to the west.
        let up = f64::from(GRAVITY);
        let view = View {
            acc: Some(Vector3::new(0.0, -tilt.sin() * up, -tilt.cos() * up).into()),
            ..still(dt)
        };
        let half_angle = kalman.correction(&view, &mut [0.0; 3]);
        let variance = 0.1;
        let gain = variance / (variance + f64::from(KalmanGains::default().acc_rad2_s) / dt);
        let expected = 0.5 * gain * tilt;
        assert!((half_angle[0] - expected).abs() < 1e-3 * expected, "{half_angle:?}");
        assert!(half_angle[1].abs() + half_angle[2].abs() < 1e-9);
    }
}
