//! One suite over every filter and scalar: what any attitude estimator must do.

#[path = "suite/subject.rs"]
mod subject;

use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;
use subject::{
    DEG, DT_US, Fixed, Subject, added, counts, error_deg, motion, norm, oracle, rest, sample,
};
use tvc_fusion::{
    Attitude, Complementary, Config, Estimator, Filter, GRAVITY, Gyro, Kalman, Madgwick, Mahony,
    Quaternion, Sample, Vqf, fixed,
};

fn starts_at_any_attitude<S: Subject>() {
    for (roll, pitch, yaw) in [
        (0.0, 0.0, 0.0),
        (3.1, 0.0, 2.0),
        (0.5, 1.57, -1.0),
        (-2.0, -1.2, 3.0),
        (1.57, 0.1, -2.5),
        (-1.57, 0.0, 3.1),
    ] {
        let truth = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let bias = Vector3::new(0.02, -0.01, 0.03);
        // The unknown offset of 2.1 deg/s tilts the mean of the first second by about a degree, and
        // the steep field turns that into a heading error tan(dip) times as large.
        let mut subject = S::start();
        let attitude = rest(&mut subject, &truth, bias, true, 1.5);
        assert!(attitude.flags.initialised);
        let error = error_deg(&attitude.orientation, &truth);
        assert!(error < 6.0, "{error} deg after a second and a half at {roll} {pitch} {yaw}");
        let attitude = rest(&mut subject, &truth, bias, true, 60.0);
        assert!(
            attitude.flags.at_rest && !attitude.flags.mag_disturbed && !attitude.flags.acc_rejected
        );
        assert!(
            f64::from((Vector3::from(attitude.bias) - bias.cast::<f32>()).norm())
                < 1e-5 + 3e-3 * S::RESOLUTION_DEG,
            "{:?}",
            attitude.bias
        );
        if S::CORRECTS {
            let error = error_deg(&attitude.orientation, &truth);
            assert!(
                error < 0.05 + S::RESOLUTION_DEG,
                "{error} deg after a minute at {roll} {pitch} {yaw}"
            );
        }
    }
}

/// With a field in every third to eighth sample, wherever the body points.
fn starts_with_a_slow_magnetometer<S: Subject>() {
    for (every, first) in [(3, 0), (3, 2), (5, 1), (6, 5), (7, 0), (8, 3), (8, 7)] {
        for heading in -6..6 {
            let yaw = f64::from(heading) * 30.0 * DEG;
            let truth = UnitQuaternion::from_euler_angles(0.1, -0.2, yaw);
            let mut subject = S::start();
            for k in 0..300 {
                let sample = sample(&truth, Vector3::zeros(), k % every == first);
                let attitude = subject.step(i64::from(DT_US), &sample);
                let error = error_deg(&attitude.orientation, &truth);
                assert!(
                    k < 100 || error < 0.1 + S::RESOLUTION_DEG,
                    "{error} deg after {k} samples at {yaw} rad, every {every}"
                );
            }
        }
    }
}

fn follows_a_motion<S: Subject>() {
    let mut subject = S::start();
    let start = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    rest(&mut subject, &start, Vector3::zeros(), true, 4.0);
    for (k, (rate, truth)) in motion(start, 6000).enumerate() {
        let attitude = subject.step(i64::from(DT_US), &sample(&truth, rate, k % 5 == 0));
        let error = error_deg(&attitude.orientation, &truth);
        assert!(error < 0.3 + S::RESOLUTION_DEG, "{error} deg at step {k}");
        assert!((norm(&attitude.orientation) - 1.0).abs() < 1e-5);
        assert!((Vector3::from(attitude.rate) - rate.cast::<f32>()).norm() < 0.01);
    }
}

