use super::super::Table;
use super::*;

fn run(text: &str) -> Vec<Row> {
    Scenario::parse(text).unwrap().run().unwrap()
}

fn last(rows: &[Row]) -> &Row {
    rows.last().unwrap()
}

/// A stiff damper hits the crank with a jump of its torque.
#[test]
fn a_stiff_stop_is_followed() {
    let rows = run("seconds = 1.0\ndt_s = 0.0005\n[input]\nvoltage_v = 6\n[options]\n\
                    crank_stop = { angle_rad = 0.8, stiffness_n_m_rad = 50, damping_n_m_s = 0.5 }");
    assert!((last(&rows).theta0 + 9.5).abs() < 0.3, "{:?}", last(&rows));
}

#[test]
fn a_prescribed_crank_sweeps_the_linkage() {
    let points: Vec<String> = (0..=60)
        .map(|i| {
            let t = 0.05 * f64::from(i);
            let angle = 0.8 * (std::f64::consts::PI * t / 3.0).sin().powi(2);
            format!("[{t}, {angle}]")
        })
        .collect();
    let rows = run(&format!(
        "seconds = 3.0\n[input]\ncrank_rad = [{}]\n[options]\nhold_pitch = true",
        points.join(", ")
    ));
    for row in &rows {
        let angle = 0.8 * (std::f64::consts::PI * row.t / 3.0).sin().powi(2);
        assert!((row.theta1 - angle).abs() < 1e-5);
        assert_eq!(row.w0, 0.0);
    }
    assert!((rows[300].theta3 - 0.39946).abs() < 1e-5);
    assert!((rows[300].theta2 + 0.24277).abs() < 1e-5);
}

/// A free drone under the same crank: prescribing what a free crank did gives the same pitch.
#[test]
fn prescribed_and_free_runs_agree() {
    let free = run("seconds = 0.5\ndt_s = 0.001\n[start]\npitch_rad = 0.1\n\
        [input]\nideal_servo = { kp = 1.0, kd = 0.3, stiffness = 900, damping = 60 }");
    let points = free.iter().map(|r| [r.t, r.theta1]).collect();
    let mut scenario = Scenario::parse("seconds = 0.5\n[start]\npitch_rad = 0.1").unwrap();
    scenario.input = Input::CrankRad(Signal::Table(Table { points, between: None }));
    let pitch = last(&scenario.run().unwrap()).theta0;
    // The table's first rate comes from its points, and is off by some mrad/s.
    assert!((pitch - last(&free).theta0).abs() < 2e-5);
}

/// A step of thrust by a held table is the same as two runs, one after the other.
#[test]
fn held_loads_jump_on_their_points() {
    let quiet = "[drone]\nbody_cm_m = [0, 0]\n[start]\npitch_rad = 0.2\ncrank_rad = 0.1\n";
    let whole = run(&format!(
        "seconds = 0.4\n{quiet}[loads]\n\
         thrust_n = {{ points = [[0, 0], [0.2, 30]], between = \"hold\" }}"
    ));
    let first = run(&format!("seconds = 0.2\n{}", quiet.replace("[0, 0]", "[0, 0]\nthrust_n = 0")));
    let middle = last(&first);
    assert!((whole[40].theta0 - middle.theta0).abs() < 1e-12);
    let mut second = Scenario::parse(&format!("seconds = 0.2\n{quiet}")).unwrap();
    second.start = super::super::Start {
        pitch_rad: middle.theta0,
        crank_rad: Some(middle.theta1),
        pitch_rate_rad_s: middle.w0,
        crank_rate_rad_s: middle.w1,
    };
    let end = *last(&second.run().unwrap());
    let whole = last(&whole);
    for (value, expected) in whole.values().into_iter().zip(end.values()).skip(1) {
        assert!((value - expected).abs() < 1e-9, "{whole:?} {end:?}");
    }
}

/// A constant moment on a drone that nothing else pulls: half the acceleration times t^2.
#[test]
fn an_external_moment_turns_the_drone() {
    let rows = run("seconds = 1\n[drone]\nthrust_n = 0\ngravity_m_s2 = 0\n\
        [input]\ncrank_rad = 0.2\n[loads]\npitch_moment_n_m = 0.05");
    let at = Mechanism::new(&crate::Parameters::PHYS).unwrap().configuration(0.2);
    assert!((last(&rows).theta0 - 0.5 * 0.05 / at.m00).abs() < 1e-10);
    let free = run("seconds = 1\n[drone]\nthrust_n = 0\n[loads]\n\
        pitch_moment_n_m = { amplitude = 0.05, period_s = 0.5 }");
    assert!(last(&free).theta0.abs() > 1e-2);
}

