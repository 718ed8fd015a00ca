use super::*;
use crate::{Controller, Gains, Q16};
use proptest::prelude::*;
use std::vec::Vec;

const PERIOD: f32 = 0.01;

fn config(kp: f32, ki: f32, kd: f32) -> Config {
    Config { gains: Gains { kp, ki, kd }, limit: -1000.0..=1000.0, ..Config::new(PERIOD) }
}

fn pid(config: Config) -> Controller<f32, Pid<f32>> {
    Controller::new(&config).unwrap()
}

fn close(a: f32, b: f32) {
    assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} is not {b}");
}

#[test]
fn the_three_actions_by_hand() {
    let mut pid = pid(config(2.0, 10.0, 0.5));
    // P 2 (1 - 0.25) = 1.5, I 10 * 0.01 * 0.75 = 0.075, D -0.5 * 0.2 = -0.1.
    close(pid.update(1.0, 0.25, 0.2), 1.475);
    close(pid.state.integral(), 0.075);
    // The integral has grown by as much again.
    close(pid.update(1.0, 0.25, 0.0), 1.65);
    close(pid.state.output(), 1.65);
}

#[test]
fn zero_error_gives_zero_output() {
    let mut pid = pid(config(2.0, 1.0, 3.0));
    for _ in 0..10 {
        assert_eq!(pid.update(0.5, 0.5, 0.0), 0.0);
    }
}

#[test]
fn a_derivative_on_measurement_does_not_kick_with_the_setpoint_or_at_the_start() {
    let mut pid = pid(Config { derivative: Derivative::Measurement, ..config(0.0, 0.0, 0.5) });
    assert_eq!(pid.update(0.0, 3.0, 9.0), 0.0);
    assert_eq!(pid.update(7.0, 3.0, 9.0), 0.0);
    // 0.02 in 0.01 s: a rate of 2, against the motion.
    close(pid.update(7.0, 3.02, 9.0), -1.0);
}

#[test]
fn a_derivative_on_error_kicks_by_its_weight() {
    for weight in [0.0, 0.5, 1.0] {
        let mut pid =
            pid(Config { derivative: Derivative::Error { weight }, ..config(0.0, 0.0, 0.5) });
        pid.update(0.0, 0.0, 0.0);
        close(pid.update(1.0, 0.0, 0.0), 50.0 * weight);
    }
}

#[test]
fn the_derivative_filter_is_a_first_order_lag() {
    let mut pid = pid(Config { derivative_filter_s: 0.1, ..config(0.0, 0.0, 1.0) });
    let outputs: Vec<f32> = (0..100).map(|_| pid.update(0.0, 0.0, 1.0)).collect();
    for (index, output) in outputs.iter().enumerate() {
        let steps = index as i32 + 1;
        close(*output, (0.1_f32 / 0.11).powi(steps) - 1.0);
    }
}