/// What the sensor's own axes are called changes nothing but the names: inputs turned by `r` give
/// orientations turned by `r`.
fn is_equivariant<S: Subject>() {
    let start = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    for r in [
        UnitQuaternion::from_euler_angles(core::f64::consts::FRAC_PI_2, 0.0, 0.0),
        UnitQuaternion::from_euler_angles(0.0, core::f64::consts::PI, 0.0),
        UnitQuaternion::from_euler_angles(1.0, 0.5, -2.0),
    ] {
        let (mut plain, mut turned) = (S::start(), S::start());
        let back = r.inverse();
        for (k, (rate, truth)) in motion(start, 6000).enumerate() {
            let mag = k % 3 == 0;
            let shake = Vector3::new(3.0, -2.0, 5.0) * (f64::from(k as u32) * 0.7).sin();
            let mut a = sample(&truth, rate, mag);
            let mut b = sample(&(truth * r), back * rate, mag);
            a.acc = added(a.acc, &shake);
            b.acc = added(b.acc, &(back * shake));
            let a = plain.step(i64::from(DT_US), &a).orientation;
            let b = turned.step(i64::from(DT_US), &b).orientation;
            if k > 5000 {
                let apart = (oracle(&a) * r).angle_to(&oracle(&b)) / DEG;
                assert!(apart < 0.1 + 2.0 * S::RESOLUTION_DEG, "{apart} deg apart at step {k}");
            }
        }
    }
}

fn a_magnet_turns_neither_roll_nor_pitch<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut subject = S::start();
    let before = rest(&mut subject, &truth, Vector3::zeros(), true, 10.0).orientation.up();
    let mut last = None;
    for k in 0..12_000 {
        let mut disturbed = sample(&truth, Vector3::zeros(), true);
        let k = k as f32 * 0.01;
        disturbed.mag = Some(Vector3::new(300.0 * k.sin(), -200.0, 100.0 * (3.0 * k).cos()).into());
        last = Some(subject.step(i64::from(DT_US), &disturbed));
    }
    let after = last.expect("some samples");
    assert!(after.flags.mag_disturbed);
    let moved = (Vector3::from(before) - Vector3::from(after.orientation.up())).norm();
    assert!(f64::from(moved) < 1e-4 + 2e-3 * S::RESOLUTION_DEG, "{moved}");
}

fn works_without_a_magnetometer<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.7, -0.4, 0.0);
    let mut subject = S::start();
    let attitude = rest(&mut subject, &truth, Vector3::new(0.0, 0.01, -0.02), false, 30.0);
    assert!(attitude.flags.initialised && !attitude.flags.mag_disturbed);
    let up: Vector3<f64> = Vector3::from(attitude.orientation.up()).cast();
    let apart = up.angle(&(truth.inverse() * Vector3::new(0.0, 0.0, -1.0))) / DEG;
    assert!(apart < if S::CORRECTS { 0.05 } else { 2.0 } + 0.5 * S::RESOLUTION_DEG, "{apart}");
}

fn time_that_stands_still_turns_nothing<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut subject = S::start();
    let before = rest(&mut subject, &truth, Vector3::zeros(), true, 20.0);
    let spinning = sample(&truth, Vector3::new(3.0, 3.0, 3.0), true);
    for _ in 0..1000 {
        subject.step(0, &spinning);
    }
    let after = subject.step(0, &spinning);
    assert!(
        oracle(&after.orientation).angle_to(&oracle(&before.orientation)) / DEG
            < 2.0 * S::RESOLUTION_DEG
    );
}

/// Rests for `seconds` and is within a degree of the truth, if it is a filter that corrects.
fn comes_back<S: Subject>(subject: &mut S, truth: &UnitQuaternion<f64>, seconds: f64) {
    let attitude = rest(subject, truth, Vector3::zeros(), true, seconds);
    let error = error_deg(&attitude.orientation, truth);
    if S::CORRECTS {
        assert!(error < 1.0 + S::RESOLUTION_DEG, "{error}");
    }
}

fn a_gap_is_bridged<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut subject = S::start();
    rest(&mut subject, &truth, Vector3::zeros(), true, 10.0);
    let turned = truth * UnitQuaternion::from_euler_angles(0.5, 0.3, 1.5);
    let attitude = subject.step(3_000_000, &sample(&turned, Vector3::zeros(), true));
    assert!(attitude.flags.gap);
    comes_back::<S>(&mut subject, &turned, 30.0);
}

/// With a field in every tenth sample, a turn that was missed is made up for within five seconds.
fn a_gap_is_bridged_by_a_slow_magnetometer<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut subject = S::start();
    for k in 0..2_000 {
        subject.step(i64::from(DT_US), &sample(&truth, Vector3::zeros(), k % 10 == 0));
    }
    let turned = truth * UnitQuaternion::from_euler_angles(0.3, 0.2, 1.2);
    subject.step(3_000_000, &sample(&turned, Vector3::zeros(), false));
    let mut error = f64::NAN;
    for k in 1..500 {
        let still = sample(&turned, Vector3::zeros(), k % 10 == 0);
        error = error_deg(&subject.step(i64::from(DT_US), &still).orientation, &turned);
    }
    assert!(!S::CORRECTS || error < 2.0 + S::RESOLUTION_DEG, "{error}");
}

