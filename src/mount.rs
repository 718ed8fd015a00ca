//! From the sensor's counts to counts along the body's axes: calibration and mount in one, in
//! integers.
//!
//! The body's axes are x forward, y right, z down; the default mount has the sensor's axes along
//! them. A sensor at rest and level then reads -981 on z: an accelerometer measures the force that
//! holds it up.

use core::f32::consts::PI;

use tvc_fusion::fixed::{Angles, Counts};
use tvc_imu::RawSample;

use crate::params::Params;
use crate::sensor::{ACC_COUNTS, GYR_COUNTS, MAG_COUNTS};

/// Fractional bits of a [`Matrix`]: factors up to 2.
const BITS: u32 = 14;
const ONE: i16 = 1 << BITS;

/// What one three-axis sensor should have read: `matrix * (counts - offset)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Reading at zero input, counts, to a quarter; up to 8,191.
    pub offset: [f32; 3],
    /// Scale, misalignment and, of the magnetometer, soft iron, row by row; components from -2 to
    /// 2.
    pub matrix: [[f32; 3]; 3],
}

impl Calibration {
    /// A sensor that reads what it should.
    pub const NOMINAL: Self =
        Self { offset: [0.0; 3], matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    fn to_matrix(self) -> Matrix {
        let [[a, b, c], [d, e, f], [g, h, i]] =
            self.matrix.map(|row| row.map(|factor| nearest(factor * f32::from(ONE))));
        Matrix([[a, d, g], [b, e, h], [c, f, i]])
    }
}

/// Factors with [`BITS`], column by column: where each axis goes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Matrix([[i16; 3]; 3]);

impl Matrix {
    const IDENTITY: Self = Self([[ONE, 0, 0], [0, ONE, 0], [0, 0, ONE]]);

    /// `self * vector + sum`, with [`BITS`]. What is too large stays at the end of the range.
    fn add(&self, vector: &[i16; 3], mut sum: [i32; 3]) -> [i32; 3] {
        for (column, component) in self.0.iter().zip(vector) {
            for (sum, factor) in sum.iter_mut().zip(column) {
                *sum = sum.saturating_add(i32::from(*factor) * i32::from(*component));
            }
        }
        sum
    }

    fn transposed(&self) -> Self {
        let [[a, b, c], [d, e, f], [g, h, i]] = self.0;
        Self([[a, d, g], [b, e, h], [c, f, i]])
    }

    fn times(&self, other: &Self) -> Self {
        Self(other.0.map(|column| whole(self.add(&column, HALF))))
    }
}

/// Half of one, for rounding.
const HALF: [i32; 3] = [1 << (BITS - 1); 3];

fn whole(sum: [i32; 3]) -> [i16; 3] {
    sum.map(|sum| (sum >> BITS).clamp(i16::MIN.into(), i16::MAX.into()) as i16)
}

/// Calibration and mount of one sensor, ready for counts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Correction {
    matrix: Matrix,
    /// The offset, turned and with [`BITS`], and half a count for rounding.
    shift: [i32; 3],
    /// Counts are taken as they are.
    is_nominal: bool,
}

impl Correction {
    fn new(mount: &Matrix, calibration: &Calibration) -> Self {
        let matrix = mount.times(&calibration.to_matrix());
        let quarters = calibration.offset.map(|counts| nearest(counts * -4.0));
        let shift = matrix.add(&quarters, HALF.map(|half| half << 2));
        let shift = shift.map(|shift| shift >> 2);
        Self { is_nominal: matrix == Matrix::IDENTITY && shift == HALF, matrix, shift }
    }

    fn apply(&self, counts: &[i16; 3]) -> [i16; 3] {
        if self.is_nominal {
            let [x, y, z] = counts;
            return [*x, *y, *z];
        }
        whole(self.matrix.add(counts, self.shift))
    }
}

/// From the axes of one sensor to those of another on the same body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relative(Matrix);

impl Relative {
    /// From a sensor that sits on the body by `from_deg` to one that sits by `to_deg`: roll, pitch
    /// and yaw, deg.
    #[must_use]
    pub fn new(from_deg: [f32; 3], to_deg: [f32; 3]) -> Self {
        Self(rotation(to_deg).transposed().times(&rotation(from_deg)))
    }

    /// A vector of the first sensor, along the axes of the second.
    #[must_use]
    pub fn turn(&self, vector: &[i16; 3]) -> [i16; 3] {
        whole(self.0.add(vector, HALF))
    }
}

/// How the sensor sits in the body, and its calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// Accelerometer, gyro, magnetometer.
    corrections: [Correction; 3],
}

