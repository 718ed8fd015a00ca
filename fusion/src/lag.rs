//! Sensors that show an earlier attitude than the gyroscope.
//!
//! Filters and conversion make the samples of one sensor older than another's. A vector `v` that
//! stands still in the earth frame changes in the body frame by `dv/dt = v x w` at the rotation
//! rate `w`. A vector seen `lag` ago is now, to second order and at a constant rate,
//!
//! ```text
//! v + lag (v x w) + lag^2/2 ((v x w) x w)
//! ```
//!
//! The field shows its own lag: as the body turns, it moves in the estimated earth frame by
//! `-lag R (m x w)` about a constant mean. Let `s` and `x` be the deviations of `R m` and of
//! `R (m x w)` from their means over half a second, in parts of the field. The rest `s + lag x` is
//! noise with the mean square `v`, of which samples within half a second say the same. With the
//! standard deviation `sd` of the configured lag, the most probable lag is
//!
//! ```text
//! weight = v 0.5 s / sd^2
//! lag = (weight mag_lag_s - sum s.x dt) / (weight + sum x.x dt)
//! ```
//!
//! So a disturbed field teaches slowly.
//!
//! The accelerometer's lag cannot be found so: off the centre of a motion, accelerations go with
//! the turning and look the same.

use crate::error::{ConfigError, in_range};
use crate::quaternion::HalfRows;
use crate::real::Real;
use crate::vector::{add_scaled, cross, difference, dot, scaled, within};

/// Largest lag that second order describes, s.
const LONGEST_S: f32 = 0.1;

/// Least standard deviation with which a lag is learned, s.
const LEAST_SD_S: f32 = 1e-6;

/// Time constant of the means, and time over which noise is correlated, s.
const MEAN_S: f32 = 0.5;

/// The noise before it is measured, in parts of the field, and the time for which it counts, s.
const NOISE: f32 = 0.03;
const NOISE_S: f32 = 5.0;

/// Time between two samples that teach the lag, s: more samples would tell little.
const LEARN_S: f32 = 0.2;

/// The turn within a lag, per axis, rad, up to which first order is enough: its error is 6e-4 of
/// the vector.
const SHORT_TURN: f32 = 0.02;

/// The present value of a vector that was `v` in the body frame `lag_s` ago, at the rate `rate`
/// (rad/s).
#[inline(always)]
pub(crate) fn now<T: Real>(v: &[T; 3], rate: &[T; 3], lag_s: T) -> [T; 3] {
    let turn = scaled(rate, lag_s);
    let first = cross(v, &turn);
    let mut now = [v[0] + first[0], v[1] + first[1], v[2] + first[2]];
    if !within(&turn, T::from_f32(SHORT_TURN)) {
        add_scaled(&mut now, &cross(&first, &turn), T::HALF);
    }
    now
}

/// A lag of the configuration, s.
pub(crate) fn checked<T: Real>(lag_s: f32, name: &'static str) -> Result<T, ConfigError> {
    in_range(lag_s, -LONGEST_S, LONGEST_S, name)?;
    Ok(T::from_f32(lag_s))
}

/// The field's lag, learned while the body turns.
#[derive(Clone, Debug, Default)]
pub(crate) struct FieldLag<T> {
    /// The lag now, s.
    lag_s: T,
    /// `None` if the lag stays as configured.
    learned: Option<Regression<T>>,
}

#[derive(Clone, Debug, Default)]
struct Regression<T> {
    /// Means of the field and of its change by a second's turning, earth frame, in parts of the
    /// field.
    means: Option<([T; 3], [T; 3])>,
    /// Time since the last sample that taught the lag, s.
    waited_s: T,
    /// The configured lag, s.
    configured_s: T,
    /// `0.5 s / sd^2`, 1/s.
    per_noise: T,
    /// `sum s.x dt`, s.
    product: T,
    /// `sum x.x dt`, 1/s.
    square: T,
    /// `sum |s + lag x|^2 dt`, and the sum of the times, s.
    noise: [T; 2],
}

impl<T: Real> FieldLag<T> {
    /// `sd_s`: the standard deviation of the configured lag, s.
    pub(crate) fn new(lag_s: f32, sd_s: f32) -> Result<Self, ConfigError> {
        let configured_s = checked(lag_s, "mag_lag_s")?;
        in_range(sd_s, 0.0, LONGEST_S, "mag_lag_sd_s")?;
        Ok(Self {
            lag_s: configured_s,
            learned: (sd_s >= LEAST_SD_S).then(|| Regression {
                configured_s,
                per_noise: T::from_f32(MEAN_S / (sd_s * sd_s)),
                noise: [NOISE * NOISE * NOISE_S, NOISE_S].map(T::from_f32),
                ..Regression::default()
            }),
        })
    }

    /// The lag as known, with the other sign.
    #[cfg(feature = "offline")]
    pub(crate) fn reversed(&self) -> Self {
        Self { lag_s: -self.lag_s, learned: None }
    }

