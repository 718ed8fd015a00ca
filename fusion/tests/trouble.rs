//! Noise, spins, slow turns and gaps that once broke the float filters.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{Config, Estimator, Filter, GRAVITY, Kalman, Mahony, Quaternion, Sample, Vqf};

const DEG: f64 = core::f64::consts::PI / 180.0;

/// Pseudo-random numbers with a deviation of one: sums of twelve.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += f64::from(self.0 >> 8) / f64::from(1u32 << 24);
        }
        sum
    }

    fn vector(&mut self, deviation: f64) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next()) * deviation
    }
}

/// A body whose sensors are perfect but for noise and for counts.
struct Body {
    attitude: UnitQuaternion<f64>,
    dt_s: f64,
    noise: Noise,
    /// Deviation of the rates, rad/s.
    gyr_noise: f64,
}

impl Body {
    fn new(dt_s: f64, gyr_noise_deg_s: f64) -> Self {
        Self {
            attitude: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3),
            dt_s,
            noise: Noise(1),
            gyr_noise: gyr_noise_deg_s * DEG,
        }
    }

    /// A step at this rate in the body frame; what the sensors show in counts of a BNO055.
    fn step(&mut self, rate: Vector3<f64>, mag: bool) -> Sample {
        self.attitude *= UnitQuaternion::from_scaled_axis(rate * self.dt_s);
        let back = self.attitude.inverse();
        let counted = |v: Vector3<f64>, unit: f64| v.map(|v| ((v / unit).round() * unit) as f32);
        let gyr = rate + self.noise.vector(self.gyr_noise);
        let acc = back * Vector3::new(0.0, 0.0, -f64::from(GRAVITY)) + self.noise.vector(0.02);
        let field = back * Vector3::new(17.1, 0.0, 47.0) + self.noise.vector(0.3);
        Sample {
            gyr: counted(gyr, DEG / 16.0).into(),
            acc: counted(acc, 0.01).into(),
            mag: mag.then(|| counted(field, 1.0 / 16.0).into()),
        }
    }

    fn error_deg(&self, estimate: &Quaternion) -> f64 {
        let [w, x, y, z] = [estimate.w, estimate.x, estimate.y, estimate.z].map(f64::from);
        let estimate = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let error_deg = estimate.angle_to(&self.attitude) / DEG;
        // The largest of several errors would leave out what is no number.
        assert!(error_deg.is_finite(), "{w} {x} {y} {z}");
        error_deg
    }
}

fn started<F: Filter<Real = f32>>() -> Estimator<F>
where
    F::Gains: Default,
{
    let config = Config {
        // All sensors are of one instant here.
        gyr_lag_s: 0.0,
        acc_lag_s: 0.0,
        mag_lag_s: 0.0,
        ..Config::default()
    };
    Estimator::new(&config).expect("the configuration is valid")
}

/// Noise makes steps of all sizes, and among a thousand a second some that look like clipping.
fn noise_is_not_clipping<F: Filter<Real = f32>>()
where
    F::Gains: Default,
{
    for (rate_hz, noise_deg_s) in [(400.0, 0.1), (400.0, 0.2), (1000.0, 0.1), (1000.0, 0.2)] {
        let mut body = Body::new(1.0 / rate_hz, noise_deg_s);
        let mut estimator = started::<F>();
        let (mut over, mut sum, mut count) = (0u32, 0.0, 0u32);
        for k in 0..(60.0 * rate_hz) as u32 {
            let t = f64::from(k) / rate_hz;
            let lively = (0.3 * (t - 4.0)).clamp(0.0, 1.0);
            let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin());
            let sample = body.step(rate * 3.5 * lively, k % 20 == 0);
            let attitude = estimator.update(body.dt_s as f32, &sample);
            if t > 5.0 {
                over += u32::from(attitude.flags.over_range);
                sum += body.error_deg(&attitude.orientation).powi(2);
                count += 1;
            }
        }
        let rms = (sum / f64::from(count)).sqrt();
        assert!(over == 0, "over range {over} of {count} at {rate_hz} Hz");
        assert!(rms < 0.2, "{rms} deg at {rate_hz} Hz, {noise_deg_s} deg/s");
    }
}

#[test]
fn vqf_takes_noise_for_noise() {
    noise_is_not_clipping::<Vqf>();
}

#[test]
fn mahony_takes_noise_for_noise() {
    noise_is_not_clipping::<Mahony>();
}

