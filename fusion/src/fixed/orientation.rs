//! The estimate as numbers, as a float quaternion and as angles.

use crate::quaternion::Quaternion;

/// A unit quaternion in fixed point, body to earth (north, east, down), Hamilton's convention.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Orientation {
    /// w, x, y, z in Q30: 2^30 is 1. The norm is 1 within 1e-4.
    pub wxyz_q30: [i32; 4],
}

/// Roll, pitch and yaw as binary angles: 2^31 is half a turn, so sums wrap by themselves. The
/// sequence is yaw, pitch, roll. At a pitch of +-90 deg, roll and yaw turn about the same axis, and
/// only their difference or sum is defined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Angles {
    /// Any angle.
    pub roll: i32,
    /// -2^30 to 2^30, positive nose up.
    pub pitch: i32,
    /// Any angle, positive from north to east.
    pub yaw: i32,
}

impl Angles {
    /// Radians of a binary angle, -pi..pi. Float: for people, not for the loop.
    pub fn to_rad(angle: i32) -> f32 {
        angle as f32 * (core::f32::consts::PI / 2_147_483_648.0)
    }

    /// The binary angle of -pi..pi rad; half a turn beyond.
    pub fn from_rad(angle: f32) -> i32 {
        (angle * (2_147_483_648.0 / core::f32::consts::PI)) as i32
    }

    /// Sine and cosine of a binary angle, Q30, within 3e-5: one CORDIC rotation.
    #[inline(never)]
    pub fn sin_cos_q30(angle: i32) -> (i32, i32) {
        // Half a turn more where the rotation would not reach.
        let near = angle.wrapping_add(1 << 30) >= 0;
        let mut left = if near { angle } else { angle.wrapping_add(i32::MIN) };
        // As much shorter as CORDIC lengthens.
        let (mut x, mut y) = (652_032_874, 0);
        for (bits, arc) in ARCS.iter().enumerate() {
            let (dx, dy) = (x >> bits, y >> bits);
            if left >= 0 {
                (x, y, left) = (x - dy, y + dx, left - arc);
            } else {
                (x, y, left) = (x + dy, y - dx, left + arc);
            }
        }
        if near { (y, x) } else { (-y, -x) }
    }
}

impl Orientation {
    /// The same in float, normalised.
    pub fn quaternion(&self) -> Quaternion {
        let mut q = self.parts();
        q.restore_norm();
        q
    }

    /// The quaternion in float, its norm 1 within 1e-5, in a few hundred cycles without an FPU.
    /// [`Orientation::quaternion`] takes two thousand.
    pub fn parts(&self) -> Quaternion {
        const EXPONENT: u32 = 30 << (f32::MANTISSA_DIGITS - 1);
        let [w, x, y, z] = self.wxyz_q30.map(|part| match part {
            0 => 0.0,
            // Divided by 2^30 in its exponent.
            part => f32::from_bits((part as f32).to_bits() - EXPONENT),
        });
        Quaternion { w, x, y, z }
    }

    /// Roll, pitch and yaw, within 0.01 deg: three CORDIC rotations.
    pub fn angles(&self) -> Angles {
        let [w, x, y, z] = self.wxyz_q15();
        let [down_x, down_y, down_z] = self.half_down_q29();
        let east_x = (x * y + w * z) >> 1;
        let north_x = ((w * w) >> 2) + ((x * x) >> 2) - ((y * y) >> 2) - ((z * z) >> 2);
        let (roll, level) = polar(down_z, down_y, &ARCS);
        let (pitch, _) = polar(level, -lengthened(down_x), &ARCS);
        let (yaw, _) = polar(north_x, east_x, &ARCS);
        Angles { roll, pitch, yaw }
    }

    /// The pitch of [`Orientation::angles`], equally exact, in one rotation and a half.
    pub fn pitch(&self) -> i32 {
        let [down_x, down_y, down_z] = self.half_down_q29();
        // The length converges long before the angle: the rest of y changes it by its square.
        let (first_arcs, _) = ARCS.split_at(LENGTH_ARCS);
        let (_, level) = polar_inlined(down_z, down_y, first_arcs);
        let (pitch, _) = polar_inlined(level, -lengthened(down_x), &ARCS);
        pitch
    }

