//! The switching surface against a plant, by hand, and under any input.

use super::*;
use crate::State;
use crate::{Controller, Q16};
use proptest::prelude::*;
use std::vec::Vec;

const PERIOD: f64 = 1.0 / 150.0;
const SAMPLES: u32 = 450;
/// A pulse in three samples, as at 50 Hz.
const SAMPLES_A_PULSE: u32 = 3;

/// Pitch of the drone through its servo: gain 31.6, 5.5 rad/s.
fn config() -> SurfaceConfig {
    SurfaceConfig {
        period_s: PERIOD as f32,
        plant_gain: 31.6,
        effect_s: 8.0e-3,
        sensor_lag_s: 0.0,
        actuator_rate: 5.5,
        actuator_loop_s: 0.03,
        actuator_lag_s: 0.01,
        actuator_play: 0.0,
        ahead_s: 0.025,
        gain_s: 0.45,
        lead_limit: 0.3,
        near_per_s: 15.0,
        curve: 0.8,
        rate_share: 0.9,
        value_share: 0.9,
        trim_rad_s: 3.0,
        trim_limit: 0.3,
        limit: 1.0,
    }
}

/// Gain of the plant that is flown.
const GAIN: f64 = 31.6;

/// Flies `value'' = GAIN (actuator + push)` from `start` for three seconds: the values, sample by
/// sample. The servo takes a new target 8 ms after every third sample.
fn fly<T: Scalar>(config: &SurfaceConfig, start: f64, push: f64) -> Vec<f64> {
    fly_upset::<T>(config, (start, push, GAIN), &mut |_, _| {})
}

/// The same with a plant of any gain, where `upset` sees and may change the law's state before each
/// sample.
fn fly_upset<T: Scalar>(
    config: &SurfaceConfig,
    (start, push, gain): (f64, f64, f64),
    upset: &mut dyn FnMut(u32, &mut SurfaceState<T>),
) -> Vec<f64> {
    const FINE: i32 = 100;
    let dt = PERIOD / f64::from(FINE);
    let law = Surface::<T>::new(config).unwrap();
    let mut state = SurfaceState::default();
    let (mut value, mut rate, mut actuator, mut speed) = (start, 0.0_f64, 0.0_f64, 0.0_f64);
    let (mut target, mut sent, mut wait) = (0.0_f64, 0.0, i32::MAX);
    (0..SAMPLES)
        .map(|sample| {
            let is_sent = sample.is_multiple_of(SAMPLES_A_PULSE);
            let reading = Reading {
                value: (value as f32).into(),
                rate: (rate as f32).into(),
                age: Some(T::ZERO),
                value_lead: T::ZERO,
            };
            upset(sample, &mut state);
            let output: f32 = law.update(&mut state, T::ZERO, &reading, is_sent).into();
            if is_sent {
                (sent, wait) = (f64::from(output), (8.0e-3 / dt) as i32);
            }
            for _ in 0..FINE {
                wait = wait.saturating_sub(1);
                if wait == 0 {
                    target = sent;
                }
                let asked = ((target - actuator) / 0.03).clamp(-5.5, 5.5);
                speed += dt / 0.01 * (asked - speed);
                actuator += dt * speed;
                rate += dt * gain * (actuator + push);
                value += dt * rate;
            }
            value
        })
        .collect()
}

/// Settling to 5 % (s), and overshoot as a share of the start.
fn figures(path: &[f64], start: f64) -> (f64, f64) {
    let share: Vec<f64> = path.iter().map(|value| value / start).collect();
    let last = share.iter().rposition(|share| share.abs() > 0.05);
    let over = share.iter().fold(0.0_f64, |low, share| low.max(-share));
    (last.map_or(0.0, |last| (last + 1) as f64 * PERIOD), over)
}

/// The time-optimal limits are 0.29, 0.36 and 0.45 s.
#[test]
fn arrives_in_little_more_than_the_shortest_time_there_is() {
    for (start, most_s) in [(0.2, 0.38), (0.4, 0.45), (0.8, 0.58), (-0.4, 0.45)] {
        let (settled_s, over) = figures(&fly::<f32>(&config(), start, 0.0), start);
        assert!(settled_s < most_s && over < 0.04, "{start}: {settled_s} {over}");
    }
}

/// With these gains the value swings about the setpoint for ever, because the servo takes a target
/// only now and then.
#[test]
fn holds_against_a_steady_push() {
    let path = fly::<f32>(&config(), 0.2, 0.08);
    let last = &path[300..];
    let mean = last.iter().sum::<f64>() / last.len() as f64;
    let most = last.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    assert!(mean.abs() < 1e-3 && most < 7e-3, "{mean} {most}");
}

/// A number of the state becomes as large as can be: a flipped bit of what it follows from.
#[test]
fn a_number_that_is_wrong_is_forgotten() {
    for number in 0..SurfaceState::<Q16>::NUMBERS {
        let path = fly_upset::<Q16>(&config(), (0.2, 0.0, GAIN), &mut |sample, state| {
            if sample == 200 {
                let mut numbers = Vec::new();
                state.tell(&mut |each| numbers.push(each));
                numbers[number] = 8_191.0.into();
                let mut next = numbers.into_iter();
                *state = State::told(&mut || next.next().unwrap());
            }
        });
        let most = path[200..].iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let last = path.last().unwrap().abs();
        assert!(most < 0.15 && last < 0.01, "number {number}: up to {most}, in the end {last}");
    }
}

