use super::*;
use crate::fixed::Vqf;

/// Tilt of a level body that the estimate has, rad.
fn tilt<F: Filter>(estimator: &Estimator<F>) -> f32 {
    let down = estimator.orientation().quaternion().half_down();
    2.0 * (down[0] * down[0] + down[1] * down[1]).sqrt()
}

/// A turn of 1.5 deg/s for a third of a second, wherever it falls, is no first offset: it
/// counts for a part of it at most.
#[test]
fn the_first_offset_is_not_that_of_a_single_block() {
    for turning in (0..480).step_by(8) {
        let mut estimator =
            Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, 10_000).expect("in range");
        let mut samples = 0;
        while estimator.bias_q9() == [0; 3] {
            let is_turning = (turning..turning + 32).contains(&samples);
            let rate = if is_turning { 16 + 24 } else { 16 };
            estimator.update(
                10_000,
                &Counts {
                    gyr: [rate, 0, 0],
                    acc: [0, 0, -981],
                    mag: None,
                },
            );
            samples += 1;
            assert!(samples < 1_000, "the offset is learned");
        }
        let [bias, ..] = estimator.bias_q9();
        assert!(bias <= (16 + 12) << 9, "{turning}: {} counts", bias >> 9);
    }
}

/// For ten seconds of free flight the rates alone count, less the offset that was learned: a
/// thrust that shows another vertical and a field that turns leave the attitude where it is,
/// and a quarter of a turn about x is one. At rest again, it is levelled by gravity.
#[test]
fn a_body_in_free_flight_is_turned_by_its_rates_alone() {
    let config = Config::default().without_lags();
    let mut estimator = Estimator::<Vqf>::new(&config, &Scale::BNO055, 10_000).expect("in range");
    let rest = Counts {
        gyr: [16, -8, 24],
        acc: [0, 0, -981],
        mag: Some([300, 0, 700]),
    };
    for _ in 0..1_000 {
        estimator.update(10_000, &rest);
    }
    let bias = estimator.bias_q9();
    for _ in 0..1_000 {
        estimator.coast(10_000, &rest.gyr);
    }
    assert!(tilt(&estimator) < 2e-3, "{}", tilt(&estimator));
    assert_eq!(estimator.bias_q9(), bias);
    // 90 deg/s for a second, in steps of one and of four periods.
    let turning = [16 + 90 * 16, -8, 24];
    for _ in 0..60 {
        estimator.coast(10_000, &turning);
    }
    for _ in 0..10 {
        estimator.coast(40_000, &turning);
    }
    let angles = estimator.orientation().angles();
    let roll = crate::fixed::Angles::to_rad(angles.roll);
    let seconds = 0.6 + 10.0 * f64::from(estimator.settings.max_dt_us) * 1e-6;
    let expected = seconds * std::f64::consts::FRAC_PI_2;
    assert!(
        (f64::from(roll) - expected).abs() < 3e-3,
        "{roll} of {expected}"
    );
    for _ in 0..3_000 {
        estimator.update(10_000, &rest);
    }
    assert!(tilt(&estimator) < 5e-3, "{}", tilt(&estimator));
}

/// A body at rest whose gyroscope reads 3 deg/s about its level axes: until the offset is known
/// the estimate turns with it, afterwards it is level within a second and keeps the offset.
#[test]
fn levelling_undoes_what_an_unknown_offset_has_turned() {
    let mut estimator =
        Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, 6_667).expect("in range");
    let counts = Counts {
        gyr: [48, -48, 0],
        acc: [0, 0, -981],
        mag: Some([300, 0, 700]),
    };
    let mut samples = 0;
    while (estimator.bias_q9()[0] - (48 << 9)).abs() > 256 {
        estimator.update(6_667, &counts);
        samples += 1;
        assert!(samples < 750, "the offset is learned within 5 s");
    }
    assert!(tilt(&estimator) > 0.02, "{}", tilt(&estimator));
    estimator.level();
    for _ in 0..150 {
        estimator.update(6_667, &counts);
    }
    assert!(tilt(&estimator) < 0.001, "{}", tilt(&estimator));
    assert!((estimator.bias_q9()[0] - (48 << 9)).abs() <= 256);
}
