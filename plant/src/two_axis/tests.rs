//! The drone with two rudders against the one-axis drone, the laws of conservation, and a cloud of
//! mass points that is moved by hand.

mod independent;

use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::Parameters;
use crate::drone::Drone;

const STEP_S: f64 = 5e-4;

impl TwoAxisDrone {
    /// Moves the tether's stops to a tilt of `stop_rad` to any side; infinite takes them away.
    fn with_tether_stop(mut self, stop_rad: f64) -> Self {
        self.stop_rad = stop_rad;
        self
    }

    /// Places the cranks without moving the drone, as when the servos are fitted at the start.
    fn place_cranks(&mut self, angles_rad: [f64; 2]) {
        let rates = self.rates_rad_s();
        self.cranks = angles_rad.map(Crank::at_rest);
        self.shape = self.shape_at(angles_rad);
        self.set_rates(rates);
    }

    /// Accelerations about the body's axes, rad/s2, with these of the cranks. The tether's push is
    /// left out.
    fn acceleration_rad_s2(&self, cranks_rad_s2: [f64; 2]) -> [f64; 3] {
        const APART_S: f64 = 1e-5;
        let (speeds, rates) = (self.speeds(), Vector3::from(self.rates_rad_s()));
        let [before, after] = [-APART_S, APART_S].map(|time_s| {
            let ahead = |axis: usize| self.cranks[axis].angle_rad + time_s * speeds[axis];
            self.shape_at([0, 1].map(ahead)).inertia
        });
        let inertia_slope = (after - before) / (2.0 * APART_S);
        let [pitch, roll] = [0, 1].map(|axis| {
            let at = &self.shape.linkages[axis];
            at.m01_slope * speeds[axis] * speeds[axis] + at.m01 * cranks_rad_s2[axis]
        });
        let state = State { attitude: self.attitude.into_inner(), momentum: self.momentum };
        let change = self.slope(&self.shape, speeds, &state).momentum;
        let load = change - inertia_slope * rates - Vector3::new(roll, pitch, 0.0);
        (self.shape.inverse * load).into()
    }

    /// Whether the drone lies against a stop of the tether, but for rounding.
    fn at_stop(&self) -> bool {
        let [pitch, roll] = self.tilt_rad();
        pitch.hypot(roll) >= self.stop_rad - 1e-12
    }

    /// Angular momentum about the pivot in the earth's axes, without that of the rotors, kg m2/s.
    fn momentum_kg_m2_s(&self) -> [f64; 3] {
        (self.attitude * self.momentum).into()
    }

    /// Kinetic and potential energy with the cranks at rest, J. The potential is zero with the
    /// centre of mass at the pivot's height.
    fn energy_j(&self) -> (f64, f64) {
        let rates = Vector3::from(self.rates_rad_s());
        let down = self.attitude.inverse() * Vector3::z();
        let gravity = self.parameters.one_axis.gravity_m_s2;
        (
            0.5 * rates.dot(&(self.shape.inertia * rates)),
            -gravity * self.shape.first_moment.dot(&down),
        )
    }
}

/// A drone whose centre of mass is above or below its pivot, not beside it, at zero rudder: then
/// neither axis disturbs the other.
fn balanced() -> Parameters {
    let p = Parameters::PHYS;
    let mechanism = Mechanism::new(&p).unwrap();
    let zero = mechanism.configuration(mechanism.linkage().zero_rudder_crank_rad());
    let mut balanced = p;
    balanced.body_cm_m[0] -= zero.first_moment[0] / p.body_mass_kg;
    balanced
}

fn attitude(pitch: f64, roll: f64, heading: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading)
        * UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0))
}

fn drone(parameters: &TwoAxisParameters, pitch: f64, roll: f64, rates: [f64; 3]) -> TwoAxisDrone {
    TwoAxisDrone::new(parameters, attitude(pitch, roll, 0.5), rates).unwrap()
}

/// A crank that swings about zero rudder.
fn swing(zero_rad: f64, time_s: f64) -> Crank {
    let (sin, cos) = (12.0 * time_s).sin_cos();
    Crank::new(zero_rad + 0.3 * sin, 3.6 * cos)
}

