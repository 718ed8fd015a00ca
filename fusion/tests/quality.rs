//! What an estimator says of how far it may be off.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{BiasState, Config, Estimator, GRAVITY, Quality, Sample, Vqf, fixed};

const DEG: f64 = core::f64::consts::PI / 180.0;
const DT_S: f64 = 0.01;

/// A body with an offset of its gyroscope in a field of 50 uT.
struct Body {
    attitude: UnitQuaternion<f64>,
    offset: Vector3<f64>,
    dip: f64,
    estimator: Estimator<Vqf>,
    /// The same in fixed point, which is to say the same.
    fixed: fixed::Estimator<fixed::Vqf>,
    state: fixed::State,
    time_s: f64,
    /// Largest error of the tilt, in standard deviations, in float and in fixed point.
    most_sigmas: [f64; 2],
}

impl Body {
    fn new(offset_deg_s: f64, dip_deg: f64) -> Self {
        let config = Config::default().without_lags();
        let fixed = fixed::Estimator::new(&config, &fixed::Scale::BNO055, 10_000).expect("valid");
        Self {
            attitude: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3),
            offset: Vector3::new(1.0, -1.0, 1.0) * (offset_deg_s * DEG),
            dip: dip_deg * DEG,
            estimator: Estimator::new(&config).expect("valid"),
            state: fixed.start(),
            fixed,
            time_s: 0.0,
            most_sigmas: [0.0; 2],
        }
    }

    /// The same, which only a rest shows its offset.
    fn waiting(offset_deg_s: f64, dip_deg: f64) -> Self {
        let mut config = Config::default().without_lags();
        config.rest.motion_tilt_rad = f32::INFINITY;
        Self {
            estimator: Estimator::new(&config).expect("valid"),
            ..Self::new(offset_deg_s, dip_deg)
        }
    }

    fn run(&mut self, seconds: f64, speed: f64, magnet: Option<f64>) -> Quality {
        self.move_on(seconds, speed, magnet, |_| Vector3::zeros());
        self.estimator.quality()
    }

    /// With an acceleration of this time, m/s^2, earth frame.
    fn move_on(
        &mut self,
        seconds: f64,
        speed: f64,
        magnet: Option<f64>,
        acceleration: impl Fn(f64) -> Vector3<f64>,
    ) {
        let gravity = Vector3::new(0.0, 0.0, f64::from(GRAVITY));
        for _ in 0..(seconds / DT_S) as u32 {
            let t = self.time_s;
            self.time_s += DT_S;
            let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin()) * speed;
            self.attitude *= UnitQuaternion::from_scaled_axis(rate * DT_S);
            let back = self.attitude.inverse();
            let field = Vector3::new(self.dip.cos(), 0.0, self.dip.sin()) * 50.0;
            let sample = Sample {
                gyr: (rate + self.offset).cast().into(),
                acc: (back * (acceleration(t) - gravity)).cast().into(),
                mag: magnet.map(|by| (back * field * (1.0 + by * (1.5 + t.sin()))).cast().into()),
            };
            self.estimator.update(DT_S as f32, &sample);
            self.fixed.update(&mut self.state, 10_000, &counts(&sample));
            let fixed = self.fixed.orientation(&self.state).quaternion().up();
            let sigmas = [
                self.error() / f64::from(self.estimator.quality().tilt_rad),
                self.error_of(fixed) / f64::from(self.fixed.quality(&self.state).tilt_rad),
            ];
            for (most, sigmas) in self.most_sigmas.iter_mut().zip(sigmas) {
                *most = most.max(sigmas);
            }
        }
    }

    /// What fixed point says is what float says.
    fn compare(&self) {
        let (float, fixed) = (self.estimator.quality(), self.fixed.quality(&self.state));
        let both = format!("{float:?}, in fixed point {fixed:?}");
        for (float, fixed) in [
            (float.tilt_rad, fixed.tilt_rad),
            (float.heading_rad, fixed.heading_rad),
            (float.bias_rad_s, fixed.bias_rad_s),
        ] {
            assert!((0.7..1.4).contains(&(fixed / float)), "{both}");
        }
        assert_eq!(float.bias, fixed.bias, "{both}");
        assert_eq!(float.heading_is_observable, fixed.heading_is_observable, "{both}");
        match (float.field_age_s, fixed.field_age_s) {
            (Some(float), Some(fixed)) => assert!((float - fixed).abs() < 1.0, "{both}"),
            (float, fixed) => assert_eq!(float, fixed, "{both}"),
        }
    }

    fn still(&mut self, seconds: f64) -> Quality {
        self.run(seconds, 0.0, Some(0.0))
    }

    /// Tilt, rad.
    fn error(&self) -> f64 {
        self.error_of(self.estimator.attitude().orientation.up())
    }

    fn error_of(&self, up: [f32; 3]) -> f64 {
        let up: Vector3<f64> = Vector3::from(up).cast();
        up.angle(&(self.attitude.inverse() * Vector3::new(0.0, 0.0, -1.0)))
    }
}