#[test]
fn a_filtered_difference_has_the_gain_of_a_filtered_rate() {
    let mut by_rate = pid(Config { derivative_filter_s: 0.05, ..config(0.0, 0.0, 0.4) });
    let mut by_difference = pid(Config {
        derivative: Derivative::Measurement,
        derivative_filter_s: 0.05,
        ..config(0.0, 0.0, 0.4)
    });
    by_difference.update(0.0, 0.0, 0.0);
    let mut angle = 0.0;
    for index in 0..50_u8 {
        let rate = f32::from(index) * 0.1;
        angle += rate * PERIOD;
        let (a, b) = (by_rate.update(0.0, 0.0, rate), by_difference.update(0.0, angle, 0.0));
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn output_stays_in_its_limits_and_its_slew() {
    let mut pid = pid(Config { limit: -0.5..=1.0, slew_per_s: 20.0, ..config(10.0, 0.0, 0.0) });
    close(pid.update(1.0, 0.0, 0.0), 0.2);
    close(pid.update(1.0, 0.0, 0.0), 0.4);
    for _ in 0..10 {
        pid.update(1.0, 0.0, 0.0);
    }
    assert_eq!(pid.state.output(), 1.0);
    for _ in 0..20 {
        pid.update(-1.0, 0.0, 0.0);
    }
    assert_eq!(pid.state.output(), -0.5);
}

/// Pushes against the limit for 5 s, then wants the opposite. Gives the samples until the output
/// leaves the limit.
fn samples_to_turn_back(anti_windup: AntiWindup) -> usize {
    let mut pid = pid(Config { limit: -1.0..=1.0, anti_windup, ..config(1.0, 2.0, 0.0) });
    for _ in 0..500 {
        assert!(pid.update(5.0, 0.0, 0.0) <= 1.0);
    }
    (0..1000).position(|_| pid.update(-0.1, 0.0, 0.0) < 0.9).unwrap()
}

#[test]
fn no_windup_by_either_method() {
    // Without either the integral would stand at 50 and take 25,000 samples.
    assert!(samples_to_turn_back(AntiWindup::Conditional) < 30);
    assert!(samples_to_turn_back(AntiWindup::BackCalculation { time_s: 0.2 }) < 60);
}

#[test]
fn back_calculation_settles_where_growth_and_cut_balance() {
    let mut pid = pid(Config {
        limit: -1.0..=1.0,
        anti_windup: AntiWindup::BackCalculation { time_s: 0.2 },
        ..config(0.0, 2.0, 0.0)
    });
    for _ in 0..1000 {
        pid.update(5.0, 0.0, 0.0);
    }
    // ki e = (v - 1) / Tt: v = 1 + 0.2 * 10 = 3; the growth of the sample, 0.1, is part of v.
    assert!((pid.state.integral() - 2.9).abs() < 0.01, "{}", pid.state.integral());
}

#[test]
fn conditional_integration_still_integrates_back_from_the_limit() {
    let mut pid = pid(Config { limit: -1.0..=1.0, ..config(0.0, 1.0, 0.0) });
    for _ in 0..300 {
        pid.update(1.0, 0.0, 0.0);
    }
    close(pid.state.output(), 1.0);
    pid.update(-1.0, 0.0, 0.0);
    close(pid.state.output(), 0.99);
}

#[test]
fn gains_change_without_a_bump() {
    let mut pid = pid(config(1.0, 0.5, 0.2));
    for _ in 0..50 {
        pid.update(1.0, 0.3, -0.4);
    }
    let before = pid.state.output();
    let growth = 0.5 * PERIOD * 0.7;
    pid.retune(&config(5.0, 0.5, 0.9)).unwrap();
    close(pid.update(1.0, 0.3, -0.4), before + growth);
    // A change of ki alone changes only the growth.
    let before = pid.state.output();
    pid.retune(&config(5.0, 3.0, 0.9)).unwrap();
    close(pid.update(1.0, 0.3, -0.4), before + 6.0 * growth);
    // The filter and the weight too.
    let before = pid.state.output();
    let changed =
        Config { derivative_filter_s: 0.05, setpoint_weight: 0.2, ..config(5.0, 3.0, 0.9) };
    pid.retune(&changed).unwrap();
    close(pid.update(1.0, 0.3, -0.4), before + 6.0 * growth);
}

#[test]
fn a_refused_configuration_changes_nothing() {
    let mut pid = pid(config(1.0, 0.5, 0.2));
    let before = pid.update(1.0, 0.0, 0.0);
    assert!(pid.retune(&config(f32::NAN, 0.5, 0.2)).is_err());
    close(pid.update(1.0, 0.0, 0.0), before + 0.005);
}

#[test]
fn handed_over_control_continues_from_the_last_output() {
    let mut pid = pid(config(2.0, 1.0, 0.0));
    pid.law.begin(&mut pid.state, 0.7, 0.0, 0.4);
    close(pid.update(0.0, 0.4, 0.0), 0.7 - 1.0 * PERIOD * 0.4);
}

#[test]
fn a_setpoint_weight_takes_the_kick_and_the_integral_still_arrives() {
    let arrive = |weight: f32| {
        let mut pid = pid(Config { setpoint_weight: weight, ..config(2.0, 4.0, 0.0) });
        // A first-order plant, 0.5 s, gain 1.
        let (mut y, mut highest, mut first) = (0.0_f32, 0.0_f32, None);
        for _ in 0..2000 {
            let u = pid.update(1.0, y, 0.0);
            first.get_or_insert(u);
            y += (u - y) * PERIOD / 0.5;
            highest = highest.max(y);
        }
        assert!((y - 1.0).abs() < 1e-3);
        (first.unwrap(), highest)
    };
    let (kick, overshoot) = arrive(1.0);
    let (soft, gentle) = arrive(0.0);
    assert!(kick > 2.0 && soft < 0.05);
    assert!(gentle < overshoot && gentle < 1.01);
}

#[test]
fn every_parameter_is_checked_by_name() {
    let refused = |config: Config| Pid::<f32>::new(&config).err();
    let good = || config(1.0, 1.0, 1.0);
    for (bad, name) in [
        (Config { period_s: 0.0, ..good() }, "period_s"),
        (config(f32::INFINITY, 0.0, 0.0), "gains.kp"),
        (config(0.0, f32::NAN, 0.0), "gains.ki"),
        (config(0.0, 0.0, 1e9), "gains.kd"),
        (Config { derivative_filter_s: -1.0, ..good() }, "derivative_filter_s"),
        (Config { setpoint_weight: 1.5, ..good() }, "setpoint_weight"),
        (Config { derivative: Derivative::Error { weight: -0.1 }, ..good() }, "derivative.weight"),
        (Config { limit: 1.0..=-1.0, ..good() }, "limit"),
        (Config { slew_per_s: 0.0, ..good() }, "slew_per_s"),
        (
            Config { anti_windup: AntiWindup::BackCalculation { time_s: 0.0 }, ..good() },
            "anti_windup.time_s",
        ),
    ] {
        assert_eq!(refused(bad), Some(ConfigError::OutOfRange(name)));
    }
    assert_eq!(refused(good()), None);
}

fn any_config() -> impl Strategy<Value = Config> {
    let derivative = prop_oneof![
        Just(Derivative::Rate),
        Just(Derivative::Measurement),
        (0.0_f32..=1.0).prop_map(|weight| Derivative::Error { weight }),
    ];
    let anti_windup = prop_oneof![
        Just(AntiWindup::Conditional),
        (0.02_f32..5.0).prop_map(|time_s| AntiWindup::BackCalculation { time_s }),
    ];
    (
        (-5.0_f32..5.0, -5.0_f32..5.0, -0.5_f32..0.5),
        derivative,
        0.0_f32..0.2,
        0.0_f32..=1.0,
        (-2.0_f32..0.0, 0.0_f32..2.0),
        prop_oneof![Just(f32::INFINITY), 1.0_f32..100.0],
        anti_windup,
    )
        .prop_map(
            |(
                (kp, ki, kd),
                derivative,
                derivative_filter_s,
                setpoint_weight,
                limit,
                slew_per_s,
                anti_windup,
            )| {
                Config {
                    period_s: PERIOD,
                    gains: Gains { kp, ki, kd },
                    derivative,
                    derivative_filter_s,
                    setpoint_weight,
                    limit: limit.0..=limit.1,
                    slew_per_s,
                    anti_windup,
                }
            },
        )
}

proptest! {
    /// For any input, numbers or not, the output is in its limits and its slew.
    #[test]
    fn no_input_breaks_the_limits(
        config in any_config(),
        inputs in prop::collection::vec((prop::num::f32::ANY, prop::num::f32::ANY, prop::num::f32::ANY), 1..100),
    ) {
        let mut pid = pid(config.clone());
        let mut last = pid.state.output();
        for (setpoint, measured, rate) in inputs {
            let output = pid.update(setpoint, measured, rate);
            prop_assert!(config.limit.contains(&output));
            prop_assert!((output - last).abs() <= config.slew_per_s * PERIOD * 1.0001 + 1e-6);
            last = output;
        }
        // It recovers: without error and integral, the output returns.
        for _ in 0..10_000 {
            last = pid.update(0.0, 0.0, 0.0);
        }
        prop_assert!(last.is_finite());
    }

    /// The fixed point controller equals the float controller, within its resolution.
    #[test]
    fn fixed_point_follows_the_float(
        config in any_config(),
        inputs in prop::collection::vec((-1.0_f32..1.0, -1.0_f32..1.0, -5.0_f32..5.0), 1..60),
    ) {
        let (mut float, mut fixed) = (pid(config.clone()), Controller::<Q16, Pid<Q16>>::new(&config).unwrap());
        for (setpoint, measured, rate) in inputs {
            let a = float.update(setpoint, measured, rate);
            let b = fixed.update(setpoint.into(), measured.into(), rate.into());
            // For each sample in the filter, kd over 0.01 s magnifies the last bit of the inputs up
            // to 50 times.
            prop_assert!((a - f32::from(b)).abs() < 0.03, "{a} {}", f32::from(b));
        }
    }
}
