//! Vectors of any [`Number`], for which nalgebra's own operators ask for more.

use nalgebra::Vector3;

use crate::real::{Number, Real};

/// The vector without a length.
#[inline(always)]
pub(crate) fn zero<T: Number>() -> Vector3<T> {
    Vector3::new(T::ZERO, T::ZERO, T::ZERO)
}

/// Every component of `v` is within `limit` of 0, and a number.
#[inline(always)]
pub(crate) fn within<T: Number>(v: &Vector3<T>, limit: T) -> bool {
    v.x.within(limit) && v.y.within(limit) && v.z.within(limit)
}

/// `v k`
#[inline(always)]
pub(crate) fn scaled<T: Number>(v: &Vector3<T>, k: T) -> Vector3<T> {
    Vector3::new(v.x * k, v.y * k, v.z * k)
}

/// `sum += v k`
#[inline(always)]
pub(crate) fn add_scaled<T: Number>(sum: &mut Vector3<T>, v: &Vector3<T>, k: T) {
    sum.x += v.x * k;
    sum.y += v.y * k;
    sum.z += v.z * k;
}

/// `a - b`
#[inline(always)]
pub(crate) fn difference<T: Number>(a: &Vector3<T>, b: &Vector3<T>) -> Vector3<T> {
    Vector3::new(a.x - b.x, a.y - b.y, a.z - b.z)
}

/// Scalar product, summed from x to z.
#[inline(always)]
pub(crate) fn dot<T: Number>(a: &Vector3<T>, b: &Vector3<T>) -> T {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// Vector product.
#[inline(always)]
pub(crate) fn cross<T: Number>(a: &Vector3<T>, b: &Vector3<T>) -> Vector3<T> {
    Vector3::new(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    )
}

/// Direction of a vector; `None` below a length of 1e-6 (of numbers around 1) or beyond 1e15.
pub(crate) fn unit<T: Real>(v: &Vector3<T>) -> Option<Vector3<T>> {
    let n = dot(v, v);
    (T::from_f32(1e-12)..T::from_f32(1e30))
        .contains(&n)
        .then(|| scaled(v, n.sqrt().recip()))
}