/// The largest value in the last second, and the estimates of the gain: the largest and the last.
fn with_gain(gain: f64) -> (f64, f32, f32) {
    let (mut most, mut last) = (0.0_f32, 0.0_f32);
    let path = fly_upset::<Q16>(&config(), (0.4, 0.0, gain), &mut |_, state| {
        last = state.plant_gain().into();
        most = most.max(last);
    });
    (path[300..].iter().fold(0.0, |most: f64, value| most.max(value.abs())), most, last)
}

/// As configured it swings by 6 mrad. Twice as quick, it would swing by 0.8 rad without an
/// estimate.
#[test]
fn the_gain_of_a_quick_plant_is_found_and_it_hardly_swings() {
    for share in [1.2, 1.5, 1.8, 2.0] {
        let (swing, _, last) = with_gain(share * GAIN);
        assert!(swing < 0.014, "{share}: swings by {swing}");
        assert!((f64::from(last) / share - 1.0).abs() < 0.06, "{share}: {last}");
    }
}

#[test]
fn the_gain_of_a_plant_as_configured_or_slower_is_left_alone() {
    for share in [0.5, 0.8, 1.0] {
        let (_, most, last) = with_gain(share * GAIN);
        assert!(most < 1.15 && last < 1.1, "{share}: {most}, {last}");
    }
}

#[test]
fn fixed_point_flies_as_float_does() {
    let (float, fixed) = (fly::<f32>(&config(), 0.4, 0.03), fly::<Q16>(&config(), 0.4, 0.03));
    for (a, b) in float.iter().zip(fixed) {
        assert!((a - b).abs() < 4e-3, "{a} {b}");
    }
}

/// By hand: an actuator that follows at once, at 0.5, with rate -1 and nothing ahead. It is back at
/// zero after 0.1 s, with 31.6 * 0.25 / 10 added to the rate and -0.1 + 31.6 * 0.125 / 75 to the
/// value.
#[test]
fn the_surface_is_where_the_actuator_is_back_at_zero() {
    let config = SurfaceConfig {
        effect_s: 0.0,
        ahead_s: 0.0,
        actuator_rate: 5.0,
        near_per_s: 1.0,
        curve: 100.0,
        lead_limit: 100.0,
        gain_s: 1.0,
        limit: 100.0,
        ..config()
    };
    let mut law = Controller::<f32, Surface<f32>>::new(&config).unwrap();
    law.law
        .correct(&mut law.state, &Reading { value: 0.3, rate: -1.0, age: None, value_lead: 0.0 });
    (law.state.actuator, law.state.position) = (0.5, 0.5);
    (law.state.sent, law.state.targets) = (0.5, [0.5; HISTORY]);
    let x = 0.3 - 0.1 + 31.6 * 0.125 / 75.0;
    let rate = -1.0 + 31.6 * 0.25 / 10.0;
    let expected = 0.5 - (rate + x);
    assert!((law.law.decide(&law.state, 0.0) - expected).abs() < 1e-5);
}

#[test]
fn six_lines_stand_for_the_curve() {
    let config = SurfaceConfig { near_per_s: 1e4, curve: 1.0, ..config() };
    let c = Coefficients::<f32>::new(&config).unwrap();
    let steepness = (31.6_f32 * 5.5).cbrt();
    for index in 2..100 {
        let x = 0.01 * index as f32;
        let exact = steepness * x.powf(2.0 / 3.0);
        let share = c.surface(x) / exact;
        assert!((0.9999..1.03).contains(&share), "{x}: {share}");
        assert_eq!(c.surface(-x), -c.surface(x));
    }
}

/// Near the setpoint the straight line counts, and beyond its intersection the tangents.
#[test]
fn the_least_of_line_and_curve_counts() {
    for near_per_s in [3.0, 8.0, 15.0, 40.0] {
        let config = SurfaceConfig { near_per_s, ..config() };
        let c = Coefficients::<f32>::new(&config).unwrap();
        for index in 0..200 {
            let x = 0.005 * index as f32;
            let tangents = c.tangents.iter();
            let curve = tangents.map(|tangent| tangent.at_zero + tangent.slope * x);
            let least = curve.fold(near_per_s * x, f32::min);
            assert!((c.surface(x) - least).abs() < 1e-5, "{near_per_s} {x}");
        }
    }
}

/// A target sent with sample k counts from 1.2 samples later on.
#[test]
fn a_target_takes_effect_between_two_samples() {
    let mut law = Controller::<f32, Surface<f32>>::new(&config()).unwrap();
    law.state.is_sent = true;
    for output in [1.0, 2.0, 3.0, 4.0] {
        law.state.output = output;
        law.law.advance(&mut law.state);
    }
    assert!((law.law.target(&law.state, 0) - (3.0 - 0.2)).abs() < 1e-5);
    assert!((law.law.target(&law.state, 1) - (4.0 - 0.2)).abs() < 1e-5);
    assert_eq!(law.law.target(&law.state, 2), 4.0);
}