    /// The tilt of the body's vertical against the earth's (the reduced attitude), as the shortest
    /// rotation vector between them. The result has its parts about the body's y and x, rad, Q28.
    /// They are within 1.5e-4 up to a right angle, and within 1.5e-4 over the sine beyond. The
    /// vector's length is the angle between the verticals, 0 to pi.
    ///
    /// Heading and rotation about the body's own vertical do not matter. Without roll the first
    /// part is the pitch, without pitch the second is the roll. Upside down every direction is
    /// equally short, and the result is any of them.
    pub fn tilt_q28(&self) -> [i32; 2] {
        /// Angle over sine by the cosine, from 0 to 1, as a polynomial, highest power first, Q15:
        /// within 3e-5 (interpolation at Chebyshev's nodes).
        const PER_SINE: [i32; 6] = [-2_214, 9_092, -17_802, 24_926, -32_705, 51_471];
        // Q28, but for their last bits.
        let [down_x, down_y, down_z] = self.half_down_q29();
        if down_z < 0 {
            return Self::tilt_beyond(down_x, down_y, down_z);
        }
        let cos = down_z >> 13;
        let per_sine = PER_SINE.into_iter().fold(0, |sum, factor| ((sum * cos) >> 15) + factor);
        let part = |down: i32| ((down >> 13) * per_sine) >> 2;
        [part(-down_x), part(down_y)]
    }

    /// The tilt beyond a right angle, by three CORDIC rotations.
    #[inline(never)]
    fn tilt_beyond(down_x: i32, down_y: i32, down_z: i32) -> [i32; 2] {
        const PI_Q14: i32 = 51_472;
        let (direction, across) = polar(-down_x, down_y, &ARCS);
        let (angle, _) = polar(lengthened(down_z), across, &ARCS);
        // Half a turn is 2^31, or 2^15 without its last bits, rounded.
        let angle_q14 = ((((angle >> 1) + (1 << 14)) >> 15) * PI_Q14) >> 15;
        let (sin, cos) = Angles::sin_cos_q30(direction);
        [cos, sin].map(|part| ((part + (1 << 15)) >> 16) * angle_q14)
    }

    /// Half of down in the body's axes, Q29: CORDIC makes it 1.65 times as long.
    #[inline(never)]
    fn half_down_q29(&self) -> [i32; 3] {
        let [w, x, y, z] = self.wxyz_q15();
        [
            (x * z - w * y) >> 1,
            (y * z + w * x) >> 1,
            ((w * w) >> 2) - ((x * x) >> 2) - ((y * y) >> 2) + ((z * z) >> 2),
        ]
    }

    /// Cosine of the angle between the body's and the earth's vertical, Q30, within 1e-4.
    pub fn cos_tilt_q30(&self) -> i32 {
        // The numbers may wrap unless [`Orientation::is_rotation`].
        let [ww, xx, yy, zz] = self.wxyz_q15().map(|part| part.wrapping_mul(part));
        ww.wrapping_sub(xx).wrapping_sub(yy).wrapping_add(zz)
    }

    /// Whether the squared norm is 1 within a hundredth, as for every rotation.
    pub fn is_rotation(&self) -> bool {
        // The square of a part of 2 in Q15 overflows. No rotation has a part beyond this limit.
        const LARGEST: i32 = 33_100;
        const ONE: i32 = 1 << 28;
        let parts = self.wxyz_q15();
        let norm2_q28: i32 =
            parts.iter().map(|part| (part.clamp(&-LARGEST, &LARGEST).pow(2)) >> 2).sum();
        (norm2_q28 - ONE).abs() < ONE / 100
    }

    fn wxyz_q15(&self) -> [i32; 4] {
        self.wxyz_q30.map(|c| c.wrapping_add(1 << 14) >> 15)
    }

    /// Turned about down: cosine and sine of half the angle, Q15.
    pub(super) fn turned(&self, (c, s): (i32, i32)) -> Self {
        let [w, x, y, z] = self.wxyz_q30.map(|c| c >> 15);
        Self { wxyz_q30: [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w] }
    }
}

/// Arcs whose tangents are 1, 1/2, 1/4 and so on: binary angles.
const ARCS: [i32; 16] = [
    0x20000000, 0x12e4051e, 0x09fb385b, 0x051111d4, 0x028b0d43, 0x0145d7e1, 0x00a2f61e, 0x00517c55,
    0x0028be53, 0x00145f2f, 0x000a2f98, 0x000517cc, 0x00028be6, 0x000145f3, 0x0000a2fa, 0x0000517d,
];