fn free_fall_and_saturation_do_no_harm<S: Subject>() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut subject = S::start();
    rest(&mut subject, &truth, Vector3::zeros(), true, 10.0);
    let mut falling = sample(&truth, Vector3::zeros(), true);
    falling.acc = Vector3::zeros().into();
    for _ in 0..200 {
        subject.step(i64::from(DT_US), &falling);
    }
    let attitude = subject.step(i64::from(DT_US), &falling);
    assert!(error_deg(&attitude.orientation, &truth) < 0.1 + S::RESOLUTION_DEG);
    let full = Vector3::new(1e9f32, -1e9, 1e9);
    for _ in 0..50 {
        let attitude = subject.step(
            i64::from(DT_US),
            &Sample { gyr: full.into(), acc: full.into(), mag: Some(full.into()) },
        );
        assert!((norm(&attitude.orientation) - 1.0).abs() < 1e-5);
        assert!(attitude.rate.iter().all(|r| r.is_finite()));
    }
    // Two seconds of spinning at full scale, and a vertical field, and it is still a compass
    // afterwards.
    let spin = Vector3::new(34.9, 0.0, 0.0);
    for _ in 0..200 {
        subject.step(i64::from(DT_US), &sample(&truth, spin, true));
    }
    comes_back::<S>(&mut subject, &truth, 120.0);
}

/// Half a minute of turning without a field to speak of, and then the earth's again, and a heading
/// that is far off: the compass has not been lost.
fn a_field_that_was_missing_is_followed_again<S: Subject>() {
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.5);
    let mut subject = S::start();
    rest(&mut subject, &truth, Vector3::zeros(), true, 10.0);
    for k in 0..3_000 {
        let rate = Vector3::new(0.3, 0.4, 0.5) * (0.01 * f64::from(k)).cos();
        truth *= UnitQuaternion::from_scaled_axis(rate * 0.01);
        let mut weak = sample(&truth, rate, true);
        weak.mag = weak.mag.map(|mag| mag.map(|part| part * 0.003));
        subject.step(i64::from(DT_US), &weak);
    }
    // Turned about the vertical, unnoticed.
    let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7) * truth;
    comes_back::<S>(&mut subject, &turned, 240.0);
}

/// Hours of coning, the motion that no axis shows in its mean: norm and attitude stay.
fn hours_leave_the_norm_alone<S: Subject>() {
    let mut subject = S::start();
    let mut truth = UnitQuaternion::identity();
    rest(&mut subject, &truth, Vector3::zeros(), true, 5.0);
    let mut last = None;
    for k in 0..360_000 {
        let t = f64::from(k) * 0.01;
        let rate = Vector3::new((5.0 * t).cos(), (5.0 * t).sin(), 0.05);
        truth *= UnitQuaternion::from_scaled_axis(rate * 0.01);
        last = Some(subject.step(i64::from(DT_US), &sample(&truth, rate, k % 5 == 0)));
    }
    let attitude = last.expect("some samples");
    assert!((norm(&attitude.orientation) - 1.0).abs() < 1e-5);
    if S::CORRECTS {
        let error = error_deg(&attitude.orientation, &truth);
        assert!(error < 0.5 + S::RESOLUTION_DEG, "{error}");
    }
}

/// Any finite or infinite or undefined input: the quaternion stays one.
fn survives<S: Subject>(steps: &[(i64, [f32; 9], bool)]) {
    let mut subject = S::start();
    for (dt_us, v, mag) in steps {
        let sample = Sample {
            gyr: Vector3::new(v[0], v[1], v[2]).into(),
            acc: Vector3::new(v[3], v[4], v[5]).into(),
            mag: mag.then_some([v[6], v[7], v[8]]),
        };
        for _ in 0..40 {
            let attitude = subject.step(*dt_us, &sample);
            let n = norm(&attitude.orientation);
            // Ordinary motion keeps 1e-5, see `hours_leave_the_norm_alone`.
            assert!((n - 1.0).abs() < 1e-4, "norm {n} after {sample:?}");
            assert!(attitude.rate.iter().chain(attitude.bias.iter()).all(|r| r.is_finite()));
        }
    }
}

