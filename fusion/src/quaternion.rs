//! Unit quaternions and their rotation matrices.

use crate::real::Real;
use crate::vector::{cross, dot, scaled, unit};

/// An orientation: a unit quaternion, Hamilton's convention, body to earth:
/// `v_earth = q v_body q*`.
///
/// Earth axes are north, east, down. A default quaternion is the identity: body x north, y east, z
/// down.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Quaternion<T = f32> {
    /// Scalar part, cosine of half the angle.
    pub w: T,
    /// Component along x.
    pub x: T,
    /// Component along y.
    pub y: T,
    /// Component along z.
    pub z: T,
}

/// Roll, pitch and yaw in rad, of the sequence yaw (about z), pitch (about y), roll (about x).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Euler<T = f32> {
    /// -pi..pi.
    pub roll_rad: T,
    /// -pi/2..pi/2. At +-pi/2 roll and yaw turn about the same axis, and only their difference or
    /// sum is defined. Near it both are noisy, though the quaternion is not.
    pub pitch_rad: T,
    /// -pi..pi, positive from north to east.
    pub yaw_rad: T,
}

/// Half of the rotation matrix body to earth, row by row: each row is an earth axis in the body
/// frame. The half spares the doublings.
#[derive(Clone, Copy, Debug)]
pub struct HalfRows<T> {
    /// Half of the unit vector north, body frame.
    pub north: [T; 3],
    /// Half of the unit vector east, body frame.
    pub east: [T; 3],
    /// Half of the unit vector down, body frame.
    pub down: [T; 3],
}

impl<T: Real> HalfRows<T> {
    /// A body vector in the earth frame.
    pub(crate) fn rotate(&self, v: &[T; 3]) -> [T; 3] {
        let twice = |half_row: &[T; 3]| {
            let half = dot(half_row, v);
            half + half
        };
        [twice(&self.north), twice(&self.east), twice(&self.down)]
    }
}

impl<T: Real> Quaternion<T> {
    /// No rotation.
    pub const IDENTITY: Self = Self::new(T::ONE, T::ZERO, T::ZERO, T::ZERO);

    /// From components whose squares have a sum of 1.
    #[inline(always)]
    pub const fn new(w: T, x: T, y: T, z: T) -> Self {
        Self { w, x, y, z }
    }

    /// From components of any length; the identity when the sum of their sizes is
    /// below 1e-30 or above 1e30.
    pub fn normalised(w: T, x: T, y: T, z: T) -> Self {
        let scale = w.abs() + x.abs() + y.abs() + z.abs();
        if !(T::from_f32(1e-30)..T::from_f32(1e30)).contains(&scale) {
            return Self::IDENTITY;
        }
        // Scaled first, so that squares neither overflow nor vanish.
        let q = Self::new(w, x, y, z).times(scale.recip());
        q.times(q.norm2().sqrt().recip())
    }

    /// All components times `k`.
    #[inline(always)]
    fn times(&self, k: T) -> Self {
        Self::new(self.w * k, self.x * k, self.y * k, self.z * k)
    }

    /// The square of the norm.
    #[inline(always)]
    pub(crate) fn norm2(&self) -> T {
        let Self { w, x, y, z } = *self;
        w * w + x * x + y * y + z * z
    }

    /// The rotation by the length of `angle` (rad) about its direction.
    pub fn from_rotation_vector(angle: &[T; 3]) -> Self {
        let mut q = Self::IDENTITY;
        q.advance(&scaled(angle, T::HALF));
        q
    }

    /// The rotation as a vector along its axis, as long as its angle, rad, 0..pi.
    pub fn rotation_vector(&self) -> [T; 3] {
        let (half, sine) = self.half_angle();
        // Of a small rotation the vector part is half the vector.
        let per_sine = if sine.within(T::from_f32(1e-6)) { T::ONE } else { half * sine.recip() };
        let k = per_sine.negated(self.w.is_negative());
        scaled(&[self.x, self.y, self.z], k + k)
    }

    /// Half the angle of the rotation, 0..pi/2, rad, and its sine.
    fn half_angle(&self) -> (T, T) {
        let Self { x, y, z, .. } = *self;
        let sine = (x * x + y * y + z * z).sqrt();
        (sine.atan2(self.w.abs()), sine)
    }

