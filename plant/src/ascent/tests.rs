//! The ascent against the vertical run of [`rocket`](crate::rocket), the rocket equation, and the
//! laws of conservation.

use std::f64::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::*;
use crate::rocket::{Bending, Rocket};

const STEP_S: f64 = 1e-3;

impl Ascent {
    /// Puts the rocket into free flight at a time since ignition (s), at a position (m) and
    /// velocity (m/s) in earth axes, in an attitude and with rates about the body's axes (rad/s).
    pub(crate) fn release(
        &mut self,
        time_s: f64,
        position_m: [f64; 3],
        velocity_m_s: [f64; 3],
        attitude: UnitQuaternion<f64>,
        rates_rad_s: [f64; 3],
    ) {
        self.time_s = Some(time_s);
        self.on_rail = false;
        self.state = State {
            position: position_m.into(),
            velocity: velocity_m_s.into(),
            attitude: attitude.into_inner(),
            rates: rates_rad_s.into(),
            flexible: Flexible::default(),
        };
    }

    /// Position of the centre of mass from where it is on the pad, north-east-down, in m.
    fn position_m(&self) -> [f64; 3] {
        self.state.position.into()
    }

    /// Velocity of the centre of mass, north-east-down, in m/s.
    fn velocity_m_s(&self) -> [f64; 3] {
        self.state.velocity.into()
    }

    /// Accelerations about the body's axes, rad/s2.
    fn acceleration_rad_s2(&self) -> [f64; 3] {
        self.slope(&self.drive(), &self.state).rates.into()
    }
}

fn spica() -> Ascent {
    Ascent::new(&AscentParameters::SPICA, UnitQuaternion::identity()).unwrap()
}

fn tilted(pitch: f64, roll: f64, heading: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading)
        * UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0))
}

/// In space, if it were not for gravity: no forces of the air.
fn airless() -> AscentParameters {
    AscentParameters::of(RocketParameters {
        normal_force_slope: 0.0,
        drag: 0.0,
        ..RocketParameters::SPICA
    })
}

#[test]
fn a_vertical_flight_is_the_vertical_run() {
    let table = Rocket::new(&RocketParameters::SPICA).unwrap();
    let mut ascent = spica();
    ascent.ignite();
    for second in 1..=90 {
        for _ in 0..200 {
            ascent.step(5e-3, [0.0; 2]);
        }
        let expected = table.at(f64::from(second));
        let [north, east, down] = ascent.velocity_m_s();
        assert!((-down - expected.speed_m_s).abs() < 1e-6 * expected.speed_m_s, "{second}");
        assert!((ascent.altitude_m() - expected.altitude_m).abs() < 1e-6 * expected.altitude_m);
        assert!(north.abs() < 1e-9 && east.abs() < 1e-9);
        let (mass, expected) = (ascent.mass_properties(), expected.mass);
        assert!((mass.mass_kg - expected.mass_kg).abs() < 1e-9 * expected.mass_kg);
        assert!((mass.cm_m - expected.cm_m).abs() < 1e-9);
    }
}

/// Without air: `v = c ln(m0 / m) - g t`, with the exhaust velocity `c` of thrust over flow. The
/// step does not divide the burn.
#[test]
fn the_rocket_equation_holds_and_the_engine_stops_at_burn_out() {
    let mut ascent = Ascent::new(&airless(), UnitQuaternion::identity()).unwrap();
    ascent.ignite();
    let mut lit_s = 0.0;
    for _ in 0..13_000 {
        if ascent.burning() {
            lit_s = ascent.time_s().unwrap();
        }
        ascent.step(7e-3, [0.0; 2]);
    }
    assert!(!ascent.burning() && (89.9929..90.0).contains(&lit_s), "{lit_s}");
    let exhaust = 100e3 / (2600.0 / 90.0);
    let expected = exhaust * (4000.0_f64 / 1400.0).ln() - GRAVITY_M_S2 * 91.0;
    let [_, _, down] = ascent.velocity_m_s();
    assert!((-down - expected).abs() < 1e-6, "{down} {expected}");
}

