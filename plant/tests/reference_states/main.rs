//! The equations of motion against reference states, reference trajectories and each other.

mod newton_euler;

use plant::free::State;
use plant::integrate::Adaptive;
use plant::{Mechanism, Parameters};
use proptest::prelude::*;

/// A reference file's rows, by column name.
fn read(name: &str) -> Vec<std::collections::HashMap<String, f64>> {
    let path = format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"));
    csv::Reader::from_path(path).unwrap().deserialize().map(Result::unwrap).collect()
}

/// Random states with all fourteen unknowns, to 1e-9 relative.
#[test]
fn newton_euler_matches_the_reference_states() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let rows = read("ne_unit_states.csv");
    assert_eq!(rows.len(), 25);
    for row in rows {
        let state = State {
            pitch_rad: row["theta0"],
            crank_rad: row["theta1"],
            pitch_rate_rad_s: row["w0"],
            crank_rate_rad_s: row["w1"],
        };
        let linkage = mechanism.linkage().at(state.crank_rad);
        assert!((linkage.link_rad() - row["theta2"]).abs() < 1e-13);
        assert!((linkage.rudder_rad() - row["theta3"]).abs() < 1e-13);
        let solution = newton_euler::dynamics(&mechanism, &state, row["tau"]).unwrap();
        let forces = [
            ("D", solution.pivot),
            ("O", solution.servo),
            ("A", solution.crank_end),
            ("B", solution.link_end),
            ("C", solution.rudder_axis),
        ];
        for (joint, force) in forces {
            for (axis, value) in ["x", "y"].into_iter().zip(force) {
                let expected = row[&format!("{joint}{axis}")];
                let error = (value - expected).abs() / expected.abs().max(1.0);
                assert!(error < 1e-9, "{joint}{axis}: {value} {expected}");
            }
        }
        for (i, value) in solution.accelerations_rad_s2.into_iter().enumerate() {
            let expected = row[&format!("t{i}dd")];
            assert!((value - expected).abs() < 1e-9 * expected.abs(), "t{i}dd: {value} {expected}");
        }
        let reduced = mechanism.accelerations(&state, row["tau"]);
        assert!((reduced[0] - row["t0dd"]).abs() < 1e-9 * row["t0dd"].abs());
        assert!((reduced[1] - row["t1dd"]).abs() < 1e-9 * row["t1dd"].abs());
    }
}

#[test]
fn constraint_sweep_is_exact() {
    let linkage = *Mechanism::new(&Parameters::PHYS).unwrap().linkage();
    let rows = read("constraint_sweep.csv");
    assert_eq!(rows.len(), 61);
    for row in rows {
        let phase = std::f64::consts::PI * row["t"] / 3.0;
        let crank = 0.8 * phase.sin().powi(2);
        let rate = 0.8 * std::f64::consts::PI / 3.0 * (2.0 * phase).sin();
        let at = linkage.at(crank);
        // The file has ten digits.
        let near = |value: f64, name: &str| {
            assert!(
                (value - row[name]).abs() < 6e-10 * row[name].abs().max(1e-3),
                "{name} {value}"
            );
        };
        near(crank, "theta1");
        near(at.link_rad(), "theta2");
        near(at.rudder_rad(), "theta3");
        near(rate, "w1");
        near(at.link_ratio * rate, "w2");
        near(at.rudder_ratio * rate, "w3");
    }
}

fn times(rows: &[std::collections::HashMap<String, f64>]) -> Vec<f64> {
    rows.iter().map(|row| row["t"]).collect()
}

/// Body 0 balanced by itself: the whole is a pendulum, the crank swings on the link's weight.
#[test]
fn gravity_only_is_a_pendulum() {
    let p =
        Parameters { body_cm_m: [0.0, 0.0], gravity_m_s2: 9.8, thrust_n: 0.0, ..Parameters::PHYS };
    let mechanism = Mechanism::new(&p).unwrap();
    let rows = read("gravity_only_pendulum.csv");
    assert_eq!(rows.len(), 101);
    let start = [0.2, mechanism.linkage().zero_rudder_crank_rad(), 0.0, 0.0];
    let derivative = |_: f64, x: &[f64; 4]| {
        let [pitch, crank] = mechanism.accelerations(&State::from_array(*x), 0.0);
        [x[2], x[3], pitch, crank]
    };
    let states = Adaptive::default().sample(derivative, &times(&rows), [], start).unwrap();
    for (row, state) in rows.iter().zip(states) {
        let at = mechanism.linkage().at(state[1]);
        for (name, value) in [
            ("theta0", state[0]),
            ("theta1", state[1]),
            ("theta2", at.link_rad()),
            ("theta3", at.rudder_rad()),
            ("w0", state[2]),
            ("w1", state[3]),
        ] {
            assert!((value - row[name]).abs() < 1e-6, "{name} at {}: {value}", row["t"]);
        }
    }
}