fn any_number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -50f32..50.0,
        1 => prop::num::f32::ANY,
        1 => prop_oneof![Just(0.0), Just(-0.0), Just(f32::MAX), Just(f32::MIN_POSITIVE), Just(f32::NAN), Just(1e30)],
    ]
}

fn any_steps() -> impl Strategy<Value = Vec<(i64, [f32; 9], bool)>> {
    let dt_us = prop_oneof![
        4 => 500i64..20_000,
        1 => 0i64..4_000_000_000,
        1 => -1_000_000i64..1,
    ];
    prop::collection::vec((dt_us, prop::array::uniform9(any_number()), any::<bool>()), 1..12)
}

/// 64, or as many as `PROPTEST_CASES` says. A case has 240 updates on average, so that 4,500 of
/// them over all subjects are fifteen million, in a minute of processor time:
/// `PROPTEST_CASES=4500 cargo test -p tvc-fusion --test suite survives_anything`. Cases that once
/// failed are kept in `suite.proptest-regressions` and come first.
fn cases() -> u32 {
    std::env::var("PROPTEST_CASES").map_or(64, |cases| cases.parse().expect("a number of cases"))
}

macro_rules! suite {
    ($($name:ident: $subject:ty),+ $(,)?) => {$(
        mod $name {
            use super::*;

            suite!(@tests $subject:
                starts_at_any_attitude,
                starts_with_a_slow_magnetometer,
                follows_a_motion,
                is_equivariant,
                a_magnet_turns_neither_roll_nor_pitch,
                works_without_a_magnetometer,
                time_that_stands_still_turns_nothing,
                a_gap_is_bridged,
                a_gap_is_bridged_by_a_slow_magnetometer,
                free_fall_and_saturation_do_no_harm,
                a_field_that_was_missing_is_followed_again,
                hours_leave_the_norm_alone,
            );

            proptest! {
                #![proptest_config(ProptestConfig {
                    cases: cases(),
                    failure_persistence: Some(Box::new(WithSource("proptest-regressions"))),
                    ..ProptestConfig::default()
                })]
                #[test]
                fn survives_anything(steps in any_steps()) {
                    survives::<$subject>(&steps);
                }
            }
        }
    )+};
    (@tests $subject:ty: $($test:ident),+ $(,)?) => {$(
        #[test]
        fn $test() {
            super::$test::<$subject>();
        }
    )+};
}

suite! {
    complementary_f32: Estimator<Complementary<f32>>,
    complementary_f64: Estimator<Complementary<f64>>,
    complementary_fixed: Fixed<fixed::Complementary>,
    mahony_f32: Estimator<Mahony<f32>>,
    mahony_f64: Estimator<Mahony<f64>>,
    mahony_fixed: Fixed<fixed::Mahony>,
    madgwick_f32: Estimator<Madgwick<f32>>,
    madgwick_f64: Estimator<Madgwick<f64>>,
    madgwick_fixed: Fixed<fixed::Madgwick>,
    vqf_f32: Estimator<Vqf<f32>>,
    vqf_f64: Estimator<Vqf<f64>>,
    kalman_f32: Estimator<Kalman<f32>>,
    kalman_f64: Estimator<Kalman<f64>>,
    vqf_fixed: Fixed<fixed::Vqf>,
}

/// Integrated rates only start and propagate.
mod gyro_f32 {
    use super::*;

    #[derive(Clone)]
    struct Baseline(Estimator<Gyro<f32>>);

    impl Subject for Baseline {
        const RESOLUTION_DEG: f64 = 0.02;
        const CORRECTS: bool = false;

        fn start() -> Self {
            Self(Subject::start())
        }

        fn step(&mut self, dt_us: i64, sample: &Sample) -> Attitude {
            self.0.step(dt_us, sample)
        }
    }

    suite!(@tests Baseline:
        starts_at_any_attitude,
        follows_a_motion,
        is_equivariant,
        a_magnet_turns_neither_roll_nor_pitch,
        works_without_a_magnetometer,
        time_that_stands_still_turns_nothing,
        a_gap_is_bridged,
        free_fall_and_saturation_do_no_harm,
        hours_leave_the_norm_alone,
    );
}