    /// From roll, pitch and yaw.
    pub fn from_euler(euler: &Euler<T>) -> Self {
        let (sr, cr) = (euler.roll_rad * T::HALF).sin_cos();
        let (sp, cp) = (euler.pitch_rad * T::HALF).sin_cos();
        let (sy, cy) = (euler.yaw_rad * T::HALF).sin_cos();
        Self {
            w: cr * cp * cy + sr * sp * sy,
            x: sr * cp * cy - cr * sp * sy,
            y: cr * sp * cy + sr * cp * sy,
            z: cr * cp * sy - sr * sp * cy,
        }
    }

    /// The orientation with up along `up_body` and north along the horizontal part of `north_body`.
    /// Without `north_body`, or if it is vertical, the heading is body x's, or body y's if x is
    /// vertical. `None` if `up_body` is too short for a direction.
    pub fn from_up_and_north(up_body: &[T; 3], north_body: Option<&[T; 3]>) -> Option<Self> {
        let up = unit(up_body)?;
        let down = [-up[0], -up[1], -up[2]];
        let east = north_body
            .and_then(|north| unit(&cross(&down, &unit(north)?)))
            .or_else(|| unit(&cross(&down, &[T::ONE, T::ZERO, T::ZERO])))
            .or_else(|| unit(&cross(&down, &[T::ZERO, T::ONE, T::ZERO])))?;
        let north = cross(&east, &down);
        Some(Self::from_rows(&north, &east, &down))
    }

    /// From the rows of the rotation matrix, the earth's axes in the body frame. Shepperd's method:
    /// the largest component first, so that no root of a small difference is needed.
    fn from_rows(n: &[T; 3], e: &[T; 3], d: &[T; 3]) -> Self {
        let (wx, wy, wz) = (d[1] - e[2], n[2] - d[0], e[0] - n[1]);
        let (xy, xz, yz) = (e[0] + n[1], d[0] + n[2], d[1] + e[2]);
        let trace = n[0] + e[1] + d[2];
        if trace >= n[0] && trace >= e[1] && trace >= d[2] {
            Self::normalised(T::ONE + trace, wx, wy, wz)
        } else if n[0] >= e[1] && n[0] >= d[2] {
            Self::normalised(wx, T::ONE + n[0] - e[1] - d[2], xy, xz)
        } else if e[1] >= d[2] {
            Self::normalised(wy, xy, T::ONE - n[0] + e[1] - d[2], yz)
        } else {
            Self::normalised(wz, xz, yz, T::ONE - n[0] - e[1] + d[2])
        }
    }

    /// The inverse rotation, earth to body.
    pub fn conj(&self) -> Self {
        Self::new(self.w, -self.x, -self.y, -self.z)
    }

    /// The same attitude with earth axes east, north, up.
    pub fn to_enu(&self) -> Self {
        let Self { w, x, y, z } = *self;
        // Half a turn about the horizontal between north and east.
        let k = T::from_f32(0.5).sqrt();
        Self::new(-x - y, w + z, w - z, y - x).times(k)
    }

    /// The same attitude with earth axes north, west, up.
    pub fn to_nwu(&self) -> Self {
        // Half a turn about north.
        Self::new(-self.x, self.w, -self.z, self.y)
    }

    /// The product `self * other`: first `other`, then `self`.
    #[inline]
    pub fn mul(&self, other: &Self) -> Self {
        let (a, b) = (self, other);
        Self {
            w: a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
            x: a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            y: a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            z: a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        }
    }

    /// A body vector in the earth frame.
    pub fn rotate(&self, v: &[T; 3]) -> [T; 3] {
        self.half_rows().rotate(v)
    }

    /// Up (against gravity) in the body frame, a unit vector.
    pub fn up(&self) -> [T; 3] {
        self.half_down().map(|half| -(half + half))
    }

    /// Sine of the pitch, -1..1: cheap, smooth, and enough for a controller near upright.
    pub fn sin_pitch(&self) -> T {
        let half = self.w * self.y - self.x * self.z;
        (half + half).limited(T::ONE)
    }

    /// Pitch in rad, -pi/2..pi/2, positive nose up.
    pub fn pitch(&self) -> T {
        self.sin_pitch().asin()
    }