/// The angular accelerations of [`rocket`](crate::rocket), `-mu_c sin(delta) - mu_a sin(alpha)`, in
/// either axis, through the burn, for a stable and an unstable airframe.
#[test]
fn angular_accelerations_are_those_of_the_two_axis_model() {
    for parameters in [AscentParameters::SPICA, AscentParameters::SPICA_UNSTABLE] {
        let table = Rocket::new(&parameters.rocket).unwrap();
        for (time, angle, gimbal) in [(5.0, 0.02, 0.0), (32.0, -0.05, 0.03), (80.0, 0.01, -0.06)] {
            let flight = table.at(time);
            for axis in [0, 1] {
                let (pitch, roll) = [(angle, 0.0), (0.0, angle)][axis];
                let mut ascent = Ascent::new(&parameters, UnitQuaternion::identity()).unwrap();
                let position = [0.0, 0.0, -flight.altitude_m];
                let velocity = [0.0, 0.0, -flight.speed_m_s];
                ascent.release(time, position, velocity, tilted(pitch, roll, 0.7), [0.0; 3]);
                ascent.gimbal_rad[axis] = gimbal;
                let found = ascent.acceleration_rad_s2();
                let expected = -flight.mu_c * gimbal.sin() - flight.mu_a * angle.sin();
                let index = 1 - axis;
                assert!((found[index] - expected).abs() < 1e-9, "{time}: {found:?} {expected}");
                assert!(found[1 - index].abs() < 1e-9 && found[2].abs() < 1e-9);
            }
        }
    }
}

#[test]
fn free_fall_feels_nothing_and_keeps_energy_and_momentum() {
    let parameters = AscentParameters { sensor_m: [0.0; 3], ..airless() };
    let mut ascent = Ascent::new(&parameters, UnitQuaternion::identity()).unwrap();
    let start = tilted(0.4, -0.2, 1.0);
    ascent.release(95.0, [0.0, 0.0, -9e4], [200.0, -50.0, -300.0], start, [0.0; 3]);
    ascent.step(STEP_S, [0.05, 0.05]);
    assert!(Vector3::from(ascent.specific_force_m_s2()).norm() < 1e-12);

    let rates = [0.3, -0.2, 1.5];
    ascent.release(95.0, [0.0, 0.0, -9e4], [200.0, -50.0, -300.0], start, rates);
    let felt = |ascent: &Ascent| Vector3::from(ascent.specific_force_m_s2());
    // The gimbal turns round the centre of mass, 7 m above it.
    let (w, lever) = (Vector3::from(rates), Vector3::new(0.0, 0.0, 7.0));
    let turning = Vector3::from(ascent.acceleration_rad_s2());
    let expected = turning.cross(&lever) + w.cross(&w.cross(&lever));
    assert!((felt(&ascent) - expected).norm() < 1e-12);
    let conserved = |ascent: &Ascent| {
        let mass = ascent.mass_properties();
        let inertia = ascent.inertia(&mass);
        let (rates, velocity) = (ascent.state.rates, ascent.state.velocity);
        let momentum = ascent.attitude() * inertia.component_mul(&rates);
        let turning = 0.5 * rates.dot(&inertia.component_mul(&rates));
        let height = 0.5 * velocity.norm_squared() + GRAVITY_M_S2 * ascent.altitude_m();
        (momentum, turning, height)
    };
    let before = conserved(&ascent);
    for _ in 0..20_000 {
        ascent.step(STEP_S, [0.0; 2]);
    }
    let after = conserved(&ascent);
    assert!((after.0 - before.0).norm() < 1e-8 * before.0.norm());
    assert!((after.1 - before.1).abs() < 1e-9 * before.1);
    assert!((after.2 - before.2).abs() < 1e-9 * before.2);
}