#[test]
fn numbers_that_are_none_change_nothing_but_flags() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut estimator = Estimator::<Mahony>::start();
    let before = rest(&mut estimator, &truth, Vector3::zeros(), true, 3.0);
    let good = sample(&truth, Vector3::new(1.0, 1.0, 1.0), true);
    for dt_s in [0.0, -0.0, -0.01, 1e-40, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let after = estimator.update(dt_s, &good);
        assert!(after.flags.skipped);
        assert_eq!(after.orientation, before.orientation);
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let after =
            estimator.update(0.01, &Sample { gyr: Vector3::new(0.0, bad, 0.0).into(), ..good });
        assert!(after.flags.skipped);
        assert_eq!(after.orientation, before.orientation);
    }
    for bad in [f32::NAN, f32::INFINITY, f32::MAX, 0.0] {
        let bad = Vector3::new(bad, bad, bad);
        let after = estimator.update(
            0.01,
            &Sample { gyr: Vector3::zeros().into(), acc: bad.into(), mag: Some(bad.into()) },
        );
        assert!(after.flags.acc_rejected && after.flags.mag_disturbed && !after.flags.skipped);
        assert!(error_deg(&after.orientation, &truth) < 0.1);
    }
}

#[test]
fn declination_makes_north_geographic() {
    let truth = UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0);
    let declination_rad = 0.076f32;
    let expected = UnitQuaternion::from_euler_angles(0.0, 0.0, f64::from(declination_rad)) * truth;
    let config = Config { declination_rad, ..Config::default() };
    let mut float = Estimator::<Mahony>::new(&config).expect("valid");
    let mut fixed = Fixed::<fixed::Mahony>::new(&config, &fixed::Scale::BNO055);
    let error =
        error_deg(&rest(&mut float, &truth, Vector3::zeros(), true, 20.0).orientation, &expected);
    assert!(error < 0.05, "{error}");
    let error =
        error_deg(&rest(&mut fixed, &truth, Vector3::zeros(), true, 20.0).orientation, &expected);
    assert!(error < 0.4, "{error}");
}

#[test]
fn a_start_exactly_at_the_accelerometers_tilt_has_no_gradient_to_normalise() {
    let mut estimator = Estimator::<Madgwick>::start();
    for _ in 0..100 {
        let level = Sample {
            gyr: Vector3::zeros().into(),
            acc: Vector3::new(0.0, 0.0, -GRAVITY).into(),
            mag: None,
        };
        assert_eq!(estimator.update(0.01, &level).orientation, Quaternion::IDENTITY);
    }
}

#[test]
fn impossible_configurations_are_refused_by_name() {
    let mut config = Config::<<Mahony as Filter>::Gains>::default();
    config.gains.acc_per_s = f32::NAN;
    let error = Estimator::<Mahony>::new(&config).expect_err("NaN is no gain");
    assert_eq!(error.to_string(), "acc_per_s is out of range");
    let config = Config::<<Mahony as Filter>::Gains>::default();
    let error = fixed::Estimator::<fixed::Mahony>::new(&config, &fixed::Scale::BNO055, 0)
        .expect_err("no period");
    assert_eq!(error.to_string(), "period_us is out of range");
}

#[test]
fn a_field_in_parts_of_the_earths_is_a_compass() {
    let truth = UnitQuaternion::from_euler_angles(0.2, -0.3, 2.0);
    let mut plain = sample(&truth, Vector3::zeros(), true);
    plain.mag = plain.mag.map(|mag| mag.map(|part| part / 50.0));
    let scale = fixed::Scale { mag_ut: 1e-3, ..fixed::Scale::BNO055 };
    let mut float = Estimator::<Vqf>::start();
    let mut fixed = Fixed::<fixed::Vqf>::new(&Config::default(), &scale);
    let counts = fixed::Counts {
        mag: plain
            .mag
            .map(|mag| [mag[0], mag[1], mag[2]].map(|v| (v / scale.mag_ut).round() as i16)),
        ..counts(&plain)
    };
    for _ in 0..300 {
        float.update(0.01, &plain);
        fixed.take(DT_US, &counts);
    }
    let error = error_deg(&float.attitude().orientation, &truth);
    assert!(error < 0.05, "{error}");
    let error = error_deg(&fixed.take(DT_US, &counts).orientation, &truth);
    assert!(error < 0.4, "{error}");
}
