//! What a motion without forces keeps.

use plant::free::State;
use plant::integrate::Adaptive;
use plant::{Mechanism, Parameters};

use crate::runs::{energy_j, momentum_kg_m2_s};

fn tumbling() -> State {
    State { pitch_rad: 0.4, crank_rad: -0.3, pitch_rate_rad_s: 1.5, crank_rate_rad_s: -4.0 }
}

/// The tumbling drone at times (s) from its start, under a servo torque (N m) over time.
fn tumble(mechanism: &Mechanism, times: &[f64], torque: impl Fn(f64) -> f64) -> Vec<State> {
    let slope = |time: f64, x: &[f64; 4]| {
        let [pitch, crank] = mechanism.accelerations(&State::from_array(*x), torque(time));
        [x[2], x[3], pitch, crank]
    };
    let states = Adaptive::default().sample(slope, times, [], tumbling().to_array()).unwrap();
    states.into_iter().map(State::from_array).collect()
}

#[test]
fn energy_is_kept_without_thrust() {
    let p = Parameters { thrust_n: 0.0, crank_cm_m: 0.01, rudder_cm_m: -0.02, ..Parameters::PHYS };
    let mechanism = Mechanism::new(&p).unwrap();
    let times: Vec<f64> = (0..=50).map(|i| 0.1 * f64::from(i)).collect();
    let (kinetic, potential) = energy_j(&mechanism, &tumbling());
    for state in tumble(&mechanism, &times, |_| 0.0) {
        let (k, v) = energy_j(&mechanism, &state);
        let drift = (k + v - kinetic - potential) / kinetic;
        assert!(drift.abs() < 1e-9, "{drift}");
    }
}

#[test]
fn angular_momentum_is_kept_without_gravity_and_thrust() {
    let p = Parameters { thrust_n: 0.0, gravity_m_s2: 0.0, ..Parameters::PHYS };
    let mechanism = Mechanism::new(&p).unwrap();
    let before = momentum_kg_m2_s(&mechanism, &tumbling());
    // The servo's torque is internal: it must not change the momentum.
    for state in tumble(&mechanism, &[0.0, 1.0, 5.0], |time| 0.02 * (5.0 * time).sin()) {
        let after = momentum_kg_m2_s(&mechanism, &state);
        assert!((after - before).abs() < 1e-11, "{after} {before}");
    }
}

#[test]
fn zero_force_is_exactly_zero_motion() {
    let p = Parameters { thrust_n: 0.0, gravity_m_s2: 0.0, ..Parameters::PHYS };
    let mechanism = Mechanism::new(&p).unwrap();
    let still = State { pitch_rad: 0.7, crank_rad: 0.2, ..State::default() };
    assert_eq!(mechanism.accelerations(&still, 0.0), [0.0, 0.0]);
}
