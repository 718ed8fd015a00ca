//! The disturbances on the bench, and what may be said of them.

use super::*;
use crate::bench::{BenchConfig, Environment, Wiring};
use samd21::board::{Board, Ticks};

const VIBRATION: Vibration =
    Vibration { acc_m_s2: 5.0, rate_dps: None, frequency_hz: 180.0, harmonics: 0, wander_pct: 0.0 };

fn environment(disturbances: Disturbances) -> Environment {
    Environment::new(&BenchConfig { disturbances, ..BenchConfig::default() }).unwrap()
}

/// Pulses of `width_us` for 200 ms from the release on.
fn steered(mut environment: Environment, width_us: u64) -> Environment {
    environment.release(0.0);
    for frame in 0..10 {
        let rise = Ticks::from_ms(20 * frame);
        environment.pin(rise, Wiring::NANO_33_IOT.servos[0], true);
        environment.pin(rise + Ticks::from_us(width_us), Wiring::NANO_33_IOT.servos[0], false);
    }
    environment.advance(Ticks::from_ms(200));
    environment
}

/// Crank angle, rad, `ms` after the power came on.
fn crank_at(environment: &Environment, ms: u64) -> f64 {
    let motion = &environment.truth.motion;
    let at = motion.partition_point(|m| m.time < Ticks::from_ms(ms));
    motion[at].cranks_rad[0]
}

fn stiff(volts: f64) -> SupplySag {
    SupplySag { volts, stall_volts: None, from_s: 0.0, until_s: None }
}

fn steered_on(servo_supply: Option<SupplySag>) -> Environment {
    let disturbances = Disturbances { servo_supply, ..Disturbances::default() };
    steered(environment(disturbances), 2150)
}

fn slew_rad_s(supply: Option<SupplySag>) -> f64 {
    let environment = steered_on(supply);
    (crank_at(&environment, 100) - crank_at(&environment, 60)) / 0.040
}

/// The load of the wash takes its part of the speed at either supply. The speed falls by more than
/// the ratio of the voltages.
#[test]
fn a_servo_at_4_8_v_slews_at_four_fifths_of_its_speed() {
    let (full, low) = (slew_rad_s(None), slew_rad_s(Some(stiff(4.8))));
    assert!((0.75..=0.82).contains(&(low / full)), "{low} of {full}");
    assert_eq!(slew_rad_s(Some(stiff(RATED_SUPPLY_V))), full);
}

/// A motor that starts draws its stall current, and a turning motor little. A weak supply costs the
/// start of a move most. At full speed it costs only what the load of the wash asks for.
#[test]
fn a_weak_supply_gives_way_to_the_servos_current() {
    let weak = SupplySag { stall_volts: Some(3.0), ..stiff(6.0) };
    // The first pulse ends at 2.15 ms.
    let start = |supply| {
        let environment = steered_on(Some(supply));
        crank_at(&environment, 12) - crank_at(&environment, 1)
    };
    let begun = start(weak) / start(stiff(6.0));
    assert!((0.5..0.8).contains(&begun), "{begun}");
    let fast = slew_rad_s(Some(weak)) / slew_rad_s(None);
    assert!((0.85..0.99).contains(&fast), "{fast}");
}

/// 30 K in the end at 0.03 deg/s/K; nothing of it changes the sensor's noise or bias at 25 deg C.
#[test]
fn a_sensor_that_warms_up_drifts_from_power_on() {
    let bias_after = |temperature, ms| {
        let mut environment = environment(Disturbances { temperature, ..Disturbances::default() });
        environment.advance(Ticks::from_ms(ms));
        environment.sensor.gyro_bias_rad_s()[1].to_degrees()
    };
    let temperature = Temperature {
        from_c: 25.0,
        to_c: 55.0,
        time_constant_s: 1.0,
        gyro_dps_k: 0.03,
        acc_mg_k: 0.0,
    };
    for (ms, share) in [(1, 0.001), (1000, 0.632), (8000, 0.9997)] {
        let drift = bias_after(Some(temperature), ms) - bias_after(None, ms);
        assert!((drift - 0.9 * share).abs() < 1e-3, "{ms} ms: {drift}");
    }
}

