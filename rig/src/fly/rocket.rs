//! The rocket on the rig: what stands on its pad, and the parameters that its image needs.
//!
//! Spica burns for 90 s; its mass falls to a third, and a gimbal angle turns it by the end two and
//! a half times as hard. Its laws are proportional-integral-derivative with gains that follow the
//! burn, or with constant ones, and a cascade.

use plant::ascent::{AscentParameters, Gust, Turbulence, Wind};
use plant::rocket::{Rocket, RocketParameters};
use rand::Rng;
use std::f64::consts::{PI, TAU};
use tvc_pid::Gains;

use crate::bench::{Kick, RocketConfig, SHAFT_PER_GIMBAL};
use crate::named_enum::named_enum;
use crate::random::{Stream, generator};

/// A degree, rad.
const DEG: f64 = PI / 180.0;

/// Tilt of the rail, which the rocket leaves with it: the first kick, rad.
pub const RAIL_TILT_RAD: f64 = 5.0 * DEG;
/// Times of the other kicks, s since ignition.
pub const KICKS_S: [f64; 4] = [20.0, 37.0, 60.0, 84.0];
/// The rate of such a kick, rad/s: the rocket turns by some 5 deg before its gimbal has stopped it.
pub const KICK_RAD_S: f64 = 0.3;
/// Angle by which the thrust is off the rocket's axis, rad.
pub const MISALIGNMENT_RAD: f64 = 2.0 * DEG;
/// The wind: the same everywhere, m/s.
pub const WIND_M_S: f64 = 8.0;
/// A gust in a layer of the air that the rocket passes at its greatest dynamic pressure: peak, m/s.
pub const GUST_M_S: f64 = 12.0;
/// Altitude of the layer's base and its depth, m.
pub const GUST_LAYER_M: [f64; 2] = [7_000.0, 1_500.0];
/// Turbulence, m/s rms in each direction, and its length, m.
pub const TURBULENCE: [f64; 2] = [1.5, 300.0];

named_enum! {
    /// Whether the air turns the rocket back to its path or away from it.
    Airframe, "airframe";
    /// The centre of pressure is 1.5 diameters behind the centre of mass.
    Stable = "stable",
    /// It is 0.75 diameters before it.
    Unstable = "unstable",
}

impl Airframe {
    /// Its figures.
    pub fn parameters(self) -> RocketParameters {
        match self {
            Self::Stable => RocketParameters::SPICA,
            Self::Unstable => RocketParameters::SPICA_UNSTABLE,
        }
    }

    /// What its scheduled gains are made for, as `tvc tune --vehicle rocket` found it.
    pub fn design(self) -> Design {
        match self {
            Self::Stable => Design { natural_rad_s: 4.646, damping: 0.642, integral: 0.148 },
            Self::Unstable => Design { natural_rad_s: 4.264, damping: 0.702, integral: 0.127 },
        }
    }

    /// The constant gains of the gimbal with which it flies best, as the same search found them.
    pub fn constant_gains(self) -> Gains {
        match self {
            Self::Stable => Gains { kp: 1.1108, ki: 0.3533, kd: 0.194 },
            Self::Unstable => Gains { kp: 1.147, ki: 0.2341, kd: 0.1934 },
        }
    }

    /// The rocket on its pad in the wind, with all directions from a seed.
    pub fn on_pad(self, seed: u64) -> RocketConfig {
        let mut dice = generator(seed, Stream::Ascent);
        let mut direction = || {
            let (sin, cos) = dice.random_range(0.0..TAU).sin_cos();
            [cos, sin]
        };
        let tilt = direction();
        let misalignment = direction();
        let [wind_north, wind_east] = direction();
        let [gust_north, gust_east] = direction();
        let kicks = KICKS_S
            .map(|at_s| Kick { at_s, rates_rad_s: direction().map(|share| share * KICK_RAD_S) });
        let [from_m, depth_m] = GUST_LAYER_M;
        let [rms_m_s, length_m] = TURBULENCE;
        RocketConfig {
            parameters: AscentParameters {
                misalignment_rad: misalignment.map(|share| share * MISALIGNMENT_RAD),
                wind: Wind {
                    steady_m_s: [wind_north * WIND_M_S, wind_east * WIND_M_S, 0.0],
                    gust: Some(Gust {
                        from_m,
                        depth_m,
                        peak_m_s: [gust_north * GUST_M_S, gust_east * GUST_M_S, 0.0],
                    }),
                    turbulence: Some(Turbulence { rms_m_s, length_m, seed }),
                },
                ..AscentParameters::of(self.parameters())
            },
            start_rad: tilt.map(|share| share * RAIL_TILT_RAD),
            kicks: kicks.to_vec(),
        }
    }
}