#[test]
fn the_pad_holds_and_the_rail_guides() {
    let attitude = tilted(-0.1, 0.05, 0.6);
    let mut ascent = Ascent::new(&AscentParameters::SPICA, attitude).unwrap();
    let upwards = attitude.inverse() * Vector3::new(0.0, 0.0, -GRAVITY_M_S2);
    for _ in 0..100 {
        ascent.step(STEP_S, [0.0; 2]);
        assert!((Vector3::from(ascent.specific_force_m_s2()) - upwards).norm() < 1e-12);
    }
    assert_eq!((ascent.position_m(), ascent.time_s()), ([0.0; 3], None));
    assert!(ascent.on_rail && !ascent.burning());
    ascent.ignite();
    ascent.ignite();
    ascent.kick([1e5; 3]);
    let nose = attitude * -Vector3::z();
    let mut moved = 0.0;
    while ascent.on_rail {
        ascent.step(STEP_S, [0.05, -0.05]);
        moved = Vector3::from(ascent.position_m()).norm();
        assert!((Vector3::from(ascent.position_m()) - moved * nose).norm() < 1e-12);
        assert!(ascent.attitude().angle_to(&attitude) < 1e-9);
        assert_eq!(ascent.rates_rad_s(), [0.0; 3]);
    }
    assert!((5.0..5.02).contains(&moved), "{moved}");
    // Free, the gimbal turns it.
    ascent.step(STEP_S, [0.05, -0.05]);
    let [roll_rate, pitch_rate, _] = ascent.rates_rad_s();
    assert!(pitch_rate < 0.0 && roll_rate > 0.0);
}

/// On a vertical rail the thrust is felt, once it is more than the weight.
#[test]
fn a_rocket_that_is_too_heavy_waits_on_its_pad() {
    let mut ascent = spica();
    ascent.ignite();
    ascent.step(STEP_S, [0.0; 2]);
    let [x, y, z] = ascent.specific_force_m_s2();
    assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && (z + 25.0).abs() < 1e-3, "{z}");

    let weak = AscentParameters::of(RocketParameters { thrust_n: 30e3, ..RocketParameters::SPICA });
    let mut ascent = Ascent::new(&weak, UnitQuaternion::identity()).unwrap();
    ascent.ignite();
    // Its mass is 30 kN / g when 942 kg of propellant are burnt.
    let off_s = (4000.0 - 30e3 / GRAVITY_M_S2) / (2600.0 / 90.0);
    while ascent.time_s().unwrap() < off_s - 2.0 * STEP_S {
        ascent.step(STEP_S, [0.0; 2]);
        assert_eq!(ascent.position_m(), [0.0; 3]);
        assert!((ascent.specific_force_m_s2()[2] + GRAVITY_M_S2).abs() < 1e-12);
    }
    for _ in 0..1000 {
        ascent.step(STEP_S, [0.0; 2]);
    }
    assert!(ascent.altitude_m() > 0.0);

    // Without a rail it flies at once, but not before it is lit.
    let bare = AscentParameters { rail_m: 0.0, ..AscentParameters::SPICA };
    let mut ascent = Ascent::new(&bare, UnitQuaternion::identity()).unwrap();
    ascent.step(STEP_S, [0.0; 2]);
    assert!(ascent.on_rail && ascent.position_m() == [0.0; 3]);
    ascent.ignite();
    ascent.step(STEP_S, [0.0; 2]);
    assert!(!ascent.on_rail);
}

#[test]
fn the_gimbal_keeps_its_limits_and_its_lag() {
    let p = RocketParameters::SPICA;
    let mut ascent = spica();
    let mut before = [0.0; 2];
    for step in 0..2000 {
        let command = if step < 1000 { [1.0, -1.0] } else { [-1.0, 1.0] };
        ascent.step(STEP_S, command);
        for (now, before) in ascent.gimbal_rad().into_iter().zip(before) {
            assert!(now.abs() <= p.gimbal_limit_rad);
            assert!((now - before).abs() <= p.gimbal_rate_rad_s * STEP_S * (1.0 + 1e-9));
        }
        before = ascent.gimbal_rad();
        if step == 999 {
            assert!((before[0] - p.gimbal_limit_rad).abs() < 1e-9);
        }
    }
    // A command too small for the limit of the rate: the lag of 5 Hz alone, in two step lengths.
    for step_s in [1e-3, 4e-3] {
        let mut ascent = spica();
        for _ in 0..(0.04 / step_s + 0.5) as usize {
            ascent.step(step_s, [0.01, 0.0]);
        }
        let expected = 0.01 * (1.0 - (-std::f64::consts::TAU * 5.0 * 0.04_f64).exp());
        assert!((ascent.gimbal_rad()[0] - expected).abs() < 1e-12);
        assert_eq!(ascent.gimbal_rad()[1], 0.0);
    }
}

