//! Recovery of the attitude after the gyroscope has clipped.
//!
//! While a rate is clipped, only the rotation about its axis is unknown: the covariance of the
//! attitude's error grows along one direction. Accelerometer and magnetometer each show two of the
//! three components of the error. The slopes before and after the clipping show the angle about the
//! axis. A Kalman filter weighs them. Its state is the error as a rotation vector in the earth
//! frame, where it stands still after the clipping. Each step moves the error into the attitude,
//! which leaves a state of zero.
//!
//! Here the field's whole direction turns the estimate, roll and pitch included. That lasts for
//! seconds and corrects errors far larger than those of an ordinary disturbance.

use crate::config::GRAVITY;
use crate::filter::View;
use crate::quaternion::HalfRows;
use crate::range::Hidden;
use crate::real::Real;
use crate::vector::{Matrix, add_outer, add_scaled, cross, dot, observe, scaled, zero};

/// Density of the rate beyond the limit, in parts of the limit: half of it, correlated for 0.1 s,
/// `2 * 0.5^2 * 0.1`.
const EXCESS_S: f32 = 0.05;

/// Deviation of the field's direction, rad, and its correlation time, s.
const FIELD: f32 = 0.1;
const FIELD_S: f32 = 0.05;

/// Standard deviation of a magnetometer's lag, s.
const LAG_DEVIATION_S: f32 = 0.02;

/// Largest deviation of an undisturbed field's strength, as a fraction of the reference.
const STRENGTH: f32 = 0.15;

/// Time of recovery after the last clipping, s. The filter's own gains correct the rest.
const LASTING_S: f32 = 2.0;

/// Share of the heading's variance that remains after that time, because the field's errors last
/// longer.
const LEFT: f32 = 0.35;

/// The observations of accelerometer and magnetometer.
pub(crate) struct Seen<T> {
    /// Specific force, m/s^2.
    pub(crate) acc: Option<[T; 3]>,
    /// Noise of its vertical, as a density, rad^2 s.
    pub(crate) acc_density: T,
    /// Field, uT, in the body frame, and its reference in the earth frame.
    pub(crate) field: Option<([T; 3], [T; 3])>,
    /// Lag of the field behind the rates, s.
    pub(crate) field_lag_s: T,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Recovery<T> {
    /// Covariance of the error, rad^2.
    covariance: Matrix<T>,
    /// The error found in this step, rad.
    error: [T; 3],
    /// Correction of the attitude so far about each clipped axis, rad.
    given: [Option<T>; 3],
    left_s: T,
}

impl<T: Real> Recovery<T> {
    /// Whether a rate is clipped, or clipped within [`LASTING_S`].
    #[inline(always)]
    pub(crate) fn is_active(&self) -> bool {
        self.left_s > T::ZERO
    }

    /// One step, from the axes' hidden rotations and the observations. Gives the correction, half a
    /// rotation vector in the body frame (rad), and the growth of the heading's variance (rad^2).
    #[cold]
    #[inline(never)]
    pub(crate) fn step(
        &mut self,
        view: &View<T>,
        hidden: &[Hidden<T>; 3],
        seen: &Seen<T>,
    ) -> ([T; 3], T) {
        let (dt, rows) = (view.dt, &view.rows);
        if !self.is_active() {
            (self.covariance, self.given) = ([zero(); 3], [None; 3]);
        }
        self.error = zero();
        self.left_s = self.left_s - dt;
        let axes = columns(rows);
        let mut heading_variance = T::ZERO;
        let mut given = self.given;
        for ((axis, hidden), given) in axes.iter().zip(hidden).zip(&mut given) {
            heading_variance += self.axis(dt, axis, *hidden, given);
        }
        self.given = given;
        if !self.is_active() {
            return (zero(), heading_variance);
        }
        if let Some(acc) = seen.acc {
            let up = scaled(&rows.rotate(&acc), T::from_f32(1.0 / GRAVITY));
            let expected = [T::ZERO, T::ZERO, -T::ONE];
            self.observe(&up, &expected, seen.acc_density * dt.recip());
        }
        if let Some((field, expected)) = &seen.field {
            self.compare(view, field, expected, seen.field_lag_s);
        }
        for (axis, given) in axes.iter().zip(&mut self.given) {
            if let Some(given) = given {
                *given += dot(axis, &self.error);
            }
        }
        let half = axes.map(|axis| dot(&axis, &self.error) * T::HALF);
        (half, heading_variance)
    }

