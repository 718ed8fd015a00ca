use super::*;
use crate::fixed::Vqf;

/// Estimated tilt of a level body, rad.
fn tilt<F: Filter>(estimator: &Estimator<F>, state: &State) -> f32 {
    let down = estimator.orientation(state).quaternion().half_down();
    2.0 * (down[0] * down[0] + down[1] * down[1]).sqrt()
}

/// A turn of 1.5 deg/s for a third of a second, at any time, makes at most a part of the first
/// offset.
#[test]
fn the_first_offset_is_not_that_of_a_single_block() {
    for turning in (0..480).step_by(8) {
        let estimator =
            Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, 10_000).expect("in range");
        let mut state = estimator.start();
        let mut samples = 0;
        while estimator.bias_q9(&state) == [0; 3] {
            let is_turning = (turning..turning + 32).contains(&samples);
            let rate = if is_turning { 16 + 24 } else { 16 };
            estimator.update(
                &mut state,
                10_000,
                &Counts { gyr: [rate, 0, 0], acc: [0, 0, -981], mag: None },
            );
            samples += 1;
            assert!(samples < 1_000, "the offset is learned");
        }
        let [bias, ..] = estimator.bias_q9(&state);
        assert!(bias <= (16 + 12) << 9, "{turning}: {} counts", bias >> 9);
    }
}

/// For ten seconds of free flight only the rates count, less the learned offset. A thrust with
/// another vertical and a turning field do not move the attitude, and a quarter of a turn about x
/// turns it by as much. At rest again, gravity levels the estimate.
#[test]
fn a_body_in_free_flight_is_turned_by_its_rates_alone() {
    let config = Config::default().without_lags();
    let estimator = Estimator::<Vqf>::new(&config, &Scale::BNO055, 10_000).expect("in range");
    let mut state = estimator.start();
    let rest = Counts { gyr: [16, -8, 24], acc: [0, 0, -981], mag: Some([300, 0, 700]) };
    for _ in 0..1_000 {
        estimator.update(&mut state, 10_000, &rest);
    }
    let bias = estimator.bias_q9(&state);
    for _ in 0..1_000 {
        estimator.coast(&mut state, 10_000, &rest.gyr);
    }
    assert!(tilt(&estimator, &state) < 2e-3, "{}", tilt(&estimator, &state));
    assert_eq!(estimator.bias_q9(&state), bias);
    // 90 deg/s for a second, in steps of one and of four periods.
    let turning = [16 + 90 * 16, -8, 24];
    for _ in 0..60 {
        estimator.coast(&mut state, 10_000, &turning);
    }
    for _ in 0..10 {
        estimator.coast(&mut state, 40_000, &turning);
    }
    let angles = estimator.orientation(&state).angles();
    let roll = crate::fixed::Angles::to_rad(angles.roll);
    let seconds = 0.6 + 10.0 * f64::from(estimator.max_dt_us) * 1e-6;
    let expected = seconds * std::f64::consts::FRAC_PI_2;
    assert!((f64::from(roll) - expected).abs() < 3e-3, "{roll} of {expected}");
    for _ in 0..3_000 {
        estimator.update(&mut state, 10_000, &rest);
    }
    assert!(tilt(&estimator, &state) < 5e-3, "{}", tilt(&estimator, &state));
}

/// A body at rest whose gyroscope reads 3 deg/s about its level axes. The estimate turns until the
/// offset is known. Then it is level within a second and keeps the offset.
#[test]
fn levelling_undoes_what_an_unknown_offset_has_turned() {
    let estimator =
        Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, 6_667).expect("in range");
    let mut state = estimator.start();
    let counts = Counts { gyr: [48, -48, 0], acc: [0, 0, -981], mag: Some([300, 0, 700]) };
    let mut samples = 0;
    while (estimator.bias_q9(&state)[0] - (48 << 9)).abs() > 256 {
        estimator.update(&mut state, 6_667, &counts);
        samples += 1;
        assert!(samples < 750, "the offset is learned within 5 s");
    }
    assert!(tilt(&estimator, &state) > 0.02, "{}", tilt(&estimator, &state));
    estimator.level(&mut state);
    for _ in 0..150 {
        estimator.update(&mut state, 6_667, &counts);
    }
    assert!(tilt(&estimator, &state) < 0.001, "{}", tilt(&estimator, &state));
    assert!((estimator.bias_q9(&state)[0] - (48 << 9)).abs() <= 256);
}

