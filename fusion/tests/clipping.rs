//! Rotation beyond the gyroscope's range, whose limit nobody tells the filter.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{Attitude, Config, Estimator, Filter, GRAVITY, Madgwick, Mahony, Sample, Vqf};

const DT_S: f64 = 0.005;

/// Peaks of the swinging, rad/s.
const PEAK: f64 = 11.0;

fn field() -> Vector3<f64> {
    Vector3::new(17.0, 0.0, 47.0)
}

/// What an estimator is wrong by, deg RMS, over a minute of swinging with the rates clipped at
/// `limit`: in all with a magnetometer, in inclination without. And for which part of the time it
/// says that it is over range.
fn swing(limit: f64, mag: bool, mut step: impl FnMut(&Sample) -> Attitude) -> (f64, f64) {
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    // A magnetometer's conversion takes time: the field is that of two samples ago.
    let mut late = [truth.inverse() * field(); 2];
    let (mut sum, mut over, mut count) = (0.0, 0.0, 0.0);
    for k in 0..13_000 {
        let t = f64::from(k) * DT_S;
        let lively = if t < 4.0 { 0.0 } else { 1.0 };
        let rate = Vector3::new(
            (PEAK - 2.0) * (4.3 * t).sin() + 2.0 * (11.0 * t).sin(),
            1.5 * (2.1 * t).cos(),
            5.0 * (2.9 * t).sin(),
        ) * lively;
        truth *= UnitQuaternion::from_scaled_axis(rate * DT_S);
        let back = truth.inverse();
        let shake = Vector3::new((7.3 * t).sin(), (9.1 * t).cos(), (8.2 * t).sin()) * 2.0 * lively;
        let acc = back * (shake + Vector3::new(0.0, 0.0, -f64::from(GRAVITY)));
        // The calibration of the axes, after clipping, mixes a little of the others in.
        let clipped = rate.map(|rate| rate.clamp(-limit, limit));
        let mixed = (clipped - rate).map(|lost| 0.01 * lost);
        let gyr = clipped + Vector3::new(mixed.y, mixed.z, mixed.x);
        let attitude = step(&Sample {
            gyr: gyr.cast().into(),
            acc: acc.cast().into(),
            mag: mag.then(|| late[1].cast().into()),
        });
        late = [back * field(), late[0]];
        if t < 4.0 {
            continue;
        }
        let q = attitude.orientation;
        let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(f64::from);
        let estimate = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let up = Vector3::new(0.0, 0.0, -1.0);
        let error = if mag {
            estimate.angle_to(&truth)
        } else {
            (estimate.inverse() * up).angle(&(back * up))
        };
        sum += error * error;
        over += f64::from(u8::from(attitude.flags.over_range));
        count += 1.0;
    }
    ((sum / count).sqrt().to_degrees(), over / count)
}

fn float<F: Filter<Real = f32>>() -> impl FnMut(&Sample) -> Attitude
where
    F::Gains: Default,
{
    let config = Config { gyr_lag_s: 0.0, acc_lag_s: 0.0, ..Config::default() };
    let mut estimator = Estimator::<F>::new(&config).expect("valid");
    move |sample| estimator.update(DT_S as f32, sample)
}

fn stays_close<S: FnMut(&Sample) -> Attitude>(subject: impl Fn() -> S) {
    // Not clipped, a fifth of the time clipped, and a third of it; without what is done against it
    // the errors are 10 and 24 deg and more.
    for (limit, most_deg) in [(2.0 * PEAK, 1.2), (7.4, 8.0), (6.0, 15.0)] {
        for mag in [true, false] {
            let (rms_deg, over) = swing(limit, mag, subject());
            println!("{limit} {mag} {rms_deg:.2} {over:.2}");
            assert!(rms_deg < most_deg, "{rms_deg} deg at {limit}, {mag}");
            assert_eq!(over > 0.5, limit < PEAK, "over range for {over} of the time");
        }
    }
}

#[test]
fn vqf_finds_the_attitude_again() {
    stays_close(float::<Vqf>);
}

#[test]
fn mahony_finds_the_attitude_again() {
    stays_close(float::<Mahony>);
}

#[test]
fn madgwick_finds_the_attitude_again() {
    stays_close(float::<Madgwick>);
}