/// The reading is a sample and a half old and equals the model's value then: nothing changes.
#[test]
fn an_old_reading_is_compared_with_the_past() {
    let mut law = Controller::<f32, Surface<f32>>::new(&config()).unwrap();
    law.state.is_known = true;
    law.state.rate = Track { now: 0.4, changes: [0.1; HISTORY] };
    law.law.correct(
        &mut law.state,
        &Reading { value: 0.0, rate: 0.25, age: Some(1.5), value_lead: 0.0 },
    );
    assert!((law.state.rate.now - 0.4).abs() < 1e-6);
    law.law.correct(
        &mut law.state,
        &Reading { value: 0.0, rate: 0.35, age: Some(1.5), value_lead: 0.0 },
    );
    assert!((law.state.rate.now - 0.49).abs() < 1e-6);
}

#[test]
fn what_it_remembers_makes_another_go_on_alike() {
    let mut law = Controller::<Q16, Surface<Q16>>::new(&config()).unwrap();
    let reading = |step: u8| Reading {
        value: Q16::from_bits(i32::from(step) * 700),
        rate: Q16::from_bits(i32::from(step) * 900),
        age: (!step.is_multiple_of(3)).then_some(Q16::from_bits(45_000)),
        value_lead: Q16::ZERO,
    };
    for step in 0..20 {
        law.read(Q16::ZERO, &reading(step), step.is_multiple_of(3));
    }
    let mut words = Vec::new();
    law.state.tell(&mut |word| words.push(word));
    assert_eq!(words.len(), SurfaceState::<Q16>::NUMBERS);
    let mut rest = words.into_iter();
    let mut other = Controller {
        law: law.law.clone(),
        state: SurfaceState::told(&mut || rest.next().unwrap()),
    };
    assert_eq!(other.state, law.state);
    for step in 20..60 {
        let reading = reading(step);
        assert_eq!(
            law.read(Q16::ZERO, &reading, step.is_multiple_of(3)),
            other.read(Q16::ZERO, &reading, step.is_multiple_of(3))
        );
    }
}

#[test]
fn other_gains_come_without_a_bump_and_impossible_ones_are_refused_by_name() {
    let mut law = Controller::<f32, Surface<f32>>::new(&config()).unwrap();
    let reading = Reading { value: 0.2, rate: 0.1, age: Some(0.6), value_lead: 0.0 };
    for _ in 0..10 {
        law.read(0.0, &reading, true);
    }
    let (actuator, rate) = (law.state.actuator, law.state.rate.now);
    let other = SurfaceConfig { gain_s: 0.4, ..config() };
    law.retune(&other).unwrap();
    assert_eq!((law.state.actuator, law.state.rate.now), (actuator, rate));
    for (config, name) in [
        (SurfaceConfig { rate_share: 1.5, ..config() }, "rate_share"),
        (SurfaceConfig { effect_s: 0.03, ..config() }, "effect_s"),
        (SurfaceConfig { actuator_rate: 0.0, ..config() }, "actuator_rate"),
        (SurfaceConfig { gain_s: f32::NAN, ..config() }, "gain_s"),
    ] {
        assert_eq!(law.retune(&config), Err(ConfigError::OutOfRange(name)));
    }
    law.reset(0.0);
    assert_eq!((law.state.actuator, law.state.disturbance()), (0.0, 0.0));
}

/// A held vehicle does not answer its rudder: the trim stays within its limit. After the release,
/// the flight differs from a fresh law's by the trim only.
#[test]
fn a_plant_that_is_held_does_not_wind_it_up() {
    let mut law = Controller::<f32, Surface<f32>>::new(&config()).unwrap();
    let held = Reading { value: 0.3, rate: 0.0, age: Some(0.0), value_lead: 0.0 };
    for sample in 0..600_u32 {
        law.read(0.0, &held, sample.is_multiple_of(3));
    }
    assert!((law.state.value.now - 0.3).abs() < 0.02, "{}", law.state.value.now);
    assert!(law.state.rate.now.abs() < 0.2, "{}", law.state.rate.now);
    assert!(law.state.disturbance().abs() <= 0.3);
    assert_eq!(law.state.plant_gain(), 1.0);
}

proptest! {
    #[test]
    fn the_output_is_a_number_within_its_limit_whatever_comes_in(
        samples in proptest::collection::vec(
            (proptest::num::f32::ANY, proptest::num::f32::ANY, proptest::num::f32::ANY, any::<bool>()),
            1..30,
        ),
    ) {
        let mut law = Controller::<f32, Surface<f32>>::new(&config()).unwrap();
        for (value, rate, age, is_sent) in samples {
            let reading = Reading { value, rate, age: Some(age), value_lead: age.half() };
            let output = law.read(0.0, &reading, is_sent);
            prop_assert!(output.abs() <= 1.0, "{output}");
        }
    }
}