/// An ideal servo of second order round a PD law.
#[test]
fn pd_with_an_ideal_servo() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let zero = mechanism.linkage().zero_rudder_crank_rad();
    let rows = read("pd_ideal_servo.csv");
    assert_eq!(rows.len(), 121);
    let derivative = |_: f64, x: &[f64; 4]| {
        let command = zero + x[0] + 0.3 * x[2];
        let crank = 900.0 * (command - x[1]) - 60.0 * x[3];
        let state = State::from_array(*x);
        [x[2], x[3], mechanism.pitch_acceleration(&state, crank, 0.0), crank]
    };
    let states =
        Adaptive::default().sample(derivative, &times(&rows), [], [0.2, zero, 0.2, 0.0]).unwrap();
    for (row, state) in rows.iter().zip(states) {
        for (name, value) in
            [("theta0", state[0]), ("theta1", state[1]), ("w0", state[2]), ("w1", state[3])]
        {
            assert!((value - row[name]).abs() < 1e-7, "{name} at {}: {value}", row["t"]);
        }
    }
}

prop_compose! {
    /// Any drone that the checks accept: offsets, frictions and masses all free.
    fn any_parameters()(
        masses in [0.5..5.0_f64, 0.001..0.1, 1e-4..0.01, 0.1..1.0],
        inertias in [0.02..0.5_f64, 1e-7..1e-2, 1e-8..1e-4, 1e-4..1e-2],
        body_cm_m in [-0.05..0.05_f64, -0.05..0.05],
        crank_cm_m in -0.02..0.02_f64,
        rudder_cm_m in -0.05..0.05_f64,
        axis_x in -0.03..0.03_f64,
        thrust_n in 0.0..60.0_f64,
        thrust_point_m in [-0.02..0.02_f64, -0.1..0.1],
        pressure_centre_m in 0.0..0.06_f64,
        wash_efficiency in 0.0..1.0_f64,
        frictions in [0.0..0.05_f64, 0.0..0.05, 0.0..0.05],
    ) -> Parameters {
        Parameters {
            body_mass_kg: masses[0],
            body_inertia_kg_m2: inertias[0],
            body_cm_m,
            crank_mass_kg: masses[1],
            crank_inertia_kg_m2: inertias[1],
            crank_cm_m,
            link_mass_kg: masses[2],
            link_inertia_kg_m2: inertias[2],
            rudder_mass_kg: masses[3],
            rudder_inertia_kg_m2: inertias[3],
            rudder_cm_m,
            rudder_axis_m: [axis_x, -0.195],
            thrust_n,
            thrust_point_m,
            wash_efficiency,
            pressure_centre_m,
            pivot_friction_n_m_s: frictions[0],
            crank_friction_n_m_s: frictions[1],
            rudder_friction_n_m_s: frictions[2],
            ..Parameters::PHYS
        }
    }
}

prop_compose! {
    fn any_state()(x in [-3.0..3.0_f64, -3.0..3.0, -10.0..10.0, -10.0..10.0]) -> State {
        State::from_array(x)
    }
}

/// Each body's centre of mass and angle.
type Places = [([f64; 2], f64); 4];

/// Places of the four centres of mass in the inertial frame, and the bodies' absolute angles,
/// straight from the geometry.
fn places(p: &Parameters, pitch: f64, crank: f64) -> Places {
    let turn = |[x, y]: [f64; 2], angle: f64| {
        let (sin, cos) = angle.sin_cos();
        [cos * x - sin * y, sin * x + cos * y]
    };
    let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
    let at = p.linkage().at(crank);
    let (link, rudder) = (at.link_rad(), at.rudder_rad());
    let servo = p.servo_axis_m();
    let crank_cm = add(servo, turn([0.0, p.crank_cm_m], crank));
    let end = add(servo, turn([0.0, p.crank_length_m], crank));
    let link_cm = add(end, turn([-0.5 * p.link_length_m, 0.0], link));
    let rudder_cm = add(p.rudder_axis_m, turn([0.0, p.rudder_cm_m], rudder));
    [
        (turn(p.body_cm_m, pitch), pitch),
        (turn(crank_cm, pitch), pitch + crank),
        (turn(link_cm, pitch), pitch + link),
        (turn(rudder_cm, pitch), pitch + rudder),
    ]
}

