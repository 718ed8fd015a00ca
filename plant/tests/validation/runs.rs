//! The motions that are checked.

use plant::free::State;
use plant::integrate::Adaptive;
use plant::scenario::{Row, Scenario};
use plant::{Mechanism, Parameters};

/// Interval of the rows, in s.
const DT_S: f64 = 5e-3;

/// An instant of a motion, with the energy and momentum for the balances.
#[derive(Clone, Copy)]
pub(crate) struct Instant {
    pub(crate) time_s: f64,
    pub(crate) state: State,
    /// Kinetic and potential energy, in J.
    pub(crate) kinetic_j: f64,
    pub(crate) potential_j: f64,
    /// Work of wash, thrust, friction and servo since the start, in J.
    pub(crate) work_j: f64,
    /// Angular momentum about the pivot, in kg m2/s, and the impulse of all outer moments.
    pub(crate) momentum: f64,
    pub(crate) impulse: f64,
}

/// All motions.
pub(crate) struct Runs {
    pub(crate) sweep: Vec<Row>,
    pub(crate) still: Vec<Row>,
    pub(crate) balanced: Vec<Row>,
    pub(crate) pendulum: Vec<Row>,
    pub(crate) top_heavy: Vec<Row>,
    pub(crate) torque: Vec<Row>,
    pub(crate) stopped: Vec<Row>,
    /// Tumbling under gravity alone.
    pub(crate) coasting: Vec<Instant>,
    /// Tumbling under gravity, wash, thrust, friction and servo.
    pub(crate) driven: Vec<Instant>,
    /// The drone of `driven`.
    pub(crate) mechanism: Mechanism,
}

impl Runs {
    /// Runs them all.
    pub(crate) fn new() -> Self {
        let gravity_only = |drone: &str, pitch: f64| {
            scenario(&format!(
                "seconds = 5\n[drone]\nthrust_n = 0\n{drone}\n[start]\npitch_rad = {pitch}"
            ))
        };
        let coasting =
            Parameters { thrust_n: 0.0, crank_cm_m: 0.01, rudder_cm_m: -0.02, ..Parameters::PHYS };
        let driven = Parameters {
            thrust_n: 30.0,
            pivot_friction_n_m_s: 0.01,
            crank_friction_n_m_s: 0.02,
            rudder_friction_n_m_s: 0.005,
            ..coasting
        };
        let mechanism = Mechanism::new(&driven).unwrap();
        Self {
            sweep: scenario(
                "seconds = 3\n[input]\ncrank_rad = { offset = 0.4, amplitude = 0.4, \
                 period_s = 3, phase_rad = \"-90 deg\" }\n[options]\nhold_pitch = true",
            ),
            still: scenario(
                "seconds = 3\n[drone]\nthrust_n = 0\ngravity_m_s2 = 0\n\
                 [start]\npitch_rad = 0.3\ncrank_rad = 0.1",
            ),
            balanced: gravity_only("", 0.1),
            pendulum: gravity_only("body_cm_m = [0, 0]\ngravity_m_s2 = 9.8", 0.2),
            top_heavy: gravity_only("body_cm_m = [-9.92e-5, 0.0625]", 0.05),
            torque: scenario(
                "seconds = 2\n[drone]\ncrank_friction_n_m_s = 0.02\n[input]\ntorque_n_m = 0.1",
            ),
            stopped: scenario(
                "seconds = 1\ndt_s = 0.0005\n[input]\nvoltage_v = 6\n[options]\ncrank_stop = { \
                 angle_rad = 0.8, stiffness_n_m_rad = 50, damping_n_m_s = 0.085 }",
            ),
            coasting: account(&Mechanism::new(&coasting).unwrap(), |_| 0.0),
            driven: account(&mechanism, |time| 0.05 * (5.0 * time).sin()),
            mechanism,
        }
    }
}

fn scenario(text: &str) -> Vec<Row> {
    Scenario::parse(text).unwrap().run().unwrap()
}

/// Kinetic and potential energy, in J; the potential is zero with the centre of mass at the pivot's
/// height.
fn energy_j(mechanism: &Mechanism, state: &State) -> (f64, f64) {
    let at = mechanism.configuration(state.crank_rad);
    let (w0, v1) = (state.pitch_rate_rad_s, state.crank_rate_rad_s);
    let (sin, cos) = state.pitch_rad.sin_cos();
    let [x, y] = at.first_moment;
    (
        0.5 * at.m00 * w0 * w0 + at.m01 * w0 * v1 + 0.5 * at.m11 * v1 * v1,
        mechanism.parameters().gravity_m_s2 * (sin * x + cos * y),
    )
}

/// Angular momentum of all bodies about the pivot, in kg m2/s.
fn momentum_kg_m2_s(mechanism: &Mechanism, state: &State) -> f64 {
    let at = mechanism.configuration(state.crank_rad);
    at.m00 * state.pitch_rate_rad_s + at.m01 * state.crank_rate_rad_s
}

/// A tumble over 5 s under a servo torque (N m) over time, the work of all loads but gravity and
/// the impulse of all moments integrated beside the motion.
fn account(mechanism: &Mechanism, torque: impl Fn(f64) -> f64) -> Vec<Instant> {
    let start =
        State { pitch_rad: 0.4, crank_rad: -0.3, pitch_rate_rad_s: 1.5, crank_rate_rad_s: -4.0 };
    let [th0, th1, w0, v1] = start.to_array();
    let slope = |time: f64, &[th0, th1, w0, v1, _, _]: &[f64; 6]| {
        let state = State::from_array([th0, th1, w0, v1]);
        let torque = torque(time);
        let [pitch, crank] = mechanism.accelerations(&state, torque);
        let at = mechanism.configuration(th1);
        let p = mechanism.parameters();
        let g3 = at.linkage.rudder_ratio;
        let friction = p.pivot_friction_n_m_s * w0 * w0
            + (p.crank_friction_n_m_s + p.rudder_friction_n_m_s * g3 * g3) * v1 * v1;
        let power = at.thrust_moment * w0 + (at.wash_torque + torque) * v1 - friction;
        [w0, v1, pitch, crank, power, mechanism.pitch_load(&at, th0, w0)]
    };
    let times: Vec<f64> = (0..=1000).map(|i| f64::from(i) * DT_S).collect();
    let states = Adaptive::default().sample(slope, &times, [], [th0, th1, w0, v1, 0.0, 0.0]);
    let states = states.unwrap();
    times
        .into_iter()
        .zip(states)
        .map(|(time_s, [th0, th1, w0, v1, work_j, impulse])| {
            let state = State::from_array([th0, th1, w0, v1]);
            let (kinetic_j, potential_j) = energy_j(mechanism, &state);
            Instant {
                time_s,
                state,
                kinetic_j,
                potential_j,
                work_j,
                momentum: momentum_kg_m2_s(mechanism, &state),
                impulse,
            }
        })
        .collect()
}
