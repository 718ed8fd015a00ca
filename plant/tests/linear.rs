//! Linear analysis against the reference figures.

mod reference;

use nalgebra::{Complex, RowVector4};
use plant::free::State;
use plant::linear::frequency::OpenLoop;
use plant::linear::{StateSpace, equilibrium, equilibrium_at_crank, linearise};
use plant::pitch_loop::Timing;
use plant::{Mechanism, Parameters, ServoModel};

/// The loop closed by `u = -gain x`, its poles.
fn closed_poles(model: &StateSpace, gain: RowVector4<f64>) -> Vec<Complex<f64>> {
    let a = model.a - model.b * gain;
    StateSpace { a, ..model.clone() }.poles()
}

/// Upright at zero rudder.
fn upright(mechanism: &Mechanism) -> State {
    State { crank_rad: mechanism.linkage().zero_rudder_crank_rad(), ..State::default() }
}

fn at_zero_rudder(p: &Parameters) -> StateSpace {
    let mechanism = Mechanism::new(p).unwrap();
    linearise(&mechanism, &upright(&mechanism), 0.0)
}

/// Whether every expected number is among those found.
fn has(found: &[Complex<f64>], expected: &[(f64, f64)], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (re, im) in expected {
        let near = |z: &&Complex<f64>| (*z - Complex::new(*re, *im)).norm() < tolerance;
        assert!(found.iter().any(|z| near(&z)), "{re}{im:+}j not in {found:?}");
    }
}

#[test]
fn state_space_of_phys() {
    let model = at_zero_rudder(&Parameters::PHYS);
    for (value, expected, digit) in [
        (model.a[(1, 0)], -0.0028, 5e-5),
        (model.a[(1, 2)], -26.162, 5e-4),
        (model.a[(3, 0)], 0.292, 5e-4),
        (model.a[(3, 2)], -565.75, 5e-3),
        (model.b[1], -14.316, 5e-4),
        (model.b[3], 1485.2, 5e-2),
    ] {
        assert!((value - expected).abs() < digit, "{value} {expected}");
    }
    assert_eq!(model.controllability().rank, 4);
    assert_eq!(model.observability().rank, 4);
}

#[test]
fn poles_and_zeros() {
    let phys = Parameters::PHYS;
    let cases = [
        (phys, [(0.0, 23.79), (0.0, 0.128)], (0.0, 57.27)),
        (Parameters { pressure_centre_m: 0.0, ..phys }, [(6.84, 0.0), (0.40, 0.0)], (0.0, 51.6)),
        (Parameters { body_cm_m: [0.0, 0.0], ..phys }, [(0.0, 23.74), (0.0, 3.06)], (0.0, 57.27)),
    ];
    let table = (Parameters::THESIS_TABLE, [(4.17, 0.0), (0.004, 0.0)], (0.0, 2.28));
    for (p, poles, zero) in cases.into_iter().chain([table]) {
        let model = at_zero_rudder(&p);
        let both = |(re, im): (f64, f64)| [(re, im), (-re, -im)];
        let expected: Vec<_> = poles.into_iter().flat_map(both).collect();
        has(&model.poles(), &expected, 0.0055);
        has(&model.zeros(), &both(zero), 0.055);
    }
}

#[test]
fn torque_control_of_pitch_alone_is_unstable() {
    let model = at_zero_rudder(&Parameters::PHYS);
    for sign in [1.0, -1.0] {
        let poles = closed_poles(&model, sign * RowVector4::new(2.0, 8.0, 0.0, 0.0));
        assert!(poles.iter().any(|p| p.re > 1.0));
    }
    // The sign that steers the right way, with the thesis' gains of 2 and 8.
    let right = closed_poles(&model, RowVector4::new(-2.0, -8.0, 0.0, 0.0));
    has(&right, &[(-131.6, 0.0), (-0.25, 0.0), (8.7, 52.7), (8.7, -52.7)], 0.2);
    // tau = kq (kp th0 + kd w0 - th1) - dq v1 stands.
    let cascade = closed_poles(&model, -RowVector4::new(2.0, 0.6, -2.0, -0.06));
    has(&cascade, &[(-44.0, 27.0), (-44.0, -27.0), (-4.6, 3.6), (-4.6, -3.6)], 0.8);
}

#[test]
fn equilibria_balance_gravity_with_the_rudder() {
    let p = Parameters { body_cm_m: [0.005, 0.0385], ..Parameters::PHYS };
    let mechanism = Mechanism::new(&p).unwrap();
    let rest = equilibrium(&mechanism, 0.0).unwrap();
    // 5 mm of lateral offset of body 0: m0 g x = 0.135 N m over K01 = 4.01 N m/rad of crank.
    let zero = mechanism.linkage().zero_rudder_crank_rad();
    assert!((rest.state.crank_rad - zero + 0.0343).abs() < 5e-4);
    let [pitch, crank] = mechanism.accelerations(&rest.state, rest.torque_n_m);
    assert!(pitch.abs() < 1e-11 && crank.abs() < 1e-9);
}