/// The linear model's torque law: PD on pitch alone runs away, the cascade brings it upright.
#[test]
fn a_torque_law_closes_the_loop() {
    let rows = run("seconds = 3\n[start]\npitch_rad = 0.1\n\
        [input]\ntorque_law = { kp = -2, kd = -0.6, crank_kp = 2, crank_kd = 0.06 }");
    assert!(last(&rows).theta0.abs() < 2e-4, "{:?}", last(&rows));
    let pitch_alone = run("seconds = 1\n[start]\npitch_rad = 0.1\n\
        [input]\ntorque_law = { kp = -2, kd = -8 }");
    assert!(pitch_alone.iter().any(|r| r.theta1.abs() > 1.0));
}

#[test]
fn servos_follow_a_command() {
    for servo in ["ideal_servo = { stiffness = 900, damping = 60,", "pulse_servo = {"] {
        let rows = run(&format!(
            "seconds = 0.6\n[drone]\nthrust_n = 0\n[input]\n{servo} command_rad = 0.3 }}"
        ));
        let zero = crate::Parameters::PHYS.linkage().zero_rudder_crank_rad();
        assert!((last(&rows).theta1 - zero - 0.3).abs() < 6e-3, "{servo}");
    }
}

/// Bars that meet over the servo's travel but not all round: an error, not a hang or a NaN.
#[test]
fn a_linkage_that_comes_apart_on_the_way_is_said() {
    let short = "[drone]\nlink_length_m = 0.07\narm_length_m = 0.027\nthrust_n = 0\n";
    let torque = format!(
        "seconds = 3\n{short}crank_friction_n_m_s = 0.01\n\
        [input]\ntorque_n_m = -0.5"
    );
    let crank = format!("seconds = 1\n{short}[input]\ncrank_rad = [[0, 0], [1, -2]]");
    for text in [torque, crank] {
        let Err(error) = Scenario::parse(&text).unwrap().run() else {
            panic!("ran to its end: {text}");
        };
        assert!(error.to_string().contains("cannot close"), "{error}");
    }
}

#[test]
fn times_of_rows_are_the_decimals_that_they_look_like() {
    let rows = run("seconds = 1");
    assert_eq!(rows[30].t, 0.15);
    assert_eq!(last(&rows).t, 1.0);
}

#[test]
fn mistakes_are_named() {
    let refusal = |text: &str| Scenario::parse(text).unwrap_err().to_string();
    assert!(refusal("dt_s = 1").contains("seconds"));
    assert!(refusal("seconds = 1\nsecond = 2").contains("second"));
    assert!(refusal("seconds = -1").contains("rows"));
    assert!(refusal("seconds = 1\ndt_s = 0").contains("rows"));
    assert!(refusal("seconds = 1\n[start]\npitch_rad = \"3 m\"").contains("must be one of"));
    assert!(refusal("seconds = 1\n[drone]\nlink_mass_kg = 0").contains("link_mass_kg"));
    assert!(refusal("seconds = 1\n[input]\npush = 3").contains("push"));
    let order = "seconds = 1\n[input]\ntorque_n_m = [[1, 0], [0, 1]]";
    assert!(refusal(order).contains("[input] torque_n_m") && refusal(order).contains("point 2"));
    let path = refusal("seconds = 1\n[input]\ntorque_n_m = { amplitude = 1 }");
    assert!(path.contains("period_s") && path.contains("torque_n_m"), "{path}");
    let path = refusal("seconds = 1\n[loads]\nthrust_n = [[0, 1], [0, 2]]");
    assert!(path.contains("[loads] thrust_n"), "{path}");
    let path = refusal("seconds = 1\n[input]\ntorque_n_m = true");
    assert!(path.contains("boolean") && path.contains("torque_n_m"), "{path}");
    assert!(refusal("seconds = 1\n[input]\nideal_servo = { kp = 1 }").contains("stiffness"));
    assert!(
        refusal("seconds = 1\n[start]\ncrank_rad = 1\n[input]\ncrank_rad = 0")
            .contains("[start] crank_rad")
    );
    let both = "seconds = 1\n[input]\ntorque_n_m = 1\nvoltage_v = 1";
    assert!(refusal(both).contains("torque_n_m and voltage_v"));
    let odd = "seconds = 1\ndt_s = 0.0007\n[input]\npulse_servo = { kp = 1, kd = 1 }";
    assert!(refusal(odd).contains("step_s"));
}