/// Lagrangian from places alone, velocities by central differences along `rates`.
fn lagrangian(p: &Parameters, q: [f64; 2], rates: [f64; 2]) -> f64 {
    let h = 1e-4;
    let along = |s: f64| places(p, q[0] + s * rates[0], q[1] + s * rates[1]);
    let (m2, m1, p1, p2) = (along(-2.0 * h), along(-h), along(h), along(2.0 * h));
    let slope =
        |f: &dyn Fn(&Places) -> f64| (f(&m2) - 8.0 * f(&m1) + 8.0 * f(&p1) - f(&p2)) / (12.0 * h);
    let here = along(0.0);
    let bodies = [
        (p.body_mass_kg, p.body_inertia_kg_m2),
        (p.crank_mass_kg, p.crank_inertia_kg_m2),
        (p.link_mass_kg, p.link_inertia_kg_m2),
        (p.rudder_mass_kg, p.rudder_inertia_kg_m2),
    ];
    (0..4)
        .map(|i| {
            let (mass, inertia) = bodies[i];
            let vx = slope(&|c| c[i].0[0]);
            let vy = slope(&|c| c[i].0[1]);
            let spin = slope(&|c| c[i].1);
            0.5 * mass * (vx * vx + vy * vy) + 0.5 * inertia * spin * spin
                - mass * p.gravity_m_s2 * here[i].0[1]
        })
        .sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// The fourteen equations and the reduced form, derived apart, agree for any drone.
    #[test]
    fn newton_euler_and_reduced_form_agree(
        p in any_parameters(), state in any_state(), torque in -0.5..0.5_f64,
    ) {
        let mechanism = Mechanism::new(&p).unwrap();
        let full = newton_euler::dynamics(&mechanism, &state, torque).unwrap().accelerations_rad_s2;
        let reduced = mechanism.accelerations(&state, torque);
        for i in 0..2 {
            let size = reduced[0].abs().max(reduced[1].abs()).max(1.0);
            prop_assert!((full[i] - reduced[i]).abs() < 1e-10 * size, "{full:?} {reduced:?}");
        }
        let at = mechanism.linkage().at(state.crank_rad);
        let v1 = state.crank_rate_rad_s;
        let rudder = at.rudder_ratio * full[1] + at.rudder_curvature * v1 * v1;
        prop_assert!((full[3] - rudder).abs() < 1e-9 * rudder.abs().max(1.0));
    }

    /// With a prescribed crank, momentum changes by the pitch load alone.
    #[test]
    fn prescribed_form_agrees_with_the_free_one(
        p in any_parameters(), state in any_state(), torque in -0.5..0.5_f64,
    ) {
        let mechanism = Mechanism::new(&p).unwrap();
        let [pitch, crank] = mechanism.accelerations(&state, torque);
        let prescribed = mechanism.pitch_acceleration(&state, crank, 0.0);
        prop_assert!((pitch - prescribed).abs() < 1e-9 * (pitch.abs() + crank.abs()).max(1.0));
    }

    /// Lagrange's equations on a Lagrangian made of places alone: no mass matrix, no ratios.
    #[test]
    fn accelerations_satisfy_lagranges_equations(p in any_parameters(), state in any_state()) {
        let p = Parameters {
            thrust_n: 0.0,
            pivot_friction_n_m_s: 0.0,
            crank_friction_n_m_s: 0.0,
            rudder_friction_n_m_s: 0.0,
            ..p
        };
        let mechanism = Mechanism::new(&p).unwrap();
        let acc = mechanism.accelerations(&state, 0.1);
        let q = [state.pitch_rad, state.crank_rad];
        let v = [state.pitch_rate_rad_s, state.crank_rate_rad_s];
        let h = 1e-3;
        // d/dt (dL/dv_i) along the motion, second order in time, minus dL/dq_i.
        let momentum = |i: usize, t: f64| {
            let at = [0, 1].map(|k| q[k] + v[k] * t + 0.5 * acc[k] * t * t);
            let rate = [0, 1].map(|k| v[k] + acc[k] * t);
            let shifted = |s: f64| {
                let mut rate = rate;
                rate[i] += s;
                lagrangian(&p, at, rate)
            };
            // L is quadratic in the rates: the central difference is exact for any step.
            0.5 * (shifted(1.0) - shifted(-1.0))
        };
        for (i, load) in [0.0, 0.1].into_iter().enumerate() {
            let dt = 1e-4;
            let change = (momentum(i, -2.0 * dt) - 8.0 * momentum(i, -dt) + 8.0 * momentum(i, dt)
                - momentum(i, 2.0 * dt)) / (12.0 * dt);
            let shifted = |s: f64| {
                let mut q = q;
                q[i] += s;
                lagrangian(&p, q, v)
            };
            let slope = (shifted(-2.0 * h) - 8.0 * shifted(-h) + 8.0 * shifted(h)
                - shifted(2.0 * h)) / (12.0 * h);
            let size = 1.0 + change.abs().max(slope.abs());
            prop_assert!((change - slope - load).abs() < 1e-6 * size, "{i}: {change} {slope}");
        }
    }
}