/// A thrust that is off the axis pulls as a gimbal that stands there.
#[test]
fn a_misalignment_is_a_gimbal_angle() {
    let off = AscentParameters { misalignment_rad: [0.01, -0.02], ..AscentParameters::SPICA };
    let flown = |parameters: &AscentParameters, gimbal: [f64; 2]| {
        let mut ascent = Ascent::new(parameters, UnitQuaternion::identity()).unwrap();
        ascent.release(10.0, [0.0; 3], [0.0, 0.0, -100.0], tilted(0.1, 0.0, 0.0), [0.0; 3]);
        ascent.gimbal_rad = gimbal;
        (ascent.acceleration_rad_s2(), ascent.specific_force_m_s2())
    };
    assert_eq!(flown(&off, [0.0; 2]), flown(&AscentParameters::SPICA, [0.01, -0.02]));
}

#[test]
fn a_spin_is_kept() {
    let mut ascent = spica();
    ascent.release(0.0, [0.0; 3], [0.0, 0.0, -50.0], tilted(0.0, 0.0, 0.0), [0.0, 0.0, 0.5]);
    ascent.kick([0.0, 0.0, 100.0]);
    let kicked = ascent.rates_rad_s()[2];
    for _ in 0..1000 {
        ascent.step(STEP_S, [0.0; 2]);
    }
    // 100 N m s on 4000 kg x (0.338 m)^2.
    let gained = 100.0 / (4000.0 * 0.955 * 0.955 / 8.0);
    assert!((kicked - 0.5 - gained).abs() < 1e-12);
    assert!((ascent.rates_rad_s()[2] - kicked).abs() < 1e-12);
}

/// Wind from the west turns a stable rocket into it, to the west, and an unstable one away; the
/// same in the earth's axes at every heading.
#[test]
fn wind_turns_a_stable_rocket_into_it_at_every_heading() {
    let nose = |rocket, heading: f64| {
        let parameters = AscentParameters {
            wind: Wind { steady_m_s: [0.0, 10.0, 0.0], ..Wind::default() },
            ..AscentParameters::of(rocket)
        };
        let mut ascent = Ascent::new(&parameters, tilted(0.0, 0.0, heading)).unwrap();
        ascent.ignite();
        for _ in 0..4000 {
            ascent.step(STEP_S, [0.0; 2]);
        }
        (ascent.attitude() * -Vector3::z(), Vector3::from(ascent.position_m()))
    };
    let (stable, at) = nose(RocketParameters::SPICA, 0.0);
    assert!(stable.y < -1e-3 && stable.x.abs() < 1e-9, "{stable}");
    assert!(nose(RocketParameters::SPICA_UNSTABLE, 0.0).0.y > 1e-3);
    for heading in [FRAC_PI_2, 1.5 * FRAC_PI_2, -2.0] {
        let (turned, moved) = nose(RocketParameters::SPICA, heading);
        assert!((turned - stable).norm() < 1e-9 && (moved - at).norm() < 1e-6, "{heading}");
    }
}

#[test]
fn turbulence_shakes_a_rocket_alike_for_one_seed() {
    let flown = |seed| {
        let parameters = AscentParameters {
            wind: Wind {
                turbulence: Some(Turbulence { rms_m_s: 2.0, length_m: 300.0, seed }),
                ..Wind::default()
            },
            ..AscentParameters::SPICA
        };
        let mut ascent = Ascent::new(&parameters, UnitQuaternion::identity()).unwrap();
        ascent.ignite();
        for _ in 0..5000 {
            ascent.step(STEP_S, [0.0; 2]);
        }
        ascent.tilt_rad()
    };
    assert_eq!(flown(1), flown(1));
    assert_ne!(flown(1), flown(2));
}