    /// Roll, pitch and yaw. Never NaN for a finite quaternion.
    pub fn euler(&self) -> Euler<T> {
        let rows = self.half_rows();
        Euler {
            roll_rad: rows.down[1].atan2(rows.down[2]),
            pitch_rad: self.pitch(),
            yaw_rad: rows.east[0].atan2(rows.north[0]),
        }
    }

    /// The angle, rad, of the rotation between two orientations, 0..pi.
    pub fn angle_to(&self, other: &Self) -> T {
        let (half, _) = self.conj().mul(other).half_angle();
        half + half
    }

    /// Half the rotation matrix.
    #[inline]
    pub fn half_rows(&self) -> HalfRows<T> {
        let Self { w, x, y, z } = *self;
        let offset = w * w - T::HALF;
        let (wx, wy, wz) = (w * x, w * y, w * z);
        let (xy, xz, yz) = (x * y, x * z, y * z);
        HalfRows {
            north: [offset + x * x, xy - wz, xz + wy],
            east: [xy + wz, offset + y * y, yz - wx],
            down: [xz - wy, yz + wx, offset + z * z],
        }
    }

    /// Half of the unit vector down, in the body frame: the last row of [`Quaternion::half_rows`].
    #[inline]
    pub fn half_down(&self) -> [T; 3] {
        let Self { w, x, y, z } = *self;
        [x * z - w * y, w * x + y * z, w * w + z * z - T::HALF]
    }

    /// Turn by a rotation vector in the body frame, given at **half** its length (rad).
    pub fn advance(&mut self, half_angle: &[T; 3]) {
        self.turn(half_angle);
        self.restore_norm();
    }

    /// [`Quaternion::advance`] without a correction of the norm, which changes by less than 2e-7.
    ///
    /// The rotation of half angle `h` is `(cos |h|, h sin|h|/|h|)`. Both factors are series in
    /// `s = |h|^2`, cut before the first term below the resolution of f32. Vectors beyond
    /// `s = 1/16` are halved into that range, and the result is squared back.
    #[inline(always)]
    pub(crate) fn turn(&mut self, h: &[T; 3]) {
        // A rate of 3 deg/s at 100 Hz: 1 - cos|h| < 2e-7.
        self.turn_from(h, 3e-4);
    }

    /// [`Quaternion::turn`], in first order up to half angles of `small` (rad) about each axis. The
    /// norm is then off by `1.5 small^2`.
    #[inline(always)]
    pub(crate) fn turn_from(&mut self, h: &[T; 3], small: f32) {
        let small = T::from_f32(small);
        if h[0].within(small) && h[1].within(small) && h[2].within(small) {
            let Self { w, x, y, z } = *self;
            self.w = w - (x * h[0] + y * h[1] + z * h[2]);
            self.x = x + (w * h[0] + y * h[2] - z * h[1]);
            self.y = y + (w * h[1] + z * h[0] - x * h[2]);
            self.z = z + (w * h[2] + x * h[1] - y * h[0]);
            return;
        }
        let s = h[0] * h[0] + h[1] * h[1] + h[2] * h[2];
        // s^2 / 24 < 2e-7
        let turn = if s.within(T::from_f32(2e-3)) {
            let k = T::ONE - T::from_f32(1.0 / 6.0) * s;
            Self::new(T::ONE - T::HALF * s, h[0] * k, h[1] * k, h[2] * k)
        } else {
            Self::from_half_angle(*h, s)
        };
        *self = self.mul(&turn);
    }

    /// One Newton step of the inverse square root, for a norm near 1.
    #[inline(never)]
    pub(crate) fn restore_norm(&mut self) {
        *self = self.times(T::from_f32(1.5) - T::HALF * self.norm2());
    }

    #[inline(never)]
    fn from_half_angle(mut h: [T; 3], mut s: T) -> Self {
        let quarter = T::from_f32(0.25);
        let mut halvings = 0;
        // No gyroscope and step reach 2^10 turns; the bound proves the loop's end.
        while !s.within(T::from_f32(1.0 / 16.0)) && halvings < 16 {
            h = scaled(&h, T::HALF);
            s = s * quarter;
            halvings += 1;
        }
        let c =
            T::ONE - s * (T::HALF - s * (T::from_f32(1.0 / 24.0) - s * T::from_f32(1.0 / 720.0)));
        let k = T::ONE - s * (T::from_f32(1.0 / 6.0) - s * T::from_f32(1.0 / 120.0));
        let mut turn = Self::new(c, h[0] * k, h[1] * k, h[2] * k);
        for _ in 0..halvings {
            turn = turn.mul(&turn);
            // Squaring doubles the error of the norm too.
            turn.restore_norm();
        }
        turn
    }
}