/// The counts of a BNO055.
fn counts(sample: &Sample) -> fixed::Counts {
    let scale = fixed::Scale::BNO055;
    let count = |v: Vector3<f32>, unit: f32| [v.x, v.y, v.z].map(|v| (v / unit).round() as i16);
    fixed::Counts {
        gyr: count(sample.gyr.into(), scale.gyr_rad_s),
        acc: count(sample.acc.into(), scale.acc_m_s2),
        mag: sample.mag.map(|mag| count(mag.into(), scale.mag_ut)),
    }
}

#[test]
fn fixed_point_says_what_float_says() {
    for (offset_deg_s, dip_deg) in [(0.0, 70.0), (3.0, 60.0), (0.0, 88.0), (6.0, 70.0)] {
        let mut body = Body::waiting(offset_deg_s, dip_deg);
        if offset_deg_s == 0.0 {
            body.run(20.0, 1.0, Some(0.0));
            body.compare();
        }
        for (seconds, speed, magnet) in [
            (20.0, 0.0, Some(0.0)),
            (20.0, 5.0, Some(0.0)),
            (20.0, 1.0, Some(2.0)),
            (20.0, 1.0, None),
            (20.0, 0.0, None),
            (20.0, 0.5, Some(0.0)),
        ] {
            body.run(seconds, speed, magnet);
            body.compare();
        }
    }
}

/// A lasting acceleration, and the circle of a vehicle, drag the estimate away without a rotation
/// that would tell.
#[test]
fn a_lasting_acceleration_shows() {
    let circles = [(0.1, 3.0), (0.5, 3.0), (0.2, 15.0)];
    let lines = [0.5, 1.0, 2.0, 3.0];
    let lines = lines.map(|m_s2| (m_s2, 0.0, 10.0));
    for (m_s2, turn, seconds) in lines.into_iter().chain(circles.map(|(w, v)| (w * v, w, 60.0))) {
        let mut body = Body::new(0.0, 60.0);
        body.still(20.0);
        body.most_sigmas = [0.0; 2];
        let away = |t: f64| Vector3::new((turn * t).cos(), (turn * t).sin(), 0.0) * m_s2;
        body.move_on(seconds, 0.0, Some(0.0), away);
        let fixed = body.fixed.quality(&body.state).tilt_rad;
        let ratio = fixed / body.estimator.quality().tilt_rad;
        assert!((0.7..1.4).contains(&ratio), "{m_s2} m/s^2, {turn} rad/s: {ratio}");
        let (error, sigmas) = (body.error() / DEG, body.most_sigmas);
        println!("{m_s2} m/s^2, {turn} rad/s: {error:.1} deg, {sigmas:.2?} deviations");
        assert!(
            sigmas.iter().all(|sigmas| (1.0..3.0).contains(sigmas)),
            "{m_s2} m/s^2, {turn} rad/s: {error} deg, {sigmas:?}"
        );
    }
}

/// The case in which all flags are well and the pitch is not.
#[test]
fn an_offset_that_is_not_known_shows() {
    let mut body = Body::waiting(3.0, 70.0);
    let moving = body.run(60.0, 1.0, Some(0.0));
    assert_eq!(moving.bias, BiasState::Unknown);
    assert!(moving.bias_rad_s > 0.015, "{moving:?}");
    let sigmas = body.error() / f64::from(moving.tilt_rad);
    assert!((0.2..3.0).contains(&sigmas), "{} of {moving:?}", body.error());
    let rested = body.still(30.0);
    assert_eq!(rested.bias, BiasState::Known);
    assert!(rested.bias_rad_s < 1e-3, "{rested:?}");
    assert!(rested.tilt_rad < 0.3 * moving.tilt_rad);
    assert!(rested.heading_rad < moving.heading_rad);
    let bias: Vector3<f64> = Vector3::from(body.estimator.attitude().bias).cast();
    assert!((bias - body.offset).norm() < 3.0 * f64::from(rested.bias_rad_s));
}