/// What the sensor feels is the second difference of its place in earth axes, less gravity. The
/// mass is nearly constant, since the centre's shift in the rocket is left out.
#[test]
fn the_sensor_feels_the_bend_of_its_path() {
    let parameters = AscentParameters {
        sensor_m: [0.2, -0.3, -9.0],
        ..AscentParameters::of(RocketParameters { propellant_kg: 1e-6, ..RocketParameters::SPICA })
    };
    let mut ascent = Ascent::new(&parameters, UnitQuaternion::identity()).unwrap();
    let start = tilted(0.2, -0.1, 0.4);
    ascent.release(20.0, [0.0, 0.0, -2e3], [30.0, 0.0, -300.0], start, [0.2, -0.3, 0.8]);
    ascent.gimbal_rad = [0.03, -0.04];
    let place = |ascent: &Ascent| {
        let lever = Vector3::from(parameters.sensor_m)
            + Vector3::new(0.0, 0.0, ascent.mass_properties().cm_m);
        ascent.state.position + ascent.attitude() * lever
    };
    let mut places = vec![place(&ascent)];
    let mut middle = ascent.clone();
    for step in 1..=2 {
        ascent.step(STEP_S, [0.03, -0.04]);
        places.push(place(&ascent));
        if step == 1 {
            middle = ascent.clone();
        }
    }
    let bend = (places[2] - 2.0 * places[1] + places[0]) / (STEP_S * STEP_S);
    let expected = middle.attitude().inverse() * (bend - Vector3::new(0.0, 0.0, GRAVITY_M_S2));
    let found = Vector3::from(middle.specific_force_m_s2());
    assert!((found - expected).norm() < 1e-4, "{found} {expected}");
}

/// Spica without air, free at once.
fn spica_with(bending: Option<Bending>, slosh_damping: Option<f64>) -> Ascent {
    let rocket = RocketParameters { bending, slosh_damping, ..airless().rocket };
    let parameters = AscentParameters { rail_m: 0.0, ..AscentParameters::of(rocket) };
    Ascent::new(&parameters, UnitQuaternion::identity()).unwrap()
}

/// Frequency, Hz, of what a push of the gimbal leaves behind, by the signs of a rate.
fn rings_hz(ascent: &mut Ascent, rate: impl Fn(&Ascent) -> f64) -> f64 {
    let push = |ascent: &mut Ascent, steps: u32, gimbal: f64| {
        let mut signs = Vec::new();
        for _ in 0..steps {
            ascent.step(STEP_S, [gimbal, 0.0]);
            signs.push(rate(ascent).is_sign_positive());
        }
        signs
            .windows(2)
            .enumerate()
            .filter(|(_, pair)| pair[0] != pair[1])
            .map(|(at, _)| at)
            .collect()
    };
    let _: Vec<usize> = push(ascent, 100, 0.01);
    push(ascent, 400, 0.0);
    let turns = push(ascent, 4_000, 0.0);
    0.5 * (turns.len() - 1) as f64 / ((turns[turns.len() - 1] - turns[0]) as f64 * STEP_S)
}

/// The first mode outlives the second, which has 2.76 times its frequency.
#[test]
fn a_beam_rings_at_its_frequency_at_the_sensor() {
    let bending = Some(Bending { length_m: 13.0, damping: 0.02 });
    let mut ascent = spica_with(bending, None);
    ascent.ignite();
    let bent = |ascent: &Ascent| ascent.sensed_rates_rad_s()[1] - ascent.rates_rad_s()[1];
    let hz = rings_hz(&mut ascent, bent);
    assert!((hz - 6.0).abs() < 0.03, "{hz}");
    let pitch_rad = ascent.sensed_tilt_rad()[0] - ascent.tilt_rad()[0];
    assert!(pitch_rad.abs() < 1e-3, "{pitch_rad}");
}

/// A push to one side: the beam's middle goes with the force, so that its ends bend back, and the
/// slope at its middle is that of the second mode alone.
#[test]
fn a_mode_turns_the_sensor_as_its_shape_says() {
    let rocket = RocketParameters {
        bending: Some(Bending { length_m: 13.0, damping: 0.02 }),
        ..airless().rocket
    };
    let slopes = |from_gimbal_m: f64| {
        let flexible = Flexible::pushed([1.0, 0.0]);
        flexible.turned(&rocket, from_gimbal_m)[0].y
    };
    // The first mode's shape is even about the middle: 1 at both ends, -0.608 between them.
    assert!(slopes(6.5).abs() < 1e-5, "{}", slopes(6.5));
    let shape: f64 = (0..13_000).map(|mm| slopes((f64::from(mm) + 0.5) * 1e-3) * 1e-3).sum();
    let to_middle: f64 = (0..6_500).map(|mm| slopes((f64::from(mm) + 0.5) * 1e-3) * 1e-3).sum();
    assert!(shape.abs() < 1e-4, "{shape}");
    assert!((to_middle.abs() - 1.608).abs() < 1e-3, "{to_middle}");
}