/// Arcs after which a length is within 2^-17 of itself.
const LENGTH_ARCS: usize = 9;

/// Angle and lengthened length of a vector (J. Volder's CORDIC, vectoring).
fn polar(x: i32, y: i32, arcs: &[i32; 16]) -> (i32, i32) {
    polar_inlined(x, y, arcs)
}

/// As [`polar`], for the control step: in place it takes 180 cycles less.
#[inline(always)]
fn polar_inlined(x: i32, y: i32, arcs: &[i32]) -> (i32, i32) {
    let (mut x, mut y, mut angle) = if x < 0 { (-x, -y, i32::MIN) } else { (x, y, 0i32) };
    for (bits, arc) in arcs.iter().enumerate() {
        let (dx, dy) = (x >> bits, y >> bits);
        if y > 0 {
            (x, y, angle) = (x + dy, y - dx, angle.wrapping_add(*arc));
        } else {
            (x, y, angle) = (x - dy, y + dx, angle.wrapping_sub(*arc));
        }
    }
    (angle, x)
}

/// Times 1.646 76, by how much CORDIC lengthens.
fn lengthened(v: i32) -> i32 {
    v + (v >> 1) + (v >> 3) + (v >> 6) + (v >> 8) + (v >> 9) + (v >> 12) + (v >> 15)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quaternion::Euler;
    use proptest::prelude::*;

    fn fixed(q: &Quaternion) -> Orientation {
        Orientation { wxyz_q30: [q.w, q.x, q.y, q.z].map(|c| (c * 1_073_741_824.0) as i32) }
    }

    #[test]
    fn the_axes_have_the_angles_that_one_expects() {
        let level = Orientation { wxyz_q30: [1 << 30, 0, 0, 0] };
        let Angles { roll, pitch, yaw } = level.angles();
        for angle in [roll, pitch, yaw] {
            assert!(angle.abs() < 1 << 17, "{angle}");
        }
        let quarter = Orientation { wxyz_q30: [759_250_125, 0, 0, 759_250_125] };
        assert!((quarter.angles().yaw - (1 << 30)).abs() < 1 << 17);
        let nose_up = Orientation { wxyz_q30: [759_250_125, 0, 759_250_125, 0] };
        assert!((nose_up.angles().pitch - (1 << 30)).abs() < 1 << 19);
    }

    #[test]
    fn sine_and_cosine_are_right_all_round() {
        for step in -1000..=1000 {
            let rad = f64::from(step) * (core::f64::consts::PI / 1000.0);
            let (sin, cos) = Angles::sin_cos_q30(Angles::from_rad(rad as f32));
            for (found, expected) in [(sin, rad.sin()), (cos, rad.cos())] {
                let found = f64::from(found) / 1_073_741_824.0;
                assert!((found - expected).abs() < 4e-5, "{rad}: {found}");
            }
        }
    }

    #[test]
    fn turning_about_down_is_the_float_product() {
        let q = Quaternion::normalised(0.3f32, -0.5, 0.7, 0.1);
        let turn = Quaternion::from_euler(&Euler { roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.3 });
        let half = ((turn.w * 32_768.0) as i32, (turn.z * 32_768.0) as i32);
        let turned = fixed(&q).turned(half).quaternion();
        assert!(turned.angle_to(&turn.mul(&q)) < 2e-4);
    }

    #[test]
    fn only_unit_quaternions_are_rotations() {
        let accepted = |parts: [f64; 4]| {
            let wxyz_q30 = parts.map(|part| (part * 1_073_741_824.0) as i32);
            Orientation { wxyz_q30 }.is_rotation()
        };
        assert!(accepted([0.5, -0.5, 0.5, -0.5]));
        assert!(accepted([-1.0, 0.0, 0.0, 0.0]));
        assert!(!accepted([0.9, 0.9, 0.0, 0.0]));
        assert!(!accepted([0.1; 4]));
        assert!(!accepted([0.0; 4]));
        for part in [1.99, -2.0] {
            assert!(!accepted([part; 4]));
            assert!(!accepted([part, 0.0, 0.0, 0.0]));
        }
        for part in [i32::MIN, i32::MAX] {
            let corrupt = Orientation { wxyz_q30: [part; 4] };
            assert!(!corrupt.is_rotation());
            corrupt.cos_tilt_q30();
        }
        let norm = |norm2: f64| accepted([0.0, norm2.sqrt(), 0.0, 0.0]);
        assert!(norm(0.9905) && norm(1.0095));
        assert!(!norm(0.9895) && !norm(1.0105));
    }

    /// The tilt as a vector, by its definition: down in the body's axes, and the angle to it.
    fn tilt(q: &Quaternion) -> [f64; 2] {
        let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(f64::from);
        let down_x = 2.0 * (x * z - w * y);
        let down_y = 2.0 * (y * z + w * x);
        let down_z = w * w - x * x - y * y + z * z;
        let across = down_x.hypot(down_y);
        let per_sine = if across < 1e-12 { 1.0 } else { across.atan2(down_z) / across };
        [-down_x * per_sine, down_y * per_sine]
    }

    fn tilt_rad(q: &Quaternion) -> [f64; 2] {
        fixed(q).tilt_q28().map(|part| f64::from(part) / 268_435_456.0)
    }

    #[test]
    fn tilts_by_hand_at_any_heading_and_beyond_a_right_angle() {
        use core::f32::consts::PI;
        for heading in [0.0, 0.5 * PI, 0.75 * PI, -2.0] {
            let turned = |roll_rad, pitch_rad| {
                tilt_rad(&Quaternion::from_euler(&Euler { roll_rad, pitch_rad, yaw_rad: heading }))
            };
            for angle in [-2.5_f32, -1.7, -0.6, 0.0, 0.2, 1.2, 1.5, 1.65, 2.5] {
                let [pitch, roll] = turned(angle, 0.0);
                assert!(
                    pitch.abs() < 4e-4 && (roll - f64::from(angle)).abs() < 2e-4,
                    "{pitch} {roll}"
                );
                if angle.abs() < 1.5 {
                    let [pitch, roll] = turned(0.0, angle);
                    assert!(roll.abs() < 1.5e-4 && (pitch - f64::from(angle)).abs() < 1.5e-4);
                }
            }
            let upside_down = turned(PI, 0.0);
            assert!((upside_down[0].hypot(upside_down[1]) - f64::from(PI)).abs() < 1e-3);
        }
    }

    proptest! {
        #[test]
        fn the_tilt_vector_is_that_of_the_float_quaternion(w in -1f32..1.0, x in -1f32..1.0, y in -1f32..1.0, z in 0.01f32..1.0) {
            let q = Quaternion::normalised(w, x, y, z);
            let (found, expected) = (tilt_rad(&q), tilt(&q));
            let angle = expected[0].hypot(expected[1]);
            let tolerance = if angle < core::f64::consts::FRAC_PI_2 {
                1.5e-4
            } else {
                1.5e-4 * (1.0 + angle / angle.sin().max(1e-3))
            };
            for (found, expected) in found.iter().zip(expected) {
                prop_assert!((found - expected).abs() < tolerance, "{found} {expected}");
            }
        }

        #[test]
        fn the_tilt_is_that_of_the_float_quaternion(w in -1f32..1.0, x in -1f32..1.0, y in -1f32..1.0, z in 0.01f32..1.0) {
            let q = Quaternion::normalised(w, x, y, z);
            let found = fixed(&q).cos_tilt_q30() as f32 / 1_073_741_824.0;
            prop_assert!((found - 2.0 * q.half_down()[2]).abs() < 1.5e-4);
            prop_assert!(fixed(&q).is_rotation());
            let apart = fixed(&q).pitch().wrapping_sub(fixed(&q).angles().pitch);
            prop_assert!(Angles::to_rad(apart).abs() < 1e-4, "{apart}");
        }

        #[test]
        fn angles_agree_with_the_float_ones(w in -1f32..1.0, x in -1f32..1.0, y in -1f32..1.0, z in 0.01f32..1.0) {
            let q = Quaternion::normalised(w, x, y, z);
            let float = q.euler();
            let angles = fixed(&q).angles();
            let level = float.pitch_rad.cos();
            let tolerance = 2e-4;
            prop_assert!((Angles::to_rad(angles.pitch) - float.pitch_rad).abs() < tolerance / level.max(0.02));
            if level > 0.05 {
                for (fixed, float) in [(angles.roll, float.roll_rad), (angles.yaw, float.yaw_rad)] {
                    let gap = Angles::to_rad(fixed.wrapping_sub((f64::from(float) / core::f64::consts::PI * 2_147_483_648.0) as i64 as i32));
                    prop_assert!(gap.abs() < tolerance / level, "{gap}");
                }
            }
        }
    }
}