#[test]
fn a_sag_begins_and_ends() {
    let sag = SupplySag { volts: 4.5, stall_volts: Some(3.0), from_s: 0.1, until_s: Some(0.3) };
    let shares = [0.0, 0.1, 0.299, 0.3].map(|s| sag.share(s, 0.0));
    assert_eq!(shares, [1.0, 0.75, 0.75, 1.0]);
    let shares = [0.0, 0.5, 1.0, 2.0].map(|current| sag.share(0.2, current));
    assert_eq!(shares, [0.75, 0.625, 0.5, 0.5]);
}

/// The rudder's moment is proportional to the thrust. A drone whose rudder is over gains half the
/// rate under half the thrust. Gravity is off: the tilt does not matter.
#[test]
fn half_the_thrust_turns_the_drone_half_as_fast() {
    let rate_after = |ramp: Option<ThrustRamp>| {
        let mut bench = BenchConfig::default();
        bench.parameters.gravity_m_s2 = 0.0;
        bench.disturbances.thrust_ramp = ramp;
        let environment = steered(Environment::new(&bench).unwrap(), 1600);
        let last = environment.truth.motion.last().unwrap();
        (last.rates_rad_s[0], last.rudders_rad[0])
    };
    let (whole, rudder) = rate_after(None);
    let held = ThrustRamp { from_pct: 50.0, seconds: 1e6 };
    let (half, same_rudder) = rate_after(Some(held));
    assert!((rudder - same_rudder).abs() < 0.01);
    assert!((half / whole - 0.5).abs() < 0.03, "{half} of {whole}");
    let ramp = ThrustRamp { from_pct: 50.0, seconds: 0.2 };
    let (between, _) = rate_after(Some(ramp));
    assert!((0.6..0.95).contains(&(between / whole)), "{between}");
    let at_once = ThrustRamp { from_pct: 100.0, seconds: 1.0 };
    assert_eq!(rate_after(Some(at_once)).0, whole);
}

/// Amplitudes, m/s2, that a sensor of 100 Hz shows of a vibration at these frequencies.
fn shown(shaking: &Vibration, hz: [f64; 2]) -> [f64; 2] {
    use crate::bno055::tests::sensors::Sensors;
    use crate::inertial::{ImuErrors, Stimulus};
    let mut sensors = Sensors::new(ImuErrors::NONE, 1);
    let mut sums = [[0.0; 2]; 2];
    let refreshes = 200;
    for step in 1..=refreshes * 20 {
        let now = Ticks::from_us(500 * step);
        let (force, rate_rad_s) = shaking.at(now.as_secs_f64());
        let truth = Stimulus {
            specific_force_m_s2: [force[0], force[1], -9.81],
            rate_rad_s,
            ..Stimulus::REST
        };
        sensors.sense(now, &truth);
        if step % 20 == 0 {
            let acc = f64::from(sensors.refresh(now).unwrap().acc[0]) * 0.01;
            for (sum, hz) in sums.iter_mut().zip(hz) {
                let (sin, cos) = (TAU * hz * now.as_secs_f64()).sin_cos();
                sum[0] += acc * cos;
                sum[1] += acc * sin;
            }
        }
    }
    sums.map(|[cos, sin]| 2.0 * f64::hypot(cos, sin) / refreshes as f64)
}

/// What a low-pass of 62.5 Hz leaves of an amplitude at a frequency.
fn passed(amplitude: f64, hz: f64) -> f64 {
    amplitude / f64::hypot(1.0, hz / 62.5)
}