/// A body that accelerates to one side for 4 s, and then rests. Levelled then, it is soon certain
/// of its tilt: what pulled it before pulls no longer.
#[test]
fn levelling_ends_what_accelerations_pulled() {
    let estimator =
        Estimator::<Vqf>::new(&Config::default(), &Scale::BNO055, 10_000).expect("in range");
    let mut state = estimator.start();
    let go = |state: &mut State, seconds: u32, side: i16| {
        let counts = Counts { gyr: [0; 3], acc: [side, 0, -981], mag: None };
        for _ in 0..100 * seconds {
            estimator.update(state, 10_000, &counts);
        }
    };
    let is_certain = |state: &State| {
        estimator.tilt_is_within(state, (2.0_f32.to_radians().powi(2) * 2.0_f32.powi(28)) as i32)
    };
    go(&mut state, 10, 0);
    go(&mut state, 4, 300);
    assert!(!is_certain(&state), "pulled");
    estimator.level(&mut state);
    go(&mut state, 3, 0);
    assert!(is_certain(&state), "at rest");
}

/// Rest, turning, and a field in every third sample.
fn lively(k: i16) -> Counts {
    let turn = if k < 600 { 0 } else { 900 - (k * 7) % 1_800 };
    Counts {
        gyr: [16 + turn, -8, 24 - turn / 2],
        acc: [k % 90, -(k % 70), -981],
        mag: (k % 3 == 0).then_some([300 - k % 40, k % 50, 700]),
    }
}

/// An estimator that has learned offset and field, and is turning.
fn turning() -> (Estimator<Vqf>, State) {
    let estimator = Estimator::new(&Config::default(), &Scale::BNO055, 10_000).expect("in range");
    let mut state = estimator.start();
    for k in 0..1_000 {
        estimator.update(&mut state, 10_000, &lively(k));
    }
    (estimator, state)
}

#[test]
fn a_state_that_was_stored_goes_on_to_the_bit() {
    let (estimator, mut state) = turning();
    let mut restored = State::from_words(state.words());
    assert!(estimator.accepts(&restored));
    for k in 1_000..2_000 {
        estimator.update(&mut state, 10_000, &lively(k));
        estimator.update(&mut restored, 10_000, &lively(k));
    }
    assert_eq!(state, restored);
    assert!(estimator.flags(&state).initialised && estimator.bias_q9(&state) != [0; 3]);
}

/// Any bit of it: an overflow is a panic in tests.
#[test]
fn a_damaged_state_is_refused_or_overflows_nowhere() {
    let (estimator, sound) = turning();
    let mut refused = 0;
    for bit in 0..State::WORDS * 32 {
        let mut words = *sound.words();
        words[bit / 32] ^= 1 << (bit % 32);
        let mut state = State::from_words(&words);
        if !estimator.accepts(&state) {
            refused += 1;
            continue;
        }
        for k in 0..400 {
            estimator.update(&mut state, 10_000, &lively(400 + k));
        }
        estimator.quality(&state);
    }
    assert!(refused > State::WORDS * 8, "{refused}");
}

#[test]
fn after_a_reset_the_attitude_is_found_anew_with_the_offset_that_was_learned() {
    let (estimator, mut state) = turning();
    let bias = estimator.bias_q9(&state);
    estimator.reset(&mut state);
    assert!(!estimator.flags(&state).initialised);
    assert_eq!(estimator.bias_q9(&state), bias);
    for k in 0..300 {
        estimator.update(&mut state, 10_000, &lively(k));
    }
    assert!(estimator.flags(&state).initialised);
    assert!(tilt(&estimator, &state) < 0.06, "{}", tilt(&estimator, &state));
}