    /// The lag is known from elsewhere, as firmly as by the configuration.
    pub(crate) fn set_lag_s(&mut self, lag_s: T) {
        self.lag_s = lag_s;
        if let Some(regression) = &mut self.learned {
            regression.configured_s = lag_s;
            (regression.product, regression.square) = (T::ZERO, T::ZERO);
        }
    }

    pub(crate) fn lag_s(&self) -> T {
        self.lag_s
    }

    /// A sample comes `dt` (s) after the sample before. If it is to teach the lag, the time since
    /// the last such sample, s.
    #[inline(always)]
    pub(crate) fn due(&mut self, dt: T) -> Option<T> {
        let regression = self.learned.as_mut()?;
        regression.waited_s += dt;
        (!regression.waited_s.within(T::from_f32(LEARN_S)))
            .then(|| core::mem::replace(&mut regression.waited_s, T::ZERO))
    }

    /// One measured sample, `dt` (s) after the last sample that taught the lag, of a field with the
    /// strength `1 / per_field`.
    #[inline(never)]
    pub(crate) fn learn(
        &mut self,
        dt: T,
        rows: &HalfRows<T>,
        field: &[T; 3],
        rate: &[T; 3],
        per_field: T,
    ) {
        let Some(regression) = &mut self.learned else {
            return;
        };
        let field = scaled(field, per_field);
        let seen = rows.rotate(&field);
        let turned = rows.rotate(&cross(&field, rate));
        let (seen_mean, turned_mean) = regression.means.get_or_insert((seen, turned));
        let share = dt * (T::from_f32(MEAN_S) + dt).recip();
        let s = difference(&seen, seen_mean);
        let x = difference(&turned, turned_mean);
        add_scaled(seen_mean, &s, share);
        add_scaled(turned_mean, &x, share);
        let mut rest = s;
        add_scaled(&mut rest, &x, self.lag_s);
        regression.noise[0] += dot(&rest, &rest) * dt;
        regression.noise[1] += dt;
        regression.product += dot(&s, &x) * dt;
        regression.square += dot(&x, &x) * dt;
        let weight = regression.noise[0] * regression.noise[1].recip() * regression.per_noise;
        let lag_s = (weight * regression.configured_s - regression.product)
            * (weight + regression.square).recip();
        if lag_s.within(T::from_f32(LONGEST_S)) {
            self.lag_s = lag_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quaternion::Quaternion;
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn a_vector_is_where_the_turn_has_taken_it() {
        let rate = Vector3::new(3.0f64, -5.0, 2.0);
        let seen = Vector3::new(20.0, 5.0, -40.0);
        for lag_s in [0.0, 0.004, 0.012, -0.01] {
            let turn = UnitQuaternion::from_scaled_axis(rate * lag_s);
            let error = (Vector3::from(now(&seen.into(), &rate.into(), lag_s))
                - turn.inverse() * seen)
                .norm();
            // The third-order term, (|w| lag)^3 / 6 of the vector, or the error of first order.
            let turn = (rate.norm() * lag_s).abs();
            let most = (turn.powi(3) / 6.0).max(6.5e-4) * seen.norm();
            assert!(error <= most, "{error} at {lag_s}");
        }
    }

    /// A minute of turning with a field that is `late_s` late.
    fn learned(late_s: f64, mut lag: FieldLag<f64>) -> f64 {
        let field = Vector3::new(17.1, 0.0, 47.0);
        let mut truth = UnitQuaternion::identity();
        for k in 0..3_000 {
            let t = f64::from(k) * 0.02;
            let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * 2.0;
            truth *= UnitQuaternion::from_scaled_axis(rate * 0.02);
            let then = truth * UnitQuaternion::from_scaled_axis(-rate * late_s);
            let q = Quaternion { w: truth.w, x: truth.i, y: truth.j, z: truth.k };
            let seen = then.inverse() * field;
            if let Some(dt) = lag.due(0.02) {
                lag.learn(dt, &q.half_rows(), &seen.into(), &rate.into(), 1.0 / field.norm());
            }
        }
        lag.lag_s()
    }

    #[test]
    fn the_field_tells_how_late_it_is() {
        for late_s in [0.0, 0.012, 0.04] {
            let lag_s = learned(late_s, FieldLag::new(0.004, 0.02).expect("valid"));
            assert!((lag_s - late_s).abs() < 3e-4 + 0.04 * late_s, "{lag_s} for {late_s}");
        }
    }

    #[test]
    fn a_lag_without_deviation_stays_as_configured() {
        let lag = FieldLag::new(0.004, 0.0).expect("valid");
        assert_eq!(learned(0.012, lag), f64::from(0.004f32));
    }

    #[test]
    fn impossible_lags_are_refused_by_name() {
        let said = |lag_s, sd_s| FieldLag::<f32>::new(lag_s, sd_s).expect_err("impossible");
        assert_eq!(said(0.2, 0.005), ConfigError::OutOfRange("mag_lag_s"));
        assert_eq!(said(f32::NAN, 0.005), ConfigError::OutOfRange("mag_lag_s"));
        for sd_s in [f32::NAN, -0.001, 0.2] {
            assert_eq!(said(0.0, sd_s), ConfigError::OutOfRange("mag_lag_sd_s"));
        }
    }
}
