//! What an estimator knows, kept, set and given back; and accelerations.

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{
    Attitude, Config, ConfigError, Estimator, Filter, GRAVITY, Mahony, MahonyGains, Quaternion,
    Sample, State, Vqf, VqfGains,
};

const DT_S: f32 = 0.01;

fn field() -> Vector3<f64> {
    Vector3::new(17.1, 0.0, 47.0)
}

/// Perfect sensors but for an offset of the gyroscope.
fn sample(truth: &UnitQuaternion<f64>, rate: Vector3<f64>, offset: Vector3<f64>) -> Sample {
    let back = truth.inverse();
    Sample {
        gyr: (rate + offset).cast().into(),
        acc: (back * Vector3::new(0.0, 0.0, -f64::from(GRAVITY))).cast().into(),
        mag: Some((back * field()).cast().into()),
    }
}

fn started<F: Filter>() -> Estimator<F>
where
    F::Gains: Default,
{
    Estimator::new(&Config::default().without_lags()).expect("valid")
}

fn error_deg(attitude: &Attitude<f64>, truth: &UnitQuaternion<f64>) -> f64 {
    let q = attitude.orientation;
    let estimate = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
    let error_deg = estimate.angle_to(truth).to_degrees();
    // The largest of several errors would leave out what is no number.
    assert!(error_deg.is_finite(), "{q:?}");
    error_deg
}

/// Turns without rest for a minute, sampled; the largest error, deg.
fn turn(
    estimator: &mut Estimator<Vqf<f64>>,
    truth: &mut UnitQuaternion<f64>,
    offset: Vector3<f64>,
) -> f64 {
    let mut most = 0.0f64;
    for k in 0..6_000 {
        let t = f64::from(k) * f64::from(DT_S);
        let rate = Vector3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.9 * t).sin());
        *truth *= UnitQuaternion::from_scaled_axis(rate * f64::from(DT_S));
        let attitude = estimator.update(DT_S, &sample(truth, rate, offset));
        most = most.max(error_deg(&attitude, truth));
    }
    most
}

/// A restart in flight goes on where it was, and one that knows nothing does not.
#[test]
fn a_restored_estimator_goes_on_as_if_nothing_had_happened() {
    let offset = Vector3::new(0.02, -0.03, 0.04);
    let mut truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let mut first = started::<Vqf<f64>>();
    assert_eq!((first.state().orientation, first.state().bias), (None, None));
    for _ in 0..6_000 {
        first.update(DT_S, &sample(&truth, Vector3::zeros(), offset));
    }
    let error = turn(&mut first, &mut truth, offset);
    assert!(error < 0.2, "{error}");

    let state = first.state();
    assert!((Vector3::from(state.bias.expect("learned")) - offset).norm() < 1e-5);
    let reference = state.field.expect("averaged");
    assert!((reference.horizontal - 17.1).abs() < 0.05 && (reference.down - 47.0).abs() < 0.05);
    let (mut restored, mut blank) = (started::<Vqf<f64>>(), started::<Vqf<f64>>());
    restored.restore(&state).expect("a state that was taken");
    assert!(restored.attitude().flags.initialised);
    assert!(turn(&mut restored, &mut truth.clone(), offset) < 0.2);
    assert!(turn(&mut blank, &mut truth, offset) > 3.0);
}

#[test]
fn a_time_that_has_passed_is_a_gap() {
    let truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let mut first = started::<Vqf<f64>>();
    for _ in 0..1_500 {
        first.update(DT_S, &sample(&truth, Vector3::zeros(), Vector3::zeros()));
    }
    let mut restored = started::<Vqf<f64>>();
    restored.restore(&first.state()).expect("valid");
    let turned = UnitQuaternion::from_euler_angles(0.2, 0.1, 0.4) * truth;
    let still = sample(&turned, Vector3::zeros(), Vector3::zeros());
    assert!(restored.update(5.0, &still).flags.gap);
    for _ in 0..2_000 {
        restored.update(DT_S, &still);
    }
    let error = error_deg(&restored.attitude(), &turned);
    assert!(error < 1.0, "{error} deg twenty seconds after the gap");
}

#[test]
fn impossible_states_are_refused_by_name_and_change_nothing() {
    let mut estimator = started::<Vqf<f64>>();
    let nothing = State { orientation: None, bias: None, field: None, mag_lag_s: None };
    let zero = Quaternion { w: 0.0, ..Quaternion::IDENTITY };
    let bad = [
        (
            "state.orientation",
            State { orientation: Some(zero), bias: Some([0.1, 0.0, 0.0]), ..nothing },
        ),
        ("state.bias", State { bias: Some([f64::NAN, 0.0, 0.0]), ..nothing }),
        (
            "state.field",
            State {
                field: Some(tvc_fusion::FieldReference { horizontal: 0.0, down: 40.0 }),
                ..nothing
            },
        ),
        ("state.mag_lag_s", State { mag_lag_s: Some(1.0), ..nothing }),
    ];
    for (name, state) in bad {
        assert_eq!(estimator.restore(&state), Err(ConfigError::OutOfRange(name)));
    }
    assert_eq!(estimator.attitude().bias, [0.0; 3]);
    assert_eq!(estimator.restore(&nothing), Ok(()));
}