/// Both drones from 0.4 rad and 0.2 rad/s about one axis, while the other stands upright.
fn follow_one_axis(one_axis: Parameters, axis: usize) {
    let mut planar = Drone::new(&one_axis, 0.4, 0.2).unwrap();
    let zero_rad = planar.crank().angle_rad;
    let (pitch, roll) = [(0.4, 0.0), (0.0, 0.4)][axis];
    let rates = [[0.0, 0.2, 0.0], [0.2, 0.0, 0.0]][axis];
    let mut both = drone(&TwoAxisParameters::of(one_axis), pitch, roll, rates);
    for step in 1..=1600 {
        let crank = swing(zero_rad, f64::from(step) * STEP_S);
        let mut cranks = [Crank::at_rest(zero_rad); 2];
        cranks[axis] = crank;
        let mut cranks_rad_s2 = [0.0; 2];
        cranks_rad_s2[axis] = (crank.rate_rad_s - planar.crank().rate_rad_s) / STEP_S;
        planar.step(STEP_S, crank);
        both.step(STEP_S, cranks);
        let turned = both.tilt_rad();
        let (rates, torques) = (both.rates_rad_s(), both.hinge_torque_n_m());
        let accelerations = both.acceleration_rad_s2(cranks_rad_s2);
        let (load, planar_load) = (both.crank_loads()[axis], planar.crank_load());
        for (found, expected) in [
            (turned[axis], planar.pitch_rad()),
            (turned[1 - axis], 0.0),
            (rates[1 - axis], planar.rate_rad_s()),
            (rates[axis], 0.0),
            (rates[2], 0.0),
            (accelerations[1 - axis], planar.acceleration_rad_s2(cranks_rad_s2[axis])),
            (accelerations[axis], 0.0),
            (torques[axis], planar.hinge_torque_n_m()),
            (load.torque_n_m, planar_load.torque_n_m),
            (load.inertia_kg_m2, planar_load.inertia_kg_m2),
            (both.rudder_rad()[axis], planar.rudder_rad()),
        ] {
            assert!((found - expected).abs() < 1e-10, "{axis}, {step}: {found} {expected}");
        }
    }
}

#[test]
fn one_axis_that_moves_is_the_one_axis_drone_about_either_axis() {
    follow_one_axis(Parameters::PHYS, 0);
    follow_one_axis(Parameters::THESIS_TEXT, 0);
    follow_one_axis(balanced(), 0);
    follow_one_axis(balanced(), 1);
}

#[test]
fn energy_is_kept_without_thrust_and_momentum_without_weight_and_thrust() {
    let tumbling = [1.5, -0.7, 2.0];
    let hung = Parameters { thrust_n: 0.0, body_cm_m: [0.01, -0.05], ..Parameters::PHYS };
    let mut falling =
        drone(&TwoAxisParameters::of(hung), 0.5, -0.3, tumbling).with_tether_stop(f64::INFINITY);
    let cranks = falling.cranks();
    let sum = |drone: &TwoAxisDrone| drone.energy_j().0 + drone.energy_j().1;
    let before = sum(&falling);
    for _ in 0..10_000 {
        falling.step(STEP_S, cranks);
    }
    assert!((sum(&falling) - before).abs() < 1e-8, "{}", sum(&falling) - before);

    let weightless = Parameters { gravity_m_s2: 0.0, ..hung };
    let mut drifting = drone(&TwoAxisParameters::of(weightless), 0.5, -0.3, tumbling)
        .with_tether_stop(f64::INFINITY);
    let before = Vector3::from(drifting.momentum_kg_m2_s());
    let zero_rad = cranks[0].angle_rad;
    for step in 1..=10_000 {
        let time_s = f64::from(step) * STEP_S;
        drifting.step(STEP_S, [swing(zero_rad, time_s), swing(zero_rad, 1.3 * time_s)]);
    }
    let after = Vector3::from(drifting.momentum_kg_m2_s());
    assert!((after - before).norm() < 1e-8, "{after} {before}");
}

#[test]
fn a_spin_is_kept() {
    let mut drone = drone(&TwoAxisParameters::PHYS, 0.3, 0.0, [0.0, 0.0, 1.0]);
    let cranks = drone.cranks();
    for _ in 0..1000 {
        drone.step(STEP_S, cranks);
    }
    assert!((drone.rates_rad_s()[2] - 1.0).abs() < 0.01);
}