    /// Takes the hidden rotation of an axis; gives the growth of the heading's variance.
    fn axis(&mut self, dt: T, axis: &[T; 3], hidden: Hidden<T>, given: &mut Option<T>) -> T {
        match hidden {
            Hidden::Nothing => T::ZERO,
            Hidden::Rate(limit) => {
                given.get_or_insert(T::ZERO);
                self.left_s = T::from_f32(LASTING_S);
                self.widen(axis, limit * limit * T::from_f32(EXCESS_S) * dt);
                T::ZERO
            }
            Hidden::Angle(angle, sigma) => {
                let variance = sigma * sigma;
                let left = match given.take() {
                    Some(given) => angle - given,
                    None => {
                        // The limit is only supposed: no correction yet.
                        self.left_s = T::from_f32(LASTING_S);
                        self.widen(axis, T::ONE);
                        angle
                    }
                };
                self.update(axis, left, variance);
                variance * axis[2] * axis[2] * T::from_f32(LEFT)
            }
        }
    }

    /// The error about an axis has gained a variance, rad^2.
    fn widen(&mut self, axis: &[T; 3], variance: T) {
        add_outer(&mut self.covariance, axis, axis, variance);
    }

    /// The field's direction, in parts of its expected strength.
    fn compare(&mut self, view: &View<T>, field: &[T; 3], expected: &[T; 3], lag_s: T) {
        let rate = &view.rate;
        let scale = dot(expected, expected).sqrt().recip();
        // dm/dt = m x rate in the body frame.
        let mut now = *field;
        add_scaled(&mut now, &cross(field, rate), lag_s);
        let field = scaled(&now, scale);
        let off = dot(&field, &field).sqrt() - T::ONE;
        if off.within(T::from_f32(STRENGTH)) {
            let lag = T::from_f32(LAG_DEVIATION_S);
            let noise = T::from_f32(FIELD * FIELD) + dot(rate, rate) * lag * lag + off * off;
            // More samples in a correlation time say no more than one.
            let samples = T::from_f32(FIELD_S) * view.mag_dt.recip();
            let samples = if samples > T::ONE { samples } else { T::ONE };
            let (field, expected) = (view.rows.rotate(&field), scaled(expected, scale));
            self.observe(&field, &expected, noise * samples);
        }
    }

    /// A seen direction in the earth frame, and the expected direction, both about 1 long:
    /// `expected - seen = error x seen`.
    fn observe(&mut self, seen: &[T; 3], expected: &[T; 3], variance: T) {
        let s = seen;
        for (row, difference) in [
            ([T::ZERO, s[2], -s[1]], expected[0] - s[0]),
            ([-s[2], T::ZERO, s[0]], expected[1] - s[1]),
            ([s[1], -s[0], T::ZERO], expected[2] - s[2]),
        ] {
            let left = difference - dot(&row, &self.error);
            self.update(&row, left, variance);
        }
    }

    /// The Kalman filter's update: the error along `row` exceeds its estimate by `left`.
    fn update(&mut self, row: &[T; 3], left: T, variance: T) {
        observe((&mut self.error, &mut self.covariance), row, left, variance);
    }
}

/// The body's axes in the earth frame.
fn columns<T: Real>(rows: &HalfRows<T>) -> [[T; 3]; 3] {
    let twice = |n: T, e: T, d: T| [n + n, e + e, d + d];
    let HalfRows { north, east, down } = rows;
    [
        twice(north[0], east[0], down[0]),
        twice(north[1], east[1], down[1]),
        twice(north[2], east[2], down[2]),
    ]
}