impl Mount {
    /// A sensor calibrated as the `CAL_` and turned as the `MNT_` parameters say.
    pub fn new(params: &Params) -> Self {
        Self::calibrated(&calibrations(params), params)
    }

    /// A sensor with these calibrations of the accelerometer, gyro and magnetometer, turned as the
    /// `MNT_` parameters say.
    fn calibrated(calibrations: &[Calibration; 3], params: &Params) -> Self {
        let rotation = rotation(params.mount_deg());
        Self {
            corrections: calibrations
                .each_ref()
                .map(|calibration| Correction::new(&rotation, calibration)),
        }
    }

    /// Counts along the body's axes, with `gyr` in place of the sample's rates. The field counts as
    /// fresh.
    pub fn convert(&self, raw: &RawSample, gyr: &[i16; 3]) -> Counts {
        let [of_acc, of_gyr, of_mag] = &self.corrections;
        Counts {
            acc: of_acc.apply(&raw.acc),
            gyr: of_gyr.apply(gyr),
            mag: Some(of_mag.apply(&raw.mag)),
        }
    }
}

/// What the `CAL_` parameters say of the accelerometer, gyro and magnetometer, in counts of 0.01
/// m/s2, 1/16 deg/s and 1/16 uT.
fn calibrations(params: &Params) -> [Calibration; 3] {
    let counts = |offset: [f32; 3], counts: f32| offset.map(|value| value * counts);
    let [x, y, z] = params.cal_acc_scale();
    let acc = Calibration {
        offset: counts(params.cal_acc_offset(), ACC_COUNTS),
        matrix: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]],
    };
    let gyr =
        Calibration { offset: counts(params.cal_gyr_offset(), GYR_COUNTS), ..Calibration::NOMINAL };
    let mag = Calibration {
        offset: counts(params.cal_mag_offset(), MAG_COUNTS),
        matrix: params.cal_mag_matrix(),
    };
    [acc, gyr, mag]
}

/// The whole number next to `value`; the nearest that there is where it is too large. The image has
/// the conversion once.
#[inline(never)]
pub(crate) fn nearest(value: f32) -> i16 {
    (value + 0.5_f32.copysign(value)) as i16
}