#[test]
fn a_heading_is_set_without_a_tilt() {
    let mut truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let mut estimator = started::<Mahony<f64>>();
    let blind = |truth| Sample { mag: None, ..sample(truth, Vector3::zeros(), Vector3::zeros()) };
    for _ in 0..300 {
        estimator.update(DT_S, &blind(&truth));
    }
    estimator.set_heading(1.0);
    assert!(error_deg(&estimator.attitude(), &truth) < 1e-3);
    // From any heading, over the south as well.
    truth = UnitQuaternion::from_euler_angles(0.4, -0.6, -3.0);
    estimator.set_heading(-3.0);
    assert!(error_deg(&estimator.attitude(), &truth) < 1e-3);
}

#[test]
fn a_reset_forgets_the_attitude_and_keeps_the_offset() {
    let offset = Vector3::new(0.02, -0.03, 0.04);
    let truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let mut estimator = started::<Vqf<f64>>();
    for _ in 0..1_000 {
        estimator.update(DT_S, &sample(&truth, Vector3::zeros(), offset));
    }
    estimator.reset();
    let blank = estimator.attitude();
    assert!(!blank.flags.initialised && blank.orientation == Quaternion::IDENTITY);
    assert!((Vector3::from(blank.bias) - offset).norm() < 1e-5);
    let turned = UnitQuaternion::from_euler_angles(-1.0, 0.5, -2.0);
    let first = estimator.update(DT_S, &sample(&turned, Vector3::zeros(), offset));
    let error = error_deg(&first, &turned);
    assert!(error < 0.01, "{error} deg with the first sample");
}

#[test]
fn gains_change_while_running_and_impossible_ones_do_not() {
    let truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
    let off = UnitQuaternion::from_euler_angles(0.0, 0.1, 0.0) * truth;
    let still = |truth| sample(truth, Vector3::zeros(), Vector3::zeros());
    let mut slow = started::<Mahony<f64>>();
    for _ in 0..1_500 {
        slow.update(DT_S, &still(&truth));
    }
    let mut fast = slow.clone();
    let gains = MahonyGains { acc_per_s: 2.0, ..MahonyGains::default() };
    fast.set_gains(&gains).expect("valid");
    let error = fast.set_gains(&MahonyGains { acc_per_s: f32::NAN, ..gains });
    assert_eq!(error, Err(ConfigError::OutOfRange("acc_per_s")));
    for _ in 0..100 {
        fast.update(DT_S, &still(&off));
        slow.update(DT_S, &still(&off));
    }
    // Of 0.1 rad a second at 2/s leaves exp(-2), one at 0.2/s exp(-0.2).
    let left = |estimator: &Estimator<Mahony<f64>>| {
        let up = estimator.attitude().orientation.up();
        let true_up = off.inverse() * Vector3::new(0.0, 0.0, -1.0);
        Vector3::from(up).angle(&true_up)
    };
    assert!((left(&fast) - 0.1 * (-2.0f64).exp()).abs() < 2e-3, "{}", left(&fast));
    assert!((left(&slow) - 0.1 * (-0.2f64).exp()).abs() < 2e-3, "{}", left(&slow));
    // What VQF has smoothed stays.
    let mut vqf = started::<Vqf<f64>>();
    assert!(vqf.set_gains(&VqfGains::published()).is_ok());
}

#[test]
fn accelerations_are_told_apart_from_gravity() {
    let truth = UnitQuaternion::from_euler_angles(0.4, -0.6, 1.0);
    let q = truth.quaternion();
    let attitude = Attitude {
        orientation: Quaternion { w: q.w, x: q.i, y: q.j, z: q.k },
        ..started::<Vqf<f64>>().attitude()
    };
    let down = truth.inverse() * Vector3::new(0.0, 0.0, f64::from(GRAVITY));
    assert!((Vector3::from(attitude.gravity()) - down).norm() < 1e-9);
    // 2 m/s^2 to the north and 3 up: specific force is acceleration less gravity.
    let earth = Vector3::new(2.0, 0.0, -3.0);
    let acc = (truth.inverse() * earth - down).cast::<f32>();
    assert!(
        (Vector3::from(attitude.linear_acceleration(&acc.into())) - truth.inverse() * earth).norm()
            < 1e-5
    );
    assert!((Vector3::from(attitude.earth_acceleration(&acc.into())) - earth).norm() < 1e-5);
}