/// Half a minute of spinning near the end of the gyroscope's range, and slower again.
#[test]
fn a_fast_steady_spin_is_followed() {
    for spin_deg_s in [500.0, 1000.0, 1900.0, -1900.0] {
        for noise_deg_s in [0.0, 0.02, 0.1] {
            let mut body = Body::new(0.01, noise_deg_s);
            let mut estimator = started::<Vqf>();
            let mut most = 0.0f64;
            for k in 0..6_000 {
                let t = f64::from(k) * 0.01;
                let share = ((t - 4.0) / 2.0).clamp(0.0, 1.0) * ((58.0 - t) / 2.0).clamp(0.0, 1.0);
                let pause = if (30.0..32.0).contains(&t) { 0.5 } else { 1.0 };
                let rate = Vector3::new(0.0, 0.0, spin_deg_s * DEG * share * pause);
                let sample = body.step(rate, true);
                let attitude = estimator.update(0.01, &sample);
                if t > 5.0 {
                    most = most.max(body.error_deg(&attitude.orientation));
                }
            }
            assert!(most < 3.0, "{most} deg at {spin_deg_s} deg/s, noise {noise_deg_s}");
        }
    }
}

/// The first samples come in a fast turn.
#[test]
fn a_start_in_a_fast_turn_is_followed() {
    for rate_deg_s in [100.0, 200.0, 500.0] {
        let mut body = Body::new(0.01, 0.05);
        let mut estimator = started::<Vqf>();
        let mut last = 0.0;
        for k in 0..500 {
            let t = f64::from(k) * 0.01;
            let slower = (1.0 - t / 2.0).max(0.0);
            let rate = Vector3::new(0.2, 0.1, 1.0) * (rate_deg_s * DEG * slower);
            let attitude = estimator.update(0.01, &body.step(rate, true));
            last = body.error_deg(&attitude.orientation);
        }
        assert!(last < 2.0, "{last} deg after a start at {rate_deg_s} deg/s");
    }
}

/// A turn that is slow enough for an offset, before any offset is known.
#[test]
fn a_slow_turn_at_the_start_is_no_offset() {
    for (rate_deg_s, turning_s) in [(1.5, 4.0), (-1.0, 5.0), (2.5, 4.0)] {
        let mut body = Body::new(0.01, 0.05);
        let mut estimator = started::<Vqf>();
        let mut most = 0.0f64;
        for k in 0..4_000 {
            let t = f64::from(k) * 0.01;
            let turn = Vector3::new(0.0, rate_deg_s * DEG, 0.0);
            // After it there is no rest in which a false offset could be mended.
            let rate = if t < turning_s {
                turn
            } else {
                Vector3::new((2.1 * t).sin(), (1.7 * t).cos(), (1.3 * t).sin()) * 0.5
            };
            let attitude = estimator.update(0.01, &body.step(rate, true));
            let off = f64::from(Vector3::from(attitude.bias).norm()) / DEG;
            assert!(off < 0.4, "{off} deg/s taken for offset in {rate_deg_s} deg/s at {t} s");
            if t > 2.0 {
                most = most.max(body.error_deg(&attitude.orientation));
            }
        }
        assert!(most < 2.0, "{most} deg");
    }
}

/// Steps of ten seconds, and a field in every fifth of them: a correction is the whole error at
/// most.
fn gaps_with_a_slow_magnetometer_leave_the_heading<F: Filter<Real = f32> + Clone>()
where
    F::Gains: Default,
{
    let mut body = Body::new(0.01, 0.0);
    let mut estimator = started::<F>();
    for k in 0..1_000 {
        estimator.update(0.01, &body.step(Vector3::zeros(), k % 10 == 0));
    }
    let mut most = 0.0f64;
    for k in 0..200 {
        // Each time 3 deg about the vertical, unnoticed.
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 3.0 * DEG);
        body.attitude = turn * body.attitude;
        let fresh = k % 5 == 0;
        estimator.update(10.0, &body.step(Vector3::zeros(), fresh));
        if k > 20 && fresh {
            // A correction is applied with the next sample.
            let still = body.step(Vector3::zeros(), false);
            let attitude = estimator.clone().update(1e-6, &still);
            most = most.max(body.error_deg(&attitude.orientation));
        }
    }
    assert!(most < 3.0, "{most} deg");
}

#[test]
fn vqf_is_right_after_repeated_gaps() {
    gaps_with_a_slow_magnetometer_leave_the_heading::<Vqf>();
}

#[test]
fn mahony_is_right_after_repeated_gaps() {
    gaps_with_a_slow_magnetometer_leave_the_heading::<Mahony>();
}

