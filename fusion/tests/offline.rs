//! Forth and back through a recording.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::offline::{TimedSample, smooth};
use tvc_fusion::{Attitude, Config, Estimator, GRAVITY, Mahony, Sample, Vqf, VqfGains};

const DT_S: f64 = 0.01;

/// Sensors of one instant.
fn config() -> Config<VqfGains> {
    Config::with_gains(VqfGains::offline()).without_lags()
}

/// Two minutes of turning and shaking that end, but do not begin, with ten seconds of rest, with an
/// offset of the gyroscope; and the true attitudes.
fn recording(offset: Vector3<f64>) -> Vec<(TimedSample, UnitQuaternion<f64>)> {
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let mut seed = 1u32;
    let mut noise = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1u32 << 24) - 0.5
    };
    let at = |k: u32| {
        let t = f64::from(k) * DT_S;
        let lively = if t < 110.0 { 1.0 } else { 0.0 };
        let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * lively;
        truth *= UnitQuaternion::from_scaled_axis(rate * DT_S);
        let shake = Vector3::new(noise(), noise(), noise()) * 6.0 * lively;
        let stir = Vector3::new(noise(), noise(), noise()) * 4.0;
        let back = truth.inverse();
        let sample = Sample {
            gyr: (rate + offset).cast().into(),
            acc: (back * (shake + Vector3::new(0.0, 0.0, -f64::from(GRAVITY)))).cast().into(),
            mag: Some((back * Vector3::new(17.1, 0.0, 47.0) + stir).cast().into()),
        };
        let dt_s = DT_S as f32;
        (TimedSample { dt_s, sample }, truth)
    };
    (0..12_000).map(at).collect()
}

fn error_deg(attitude: &Attitude<f64>, truth: &UnitQuaternion<f64>) -> f64 {
    let q = attitude.orientation;
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z))
        .angle_to(truth)
        .to_degrees()
}

fn rms_deg<'a>(
    estimates: impl IntoIterator<Item = &'a Attitude<f64>>,
    truth: impl IntoIterator<Item = &'a UnitQuaternion<f64>>,
) -> f64 {
    let squares: Vec<f64> = estimates
        .into_iter()
        .zip(truth)
        .map(|(estimate, truth)| error_deg(estimate, truth).powi(2))
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

fn split(
    recording: Vec<(TimedSample, UnitQuaternion<f64>)>,
) -> (Vec<TimedSample>, Vec<UnitQuaternion<f64>>) {
    recording.into_iter().unzip()
}

/// An offset that only a rest at the end shows is known from the first sample on, and noise counts
/// for less.
#[test]
fn what_is_learned_late_counts_from_the_beginning() {
    let (samples, truth) = split(recording(Vector3::new(0.01, -0.02, 0.03)));
    let mut causal = Estimator::<Vqf<f64>>::new(&config()).expect("valid");
    let forth: Vec<_> =
        samples.iter().map(|timed| causal.update(timed.dt_s, &timed.sample)).collect();
    let both = smooth::<Vqf<f64>>(&config(), &samples).expect("valid");
    let (forth, both_rms) = (rms_deg(&forth, &truth), rms_deg(&both, &truth));
    assert!(forth > 1.5, "{forth} deg forth alone");
    assert!(both_rms < 1.2, "{both_rms} deg forth and back");
    let first = rms_deg(&both[..100], &truth[..100]);
    assert!(first < 1.2, "{first} deg in the first second");
    assert!((Vector3::from(both[0].bias) - Vector3::new(0.01, -0.02, 0.03)).norm() < 1e-3);
}

/// A recording that is turned over in time gives the same attitudes.
#[test]
fn time_has_no_direction() {
    let (samples, truth) = split(recording(Vector3::zeros()));
    let turned: Vec<_> = (0..samples.len())
        .rev()
        .map(|k| {
            let rate = samples.get(k + 1).map(|next| next.sample.gyr.map(|rate| -rate));
            let sample = Sample { gyr: rate.unwrap_or_default(), ..samples[k].sample };
            TimedSample { dt_s: DT_S as f32, sample }
        })
        .collect();
    let plain = smooth::<Mahony<f64>>(&Config::default().without_lags(), &samples).expect("valid");
    let back = smooth::<Mahony<f64>>(&Config::default().without_lags(), &turned).expect("valid");
    let apart = plain
        .iter()
        .zip(back.iter().rev())
        .skip(1000)
        .take(10_000)
        .map(|(a, b)| a.orientation.angle_to(&b.orientation).to_degrees())
        .fold(0.0, f64::max);
    assert!(apart < 0.5, "{apart} deg apart");
    assert!(rms_deg(&plain, &truth) < 1.0);
}

/// An acceleration that swings tilts the VQF class by the square of its filter's response. The mean
/// of two passes would have the real part of the response, which is more.
#[test]
fn a_swinging_acceleration_counts_by_the_square_of_the_response() {
    const SWING: f64 = 0.5;
    let per_s = core::f64::consts::TAU * 0.2;
    let samples: Vec<_> = (0..12_000)
        .map(|k| {
            let forward = SWING * (per_s * f64::from(k) * DT_S).sin();
            let acc = [forward as f32, 0.0, -GRAVITY];
            let sample = Sample { gyr: [0.0; 3], acc, mag: None };
            TimedSample { dt_s: DT_S as f32, sample }
        })
        .collect();
    let swung = smooth::<Vqf<f64>>(&config(), &samples).expect("valid");
    let pitch = swung[4_000..8_000].iter().map(|attitude| attitude.orientation.pitch());
    let (least, most) = pitch.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
    let response = (most - least) / 2.0 * f64::from(GRAVITY) / SWING;
    // 1 / (tau T s^2 + tau s + 1) at s = j per_s.
    let VqfGains { acc_tau_s, acc_smoothing_s, .. } = VqfGains::offline();
    let [tau, smoothing] = [acc_tau_s, acc_smoothing_s].map(f64::from);
    let (real, imaginary) = (1.0 - tau * smoothing * per_s * per_s, tau * per_s);
    let square = 1.0 / (real * real + imaginary * imaginary);
    let mean = (real * square).abs();
    assert!((response / square - 1.0).abs() < 0.05, "{response} for {square}; mean {mean}");
    assert!(mean > 3.0 * response, "{response} for {square}; mean {mean}");
}

#[test]
fn recordings_of_no_sample_and_of_one_are_no_trouble() {
    assert!(smooth::<Vqf>(&config(), &[]).expect("valid").is_empty());
    let (samples, truth) = split(recording(Vector3::zeros()));
    let one = smooth::<Vqf<f64>>(&config(), &samples[..1]).expect("valid");
    assert_eq!(one.len(), 1);
    // The noise of a single sample.
    assert!(error_deg(&one[0], &truth[0]) < 45.0);
}
