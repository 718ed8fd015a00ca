//! The rocket on the rig: what stands on its pad, and the parameters that its image needs.
//!
//! Spica burns for 90 s; its mass falls to a third, and a gimbal angle turns it by the end two and
//! a half times as hard. Its laws are proportional-integral-derivative with gains that follow the
//! burn, or with constant ones, and a cascade.

use plant::ParameterError;
use plant::ascent::{AscentParameters, Gust, Turbulence, Wind};
use plant::parameters::check;
use plant::rocket::{GRAVITY_M_S2, Rocket, RocketParameters};
use rand::Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use tvc_pid::Gains;

use crate::bench::{Kick, RocketConfig};
use crate::random::{Stream, generator};

/// A degree, rad.
const DEG: f64 = PI / 180.0;
/// Least angular acceleration for each radian of Spica's gimbal, 1/s2.
const SPICA_EFFECT: f64 = 12.3;

/// What a rocket meets on its way; all directions come from a seed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Way along the rail, m.
    pub rail_m: f64,
    /// Tilt of the rail, which the rocket leaves with it: the first kick, rad.
    pub rail_tilt_rad: f64,
    /// Angle by which the thrust is off the rocket's axis, rad.
    pub misalignment_rad: f64,
    /// Times of the kicks, s since ignition.
    pub kicks_s: [f64; 4],
    /// The rate of a kick, rad/s.
    pub kick_rad_s: f64,
    /// The wind: the same everywhere, m/s.
    pub wind_m_s: f64,
    /// A gust in a layer of the air: peak, m/s.
    pub gust_m_s: f64,
    /// Altitude of the layer's base, m.
    pub gust_from_m: f64,
    /// Depth of the layer, m.
    pub gust_depth_m: f64,
    /// Turbulence, rms in each direction, m/s.
    pub turbulence_m_s: f64,
    /// Its length, m.
    pub turbulence_length_m: f64,
}

impl Conditions {
    /// Calm air, a rail that stands upright, and no kick.
    pub const CALM: Self = Self {
        rail_m: 5.0,
        rail_tilt_rad: 0.0,
        misalignment_rad: 0.0,
        kicks_s: [0.0; 4],
        kick_rad_s: 0.0,
        wind_m_s: 0.0,
        gust_m_s: 0.0,
        gust_from_m: 0.0,
        gust_depth_m: 1_500.0,
        turbulence_m_s: 0.0,
        turbulence_length_m: 300.0,
    };

    /// Those of Spica: a kick turns it by some 5 deg before its gimbal has stopped it, and it
    /// passes the gust at its greatest dynamic pressure.
    pub const SPICA: Self = Self {
        rail_tilt_rad: 5.0 * DEG,
        misalignment_rad: 2.0 * DEG,
        kicks_s: [20.0, 37.0, 60.0, 84.0],
        kick_rad_s: 0.3,
        wind_m_s: 8.0,
        gust_m_s: 12.0,
        gust_from_m: 7_000.0,
        turbulence_m_s: 1.5,
        ..Self::CALM
    };
}

/// How sensor and actuators sit in a rocket.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mounting {
    /// The sensor, from the gimbal along the body's axes, m: the nose is at negative z.
    pub sensor_m: [f64; 3],
    /// Angle of an actuator's shaft for one of the gimbal.
    pub shaft_per_gimbal: f64,
}

impl Mounting {
    /// That of Spica: the sensor is 9 m above the gimbal, of which 5 deg are 30 deg, 300 us of
    /// pulse.
    pub const SPICA: Self =
        Self { sensor_m: AscentParameters::SPICA.sensor_m, shaft_per_gimbal: 6.0 };
}

/// A rocket as its image is told of it, and what it meets.
#[derive(Clone, Debug, PartialEq)]
pub struct Airframe {
    /// Its name in reports.
    pub name: String,
    /// Masses, thrust, air and gimbal, in calm air, with the thrust along the axis.
    parameters: AscentParameters,
    /// Sensor and actuators.
    pub mounting: Mounting,
    /// What it meets.
    pub conditions: Conditions,
    /// What its scheduled gains are made for.
    pub design: Design,
    /// Constant gains of the gimbal.
    pub constant_gains: Gains,
}

impl Airframe {
    /// Spica, whose centre of pressure is 1.5 diameters behind its centre of mass.
    pub fn stable() -> Self {
        Self {
            name: "stable".to_owned(),
            parameters: AscentParameters::SPICA,
            mounting: Mounting::SPICA,
            conditions: Conditions::SPICA,
            // As `tvc tune --vehicle rocket` found them.
            design: Design::STABLE,
            constant_gains: Gains { kp: 1.1108, ki: 0.3533, kd: 0.194 },
        }
    }

    /// Spica with a centre of pressure 0.75 diameters before its centre of mass.
    pub fn unstable() -> Self {
        Self {
            name: "unstable".to_owned(),
            parameters: AscentParameters::SPICA_UNSTABLE,
            design: Design::UNSTABLE,
            constant_gains: Gains { kp: 1.147, ki: 0.2341, kd: 0.1934 },
            ..Self::stable()
        }
    }

