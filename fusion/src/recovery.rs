//! Finding the attitude again after the gyroscope has clipped.
//!
//! While a rate is clipped the rotation about that axis is unknown, and about no other: the
//! covariance of the attitude's error grows along one direction only. Accelerometer and
//! magnetometer each show two of the three components of the error, and the slopes before and after
//! the clipping show the angle about the axis. A Kalman filter weighs them. Its state is the error
//! as a rotation vector in the earth frame, where it stands still once the clipping is over; it is
//! given to the attitude with every step and so is always zero again.
//!
//! Only here does the field's whole direction turn the estimate, roll and pitch included: for
//! seconds, from an attitude that is off by far more than an ordinary disturbance of the field
//! makes it.

use crate::config::GRAVITY;
use crate::quaternion::HalfRows;
use crate::range::Hidden;
use crate::real::Real;
use crate::vector::{Matrix, add_outer, add_scaled, cross, dot, observe, scaled, zero};

/// The rate beyond the limit, in parts of it and as a density: half of it, correlated for 0.1 s,
/// `2 * 0.5^2 * 0.1`.
const EXCESS_S: f32 = 0.05;

/// Deviation of the field's direction, rad; its time of correlation, s, makes it a density.
const FIELD: f32 = 0.1;
const FIELD_S: f32 = 0.05;

/// Standard deviation of a magnetometer's lag, s.
const LAG_DEVIATION_S: f32 = 0.02;

/// A field whose strength is further off than this is disturbed, as a fraction of the reference.
const STRENGTH: f32 = 0.15;

/// Time for which the recovery works after the last clipping, s; the filter's own gains take away
/// what is left.
const LASTING_S: f32 = 2.0;

/// The part of a heading's variance that the field does not take away within that time, because its
/// errors are the same for longer.
const LEFT: f32 = 0.35;

/// What accelerometer and magnetometer show.
pub(crate) struct Seen<T> {
    /// Specific force, m/s^2.
    pub(crate) acc: Option<[T; 3]>,
    /// The noise of the vertical that it shows, as a density, rad^2 s.
    pub(crate) acc_density: T,
    /// Field, uT, in the body frame, and what it should be in the earth frame.
    pub(crate) field: Option<([T; 3], [T; 3])>,
    /// Time since the last field, s.
    pub(crate) field_dt: T,
    /// How late the field is behind the rates, s.
    pub(crate) field_lag_s: T,
    /// Rotation rate, rad/s.
    pub(crate) rate: [T; 3],
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Recovery<T> {
    /// Covariance of the error, rad^2.
    covariance: Matrix<T>,
    /// The error found in this step, rad.
    error: [T; 3],
    /// The angle by which the attitude was corrected so far about each axis that is clipped, rad.
    given: [Option<T>; 3],
    left_s: T,
}

impl<T: Real> Recovery<T> {
    /// Whether a rate is clipped, or was within [`LASTING_S`].
    #[inline(always)]
    pub(crate) fn is_active(&self) -> bool {
        self.left_s > T::ZERO
    }

    /// One step: what the axes hide and what is seen, with the earth's axes at half length. The
    /// correction, half a rotation vector in the body frame (rad), and the variance that the
    /// heading has gained (rad^2).
    #[cold]
    #[inline(never)]
    pub(crate) fn step(
        &mut self,
        dt: T,
        rows: &HalfRows<T>,
        hidden: &[Hidden<T>; 3],
        seen: &Seen<T>,
    ) -> ([T; 3], T) {
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
            self.compare(rows, seen, field, expected);
        }
        for (axis, given) in axes.iter().zip(&mut self.given) {
            if let Some(given) = given {
                *given += dot(axis, &self.error);
            }
        }
        let half = axes.map(|axis| dot(&axis, &self.error) * T::HALF);
        (half, heading_variance)
    }

    /// What an axis hides; the variance that the heading gains by it.
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
                        // The limit was only supposed: nothing was corrected yet.
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
    fn compare(&mut self, rows: &HalfRows<T>, seen: &Seen<T>, field: &[T; 3], expected: &[T; 3]) {
        let rate = &seen.rate;
        let scale = dot(expected, expected).sqrt().recip();
        // dm/dt = m x rate in the body frame.
        let mut now = *field;
        add_scaled(&mut now, &cross(field, rate), seen.field_lag_s);
        let field = scaled(&now, scale);
        let off = dot(&field, &field).sqrt() - T::ONE;
        if off.within(T::from_f32(STRENGTH)) {
            let lag = T::from_f32(LAG_DEVIATION_S);
            let noise = T::from_f32(FIELD * FIELD) + dot(rate, rate) * lag * lag + off * off;
            // More samples in a time of correlation say no more than one.
            let samples = T::from_f32(FIELD_S) * seen.field_dt.recip();
            let samples = if samples > T::ONE { samples } else { T::ONE };
            let (field, expected) = (rows.rotate(&field), scaled(expected, scale));
            self.observe(&field, &expected, noise * samples);
        }
    }

    /// A direction is seen in the earth frame where another is expected, about as long as one;
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

    /// The Kalman filter's update: the error along `row` is by `left` larger than what was found of
    /// it.
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
