//! A field and an acceleration that are older than the rates.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{Config, Estimator, Filter, GRAVITY, Mahony, Quaternion, Sample, Vqf, fixed};

const DT_S: f64 = 0.005;

/// Errors, deg RMS, over the second of two minutes of turning by up to 3 rad/s, with sensors that
/// are `acc_s` and `mag_s` late.
fn errors_deg((acc_s, mag_s): (f64, f64), mut step: impl FnMut(&Sample) -> Quaternion<f32>) -> f64 {
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..24_000 {
        let t = f64::from(k) * DT_S;
        let lively = ((t - 4.0) * 0.3).clamp(0.0, 1.0);
        let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * 3.0 * lively;
        truth *= UnitQuaternion::from_scaled_axis(rate * DT_S);
        let before =
            |age_s: f64| (truth * UnitQuaternion::from_scaled_axis(-rate * age_s)).inverse();
        let sample = Sample {
            gyr: rate.cast().into(),
            acc: (before(acc_s) * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast().into(),
            mag: (k % 4 == 0)
                .then(|| (before(mag_s) * Vector3::new(17.1, 0.0, 47.0)).cast().into()),
        };
        let q = step(&sample);
        if t > 60.0 {
            let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(f64::from);
            let estimate = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
            sum += estimate.angle_to(&truth).to_degrees().powi(2);
            count += 1.0;
        }
    }
    (sum / count).sqrt()
}

/// The same of a filter in float; and the field's lag that it has learned, s.
fn error_deg<F: Filter<Real = f32>>(late: (f64, f64), config: &Config<F::Gains>) -> (f64, f32) {
    let mut estimator = Estimator::<F>::new(config).expect("valid");
    let error = errors_deg(late, |sample| estimator.update(DT_S as f32, sample).orientation);
    (error, estimator.mag_lag_s())
}

/// The same of a filter in fixed point, on the counts of a BNO055.
fn fixed_error_deg<F: fixed::Filter>(late: (f64, f64), config: &Config<F::Gains>) -> (f64, f32) {
    let (period_us, scale) = ((DT_S * 1e6) as u32, fixed::Scale::BNO055);
    let mut estimator = fixed::Estimator::<F>::new(config, &scale, period_us).expect("valid");
    let mut state = estimator.start();
    let mut lag = fixed::FieldLag::new(config).expect("valid");
    let counts = |v: Vector3<f32>, unit: f32| [v.x, v.y, v.z].map(|v| (v / unit).round() as i16);
    let error = errors_deg(late, |sample| {
        let counts = fixed::Counts {
            gyr: counts(sample.gyr.into(), scale.gyr_rad_s),
            acc: counts(sample.acc.into(), scale.acc_m_s2),
            mag: sample.mag.map(|mag| counts(mag.into(), scale.mag_ut)),
        };
        estimator.update(&mut state, period_us, &counts);
        lag.learn(&mut estimator, &state, period_us, &counts);
        estimator.orientation(&state).quaternion()
    });
    (error, lag.lag_s())
}

/// `of` runs a filter with a configuration on late sensors, and gives its error and learned lag.
/// The error is at most `most_deg` where the lags are known.
fn lags_are_made_good_for<G: Default + Copy>(
    most_deg: f64,
    of: impl Fn((f64, f64), &Config<G>) -> (f64, f32),
) {
    let late = (0.006, 0.03);
    let ignored = Config::<G>::default().without_lags();
    let (error, _) = of(late, &ignored);
    assert!(error > 1.5, "{error} deg where the lags are ignored");
    let known = Config { acc_lag_s: 0.006, mag_lag_s: 0.03, ..ignored };
    let (error, lag_s) = of(late, &known);
    assert!(error < most_deg, "{error} deg where the lags are known");
    assert_eq!(lag_s, 0.03);
    let learned = Config { gyr_lag_s: 0.0, acc_lag_s: 0.006, ..Config::default() };
    let (error, lag_s) = of(late, &learned);
    assert!((lag_s - 0.03).abs() < 0.003, "{lag_s} s learned");
    assert!(error < 0.6, "{error} deg where the field's lag is learned");
}

#[test]
fn fixed_vqf_makes_good_for_late_sensors() {
    lags_are_made_good_for(0.2, fixed_error_deg::<fixed::Vqf>);
}

#[test]
fn fixed_mahony_makes_good_for_late_sensors() {
    lags_are_made_good_for(0.2, fixed_error_deg::<fixed::Mahony>);
}

#[test]
fn vqf_makes_good_for_late_sensors() {
    lags_are_made_good_for(0.15, error_deg::<Vqf>);
}

#[test]
fn mahony_makes_good_for_late_sensors() {
    lags_are_made_good_for(0.15, error_deg::<Mahony>);
}

/// A magnetometer beside a magnet: all its counts are at their ends.
#[test]
fn the_strongest_field_is_learned_from_without_overflow() {
    let (config, period_us) = (Config::default(), 10_000);
    let scale = fixed::Scale::BNO055;
    let estimator = fixed::Estimator::<fixed::Vqf>::new(&config, &scale, period_us);
    let mut estimator = estimator.expect("valid");
    let (mut state, mut lag) = (estimator.start(), fixed::FieldLag::new(&config).expect("valid"));
    for k in 0..3_000 {
        let rate = if k % 200 < 100 { 3_000 } else { -3_000 };
        let counts = fixed::Counts {
            gyr: [0, 0, if k < 1_500 { 0 } else { rate }],
            acc: [0, 0, -981],
            mag: Some([i16::MAX, i16::MIN, i16::MAX]),
        };
        estimator.update(&mut state, period_us, &counts);
        lag.learn(&mut estimator, &state, period_us, &counts);
    }
    assert!(lag.lag_s().abs() <= 0.1, "{} s", lag.lag_s());
}

/// All sensors are late by the same: the attitude is, too, unless that is known.
#[test]
fn the_attitude_is_that_of_the_present() {
    let late_s = 0.02;
    let dt_s = 0.01;
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let config = Config { gyr_lag_s: late_s as f32, acc_lag_s: 0.0, ..Config::default() };
    let mut estimator = Estimator::<Vqf<f64>>::new(&config).expect("valid");
    let rate_at = |k: u32| {
        let t = f64::from(k) * dt_s;
        Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * (0.5 * t).min(2.0)
    };
    // Of two samples ago.
    let mut then = [truth; 3];
    let mut most = 0.0f64;
    for k in 0..6_000 {
        truth *= UnitQuaternion::from_scaled_axis(rate_at(k) * dt_s);
        then = [then[1], then[2], truth];
        let sample = Sample {
            gyr: rate_at(k.saturating_sub(2)).cast().into(),
            acc: (then[0].inverse() * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast().into(),
            mag: None,
        };
        let q = estimator.update(dt_s as f32, &sample).orientation;
        if k > 1_000 {
            let estimate =
                UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
            let up = Vector3::new(0.0, 0.0, -1.0);
            most = most.max((estimate.inverse() * up).angle(&(truth.inverse() * up)));
        }
    }
    // Of 2 to 3 deg that the body turns within the lag, what its acceleration makes of it is left.
    assert!(most.to_degrees() < 0.1, "{} deg", most.to_degrees());
}