/// 2,600 kg that are 3.8 m deep in a radius of 0.4775 m: 149 kg slide, at 9.8 rad/s under the
/// 25 m/s2 of lift-off. What they take from the body, they have: the centre of mass of both moves
/// as a rigid rocket's.
#[test]
fn liquid_slides_at_its_frequency_and_keeps_momentum() {
    let mut sloshing = spica_with(None, Some(0.005));
    sloshing.ignite();
    let hz = rings_hz(&mut sloshing, |ascent| ascent.state.flexible.slosh_speed().x);
    // The tank that yields makes it some 2 % faster, and so does the propellant that has burnt by
    // then, 1 %.
    assert!((hz - 1.03 * 9.83 / std::f64::consts::TAU).abs() < 0.03, "{hz}");

    let mut rigid = spica_with(None, None);
    let mut sloshing = spica_with(None, Some(0.005));
    for ascent in [&mut rigid, &mut sloshing] {
        ascent.ignite();
        for _ in 0..100 {
            ascent.step(STEP_S, [0.02, -0.01]);
        }
    }
    let [rigid_x, ..] = rigid.velocity_m_s();
    let [sloshing_x, ..] = sloshing.velocity_m_s();
    let carried = 149.0 / 4_000.0 * sloshing.state.flexible.slosh_speed().x;
    assert!((sloshing_x + carried - rigid_x).abs() < 0.02 * carried.abs(), "{carried}");
    assert!(carried.abs() > 5e-4, "{carried}");
}

proptest! {
    /// Whatever the attitude, wind and command, the state stays finite and the attitude a rotation.
    #[test]
    fn nothing_breaks_a_flight(
        attitude in proptest::array::uniform3(-3.0..3.0_f64),
        rates in proptest::array::uniform3(-2.0..2.0_f64),
        velocity in proptest::array::uniform3(-500.0..500.0_f64),
        command in proptest::array::uniform2(-1.0..1.0_f64),
        time_s in 0.0..100.0_f64,
    ) {
        let mut ascent = spica();
        let attitude = UnitQuaternion::from_scaled_axis(Vector3::from(attitude));
        ascent.release(time_s, [0.0, 0.0, -1e4], velocity, attitude, rates);
        for _ in 0..200 {
            ascent.step(5e-3, command);
        }
        prop_assert!((ascent.attitude().norm() - 1.0).abs() < 1e-12);
        prop_assert!(ascent.tilt_rad().iter().all(|tilt| tilt.abs() <= std::f64::consts::PI));
        prop_assert!(ascent.specific_force_m_s2().iter().all(|felt| felt.is_finite()));
    }
}

#[test]
fn bad_figures_are_named() {
    let good = AscentParameters::SPICA;
    let with_wind = |wind| AscentParameters { wind, ..good };
    let rocket = RocketParameters { burn_s: 0.0, ..good.rocket };
    let gust = Gust { from_m: 0.0, depth_m: 0.0, peak_m_s: [0.0; 3] };
    let turbulence = Turbulence { rms_m_s: -1.0, length_m: 100.0, seed: 0 };
    for (bad, name) in [
        (AscentParameters { rocket, ..good }, "burn_s"),
        (AscentParameters { axial_gyration_m: 0.0, ..good }, "axial_gyration_m"),
        (AscentParameters { rail_m: -1.0, ..good }, "rail_m"),
        (AscentParameters { sensor_m: [0.0, f64::NAN, 0.0], ..good }, "sensor_m"),
        (AscentParameters { misalignment_rad: [f64::INFINITY, 0.0], ..good }, "misalignment_rad"),
        (with_wind(Wind { steady_m_s: [f64::NAN; 3], ..Wind::default() }), "steady_m_s"),
        (with_wind(Wind { gust: Some(gust), ..Wind::default() }), "depth_m"),
        (with_wind(Wind { turbulence: Some(turbulence), ..Wind::default() }), "rms_m_s"),
    ] {
        let error = Ascent::new(&bad, UnitQuaternion::identity()).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}