/// A pendulum (body 0 balanced at the pivot) that a deflected rudder holds askew.
#[test]
fn a_pendulum_rests_where_its_weight_balances_the_wash() {
    let mechanism = Mechanism::new(&Parameters::THESIS_TEXT).unwrap();
    for crank in [-0.15, 0.0, 0.2] {
        let rest = equilibrium_at_crank(&mechanism, crank).unwrap();
        assert_eq!(rest.state.crank_rad, crank);
        let acc = mechanism.accelerations(&rest.state, rest.torque_n_m);
        assert!(acc[0].abs() < 1e-11 && acc[1].abs() < 1e-9, "{acc:?}");
        // Positive rudder turns the drone clockwise until its weight holds it.
        let rudder = mechanism.linkage().at(crank).rudder_rad();
        assert!(rest.state.pitch_rad * rudder < 0.0);
        assert!(rest.state.pitch_rad.abs() < 1.2);
    }
    // At 60 deg of crank the wash is stronger than the weight; a balanced drone has none.
    assert_eq!(equilibrium_at_crank(&mechanism, 1.05), None);
    let balanced = Mechanism::new(&Parameters::PHYS).unwrap();
    assert_eq!(equilibrium_at_crank(&balanced, 0.1), None);
}

/// The law asks for rudder: at a point where the linkage has less gain, the crank moves more, and
/// the margins are nearly those at zero rudder.
#[test]
fn margins_hold_away_from_zero_rudder() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let point = State { crank_rad: 0.6, ..State::default() };
    let (servo, timing) = (ServoModel::S3003, Timing::ANALOGUE);
    let zero = upright(&mechanism);
    let zero = OpenLoop::new(&mechanism, &zero, &servo, &timing, 1.0, 0.30).margins();
    let away = OpenLoop::new(&mechanism, &point, &servo, &timing, 1.0, 0.30);
    assert!(away.kp > 1.25);
    let phase = |margins: plant::linear::frequency::Margins| margins.phase.unwrap().deg;
    assert!((phase(away.margins()) - phase(zero)).abs() < 5.0);
}

/// For the digital servo the reference quotes the value of the smallest gain margin, which lies at
/// 196 rad/s, with the frequency of the first phase crossing, where there are 30 dB left.
#[test]
fn margins_of_the_reference_table() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let (a, b) = (reference::S3003, reference::DIGITAL);
    let (slow, fast) = (Timing::ANALOGUE, Timing::DIGITAL);
    for (servo, timing, kp, kd, gm, pm, at, delay_ms) in [
        (a, slow, 1.0, 0.30, 13.1, 42.7, 9.7, 77.0),
        (a, slow, 0.9, 0.25, 14.6, 42.3, 8.4, 88.0),
        (a, slow, 1.2, 0.35, 11.8, 40.4, 11.1, 64.0),
        (b, fast, 1.6, 0.35, 18.05, 50.2, 11.5, 76.0),
        (b, fast, 1.8, 0.35, 18.03, 47.9, 11.7, 71.0),
    ] {
        let zero = upright(&mechanism);
        let margins = OpenLoop::new(&mechanism, &zero, &servo, &timing, kp, kd).margins();
        let (gain, phase) = (margins.gain.unwrap(), margins.phase.unwrap());
        assert!((gain.db - gm).abs() < 0.06, "{gain:?}");
        assert!((phase.deg - pm).abs() < 0.06, "{phase:?}");
        assert!((phase.at_rad_s - at).abs() < 0.06, "{phase:?}");
        assert!((1e3 * phase.delay_s - delay_ms).abs() < 0.6, "{phase:?}");
    }
}

/// The rational loop and its root locus: stable at the nominal gain, unstable beyond the margin.
#[test]
fn root_locus_crosses_at_the_gain_margin() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let (zero, servo, timing) = (upright(&mechanism), ServoModel::S3003, Timing::ANALOGUE);
    let open = OpenLoop::new(&mechanism, &zero, &servo, &timing, 1.0, 0.30);
    let margin = 10.0_f64.powf(open.margins().gain.unwrap().db / 20.0);
    let open = open.rational();
    let worst = |gain| open.closed_poles(gain).iter().map(|p| p.re).fold(f64::MIN, f64::max);
    assert!(worst(1.0) < -1.0 && worst(0.9 * margin) < 0.0 && worst(1.1 * margin) > 0.0);
}
