//! What the suite is run over, and what it is fed with.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::filter::Real;
use tvc_fusion::{Attitude, Config, Estimator, Filter, GRAVITY, Quaternion, Sample, fixed};

pub(crate) const DEG: f64 = core::f64::consts::PI / 180.0;
pub(crate) const DT_US: u32 = 10_000;

/// Whatever turns samples into attitudes.
pub(crate) trait Subject: Clone {
    /// Degrees within which it agrees with the truth where the sensors are perfect: quantisation.
    const RESOLUTION_DEG: f64;
    /// It corrects heading and tilt after start-up.
    const CORRECTS: bool = true;

    fn start() -> Self;
    fn step(&mut self, dt_us: i64, sample: &Sample) -> Attitude;
}

impl<F: Filter + Clone> Subject for Estimator<F>
where
    F::Gains: Default,
{
    const RESOLUTION_DEG: f64 = 0.02;

    fn start() -> Self {
        // The suite's sensors are all of one instant.
        Estimator::new(&Config::default().without_lags()).expect("the configuration is valid")
    }

    fn step(&mut self, dt_us: i64, sample: &Sample) -> Attitude {
        let attitude = self.update(dt_us as f32 * 1e-6, sample);
        let q = attitude.orientation;
        Attitude {
            orientation: Quaternion {
                w: q.w.to_f32(),
                x: q.x.to_f32(),
                y: q.y.to_f32(),
                z: q.z.to_f32(),
            },
            rate: attitude.rate.map(Real::to_f32),
            bias: attitude.bias.map(Real::to_f32),
            flags: attitude.flags,
        }
    }
}

/// Counts of a BNO055: a sensor that cannot say "not a number" and ends at 16 bits.
pub(crate) fn counts(sample: &Sample) -> fixed::Counts {
    let scale = fixed::Scale::BNO055;
    let count = |v: Vector3<f32>, unit: f32| [v.x, v.y, v.z].map(|v| (v / unit).round() as i16);
    fixed::Counts {
        gyr: count(sample.gyr.into(), scale.gyr_rad_s),
        acc: count(sample.acc.into(), scale.acc_m_s2),
        mag: sample.mag.map(|mag| count(mag.into(), scale.mag_ut)),
    }
}

/// A filter in fixed point.
#[derive(Clone)]
pub(crate) struct Fixed<F> {
    estimator: fixed::Estimator<F>,
    state: fixed::State,
}

impl<F: fixed::Filter> Fixed<F> {
    pub(crate) fn new(config: &Config<F::Gains>, scale: &fixed::Scale) -> Self {
        let estimator = fixed::Estimator::new(config, scale, DT_US).expect("valid");
        let state = estimator.start();
        Self { estimator, state }
    }

    pub(crate) fn take(&mut self, dt_us: u32, counts: &fixed::Counts) -> Attitude {
        self.estimator.update(&mut self.state, dt_us, counts);
        self.estimator.attitude(&self.state, &counts.gyr)
    }
}

impl<F: fixed::Filter + Clone> Subject for Fixed<F>
where
    F::Gains: Default,
{
    // A count of the magnetometer is 0.2 deg of heading.
    const RESOLUTION_DEG: f64 = 0.4;

    fn start() -> Self {
        Self::new(&Config::default().without_lags(), &fixed::Scale::BNO055)
    }

    fn step(&mut self, dt_us: i64, sample: &Sample) -> Attitude {
        self.take(dt_us as u32, &counts(sample))
    }
}

/// Field of Copenhagen: 50 uT, dip 70 deg, in north, east, down.
pub(crate) fn field_ned() -> Vector3<f64> {
    Vector3::new(50.0 * (70.0 * DEG).cos(), 0.0, 50.0 * (70.0 * DEG).sin())
}

pub(crate) fn sample(truth: &UnitQuaternion<f64>, rate: Vector3<f64>, mag: bool) -> Sample {
    let back = truth.inverse();
    Sample {
        gyr: rate.cast().into(),
        acc: (back * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast().into(),
        mag: mag.then(|| (back * field_ned()).cast().into()),
    }
}

pub(crate) fn oracle(q: &Quaternion) -> UnitQuaternion<f64> {
    let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(f64::from);
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
}

pub(crate) fn error_deg(estimate: &Quaternion, truth: &UnitQuaternion<f64>) -> f64 {
    oracle(estimate).angle_to(truth) / DEG
}

pub(crate) fn norm(q: &Quaternion) -> f32 {
    (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z).sqrt()
}

/// Rest for `seconds` with an offset on the gyroscope, rad/s.
pub(crate) fn rest<S: Subject>(
    subject: &mut S,
    truth: &UnitQuaternion<f64>,
    bias: Vector3<f64>,
    mag: bool,
    seconds: f64,
) -> Attitude {
    let sample = sample(truth, bias, mag);
    (0..(seconds * 100.0) as u32)
        .map(|_| subject.step(i64::from(DT_US), &sample))
        .last()
        .expect("some samples")
}

/// The vector and another.
pub(crate) fn added(v: [f32; 3], other: &Vector3<f64>) -> [f32; 3] {
    (Vector3::from(v) + other.cast::<f32>()).into()
}

/// A lively motion: mean rates over the step, and the attitude at its end.
pub(crate) fn motion(
    start: UnitQuaternion<f64>,
    steps: u32,
) -> impl Iterator<Item = (Vector3<f64>, UnitQuaternion<f64>)> {
    let mut truth = start;
    (0..steps).map(move |k| {
        let t = f64::from(k) * 0.01;
        let rate =
            Vector3::new(2.0 * (1.3 * t).sin(), 1.5 * (0.7 * t).cos(), 3.0 * (0.9 * t).sin());
        truth *= UnitQuaternion::from_scaled_axis(rate * 0.01);
        (rate, truth)
    })
}
