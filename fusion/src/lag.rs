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
//! `-lag R (m x w)` about a constant mean. Five times a second, let `s` and `x` be the deviations
//! of `R m` and of `R (m x w)` from their running means, in parts of the field. The rest
//! `s + lag x` is noise with the mean square `v`, of which some 2.5 samples in a row say the same.
//! With the standard deviation `sd` of the configured lag, the most probable lag is
//!
//! ```text
//! weight = 2.5 v / sd^2
//! lag = (weight mag_lag_s - sum s.x) / (weight + sum x.x)
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

/// Share of a sample in the means: they forget in half a second.
const SHARE: f32 = 0.286;

/// The noise before it is measured, in parts of the field, and as how many samples it counts.
const NOISE: f32 = 0.03;
const NOISE_SAMPLES: u16 = 25;

/// Samples in a row with the same noise.
const CORRELATED: f32 = 2.5;

/// Time between two samples that teach the lag, s: more samples would tell little.
const LEARN_S: f32 = 0.2;

/// Samples that teach the lag before it is renewed.
const RENEW: u16 = 4;

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
    /// `2.5 / sd^2`, 1/s^2.
    per_noise: T,
    /// `sum s.s`.
    own: T,
    /// `sum s.x`, 1/s.
    product: T,
    /// `sum x.x`, 1/s^2.
    square: T,
    /// Samples that have taught the lag. After 65,535, four hours of turning, it stays.
    taught: u16,
}

impl<T: Real> Regression<T> {
    fn new(configured_s: T, per_noise: T) -> Self {
        Self {
            configured_s,
            per_noise,
            own: T::from_f32(NOISE * NOISE * f32::from(NOISE_SAMPLES)),
            taught: NOISE_SAMPLES,
            ..Self::default()
        }
    }
}

impl<T: Real> FieldLag<T> {
    /// `sd_s`: the standard deviation of the configured lag, s.
    pub(crate) fn new(lag_s: f32, sd_s: f32) -> Result<Self, ConfigError> {
        let configured_s = checked(lag_s, "mag_lag_s")?;
        in_range(sd_s, 0.0, LONGEST_S, "mag_lag_sd_s")?;
        Ok(Self {
            lag_s: configured_s,
            learned: (sd_s >= LEAST_SD_S)
                .then(|| Regression::new(configured_s, T::from_f32(CORRELATED / (sd_s * sd_s)))),
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
            *regression = Regression::new(lag_s, regression.per_noise);
        }
    }

    pub(crate) fn lag_s(&self) -> T {
        self.lag_s
    }

    /// Whether a sample, `dt` (s) after the sample before, is to teach the lag.
    #[inline(always)]
    pub(crate) fn is_due(&mut self, dt: T) -> bool {
        let Some(regression) = &mut self.learned else {
            return false;
        };
        regression.waited_s += dt;
        let is_due = !regression.waited_s.within(T::from_f32(LEARN_S));
        if is_due {
            regression.waited_s = T::ZERO;
        }
        is_due
    }

    /// One measured sample of a field with the strength `1 / per_field`.
    #[inline(never)]
    pub(crate) fn learn(
        &mut self,
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
        let s = difference(&seen, seen_mean);
        let x = difference(&turned, turned_mean);
        add_scaled(seen_mean, &s, T::from_f32(SHARE));
        add_scaled(turned_mean, &x, T::from_f32(SHARE));
        regression.own += dot(&s, &s);
        regression.product += dot(&s, &x);
        regression.square += dot(&x, &x);
        regression.taught = regression.taught.saturating_add(1);
        if !regression.taught.is_multiple_of(RENEW) {
            return;
        }
        let Regression { own, product, square, taught, per_noise, configured_s, .. } = *regression;
        let count = T::from_f32(taught.into());
        // `count v / sd^2`, with the sum of `|s + lag x|^2`.
        let noise = own + (product + product + self.lag_s * square) * self.lag_s;
        let weight = noise * per_noise;
        let lag_s = (weight * configured_s - product * count) * (weight + square * count).recip();
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
            if lag.is_due(0.02) {
                lag.learn(&q.half_rows(), &seen.into(), &rate.into(), 1.0 / field.norm());
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
