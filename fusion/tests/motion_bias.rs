//! A start in motion, with an offset of the gyroscope that no rest has shown.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{
    Complementary, Config, Estimator, Filter, GRAVITY, Madgwick, Mahony, Quality, RestConfig,
    Sample, Vqf,
};

const DEG: f64 = core::f64::consts::PI / 180.0;
const RATE_HZ: f64 = 150.0;

/// What moves the body.
#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Steps of the pitch by 0.8 rad about level every two seconds, as of the drone on its tether.
    PitchSteps,
    /// A hand's: all axes, up to 2 rad/s, with accelerations of 1.5 m/s^2.
    Hand,
}

impl Motion {
    fn rate(self, t: f64) -> Vector3<f64> {
        match self {
            // A smooth step within half a second, to and fro.
            Self::PitchSteps => {
                let within = t.rem_euclid(2.0);
                let sense = if t.rem_euclid(4.0) < 2.0 { 1.0 } else { -1.0 };
                let pulse = if within < 0.5 {
                    (1.0 - (within * 4.0 * std::f64::consts::PI).cos()) * 0.8 / 0.5
                } else {
                    0.0
                };
                Vector3::new(0.0, sense * pulse, 0.0)
            }
            Self::Hand => Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * 2.0,
        }
    }

    fn acceleration(self, t: f64) -> Vector3<f64> {
        match self {
            Self::PitchSteps => Vector3::new((9.0 * t).sin(), (7.0 * t).cos(), 0.0) * 0.3,
            Self::Hand => Vector3::new((2.1 * t).sin(), (3.3 * t).cos(), (1.7 * t).sin()) * 1.5,
        }
    }
}

/// Pitch error, deg RMS, and that of the offset, deg/s at the end, over a minute that starts in
/// motion.
fn errors<F: Filter<Real = f32>>(
    motion: Motion,
    offset_deg_s: f64,
    config: &Config<F::Gains>,
) -> (f64, f64, Quality) {
    let dt_s = 1.0 / RATE_HZ;
    let mut estimator = Estimator::<F>::new(config).expect("valid");
    let mut truth = UnitQuaternion::from_euler_angles(0.0, -0.4, 0.5);
    let offset = Vector3::new(0.5, 1.0, -0.5) * (offset_deg_s * DEG);
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..(60.0 * RATE_HZ) as u32 {
        let t = f64::from(k) * dt_s;
        let rate = motion.rate(t);
        truth *= UnitQuaternion::from_scaled_axis(rate * dt_s);
        let back = truth.inverse();
        let acc = back * (motion.acceleration(t) + Vector3::new(0.0, 0.0, -f64::from(GRAVITY)));
        let sample = Sample {
            gyr: (rate + offset).cast().into(),
            acc: acc.cast().into(),
            mag: (k % 7 == 0).then(|| (back * Vector3::new(17.1, 0.0, 47.0)).cast().into()),
        };
        let q = estimator.update(dt_s as f32, &sample).orientation;
        let pitch = f64::from(q.euler().pitch_rad);
        sum += ((pitch - truth.euler_angles().1) / DEG).powi(2);
        count += 1.0;
    }
    let bias: Vector3<f64> = Vector3::from(estimator.attitude().bias).cast();
    (f64::sqrt(sum / count), (bias - offset).norm() / DEG, estimator.quality())
}

/// With the offset found in motion, and as it was without.
fn finds_the_offset<F: Filter<Real = f32>>()
where
    F::Gains: Default,
{
    let moving = Config::<F::Gains>::default().without_lags();
    let waiting = Config {
        rest: RestConfig { motion_tilt_rad: f32::INFINITY, ..RestConfig::default() },
        ..Config::default().without_lags()
    };
    for (motion, offset_deg_s) in [
        (Motion::PitchSteps, 0.0),
        (Motion::PitchSteps, 1.0),
        (Motion::PitchSteps, 3.0),
        (Motion::Hand, 0.0),
        (Motion::Hand, 1.0),
        (Motion::Hand, 3.0),
    ] {
        let (pitch, left, quality) = errors::<F>(motion, offset_deg_s, &moving);
        let (before, _, unknown) = errors::<F>(motion, offset_deg_s, &waiting);
        println!(
            "{motion:?} {offset_deg_s} deg/s: {pitch:.2} deg, {before:.2} without; \
             offset off by {left:.2} deg/s"
        );
        let case = format!("{motion:?} {offset_deg_s} deg/s: {pitch} deg, {before} without");
        match motion {
            Motion::PitchSteps => {
                assert!(pitch < 2.0 && left < 0.5, "{case}");
                assert!(pitch < 0.2 + 0.3 * before, "{case}");
                assert!(quality.bias_rad_s < 0.9 * unknown.bias_rad_s);
            }
            // Its accelerations go with its turning, and look like an offset.
            Motion::Hand => assert!(pitch < 0.7 * before + 1.0, "{case}"),
        }
    }
}

#[test]
fn vqf_finds_the_offset_in_motion() {
    finds_the_offset::<Vqf>();
}

#[test]
fn mahony_finds_the_offset_in_motion() {
    finds_the_offset::<Mahony>();
}

#[test]
fn madgwick_finds_the_offset_in_motion() {
    finds_the_offset::<Madgwick>();
}

#[test]
fn the_complementary_filter_finds_the_offset_in_motion() {
    finds_the_offset::<Complementary>();
}
