//! Vectors of three numbers.

use crate::real::Real;

/// Rows of a matrix.
pub(crate) type Matrix<T> = [[T; 3]; 3];

/// The vector without a length.
#[inline(always)]
pub(crate) fn zero<T: Real>() -> [T; 3] {
    [T::ZERO, T::ZERO, T::ZERO]
}

/// Every component of `v` is within `limit` of 0, and a number.
#[inline(always)]
pub(crate) fn within<T: Real>(v: &[T; 3], limit: T) -> bool {
    v[0].within(limit) && v[1].within(limit) && v[2].within(limit)
}

/// `v k`
#[inline(always)]
pub(crate) fn scaled<T: Real>(v: &[T; 3], k: T) -> [T; 3] {
    [v[0] * k, v[1] * k, v[2] * k]
}

/// `sum += v k`
#[inline(always)]
pub(crate) fn add_scaled<T: Real>(sum: &mut [T; 3], v: &[T; 3], k: T) {
    sum[0] += v[0] * k;
    sum[1] += v[1] * k;
    sum[2] += v[2] * k;
}

/// `sum += v`
#[inline(always)]
pub(crate) fn add<T: Real>(sum: &mut [T; 3], v: &[T; 3]) {
    sum[0] += v[0];
    sum[1] += v[1];
    sum[2] += v[2];
}

/// `a - b`
#[inline(always)]
pub(crate) fn difference<T: Real>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Scalar product, summed from x to z.
#[inline(always)]
pub(crate) fn dot<T: Real>(a: &[T; 3], b: &[T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[inline(always)]
pub(crate) fn cross<T: Real>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The diagonal matrix of this number.
pub(crate) fn diagonal<T: Real>(value: T) -> Matrix<T> {
    let mut matrix = Matrix::default();
    add_diagonal(&mut matrix, value);
    matrix
}

/// `matrix += value I`
pub(crate) fn add_diagonal<T: Real>([x, y, z]: &mut Matrix<T>, value: T) {
    x[0] += value;
    y[1] += value;
    z[2] += value;
}

/// `matrix += left right^T k`
pub(crate) fn add_outer<T: Real>(matrix: &mut Matrix<T>, left: &[T; 3], right: &[T; 3], k: T) {
    for (line, part) in matrix.iter_mut().zip(left) {
        add_scaled(line, right, *part * k);
    }
}

/// A Kalman filter's update: `row . state` is seen to be larger by `left`, with this variance. A
/// variance along the row that rounding has made negative changes nothing.
pub(crate) fn observe<T: Real>(
    (state, covariance): (&mut [T; 3], &mut Matrix<T>),
    row: &[T; 3],
    left: T,
    variance: T,
) {
    let along = covariance.each_ref().map(|c| dot(c, row));
    let own = dot(row, &along);
    if own < T::ZERO {
        return;
    }
    let inverse = (own + variance).recip();
    add_scaled(state, &along, left * inverse);
    add_outer(covariance, &along, &along, -inverse);
}

/// Direction of a vector; `None` below a length of 1e-6 (of numbers around 1) or beyond 1e15.
pub(crate) fn unit<T: Real>(v: &[T; 3]) -> Option<[T; 3]> {
    let n = dot(v, v);
    (T::from_f32(1e-12)..T::from_f32(1e30)).contains(&n).then(|| scaled(v, n.sqrt().recip()))
}
