//! One suite over every filter and scalar: what any attitude estimator must do.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{
    Attitude, Complementary, Config, Estimator, Filter, GRAVITY, Madgwick, Mahony, Quaternion,
    Real, Sample, Vqf,
};

const DEG: f64 = core::f64::consts::PI / 180.0;

/// Field of Copenhagen: 50 uT, dip 70 deg, in north, east, down.
fn field_ned() -> Vector3<f64> {
    Vector3::new(50.0 * (70.0 * DEG).cos(), 0.0, 50.0 * (70.0 * DEG).sin())
}

fn sample(truth: &UnitQuaternion<f64>, rate: Vector3<f64>, mag: bool) -> Sample {
    let back = truth.inverse();
    Sample {
        gyr: rate.cast(),
        acc: (back * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast(),
        mag: mag.then(|| (back * field_ned()).cast()),
    }
}

fn error_deg<T: Real>(estimate: &Quaternion<T>, truth: &UnitQuaternion<f64>) -> f64 {
    let q = nalgebra::Quaternion::new(
        estimate.w.to_f32().into(),
        estimate.x.to_f32().into(),
        estimate.y.to_f32().into(),
        estimate.z.to_f32().into(),
    );
    UnitQuaternion::from_quaternion(q).angle_to(truth) / DEG
}

fn estimator<F: Filter>() -> Estimator<F>
where
    F::Gains: Default,
{
    Estimator::new(&Config::default()).expect("the defaults are valid")
}

/// Rest at an attitude for `seconds`, at 100 Hz, with an offset on the gyroscope (rad/s).
fn rest<F: Filter>(
    estimator: &mut Estimator<F>,
    truth: &UnitQuaternion<f64>,
    bias: Vector3<f64>,
    mag: bool,
    seconds: f64,
) -> Attitude<F::Real> {
    for _ in 0..(seconds * 100.0) as u32 {
        estimator.update(0.01, &sample(truth, bias, mag));
    }
    estimator.attitude()
}

fn starts_at_any_attitude<F: Filter>()
where
    F::Gains: Default,
{
    for (roll, pitch, yaw) in [
        (0.0, 0.0, 0.0),
        (3.1, 0.0, 2.0),
        (0.5, 1.57, -1.0),
        (-2.0, -1.2, 3.0),
        (1.57, 0.1, -2.5),
    ] {
        let truth = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let attitude = rest(
            &mut estimator::<F>(),
            &truth,
            Vector3::new(0.02, -0.01, 0.03),
            true,
            1.1,
        );
        assert!(attitude.flags.initialised);
        // The unknown offset of 2.1 deg/s tilts the mean of the first second by about a degree, and the
        // steep field turns that into a heading error tan(dip) times as large.
        let error = error_deg(&attitude.orientation, &truth);
        assert!(
            error < 4.0,
            "{error} deg after a second at {roll} {pitch} {yaw}"
        );
        let attitude = rest(
            &mut estimator::<F>(),
            &truth,
            Vector3::new(0.02, -0.01, 0.03),
            true,
            60.0,
        );
        let error = error_deg(&attitude.orientation, &truth);
        assert!(
            error < 0.05,
            "{error} deg after a minute at {roll} {pitch} {yaw}"
        );
        assert!(
            attitude.flags.at_rest && !attitude.flags.mag_disturbed && !attitude.flags.acc_rejected
        );
        assert!((attitude.bias.x.to_f32() - 0.02).abs() < 1e-5);
    }
}

fn follows_a_motion<F: Filter>()
where
    F::Gains: Default,
{
    let mut estimator = estimator::<F>();
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    rest(&mut estimator, &truth, Vector3::zeros(), true, 3.0);
    let dt = 0.01;
    for k in 0..6000 {
        let t = f64::from(k) * dt;
        let rate = Vector3::new(
            2.0 * (1.3 * t).sin(),
            1.5 * (0.7 * t).cos(),
            (0.9 * t).sin() * 3.0,
        );
        truth *= UnitQuaternion::from_scaled_axis(rate * dt);
        let attitude = estimator.update(dt as f32, &sample(&truth, rate, k % 5 == 0));
        let error = error_deg(&attitude.orientation, &truth);
        assert!(error < 0.3, "{error} deg at {t} s");
    }
}

fn a_magnet_turns_neither_roll_nor_pitch<F: Filter>()
where
    F::Gains: Default,
{
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut estimator = estimator::<F>();
    rest(&mut estimator, &truth, Vector3::zeros(), true, 10.0);
    let before = estimator.attitude().orientation.up();
    for k in 0..12_000 {
        let mut disturbed = sample(&truth, Vector3::zeros(), true);
        let k = k as f32 * 0.01;
        disturbed.mag = Some(Vector3::new(
            300.0 * k.sin(),
            -200.0,
            100.0 * (3.0 * k).cos(),
        ));
        estimator.update(0.01, &disturbed);
    }
    let after = estimator.attitude();
    assert!(after.flags.mag_disturbed);
    let up = after.orientation.up();
    for (before, after) in before.iter().zip(up.iter()) {
        assert!((before.to_f32() - after.to_f32()).abs() < 1e-4);
    }
}

fn bad_input_changes_nothing_but_flags<F: Filter>()
where
    F::Gains: Default,
{
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut estimator = estimator::<F>();
    rest(&mut estimator, &truth, Vector3::zeros(), true, 3.0);
    let before = estimator.attitude();
    let good = sample(&truth, Vector3::new(1.0, 1.0, 1.0), true);
    for dt in [0.0, -0.0, -0.01, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let after = estimator.update(dt, &good);
        assert!(after.flags.skipped);
        assert_eq!(after.orientation, before.orientation);
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let after = estimator.update(
            0.01,
            &Sample {
                gyr: Vector3::new(0.0, bad, 0.0),
                ..good
            },
        );
        assert!(after.flags.skipped);
        assert_eq!(after.orientation, before.orientation);
    }
    for bad in [f32::NAN, f32::INFINITY, f32::MAX, 0.0] {
        let bad = Vector3::new(bad, bad, bad);
        let still = Vector3::zeros();
        let after = estimator.update(
            0.01,
            &Sample {
                gyr: still,
                acc: bad,
                mag: Some(bad),
            },
        );
        assert!(after.flags.acc_rejected && after.flags.mag_disturbed && !after.flags.skipped);
        assert!(error_deg(&after.orientation, &truth) < 0.1);
    }
}

macro_rules! suite {
    ($($name:ident: $filter:ty),+ $(,)?) => {$(
        mod $name {
            use super::*;

            #[test]
            fn starts_at_any_attitude() {
                super::starts_at_any_attitude::<$filter>();
            }

            #[test]
            fn follows_a_motion() {
                super::follows_a_motion::<$filter>();
            }

            #[test]
            fn a_magnet_turns_neither_roll_nor_pitch() {
                super::a_magnet_turns_neither_roll_nor_pitch::<$filter>();
            }

            #[test]
            fn bad_input_changes_nothing_but_flags() {
                super::bad_input_changes_nothing_but_flags::<$filter>();
            }
        }
    )+};
}

suite! {
    complementary_f32: Complementary<f32>,
    complementary_f64: Complementary<f64>,
    mahony_f32: Mahony<f32>,
    mahony_f64: Mahony<f64>,
    madgwick_f32: Madgwick<f32>,
    madgwick_f64: Madgwick<f64>,
    vqf_f32: Vqf<f32>,
    vqf_f64: Vqf<f64>,
}