/// By how much rockets differ from their figures, either way: thrust, and inertia and propellant,
/// as shares; the dry centre of mass, m; the static margin, diameters; speed and bandwidth of the
/// gimbal, as a share.
const THRUST: f64 = 0.05;
const INERTIA: f64 = 0.2;
const PROPELLANT: f64 = 0.03;
const CENTRE_M: f64 = 0.3;
const MARGIN: f64 = 0.4;
const GIMBAL: f64 = 0.2;

/// A rocket that is not as its image was told, drawn from a seed: wind, gust and misalignment are
/// anything up to those of [`Airframe::on_pad`], and the total impulse is that of the propellant.
pub fn dispersed(seed: u64) -> (Airframe, RocketConfig) {
    let airframe = Airframe::ALL[(seed % 2) as usize];
    let mut config = airframe.on_pad(seed);
    let mut dice = generator(seed, Stream::Campaign);
    let mut about = |share: f64| dice.random_range(-share..=share);
    let rocket = &mut config.parameters.rocket;
    let (thrust, propellant) = (1.0 + about(THRUST), 1.0 + about(PROPELLANT));
    rocket.thrust_n *= thrust;
    rocket.propellant_kg *= propellant;
    rocket.burn_s *= propellant / thrust;
    rocket.dry_inertia_kg_m2 *= 1.0 + about(INERTIA);
    rocket.dry_cm_m += about(CENTRE_M);
    rocket.static_margin += about(MARGIN);
    rocket.gimbal_rate_rad_s *= 1.0 + about(GIMBAL);
    rocket.gimbal_hz *= 1.0 + about(GIMBAL);
    let mut part = || 0.5 + about(0.5);
    let parameters = &mut config.parameters;
    let scaled = |values: &mut [f64], part: f64| values.iter_mut().for_each(|value| *value *= part);
    scaled(&mut parameters.misalignment_rad, part());
    scaled(&mut parameters.wind.steady_m_s, part());
    if let Some(gust) = &mut parameters.wind.gust {
        scaled(&mut gust.peak_m_s, part());
    }
    scaled(&mut config.start_rad, part());
    (airframe, config)
}

/// How the rocket is controlled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RocketLaw {
    /// Proportional, integral and derivative, with gains that follow the burn.
    Scheduled,
    /// The same with constant gains, of the gimbal.
    Constant(Gains),
    /// A loop of the angle around one of the rate, with gains that follow the burn.
    Cascade,
}

/// What scheduled gains are made for, throughout the burn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design {
    /// Natural frequency of the closed loop, rad/s.
    pub natural_rad_s: f64,
    /// Its damping.
    pub damping: f64,
    /// Integral gain as a share of the natural frequency's cube, over the gimbal's effect.
    pub integral: f64,
}

/// Times of the schedule's rows, s.
pub const ROWS_S: [f64; 6] = [0.0, 20.0, 37.0, 60.0, 78.0, 90.0];

impl Design {
    /// The gains of the gimbal at a time of a rocket's burn, s.
    pub fn gains(&self, rocket: &Rocket, time_s: f64) -> Gains {
        let flight = rocket.at(time_s);
        let gains = flight.gains(self.natural_rad_s, self.damping);
        Gains {
            kp: gains.kp as f32,
            ki: (self.integral * self.natural_rad_s.powi(3) / flight.mu_c) as f32,
            kd: gains.kd as f32,
        }
    }
}