#[test]
fn an_offset_that_motion_shows_is_better_known() {
    let mut body = Body::new(3.0, 70.0);
    let moving = body.run(60.0, 1.0, Some(0.0));
    assert_eq!(moving.bias, BiasState::Unknown);
    let bias: Vector3<f64> = Vector3::from(body.estimator.attitude().bias).cast();
    let off = (bias - body.offset).norm();
    assert!(off < 4.0 * f64::from(moving.bias_rad_s), "{off} of {moving:?}");
    assert!(moving.bias_rad_s < 0.005, "{moving:?}");
    assert!(body.error() < 3.0 * f64::from(moving.tilt_rad), "{moving:?}");
}

/// Nothing is said to be known of an offset of 6 deg/s, which counts as a turn.
#[test]
fn an_offset_that_is_refused_is_said_to_be() {
    let mut body = Body::new(6.0, 70.0);
    assert_eq!(body.still(1.0).bias, BiasState::Unknown);
    let refused = body.still(9.0);
    assert_eq!(refused.bias, BiasState::Refused);
    assert!(refused.bias_rad_s > 0.002, "{refused:?}");
    assert_eq!(body.run(3.0, 1.0, Some(0.0)).bias, BiasState::Unknown);
}

#[test]
fn a_heading_is_observable_where_a_field_shows_it() {
    let observable = |mut body: Body, magnet| body.run(30.0, 0.5, magnet).heading_is_observable;
    assert!(observable(Body::new(0.0, 70.0), Some(0.0)));
    assert!(!observable(Body::new(0.0, 70.0), None));
    assert!(!observable(Body::new(0.0, 88.0), Some(0.0)));
    let mut body = Body::new(0.0, 70.0);
    assert!(body.still(10.0).heading_is_observable);
    // A magnet that comes and goes.
    assert!(!body.run(10.0, 1.0, Some(2.0)).heading_is_observable);
}

#[test]
fn faster_turning_is_less_certain() {
    let of = |speed| {
        let mut body = Body::new(0.0, 70.0);
        body.still(20.0);
        body.run(30.0, speed, Some(0.0)).tilt_rad
    };
    let (slow, fast) = (of(0.5), of(6.0));
    assert!(fast > 2.0 * slow, "{slow} {fast}");
}

#[test]
fn a_heading_that_nothing_shows_grows_uncertain_and_the_tilt_does_not() {
    let mut body = Body::new(0.0, 70.0);
    body.still(20.0);
    let before = body.run(30.0, 1.0, Some(0.0));
    assert!(before.field_age_s.expect("there is one") < 0.5);
    // A magnet that comes and goes.
    let after = body.run(50.0, 1.0, Some(2.0));
    let age_s = after.field_age_s.expect("there was one");
    assert!((49.0..51.0).contains(&age_s), "{age_s}");
    assert!(after.heading_rad > 1.5 * before.heading_rad, "{before:?} {after:?}");
    assert!((after.tilt_rad - before.tilt_rad).abs() < 0.2 * before.tilt_rad);
}

#[test]
fn a_steep_field_shows_little_of_the_heading() {
    let of = |dip| Body::new(0.0, dip).still(30.0).heading_rad;
    // By the ratio of the horizontal parts: 0.5 to 0.035.
    assert!(of(88.0) > 8.0 * of(60.0), "{} {}", of(60.0), of(88.0));
}

#[test]
fn a_gap_makes_everything_uncertain_but_the_offset() {
    let mut body = Body::new(1.0, 70.0);
    let before = body.still(30.0);
    let still = Sample {
        gyr: body.offset.cast().into(),
        acc: (body.attitude.inverse() * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast().into(),
        mag: None,
    };
    body.estimator.update(5.0, &still);
    let after = body.estimator.quality();
    assert!(after.tilt_rad > 10.0 * before.tilt_rad, "{before:?} {after:?}");
    assert!(after.heading_rad > 5.0 * before.heading_rad);
    assert!(after.bias_rad_s < 1e-3);
    let settled = body.still(20.0);
    assert!(settled.tilt_rad < 1.5 * before.tilt_rad, "{settled:?}");
}

#[test]
fn an_estimator_that_has_not_begun_knows_nothing() {
    let estimator = Estimator::<Vqf>::new(&Config::default()).expect("valid");
    let quality = estimator.quality();
    assert_eq!(quality.field_age_s, None);
    assert!(quality.tilt_rad > 0.1 && quality.bias_rad_s > 0.015);
}