/// `R = Rz(yaw) Ry(pitch) Rx(roll)`, sensor to body, as autopilots define a sensor's orientation.
fn rotation(angles_deg: [f32; 3]) -> Matrix {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles_deg.map(|angle_deg| {
        let (sin, cos) = Angles::sin_cos_q30(Angles::from_rad(angle_deg * (PI / 180.0)));
        let rounded = |value: i32| ((value + (1 << 15)) >> 16) as i16;
        (rounded(sin), rounded(cos))
    });
    let about_x = Matrix([[ONE, 0, 0], [0, cr, sr], [0, -sr, cr]]);
    let about_y = Matrix([[cp, 0, -sp], [0, ONE, 0], [sp, 0, cp]]);
    let about_z = Matrix([[cy, sy, 0], [-sy, cy, 0], [0, 0, ONE]]);
    about_z.times(&about_y).times(&about_x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tvc_imu::Micros;

    fn raw(acc: [i16; 3], gyr: [i16; 3], mag: [i16; 3]) -> RawSample {
        RawSample { time: Micros(0), acc, gyr, mag }
    }

    fn convert(mount: &Mount, raw: &RawSample) -> Counts {
        mount.convert(raw, &raw.gyr)
    }

    fn mount(roll: f32, pitch: f32, yaw: f32) -> Mount {
        let mut params = Params::default();
        params.set("MNT_ROLL_DEG", roll).unwrap();
        params.set("MNT_PITCH_DEG", pitch).unwrap();
        params.set("MNT_YAW_DEG", yaw).unwrap();
        Mount::new(&params)
    }

    #[test]
    fn a_nominal_sensor_along_the_axes_is_taken_as_it_is() {
        let sample = raw([0, i16::MIN, -981], [16, -160, i16::MAX], [800, 0, 16]);
        let body = convert(&mount(0.0, 0.0, 0.0), &sample);
        assert_eq!((body.acc, body.gyr, body.mag), (sample.acc, sample.gyr, Some(sample.mag)));
    }

    fn assert_acc(mount: &Mount, acc: [i16; 3], expected: [i16; 3]) {
        let body = convert(mount, &raw(acc, [0; 3], [0; 3])).acc;
        assert_eq!(body, expected);
    }

    #[test]
    fn a_sensor_upside_down_is_turned_by_180_degrees_of_roll() {
        assert_acc(&mount(180.0, 0.0, 0.0), [1, 2, 981], [1, -2, -981]);
    }

    #[test]
    fn quarter_turns_move_axes_as_the_right_hand_says() {
        let (x, y) = ([100, 0, 0], [0, 100, 0]);
        assert_acc(&mount(0.0, 0.0, 90.0), x, [0, 100, 0]);
        assert_acc(&mount(0.0, 90.0, 0.0), x, [0, 0, -100]);
        assert_acc(&mount(90.0, 0.0, 0.0), y, [0, 0, 100]);
        // Roll first, yaw last: y goes to z by the roll and stays there; x goes to y by the yaw.
        assert_acc(&mount(90.0, 0.0, 90.0), y, [0, 0, 100]);
        assert_acc(&mount(90.0, 0.0, 90.0), x, [0, 100, 0]);
    }

    #[test]
    fn a_mount_is_what_an_independent_library_makes_of_its_angles() {
        let oracle = nalgebra::Rotation3::from_euler_angles(0.3_f64, -0.7, 2.1);
        let expected = oracle * nalgebra::Vector3::new(3000.0, -5000.0, 8000.0);
        let mount = mount(0.3_f32.to_degrees(), -0.7_f32.to_degrees(), 2.1_f32.to_degrees());
        let found = convert(&mount, &raw([0; 3], [3000, -5000, 8000], [0; 3])).gyr;
        for (found, expected) in found.iter().zip(expected.iter()) {
            // Half a count of rounding, and a bit of each factor.
            assert!((f64::from(*found) - expected).abs() < 1.5, "{found} {expected}");
        }
    }

    #[test]
    fn calibration_takes_off_the_offset_and_scales() {
        let params = Params::default();
        let acc = Calibration {
            offset: [10.4, 0.0, -3.0],
            matrix: [[1.5, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, -1.0]],
        };
        let [gyr, mag] = [Calibration::NOMINAL; 2];
        let mount = Mount::calibrated(&[acc, gyr, mag], &params);
        // 1.5 * 99.6 = 149.4; 100 + 0.5 * 43 = 121.5; -43.
        assert_acc(&mount, [110, 100, 40], [149, 122, -43]);
        let sample = raw([0; 3], [7, 8, 9], [0; 3]);
        assert_eq!(convert(&mount, &sample).gyr, [7, 8, 9]);
    }

    /// Numbers by hand, through the parameters' names and units.
    #[test]
    fn calibration_parameters_are_in_si_units() {
        let mut params = Params::default();
        for (name, value) in [
            ("CAL_ACC_OX", 0.5),
            ("CAL_ACC_SZ", 1.1),
            ("CAL_GYR_OY", -2.0),
            ("CAL_MAG_OZ", 40.0),
            ("CAL_MAG_XY", 0.25),
            ("CAL_MAG_ZZ", 0.5),
        ] {
            params.set(name, value).unwrap();
        }
        let found = convert(&Mount::new(&params), &raw([50, 0, -900], [0, -32, 7], [100, 80, 840]));
        assert_eq!(found.acc, [0, 0, -990]);
        assert_eq!(found.gyr, [0, 0, 7]);
        assert_eq!(found.mag, Some([120, 80, 100]));
    }

    proptest! {
        /// No calibration and no mount makes a count wrap round.
        #[test]
        fn what_is_too_large_stays_at_the_end(
            counts in prop::array::uniform3(any::<i16>()),
            offset in prop::array::uniform3(-8_000.0_f32..8_000.0),
            matrix in prop::array::uniform3(prop::array::uniform3(-1.1_f32..1.1)),
            roll in -180.0_f32..180.0,
        ) {
            let mut params = Params::default();
            params.set("MNT_ROLL_DEG", roll).unwrap();
            let mount = Mount::calibrated(&[Calibration { offset, matrix }; 3], &params);
            let found = convert(&mount, &raw(counts, counts, counts)).gyr;
            let turn = nalgebra::Rotation3::from_euler_angles(f64::from(roll).to_radians(), 0.0, 0.0);
            let matrix = turn.matrix() * nalgebra::Matrix3::from_fn(|r, c| f64::from(matrix[r][c]));
            let input = nalgebra::Vector3::from_fn(|i, _| f64::from(counts[i]) - f64::from(offset[i]));
            for (found, expected) in found.iter().zip((matrix * input).iter()) {
                let expected = expected.clamp(-32_768.0, 32_767.0);
                prop_assert!((f64::from(*found) - expected).abs() < 8.0, "{found} {expected}");
            }
        }
    }
}