    /// A rocket by its figures, with the gains that Spica's design gives it. The design is made
    /// slower where the gimbal has less effect than Spica's, so that the rate gain is no higher.
    ///
    /// # Errors
    /// The first figure out of range, by name.
    pub fn new(
        name: String,
        rocket: RocketParameters,
        mounting: Mounting,
        conditions: Conditions,
    ) -> Result<Self, ParameterError> {
        let mut design = if rocket.static_margin > 0.0 { Design::STABLE } else { Design::UNSTABLE };
        let table = Rocket::new(&rocket)?;
        let effects = rows_s(rocket.burn_s).map(|at_s| table.at(at_s).mu_c);
        let least = effects.into_iter().fold(SPICA_EFFECT, f64::min);
        design.natural_rad_s *= least / SPICA_EFFECT;
        let constant_gains = design.gains(&table, 0.5 * rocket.burn_s);
        let parameters =
            AscentParameters { sensor_m: mounting.sensor_m, ..AscentParameters::of(rocket) };
        let airframe = Self { name, parameters, mounting, conditions, design, constant_gains };
        let ratio = ("shaft_per_gimbal", mounting.shaft_per_gimbal);
        check(&[ratio], "0.1 to 100", |ratio| (0.1..=100.0).contains(&ratio))?;
        let Conditions { rail_tilt_rad, misalignment_rad, kick_rad_s, .. } = conditions;
        for (name, size) in [
            ("rail_tilt_rad", rail_tilt_rad),
            ("misalignment_rad", misalignment_rad),
            ("kick_rad_s", kick_rad_s),
        ] {
            check(&[(name, size)], "0 to 0.8", |size| (0.0..=0.8).contains(&size))?;
        }
        airframe.on_pad(1).parameters.validate()?;
        Ok(airframe)
    }

    /// Its figures.
    pub fn rocket(&self) -> &RocketParameters {
        &self.parameters.rocket
    }

    /// The rocket on its pad, with all directions of what it meets from a seed.
    pub fn on_pad(&self, seed: u64) -> RocketConfig {
        let mut dice = generator(seed, Stream::Ascent);
        let met = &self.conditions;
        let mut direction = |size: f64| {
            let (sin, cos) = dice.random_range(0.0..TAU).sin_cos();
            [cos * size, sin * size]
        };
        let start_rad = direction(met.rail_tilt_rad);
        let misalignment_rad = direction(met.misalignment_rad);
        let [wind_north, wind_east] = direction(met.wind_m_s);
        let [gust_north, gust_east] = direction(met.gust_m_s);
        let kicks = met.kicks_s.map(|at_s| Kick { at_s, rates_rad_s: direction(met.kick_rad_s) });
        let gust = Gust {
            from_m: met.gust_from_m,
            depth_m: met.gust_depth_m,
            peak_m_s: [gust_north, gust_east, 0.0],
        };
        let (rms_m_s, length_m) = (met.turbulence_m_s, met.turbulence_length_m);
        RocketConfig {
            parameters: AscentParameters {
                misalignment_rad,
                rail_m: met.rail_m,
                wind: Wind {
                    steady_m_s: [wind_north, wind_east, 0.0],
                    gust: Some(gust),
                    turbulence: Some(Turbulence { rms_m_s, length_m, seed }),
                },
                ..self.parameters
            },
            start_rad,
            kicks: kicks.to_vec(),
            shaft_per_gimbal: self.mounting.shaft_per_gimbal,
        }
    }

    /// Times of the schedule's rows, s.
    pub fn rows_s(&self) -> [f64; 6] {
        rows_s(self.rocket().burn_s)
    }
}

/// Times of the rows for a burn, s.
fn rows_s(burn_s: f64) -> [f64; 6] {
    /// Those of a burn of 90 s.
    const SPICA_S: [f64; 6] = [0.0, 20.0, 37.0, 60.0, 78.0, 90.0];
    let scale = burn_s / RocketParameters::SPICA.burn_s;
    SPICA_S.map(|at_s| at_s * scale)
}

// By how much rockets differ from their figures, either way.

/// Thrust, a share.
const THRUST: f64 = 0.05;
/// Inertia, a share.
const INERTIA: f64 = 0.2;
/// Propellant, a share.
const PROPELLANT: f64 = 0.03;
/// The dry centre of mass, m, if it is as far from the gimbal as Spica's.
const CENTRE_M: f64 = 0.3;
/// The static margin, diameters.
const MARGIN: f64 = 0.4;
/// Speed and bandwidth of the gimbal, a share.
const GIMBAL: f64 = 0.2;

