//! Sensors of other scales and rates in fixed point: no product overflows, which is a panic in
//! these tests, and the attitude is right.

use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;
use tvc_fusion::fixed::{
    Complementary, Counts, Estimator, Filter, Madgwick, Mahony, PERIOD_US, Scale, Vqf,
};
use tvc_fusion::{Config, ConfigError, GRAVITY};

const G: f32 = GRAVITY;

/// The sensors of the market, with counts per deg/s and per g at each full scale, and uT of a
/// count.
const SENSORS: [(&str, &[f32], &[f32], f32); 6] = [
    ("BNO055", &[16.0], &[980.665], 0.0625),
    ("BMI270", &[262.4, 131.2, 65.6, 32.8, 16.4], &[16_384.0, 8_192.0, 4_096.0, 2_048.0], 0.3),
    ("ICM-20948", &[131.0, 65.5, 32.8, 16.4], &[16_384.0, 8_192.0, 4_096.0, 2_048.0], 0.15),
    (
        "LSM6DSO",
        &[228.57, 114.29, 57.14, 28.57, 14.286],
        &[16_393.4, 8_196.7, 4_098.4, 2_049.2],
        0.15,
    ),
    ("MPU-6050", &[131.0, 65.5, 32.8, 16.4], &[16_384.0, 8_192.0, 4_096.0, 2_048.0], 0.3),
    ("MPU-9250", &[131.0, 65.5, 32.8, 16.4], &[16_384.0, 8_192.0, 4_096.0, 2_048.0], 0.6),
];

const RATES_HZ: [u32; 6] = [104, 200, 400, 833, 1_000, 2_000];

fn scales() -> impl Iterator<Item = (String, Scale)> {
    SENSORS.iter().flat_map(|(name, gyr, acc, mag_ut)| {
        gyr.iter().flat_map(move |gyr| {
            acc.iter().map(move |acc| {
                let scale = Scale {
                    gyr_rad_s: (1.0 / gyr).to_radians(),
                    acc_m_s2: G / acc,
                    mag_ut: *mag_ut,
                };
                (format!("{name}, {gyr} per deg/s, {acc} per g"), scale)
            })
        })
    })
}

/// Ten seconds of rest with an offset of 3 deg/s, levelled when the offset is known. Then five of
/// turning at up to a third of the range and shaken. The error at the end, deg.
fn error_deg<F: Filter<Gains: Default>>(scale: &Scale, rate_hz: u32) -> f64 {
    let period_us = 1_000_000 / rate_hz;
    let config = Config::default();
    let estimator = Estimator::<F>::new(&config, scale, period_us).expect("in range");
    let mut state = estimator.start();
    let counts = |v: Vector3<f64>, unit: f32| {
        let [x, y, z] = [v.x, v.y, v.z];
        [x, y, z].map(|c| (c / f64::from(unit)).round() as i16)
    };
    let offset = Vector3::new(3.0_f64, -2.0, 1.5).map(f64::to_radians);
    let largest = f64::from(scale.gyr_rad_s) * 32_767.0;
    let dt_s = f64::from(period_us) * 1e-6;
    let mut truth = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0);
    for k in 0..(15.0 / dt_s) as u32 {
        let t = f64::from(k) * dt_s;
        let moving = if t < 10.0 { 0.0 } else { (largest / 3.0).min(3.0) };
        let rate = Vector3::new((5.0 * t).sin(), (3.0 * t).cos(), (4.0 * t).sin()) * moving;
        truth *= UnitQuaternion::from_scaled_axis(rate * dt_s);
        let back = truth.inverse();
        let shake = Vector3::new((40.0 * t).sin(), 0.0, (31.0 * t).cos()) * moving;
        let acc = back * (shake + Vector3::new(0.0, 0.0, -f64::from(G)));
        let field = back * Vector3::new(17.0, 0.0, 47.0);
        if k == (6.0 / dt_s) as u32 {
            estimator.level(&mut state);
        }
        estimator.update(
            &mut state,
            period_us,
            &Counts {
                gyr: counts(rate + offset, scale.gyr_rad_s),
                acc: counts(acc, scale.acc_m_s2),
                mag: (k % 4 == 0).then(|| counts(field, scale.mag_ut)),
            },
        );
    }
    let [w, x, y, z] = estimator.orientation(&state).wxyz_q30.map(f64::from);
    let estimate = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
    estimate.angle_to(&truth).to_degrees()
}