/// Past the accelerometer's low-pass and its 100 Hz refresh, 180 Hz come out at 20 Hz with a third
/// of their amplitude. 101 Hz come out at 1 Hz with half of it, which no filter after the sampling
/// can tell from a motion.
#[test]
fn what_the_sensor_is_too_slow_for_arrives_as_an_alias() {
    for (frequency_hz, alias_hz) in [(180.0, 20.0), (101.0, 1.0)] {
        let shaking = Vibration { frequency_hz, ..VIBRATION };
        let [alias, elsewhere] = shown(&shaking, [alias_hz, 30.0]);
        let passed = passed(5.0, frequency_hz);
        assert!((alias / passed - 1.0).abs() < 0.15, "{alias} of {passed}");
        assert!(elsewhere < 0.05, "{elsewhere}");
    }
}

/// 120 Hz and its second line at 240 Hz, half as strong, come out at 20 and 40 Hz.
#[test]
fn each_line_has_its_own_alias() {
    let shaking = Vibration { frequency_hz: 120.0, harmonics: 1, ..VIBRATION };
    let [first, second] = shown(&shaking, [20.0, 40.0]);
    assert!((first / passed(5.0, 120.0) - 1.0).abs() < 0.15, "{first}");
    assert!((second / passed(2.5, 240.0) - 1.0).abs() < 0.15, "{second}");
}

#[test]
fn a_vibration_turns_in_the_propellers_plane() {
    let shaking = VIBRATION;
    assert!((shaking.rate_rad_s().to_degrees() - 2.53).abs() < 0.01);
    let (force, rate) = shaking.at(0.25 / 180.0);
    assert!(force[0].abs() < 1e-9 && (force[1] - 5.0).abs() < 1e-9 && force[2] == 0.0);
    assert!((rate[1] - shaking.rate_rad_s()).abs() < 1e-9);
}

/// At time zero all lines point ahead: 5, 2.5 and 1.25 m/s2. Half a turn later the second stands as
/// before and the others point back.
#[test]
fn harmonics_turn_faster_and_weaker() {
    let shaking = Vibration { frequency_hz: 100.0, harmonics: 2, ..VIBRATION };
    let x = |turns: f64| shaking.at(turns / 100.0).0[0];
    assert!((x(0.0) - 8.75).abs() < 1e-9, "{}", x(0.0));
    assert!((x(0.5) + 3.75).abs() < 1e-9, "{}", x(0.5));
}

/// The frequency, by the angle that the force turns through in a millisecond, stays within 10 % of
/// 200 Hz, comes near both ends in a minute, and is 200 Hz on the whole.
#[test]
fn a_wandering_propeller_keeps_its_mean_speed() {
    let shaking = Vibration { frequency_hz: 200.0, wander_pct: 10.0, ..VIBRATION };
    let angle = |time_s: f64| {
        let (force, _) = shaking.at(time_s);
        force[1].atan2(force[0])
    };
    let speeds_hz: Vec<f64> = (0..60_000)
        .map(|ms| {
            let time_s = 1e-3 * f64::from(ms);
            (angle(time_s + 1e-3) - angle(time_s)).rem_euclid(TAU) / TAU * 1e3
        })
        .collect();
    let least = speeds_hz.iter().copied().fold(f64::INFINITY, f64::min);
    let most = speeds_hz.iter().copied().fold(0.0, f64::max);
    assert!((180.0..183.0).contains(&least), "{least}");
    assert!((217.0..=220.0).contains(&most), "{most}");
    let mean = speeds_hz.iter().sum::<f64>() / speeds_hz.len() as f64;
    assert!((mean - 200.0).abs() < 0.5, "{mean}");
}