/// The parameters of the image that steers the rocket, where they differ from the drone's.
pub fn parameters(airframe: Airframe, law: RocketLaw) -> Vec<(String, f32)> {
    let limit = airframe.parameters().gimbal_limit_rad;
    let rate = airframe.parameters().gimbal_rate_rad_s;
    // A shaft turns by 1 deg for 10 us.
    let us_per_rad = 10.0 * SHAFT_PER_GIMBAL / DEG;
    let centre_us = crate::bench::ZERO_RUDDER_US;
    let ends = [-limit, limit].map(|angle| (centre_us + angle * us_per_rad) as f32);
    let mut all = Vec::new();
    let mut set = |name: &str, value: f32| all.push((name.to_owned(), value));
    set("AXES", 2.0);
    set("FUSE_ACC", 0.0);
    set("LAUNCH_ACC", 15.0);
    set("BURNOUT_ACC", 5.0);
    set("BURN_S", 100.0);
    set("SRV_SLEW_US_S", (rate * us_per_rad) as f32);
    for servo in ["SRV", "SRV2"] {
        set(&format!("{servo}_POLARITY"), 1.0);
        set(&format!("{servo}_MIN_US"), ends[0]);
        set(&format!("{servo}_MAX_US"), ends[1]);
    }
    let shaft = |gains: Gains| {
        let scale = SHAFT_PER_GIMBAL as f32;
        [("KP", gains.kp * scale), ("KI", gains.ki * scale), ("KD", gains.kd * scale)]
    };
    match law {
        RocketLaw::Constant(gains) => {
            set("PID_LAW", 0.0);
            set("GS_ROWS", 0.0);
            for (name, gain) in shaft(gains) {
                set(&format!("PID_{name}"), gain);
            }
        }
        RocketLaw::Scheduled | RocketLaw::Cascade => {
            set("PID_LAW", if law == RocketLaw::Cascade { 3.0 } else { 0.0 });
            set("GS_ROWS", ROWS_S.len() as f32);
            if let Ok(rocket) = Rocket::new(&airframe.parameters()) {
                for (row, at_s) in (1..).zip(ROWS_S) {
                    set(&format!("GS{row}_S"), at_s as f32);
                    for (name, gain) in shaft(airframe.design().gains(&rocket, at_s)) {
                        set(&format!("GS{row}_{name}"), gain);
                    }
                }
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::ascent::Ascent;
    use tvc_nano::Params;

    #[test]
    fn every_law_of_either_airframe_is_within_the_parameters_ranges() {
        for airframe in Airframe::ALL {
            let constant = RocketLaw::Constant(airframe.constant_gains());
            for law in [RocketLaw::Scheduled, constant, RocketLaw::Cascade] {
                let mut params = Params::default();
                for (name, value) in parameters(airframe, law) {
                    let set = params.set(&name, value);
                    assert!(set.is_ok(), "{airframe:?}, {law:?}: {name} {value}");
                }
            }
        }
    }

    #[test]
    fn rockets_of_all_seeds_are_possible_and_differ() {
        let mut thrusts: Vec<f64> = (0..200)
            .map(|seed| {
                let (_, config) = dispersed(seed);
                let attitude = nalgebra::UnitQuaternion::identity();
                assert!(Ascent::new(&config.parameters, attitude).is_ok(), "{seed}");
                let [pitch, roll] = config.start_rad;
                assert!(pitch.hypot(roll) <= RAIL_TILT_RAD + 1e-9);
                config.parameters.rocket.thrust_n
            })
            .collect();
        thrusts.sort_by(f64::total_cmp);
        assert!(thrusts[0] < 96e3 && thrusts[199] > 104e3, "{thrusts:?}");
    }

    /// The gains at lift-off are those of the reference: a natural frequency and a damping, over
    /// the gimbal's effect of 12.4 1/s2.
    #[test]
    fn gains_give_their_design() {
        let rocket = Rocket::new(&RocketParameters::SPICA).unwrap();
        let design = Design { natural_rad_s: 3.0, damping: 0.8, integral: 0.1 };
        let gains = design.gains(&rocket, 0.0);
        assert!((gains.kp - 9.0 / 12.4).abs() < 3e-3);
        assert!((gains.kd - 4.8 / 12.4).abs() < 3e-3);
        assert!((gains.ki - 2.7 / 12.4).abs() < 3e-3);
    }
}