#[test]
fn the_attitude_is_right_with_every_sensor_of_the_market() {
    for (name, scale) in scales() {
        for rate_hz in RATES_HZ {
            let errors = [error_deg::<Vqf>(&scale, rate_hz), error_deg::<Mahony>(&scale, rate_hz)];
            let worst = errors.into_iter().fold(0.0, f64::max);
            assert!(worst < 1.5, "{name}, {rate_hz} Hz: {errors:?}");
        }
    }
}

/// The largest range of an LSM6DSO turns too far in 10 ms, if not in one of its own 9.6 ms.
#[test]
fn a_scale_that_has_no_room_is_refused_by_name() {
    let (_, scale) = scales().last().expect("some sensors");
    let scale = Scale { gyr_rad_s: 0.07_f32.to_radians(), ..scale };
    let refused = Estimator::<Vqf>::new(&Config::default(), &scale, 10_000).map(|_| ());
    assert_eq!(refused, Err(ConfigError::OutOfRange("period_us")));
    assert!(Estimator::<Vqf>::new(&Config::default(), &scale, 9_615).is_ok());
}

fn any_count() -> impl Strategy<Value = i16> {
    prop_oneof![
        4 => -500_i16..500,
        1 => any::<i16>(),
        1 => prop_oneof![Just(i16::MIN), Just(i16::MAX), Just(0), Just(-1)],
    ]
}

/// A sample, how often it comes, and how long after the one before, us.
fn any_steps() -> impl Strategy<Value = Vec<([i16; 9], bool, u16, u32)>> {
    let dt_us = prop_oneof![6 => 400_u32..12_000, 1 => 0_u32..200_000, 1 => any::<u32>()];
    let step = (prop::array::uniform9(any_count()), any::<bool>(), 1_u16..400, dt_us);
    prop::collection::vec(step, 1..20)
}

fn any_scale() -> impl Strategy<Value = Scale> {
    let within = |range: std::ops::RangeInclusive<f32>| {
        let (low, high) = (range.start().ln(), range.end().ln());
        (0.0_f32..=1.0).prop_map(move |share| (low + share * (high - low)).exp())
    };
    (within(Scale::GYR_RAD_S), within(Scale::ACC_M_S2), within(Scale::MAG_UT))
        .prop_map(|(gyr_rad_s, acc_m_s2, mag_ut)| Scale { gyr_rad_s, acc_m_s2, mag_ut })
}

fn take<F: Filter>(estimator: &Estimator<F>, steps: &[([i16; 9], bool, u16, u32)]) {
    let mut state = estimator.start();
    for ([gx, gy, gz, ax, ay, az, mx, my, mz], has_field, times, dt_us) in steps {
        let counts = Counts {
            gyr: [*gx, *gy, *gz],
            acc: [*ax, *ay, *az],
            mag: has_field.then_some([*mx, *my, *mz]),
        };
        for _ in 0..*times {
            estimator.update(&mut state, *dt_us, &counts);
        }
        let norm: f64 = estimator
            .orientation(&state)
            .wxyz_q30
            .map(|part| (f64::from(part) / f64::from(1 << 30)).powi(2))
            .iter()
            .sum();
        // At full scale on all three axes; with ordinary motion it is within 1e-5.
        assert!((norm - 1.0).abs() < 1e-2, "{norm}");
    }
}

/// `lags_s`: of gyroscope, accelerometer and magnetometer.
fn survives<F: Filter<Gains: Default>>(
    scale: &Scale,
    period_us: u32,
    [gyr_lag_s, acc_lag_s, mag_lag_s]: [f32; 3],
    steps: &[([i16; 9], bool, u16, u32)],
) {
    let config = Config::<F::Gains> { gyr_lag_s, acc_lag_s, mag_lag_s, ..Config::default() };
    // A scale for which the gains have no room is refused.
    if let Ok(estimator) = Estimator::<F>::new(&config, scale, period_us) {
        take(&estimator, steps);
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: cases(),
        failure_persistence: Some(Box::new(WithSource("proptest-regressions"))),
        ..ProptestConfig::default()
    })]
    #[test]
    fn no_product_overflows_at_any_scale(
        scale in any_scale(),
        period_us in PERIOD_US,
        lags_s in prop::array::uniform3(-0.1_f32..0.1),
        steps in any_steps(),
    ) {
        survives::<Vqf>(&scale, period_us, lags_s, &steps);
        survives::<Mahony>(&scale, period_us, lags_s, &steps);
        survives::<Madgwick>(&scale, period_us, lags_s, &steps);
        survives::<Complementary>(&scale, period_us, lags_s, &steps);
    }
}

/// 100, or as many as `PROPTEST_CASES` says: a case has some 8,000 updates.
fn cases() -> u32 {
    std::env::var("PROPTEST_CASES").map_or(100, |cases| cases.parse().expect("a number of cases"))
}