/// A rocket that is not as its image was told, drawn from a seed: wind, gust and misalignment are
/// anything up to those of [`Airframe::on_pad`], and the total impulse is that of the propellant.
pub fn dispersed(seed: u64, airframe: &Airframe) -> RocketConfig {
    let mut config = airframe.on_pad(seed);
    let mut dice = generator(seed, Stream::Campaign);
    let mut about = |share: f64| dice.random_range(-share..=share);
    let rocket = &mut config.parameters.rocket;
    let (thrust, propellant) = (1.0 + about(THRUST), 1.0 + about(PROPELLANT));
    rocket.thrust_n *= thrust;
    rocket.propellant_kg *= propellant;
    rocket.burn_s *= propellant / thrust;
    rocket.dry_inertia_kg_m2 *= 1.0 + about(INERTIA);
    let centre = rocket.dry_cm_m / RocketParameters::SPICA.dry_cm_m;
    rocket.dry_cm_m += centre * about(CENTRE_M);
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
    config
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

impl Design {
    /// For Spica, as `tvc tune --vehicle rocket` found it.
    const STABLE: Self = Self { natural_rad_s: 4.646, damping: 0.642, integral: 0.148 };
    /// The same for its unstable airframe.
    const UNSTABLE: Self = Self { natural_rad_s: 4.264, damping: 0.702, integral: 0.127 };

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
pub fn parameters(airframe: &Airframe, law: RocketLaw) -> Vec<(String, f32)> {
    let rocket = airframe.rocket();
    let (limit, rate) = (rocket.gimbal_limit_rad, rocket.gimbal_rate_rad_s);
    let acceleration = rocket.thrust_n / (rocket.dry_mass_kg + rocket.propellant_kg);
    let per_gimbal = airframe.mounting.shaft_per_gimbal;
    // A shaft turns by 1 deg for 10 us.
    let us_per_rad = 10.0 * per_gimbal / DEG;
    let centre_us = crate::bench::ZERO_RUDDER_US;
    let ends = [-limit, limit].map(|angle| (centre_us + angle * us_per_rad) as f32);
    let mut all = Vec::new();
    let mut set = |name: &str, value: f32| all.push((name.to_owned(), value));
    set("AXES", 2.0);
    set("FUSE_ACC", 0.0);
    // Between 1 g and what the thrust gives; well below what it gives; later than the burnout.
    let launch = GRAVITY_M_S2 + (acceleration - GRAVITY_M_S2) / 3.0;
    set("LAUNCH_ACC", launch.round() as f32);
    set("BURNOUT_ACC", (0.2 * acceleration) as f32);
    set("BURN_S", (rocket.burn_s / 0.9) as f32);
    set("SRV_SLEW_US_S", (rate * us_per_rad) as f32);
    for servo in ["SRV", "SRV2"] {
        set(&format!("{servo}_POLARITY"), 1.0);
        set(&format!("{servo}_MIN_US"), ends[0]);
        set(&format!("{servo}_MAX_US"), ends[1]);
    }
    let shaft = |gains: Gains| {
        let scale = per_gimbal as f32;
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
            let rows_s = airframe.rows_s();
            set("GS_ROWS", rows_s.len() as f32);
            if let Ok(rocket) = Rocket::new(rocket) {
                for (row, at_s) in (1..).zip(rows_s) {
                    set(&format!("GS{row}_S"), at_s as f32);
                    for (name, gain) in shaft(airframe.design.gains(&rocket, at_s)) {
                        set(&format!("GS{row}_{name}"), gain);
                    }
                }
            }
        }
    }
    all
}

/// Standard deviation of what six faces of eight seconds each tell of a gyroscope's shift by
/// acceleration, deg/s for each g: ten calibrations at the rig.
const PER_G_SD: f64 = 0.003;

/// The parameters of an image whose gyroscope was calibrated. It shifts on all axes by
/// `per_g_deg_s` for each g along the sensor's z. The calibration's error comes from a seed.
pub fn calibrated(per_g_deg_s: f64, seed: u64) -> [(String, f32); 3] {
    let mut dice = generator(seed, Stream::GyroCalibration);
    // From tail to nose is against the sensor's z.
    let mut found = || -per_g_deg_s + PER_G_SD * dice.sample::<f64, _>(StandardNormal);
    let values = [("GYR_PER_G", PER_G_SD), ("GYR_PER_G_X", found()), ("GYR_PER_G_Y", found())];
    values.map(|(name, value)| (name.to_owned(), value as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::ascent::Ascent;
    use tvc_nano::Params;

    #[test]
    fn every_law_of_either_airframe_is_within_the_parameters_ranges() {
        for airframe in [Airframe::stable(), Airframe::unstable()] {
            let constant = RocketLaw::Constant(airframe.constant_gains);
            for law in [RocketLaw::Scheduled, constant, RocketLaw::Cascade] {
                let mut params = Params::default();
                for (name, value) in parameters(&airframe, law) {
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
                let config = dispersed(seed, &Airframe::stable());
                let attitude = nalgebra::UnitQuaternion::identity();
                assert!(Ascent::new(&config.parameters, attitude).is_ok(), "{seed}");
                let [pitch, roll] = config.start_rad;
                assert!(pitch.hypot(roll) <= Conditions::SPICA.rail_tilt_rad + 1e-9);
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