/// The largest error, deg, in the second half of two minutes of turning that begin in motion, with
/// an offset of 3 deg/s that no rest shows.
fn unknown_offset_deg<F: Filter<Real = f32>>() -> f64
where
    F::Gains: Default,
{
    let mut body = Body::new(0.01, 0.05);
    let mut estimator = started::<F>();
    let offset = Vector3::new(3.0, -3.0, 3.0) * DEG;
    let mut most = 0.0f64;
    for k in 0..12_000 {
        let t = f64::from(k) * 0.01;
        let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin());
        let mut sample = body.step(rate, true);
        sample.gyr = (Vector3::from(sample.gyr) + offset.cast::<f32>()).into();
        let attitude = estimator.update(0.01, &sample);
        if t > 60.0 {
            most = most.max(body.error_deg(&attitude.orientation));
        }
    }
    most
}

/// Rates that are no numbers for two seconds, in which the body turns by 57 deg, are a gap.
#[test]
fn skipped_samples_are_a_gap() {
    let (mut body, mut estimator) = (Body::new(0.01, 0.1), started::<Vqf>());
    for _ in 0..1_000 {
        estimator.update(0.01, &body.step(Vector3::zeros(), true));
    }
    for k in 1..=200 {
        let mut sample = body.step(Vector3::new(0.5, 0.0, 0.0), true);
        sample.gyr = [f32::NAN; 3];
        let attitude = estimator.update(0.01, &sample);
        assert_eq!(attitude.flags.gap, k >= 25, "{k}");
    }
    let tilt_rad = estimator.quality().tilt_rad;
    assert!(tilt_rad > 0.3, "{tilt_rad}");
    let mut error_deg = 0.0;
    for _ in 0..1_000 {
        let attitude = estimator.update(0.01, &body.step(Vector3::new(0.2, 0.1, 0.0), true));
        error_deg = body.error_deg(&attitude.orientation);
    }
    assert!(error_deg < 8.0, "{error_deg} deg after ten seconds");
}

/// A few skipped samples count by the rate behind them.
#[test]
fn the_time_of_skipped_samples_counts() {
    let (mut body, mut estimator) = (Body::new(0.01, 0.0), started::<Vqf>());
    for _ in 0..1_000 {
        estimator.update(0.01, &body.step(Vector3::zeros(), true));
    }
    let mut error_deg = 0.0;
    for k in 0..200 {
        let mut sample = body.step(Vector3::new(0.0, 1.0, 0.0), true);
        if k % 4 != 3 {
            sample.gyr[0] = f32::INFINITY;
        }
        error_deg = body.error_deg(&estimator.update(0.01, &sample).orientation);
    }
    assert!(error_deg < 2.5, "{error_deg} deg after 115 deg of turn");
}

/// Garbage makes the Kalman filter believe in an impossible offset, which it forgets.
#[test]
fn an_impossible_offset_is_forgotten() {
    let runs = (1..13).flat_map(|seed| [(seed, 1_000), (seed, 10_000)]);
    let errors_deg: Vec<f64> =
        runs.map(|(seed, samples)| after_garbage_deg(seed, samples)).collect();
    let mean_deg = errors_deg.iter().sum::<f64>() / errors_deg.len() as f64;
    assert!(mean_deg < 1.5, "{mean_deg} deg in the mean of {errors_deg:.1?}");
    assert!(errors_deg.iter().all(|error| *error < 10.0), "{errors_deg:.1?}");
}

/// The Kalman filter's error a minute after that number of garbage samples, deg.
fn after_garbage_deg(seed: u32, samples: u32) -> f64 {
    let (mut body, mut estimator) = (Body::new(0.01, 0.1), started::<Kalman>());
    let mut noise = Noise(seed);
    for _ in 0..samples {
        let garbage = Sample {
            gyr: noise.vector(10.0).cast().into(),
            acc: noise.vector(60.0).cast().into(),
            mag: Some(noise.vector(500.0).cast().into()),
        };
        estimator.update(0.01, &garbage);
    }
    let mut error_deg = 0.0;
    for k in 0..6_000 {
        let t = f64::from(k) * 0.01;
        let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin());
        let attitude = estimator.update(0.01, &body.step(rate, true));
        error_deg = body.error_deg(&attitude.orientation);
    }
    error_deg
}

/// Accelerations in units of g are told from the first sample on.
#[test]
fn accelerations_in_g_are_rejected() {
    let (mut body, mut estimator) = (Body::new(0.01, 0.1), started::<Vqf>());
    for _ in 0..500 {
        let mut sample = body.step(Vector3::new(0.3, 0.0, 0.0), true);
        sample.acc = sample.acc.map(|acc| acc / GRAVITY);
        let flags = estimator.update(0.01, &sample).flags;
        assert!(flags.acc_rejected && !flags.initialised, "{flags:?}");
    }
}

#[test]
fn an_offset_is_learned_in_motion() {
    let errors = [unknown_offset_deg::<Kalman>(), unknown_offset_deg::<Vqf>()];
    assert!(errors.iter().all(|error| *error < 2.5), "{errors:?} deg");
}
