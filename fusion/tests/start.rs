//! How soon after the start the gyroscope's offset is known.

use tvc_fusion::fixed::{Counts, Estimator, Scale, Vqf};
use tvc_fusion::{Config, Sample};

/// Seconds of rest until an offset of a degree per second is within a tenth of itself.
fn fixed_s(period_us: u32) -> f64 {
    let estimator = Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, period_us)
        .expect("the configuration is valid");
    let mut state = estimator.start();
    let rest = Counts { gyr: [16, 0, 0], acc: [0, 0, -981], mag: None };
    let samples = (1..).find(|_| {
        estimator.update(&mut state, period_us, &rest);
        (estimator.bias_q9(&state)[0] - (16 << 9)).abs() < 819
    });
    f64::from(samples.unwrap_or(0)) * f64::from(period_us) * 1e-6
}

fn float_s(period_us: u32) -> f64 {
    let mut estimator = tvc_fusion::Estimator::<tvc_fusion::Vqf<f32>>::new(&Config::default())
        .expect("the configuration is valid");
    let rate = 16.0 * Scale::BNO055.gyr_rad_s;
    let rest = Sample { gyr: [rate, 0.0, 0.0], acc: [0.0, 0.0, -9.81], mag: None };
    let samples = (1..).find(|_| {
        let attitude = estimator.update(period_us as f32 * 1e-6, &rest);
        (attitude.bias[0] - rate).abs() < 0.1 * rate
    });
    f64::from(samples.unwrap_or(0)) * f64::from(period_us) * 1e-6
}

#[test]
fn fixed_point_knows_the_first_offset_about_as_soon_as_float() {
    for period_us in [1_000, 2_500, 5_000, 6_667, 10_000] {
        let (fixed_s, float_s) = (fixed_s(period_us), float_s(period_us));
        println!("{period_us} us: fixed {fixed_s:.2} s, float {float_s:.2} s");
        assert!(fixed_s < 2.1, "{period_us} us: {fixed_s} s");
        assert!(fixed_s < float_s + 0.25, "{fixed_s} s, float {float_s} s");
    }
}