#[test]
fn disturbances_have_units_and_ranges() {
    let vibration = |text: &str| text.parse::<Vibration>();
    let supply = |text: &str| text.parse::<SupplySag>();
    let thrust_ramp = |text: &str| text.parse::<ThrustRamp>();
    let temperature = |text: &str| text.parse::<Temperature>();
    assert_eq!(vibration("5, 180").unwrap(), VIBRATION);
    let rate = vibration("5,180,10").unwrap().rate_rad_s();
    assert!((rate.to_degrees() - 10.0).abs() < 1e-9);
    assert_eq!(supply("4.8").unwrap().until_s(), f64::INFINITY);
    let sag = supply("4.5,0.2,0.6").unwrap();
    assert_eq!((sag.volts, sag.from_s, sag.until_s()), (4.5, 0.2, 0.6));
    assert_eq!(sag.stall_volts(), 4.5);
    assert_eq!(supply("6,0,3,4").unwrap().stall_volts(), 4.0);
    let ramp = thrust_ramp("40,0.5").unwrap();
    assert_eq!((ramp.share(0.0), ramp.seconds), (0.4, 0.5));
    let warm = temperature("20,45,60").unwrap();
    assert_eq!((warm.from_c, warm.to_c), (20.0, 45.0));
    let drift = |text| temperature(text).unwrap().of(ImuErrors::NONE).gyro_drift_rad_s_k[2];
    assert!((drift("20,45,60").to_degrees() - 0.015).abs() < 1e-12);
    assert!((drift("20,45,60,-0.03").to_degrees() + 0.03).abs() < 1e-12);
    for bad in ["20,45", "20,200,60", "20,45,0", "20,45,60,NaN", "NaN,45,60"] {
        assert!(temperature(bad).is_err(), "{bad}");
    }
    let rich = vibration("5,120,10,2,3").unwrap();
    assert_eq!((rich.harmonics, rich.wander_pct), (2, 3.0));
    for bad in [
        "5",
        "5,0",
        "5,500",
        "-1,180",
        "5,NaN",
        "5,180,-1",
        "a,b",
        "5,120,10,2",
        "5,120,10,1.5,3",
        "5,120,10,-1,3",
        "5,50,10,5,0",
        "5,50,10,NaN,0",
        "5,120,10,1,21",
        "5,120,10,1,NaN",
        "5,180,10,2,0",
        "5,390,10,0,3",
    ] {
        assert!(vibration(bad).is_err(), "{bad}");
    }
    for bad in [
        "2",
        "9",
        "NaN",
        "4.5,0.2",
        "4.5,0.6,0.2",
        "4.5,-1,2",
        "4.5,0,NaN",
        "4.5,0,1,5",
        "4.5,0,1,0.5",
        "4.5,0,1,NaN",
    ] {
        assert!(supply(bad).is_err(), "{bad}");
    }
    for bad in ["40", "101,1", "-1,1", "40,0", "40,11", "NaN,1", "40,NaN"] {
        assert!(thrust_ramp(bad).is_err(), "{bad}");
    }
}

#[test]
fn a_report_leaves_no_default_open() {
    assert_eq!(Disturbances::default().report(), None);
    let disturbances = Disturbances {
        vibration: Some(VIBRATION),
        servo_supply: Some(stiff(4.8)),
        ..Disturbances::default()
    };
    let report = disturbances.report().unwrap();
    assert!((report.vibration.unwrap().rate_dps.unwrap() - 2.53).abs() < 0.01);
    assert_eq!(report.servo_supply.unwrap().stall_volts, Some(4.8));
    let rows = [
        ("propeller vibration", "5 m/s2 and 2.5 deg/s at 180 Hz".to_owned()),
        ("servo supply", "4.8 V from 0 s on".to_owned()),
    ];
    assert_eq!(disturbances.rows(), rows);
    assert_eq!(report.rows(), rows);
    let rich = Disturbances {
        vibration: Some("5,120,10,2,3".parse().unwrap()),
        ..Disturbances::default()
    };
    let how = "5 m/s2 and 10.0 deg/s at 120 Hz +-3 %, 2 harmonics".to_owned();
    assert_eq!(rich.rows(), [("propeller vibration", how)]);
}
