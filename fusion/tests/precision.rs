//! How far the fixed-point and the f32 filters are from themselves in f64, on the same counts.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::filter::Real;
use tvc_fusion::{Config, Estimator, Filter, GRAVITY, Mahony, Quaternion, Sample, Vqf, fixed};

const SCALE: fixed::Scale = fixed::Scale::BNO055;
const MINUTES: u32 = 10;

fn oracle<T: Real>(q: &Quaternion<T>) -> UnitQuaternion<f64> {
    let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(|c| f64::from(c.to_f32()));
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
}

/// Ten minutes at 1 kHz as a BNO055 would give them: rest, then hand motion with up to 300 deg/s
/// and half a g, in counts. The field has its own noise, seeded, so that its counts are no
/// staircase. Acceleration and field are as late as said, s.
fn recording(acc_lag_s: f32, mag_lag_s: f32) -> impl Iterator<Item = fixed::Counts> {
    let mut truth = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
    let mut seed = 1u32;
    (0..MINUTES * 60_000).map(move |k| {
        let t = f64::from(k) * 1e-3;
        let lively = if t < 5.0 { 0.0 } else { 1.0 };
        let rate =
            Vector3::new((1.1 * t).sin() * 3.0, (0.7 * t).cos() * 2.5, (0.4 * t).sin() * 4.0)
                * lively;
        truth *= UnitQuaternion::from_scaled_axis(rate * 1e-3);
        let motion = Vector3::new((2.1 * t).sin(), (3.3 * t).cos(), (1.7 * t).sin()) * 3.0 * lively;
        let mut noise = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 16) / 65_536.0 - 0.5
        };
        let back = |late_s: f32| {
            (truth * UnitQuaternion::from_scaled_axis(-rate * f64::from(late_s))).inverse()
        };
        let acc = back(acc_lag_s) * (motion + Vector3::new(0.0, 0.0, -f64::from(GRAVITY)));
        let field = back(mag_lag_s) * Vector3::new(17.1, 0.0, 46.98);
        let mag = field + Vector3::new(noise(), noise(), noise());
        let bias = Vector3::new(0.008, -0.005, 0.003);
        let count = |v: Vector3<f64>, unit: f32| {
            [v.x, v.y, v.z].map(|v| (v / f64::from(unit)).round() as i16)
        };
        fixed::Counts {
            gyr: count(rate + bias, SCALE.gyr_rad_s),
            acc: count(acc, SCALE.acc_m_s2),
            mag: (k % 50 == 0).then(|| count(mag, SCALE.mag_ut)),
        }
    })
}

fn sample(counts: &fixed::Counts) -> Sample {
    let vector = |v: [i16; 3], unit: f32| Vector3::from(v).map(|v| f32::from(v) * unit);
    Sample {
        gyr: vector(counts.gyr, SCALE.gyr_rad_s).into(),
        acc: vector(counts.acc, SCALE.acc_m_s2).into(),
        mag: counts.mag.map(|mag| vector(mag, SCALE.mag_ut).into()),
    }
}

/// RMS and largest angle, in degrees, from the f64 filter, after the first minute: the beginning, a
/// running mean, is a staircase in fixed point.
fn compare<F>(
    config: &Config<F::Gains>,
    mut step: impl FnMut(&fixed::Counts) -> UnitQuaternion<f64>,
) -> (f64, f64)
where
    F: Filter<Real = f64>,
{
    let mut reference = Estimator::<F>::new(config).expect("valid");
    let (mut sum, mut most, mut n) = (0.0, 0.0f64, 0.0);
    for (k, counts) in recording(config.acc_lag_s, config.mag_lag_s).enumerate() {
        let expected = oracle(&reference.update(1e-3, &sample(&counts)).orientation);
        let apart = step(&counts).angle_to(&expected).to_degrees();
        if k >= 60_000 {
            sum += apart * apart;
            most = most.max(apart);
            n += 1.0;
        }
    }
    ((sum / n).sqrt(), most)
}

/// With sensors of one instant, and with ones that are late by what is known.
fn fixed_point_stays_with_f64<F, G>()
where
    F: Filter<Real = f64>,
    G: fixed::Filter<Gains = F::Gains>,
    F::Gains: Default,
{
    let known = Config { mag_lag_sd_s: 0.0, ..Config::default() };
    // A vector that is brought to the present is rounded to counts once more.
    for (name, config, limit) in
        [("no lags", Config::default().without_lags(), 0.02), ("lags", known, 0.025)]
    {
        let estimator = fixed::Estimator::<G>::new(&config, &SCALE, 1000).expect("valid");
        let mut state = estimator.start();
        let (rms, most) = compare::<F>(&config, |counts| {
            estimator.update(&mut state, 1000, counts);
            oracle(&estimator.orientation(&state).quaternion())
        });
        println!("{name}: {rms} {most}");
        assert!(rms < limit, "{name}: {rms} deg RMS, {most} at most");
    }
}

#[test]
fn fixed_point_mahony_stays_with_f64() {
    fixed_point_stays_with_f64::<Mahony<f64>, fixed::Mahony>();
}

#[test]
fn fixed_point_vqf_stays_with_f64() {
    fixed_point_stays_with_f64::<Vqf<f64>, fixed::Vqf>();
}

#[test]
fn single_precision_is_enough() {
    let config = Config::default().without_lags();
    let mut estimator = Estimator::<Mahony<f32>>::new(&config).expect("valid");
    let (rms, most) = compare::<Mahony<f64>>(&config, |counts| {
        oracle(&estimator.update(1e-3, &sample(counts)).orientation)
    });
    println!("{rms} {most}");
    assert!(rms < 0.002, "{rms} deg RMS, {most} at most");
}