/// The tilt is continuous at zero and at every side, and is finite and at the stop upside down.
#[test]
fn the_tilt_is_the_reduced_attitude() {
    let tilt = |attitude| {
        let drone = TwoAxisDrone::new(&TwoAxisParameters::PHYS, attitude, [0.0; 3]).unwrap();
        (drone.tilt_rad(), drone.at_stop())
    };
    for (pitch, roll) in [(0.0, 0.0), (1e-12, -2e-12), (-1e-200, 0.0), (0.9, -0.7), (-3.0, 0.5)] {
        let ([found_pitch, found_roll], _) = tilt(attitude(pitch, roll, 0.8));
        assert!((found_pitch - pitch).abs() < 1e-12 && (found_roll - roll).abs() < 1e-12);
    }
    for axis in [Vector3::x_axis(), Vector3::y_axis()] {
        let flip = UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
        let exact = UnitQuaternion::new_unchecked(Quaternion::from_imag(axis.into_inner()));
        for attitude in [flip, exact] {
            let ([pitch, roll], at_stop) = tilt(attitude);
            assert!((pitch.hypot(roll) - std::f64::consts::PI).abs() < 1e-12 && at_stop);
        }
    }
}

/// Rotors that turn to the right push the nose of a drone that rolls right up: the momentum along
/// z must turn with the body.
#[test]
fn rotors_that_do_not_cancel_turn_a_motion_aside() {
    let parameters =
        TwoAxisParameters { rotor_momentum_kg_m2_s: 0.02, ..TwoAxisParameters::of(balanced()) };
    let mut drone = drone(&parameters, 0.0, 0.0, [0.5, 0.0, 0.0]);
    let cranks = drone.cranks();
    drone.step(STEP_S, cranks);
    let [_, pitch_rate, _] = drone.rates_rad_s();
    // dH_y/dt = -(w x h)_y = w_x h.
    let expected = 0.5 * 0.02 / drone.shape.inertia[(1, 1)] * STEP_S;
    assert!((pitch_rate - expected).abs() < 1e-3 * expected, "{pitch_rate} {expected}");
}

#[test]
fn a_clamp_holds_and_a_stop_is_inelastic() {
    let mut drone = drone(&TwoAxisParameters::of(Parameters::PHYS), 0.2, 0.1, [0.0; 3]);
    drone.clamp(attitude(0.3, -0.2, 0.5));
    let cranks = drone.cranks();
    drone.step(STEP_S, cranks);
    drone.kick([1.0, 1.0, 1.0]);
    assert!(drone.held() && drone.rates_rad_s().iter().all(|rate| rate.abs() < 1e-12));
    let [pitch, roll] = drone.tilt_rad();
    assert!((pitch - 0.3).abs() < 1e-12 && (roll + 0.2).abs() < 1e-12);
    drone.release([-2.0, 3.0, 0.5]);
    let mut stopped = false;
    for _ in 0..2000 {
        drone.step(STEP_S, cranks);
        let [pitch, roll] = drone.tilt_rad();
        assert!(pitch.hypot(roll) < TETHER_STOP_RAD + 1e-9);
        if drone.at_stop() {
            let [roll_rate, pitch_rate, _] = drone.rates_rad_s();
            assert!(roll_rate * roll + pitch_rate * pitch < 1e-9);
            stopped = true;
        }
    }
    assert!(stopped);
}

#[test]
fn the_heading_does_not_matter() {
    let parameters = TwoAxisParameters::of(Parameters::PHYS);
    let flown = |heading: f64| {
        let start = attitude(0.4, -0.2, heading);
        let mut drone = TwoAxisDrone::new(&parameters, start, [0.1, 0.2, 1.0]).unwrap();
        let zero_rad = drone.cranks()[0].angle_rad;
        for step in 1..=500 {
            let crank = swing(zero_rad, f64::from(step) * STEP_S);
            drone.step(STEP_S, [crank; 2]);
        }
        drone.tilt_rad()
    };
    let at_zero = flown(0.0);
    for heading in [1.0, -3.0, FRAC_PI_2, 1.5 * FRAC_PI_2] {
        for (found, expected) in flown(heading).iter().zip(at_zero) {
            assert!((found - expected).abs() < 1e-9);
        }
    }
}

#[test]
fn impossible_figures_are_named() {
    let good = TwoAxisParameters::of(Parameters::PHYS);
    for (bad, name) in [
        (TwoAxisParameters { axial_inertia_kg_m2: 0.0, ..good }, "axial_inertia_kg_m2"),
        (TwoAxisParameters { axial_inertia_kg_m2: 1e-5, ..good }, "axial_inertia_kg_m2"),
        (TwoAxisParameters { lateral_cm_m: f64::INFINITY, ..good }, "lateral_cm_m"),
        (
            TwoAxisParameters {
                one_axis: Parameters { link_mass_kg: 0.0, ..Parameters::PHYS },
                ..good
            },
            "link_mass_kg",
        ),
    ] {
        let error = TwoAxisDrone::new(&bad, UnitQuaternion::identity(), [0.0; 3]).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}