impl<T: Real> Default for Quaternion<T> {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::{FRAC_PI_2, PI};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    fn oracle(q: &Quaternion) -> UnitQuaternion<f64> {
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
            q.w.into(),
            q.x.into(),
            q.y.into(),
            q.z.into(),
        ))
    }

    fn vector() -> impl Strategy<Value = Vector3<f32>> {
        (-1f32..1.0, -1f32..1.0, -1f32..1.0).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    fn orientation() -> impl Strategy<Value = Quaternion> {
        (-1f32..1.0, -1f32..1.0, -1f32..1.0, 0.01f32..1.0)
            .prop_map(|(w, x, y, z)| Quaternion::normalised(w, x, y, z))
    }

    #[test]
    fn a_quarter_turn_about_down_takes_body_x_to_east() {
        let q =
            Quaternion::from_euler(&Euler { roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: FRAC_PI_2 });
        let east = Vector3::from(q.rotate(&[1.0, 0.0, 0.0]));
        assert!((east - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-6);
    }

    #[test]
    fn nose_up_is_positive_pitch_and_tilts_up_towards_body_x() {
        let q = Quaternion::from_euler(&Euler { roll_rad: 0.0, pitch_rad: 0.5, yaw_rad: 1.0 });
        assert!((q.pitch() - 0.5).abs() < 1e-6);
        assert!(
            (Vector3::from(q.up()) - Vector3::new(0.5f32.sin(), 0.0, -0.5f32.cos())).norm() < 1e-6
        );
    }

    #[test]
    fn earth_axes_can_point_up() {
        let q = Quaternion::from_euler(&Euler { roll_rad: 0.3f64, pitch_rad: -0.5, yaw_rad: 1.1 });
        let v = Vector3::new(1.0, -2.0, 3.0);
        let ned = q.rotate(&v.into());
        let enu = Vector3::new(ned[1], ned[0], -ned[2]);
        assert!((Vector3::from(q.to_enu().rotate(&v.into())) - enu).norm() < 1e-12);
        let nwu = Vector3::new(ned[0], -ned[1], -ned[2]);
        assert!((Vector3::from(q.to_nwu().rotate(&v.into())) - nwu).norm() < 1e-12);
    }

    #[test]
    fn rotation_vectors_come_back() {
        for vector in [
            Vector3::new(0.0f64, 0.0, 0.0),
            Vector3::new(1e-9, -2e-9, 3e-9),
            Vector3::new(0.3, -0.4, 0.5),
            Vector3::new(0.0, 3.1, 0.0),
        ] {
            let q = Quaternion::from_rotation_vector(&vector.into());
            let negative = Quaternion { w: -q.w, x: -q.x, y: -q.y, z: -q.z };
            for q in [q, negative] {
                let error = (Vector3::from(q.rotation_vector()) - vector).norm();
                assert!(error < 1e-6 * vector.norm() + 1e-15, "{error} of {vector}");
            }
        }
    }

    #[test]
    fn straight_up_clamps_instead_of_giving_nan() {
        let c = libm::sqrtf(0.5) * 1.000_001;
        let q = Quaternion { w: c, x: 0.0, y: c, z: 0.0 };
        let euler = q.euler();
        assert_eq!(euler.pitch_rad, FRAC_PI_2);
        assert!(euler.roll_rad.is_finite() && euler.yaw_rad.is_finite());
    }

    #[test]
    fn up_and_north_give_the_orientation_that_sees_them() {
        let flat = Quaternion::from_up_and_north(&[0.0, 0.0, -9.81], None);
        assert_eq!(flat, Some(Quaternion::IDENTITY));
        // Body y points down, body x south.
        let q = Quaternion::from_up_and_north(&[0.0, -9.81, 0.0], Some(&[-20.0, 45.0, 0.0]))
            .expect("a direction");
        for (body, earth) in
            [([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])]
        {
            let error = Vector3::from(q.rotate(&body)) - Vector3::from(earth);
            assert!(error.norm() < 1e-6, "{error}");
        }
        assert_eq!(Quaternion::<f32>::from_up_and_north(&[0.0; 3], None), None);
    }

    #[test]
    fn a_vertical_field_or_a_vertical_x_axis_still_gives_an_orientation() {
        let down = Vector3::new(0.0f32, 0.0, 1.0);
        assert!(Quaternion::from_up_and_north(&(-down).into(), Some(&down.into())).is_some());
        assert!(
            Quaternion::from_up_and_north(&Vector3::new(1.0f32, 0.0, 0.0).into(), None).is_some()
        );
    }

    #[test]
    fn nothing_and_infinity_normalise_to_the_identity() {
        assert_eq!(Quaternion::normalised(0.0f32, 0.0, 0.0, 0.0), Quaternion::IDENTITY);
        assert_eq!(Quaternion::normalised(f32::INFINITY, 0.0, 0.0, 1.0), Quaternion::IDENTITY);
        assert_eq!(Quaternion::normalised(f32::NAN, 0.0, 0.0, 1.0), Quaternion::IDENTITY);
        assert_eq!(Quaternion::normalised(0.0f32, 1e-29, 0.0, 0.0).x, 1.0);
    }

    proptest! {
        #[test]
        fn product_rotation_and_euler_angles_agree_with_nalgebra(a in orientation(), b in orientation(), v in vector()) {
            let product = a.mul(&b);
            prop_assert!(oracle(&product).angle_to(&(oracle(&a) * oracle(&b))) < 1e-6);
            let expected = oracle(&a) * v.cast::<f64>();
            prop_assert!((Vector3::from(a.rotate(&v.into())).cast::<f64>() - expected).norm() < 1e-6);
            let back = Vector3::from(a.conj().rotate(&a.rotate(&v.into())));
            prop_assert!((back - v).norm() < 2e-6);
            let (roll, pitch, yaw) = oracle(&a).euler_angles();
            let euler = a.euler();
            if pitch.abs() < 1.5 {
                let tolerance = 1e-5 / pitch.cos();
                prop_assert!((f64::from(euler.pitch_rad) - pitch).abs() < tolerance);
                for (ours, theirs) in [(euler.roll_rad, roll), (euler.yaw_rad, yaw)] {
                    let gap = (f64::from(ours) - theirs).rem_euclid(core::f64::consts::TAU);
                    prop_assert!(gap.min(core::f64::consts::TAU - gap) < tolerance);
                }
            }
            prop_assert!(Quaternion::from_euler(&euler).angle_to(&a) < 2e-3);
        }

        #[test]
        fn advancing_by_a_rotation_vector_is_nalgebras_exponential(q in orientation(), v in vector(), scale in 0f32..12.0) {
            let angle = v * scale;
            let mut ours = q;
            ours.advance(&(angle * 0.5).into());
            let expected = oracle(&q) * UnitQuaternion::from_scaled_axis(angle.cast::<f64>());
            prop_assert!(oracle(&ours).angle_to(&expected) < 2e-5);
            let n = ours.w * ours.w + ours.x * ours.x + ours.y * ours.y + ours.z * ours.z;
            prop_assert!((n - 1.0).abs() < 1e-6);
        }

        #[test]
        fn up_and_north_recover_any_orientation(q in orientation(), dip in -1.4f32..1.4) {
            let north = q.conj().rotate(&[dip.cos(), 0.0, dip.sin()]);
            let found = Quaternion::from_up_and_north(&scaled(&q.up(), 9.81), Some(&scaled(&north, 50.0))).expect("a direction");
            prop_assert!(found.angle_to(&q) < 1e-5 / dip.cos());
        }
    }

    #[test]
    fn a_thousand_turns_keep_norm_and_angle() {
        let mut q = Quaternion::<f32>::IDENTITY;
        for _ in 0..1000 * 360 {
            q.advance(&Vector3::new(0.0, 0.0, PI / 360.0).into());
        }
        assert!((q.w.abs() - 1.0).abs() < 1e-6 && q.z.abs() < 0.02, "{q:?}");
    }
}
