//! The rocket that the drone stands for: pitch and yaw of Spica through its burn.
//!
//! While roll is held, pitch and yaw are two equal and independent axes,
//!
//! ```text
//! I th'' = -F x_cm delta - q S CNa (static margin) alpha
//! th''   = -mu_c delta - mu_a alpha,     alpha = th
//! ```
//!
//! with mass, centre of mass and inertia changing as propellant burns, and the dynamic pressure `q`
//! of a vertical run. The centre of pressure is fixed in the body, and the centre of mass moves
//! away from it. Left out: lateral drift and wind, slosh, bending, jet damping.
//!
//! The stated figures do not fit each other. 100 kN from 2600 kg in 90 s imply a specific impulse
//! of 353 s, too much for oxygen and ethanol (at 250 s the burn would last 64 s). A vertical run on
//! them ends at 2.5 km/s and 84 km, where 1 km/s and 50 km are stated. They are used as stated.

mod motor;

use serde::{Deserialize, Serialize};

pub use self::motor::{Motor, MotorError, ThrustCurve};
use crate::parameters::{Checked, check, finite, named, positive};

/// Density of air at sea level, in kg/m3.
const SEA_LEVEL_KG_M3: f64 = 1.225;
/// Gravity, in m/s2.
pub const GRAVITY_M_S2: f64 = 9.81;
/// Step of the ascent, in s.
const ASCENT_STEP_S: f64 = 0.01;
/// The gimbal's effect counts at least as with so much of the mean thrust: at both ends of a thrust
/// curve, gains that follow from it would have no bound.
const LEAST_THRUST: f64 = 0.4;

/// The rocket's figures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RocketParameters {
    /// Thrust, in N: its mean where it has a curve.
    pub thrust_n: f64,
    /// How the thrust changes over the burn; constant without.
    #[serde(skip)]
    pub curve: Option<ThrustCurve>,
    /// Mass at burn-out, in kg.
    pub dry_mass_kg: f64,
    /// Propellant, in kg.
    pub propellant_kg: f64,
    /// Duration of the burn, in s.
    pub burn_s: f64,
    /// Centre of mass at burn-out, from the gimbal, in m.
    pub dry_cm_m: f64,
    /// Inertia at burn-out, about its centre of mass, in kg m2.
    pub dry_inertia_kg_m2: f64,
    /// Length of the full propellant column, in m; it shrinks onto its base.
    pub column_m: f64,
    /// Base of the propellant column, from the gimbal, in m.
    pub column_base_m: f64,
    /// Diameter, in m: reference of area and of the static margin.
    pub diameter_m: f64,
    /// Slope of the normal force over angle of attack, in 1/rad.
    pub normal_force_slope: f64,
    /// Centre of pressure behind the centre of mass at lift-off, in diameters; negative is
    /// unstable.
    pub static_margin: f64,
    /// Drag coefficient.
    pub drag: f64,
    /// Scale height of the atmosphere, in m.
    pub scale_height_m: f64,
    /// Largest gimbal angle either side, in rad.
    pub gimbal_limit_rad: f64,
    /// Largest gimbal rate, in rad/s.
    pub gimbal_rate_rad_s: f64,
    /// Bandwidth of the gimbal's first-order lag, in Hz.
    pub gimbal_hz: f64,
    /// First bending mode, in Hz: it bounds the gains.
    pub bending_hz: f64,
    /// How it bends; without, the model is rigid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bending: Option<Bending>,
    /// Damping of the liquid propellant's slosh; without, it does not move.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slosh_damping: Option<f64>,
}

/// How a rocket bends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bending {
    /// Length of the airframe, in m.
    pub length_m: f64,
    /// Damping of either mode, as a share of the critical.
    pub damping: f64,
}

impl RocketParameters {
    /// Spica as stated, with estimates for what is not: structure, aerodynamics, gimbal; the
    /// atmosphere and drag give its stated Mach 1 near 20 s and 57 kPa at 32 s.
    pub const SPICA: Self = Self {
        thrust_n: 100e3,
        curve: None,
        dry_mass_kg: 1400.0,
        propellant_kg: 2600.0,
        burn_s: 90.0,
        dry_cm_m: 7.0,
        dry_inertia_kg_m2: 1.15 * 1400.0 * 13.0 * 13.0 / 12.0,
        column_m: 3.8,
        column_base_m: 1.5,
        diameter_m: 0.955,
        normal_force_slope: 4.5,
        static_margin: 1.5,
        drag: 0.4,
        scale_height_m: 7800.0,
        gimbal_limit_rad: 5.0 * std::f64::consts::PI / 180.0,
        gimbal_rate_rad_s: 30.0 * std::f64::consts::PI / 180.0,
        gimbal_hz: 5.0,
        bending_hz: 6.0,
        bending: None,
        slosh_damping: None,
    };

    /// Spica with an airframe that is unstable for the first 70 s: at first half the aerodynamic
    /// moment, of the other sign.
    pub const SPICA_UNSTABLE: Self = Self { static_margin: -0.75, ..Self::SPICA };

    /// Checks that every figure is finite and in range.
    ///
    /// # Errors
    /// The first figure out of range, by name.
    pub fn validate(&self) -> Checked {
        positive(&named!(self;
            thrust_n, dry_mass_kg, propellant_kg, burn_s, dry_cm_m, dry_inertia_kg_m2, column_m,
            diameter_m, scale_height_m, gimbal_limit_rad, gimbal_rate_rad_s, gimbal_hz,
            bending_hz,
        ))?;
        if let Some(bending) = self.bending {
            positive(&named!(bending; length_m, damping))?;
        }
        if let Some(slosh_damping) = self.slosh_damping {
            positive(&named!(slosh_damping))?;
        }
        // Its ascent is kept in steps.
        check(&named!(self; burn_s), "at most 600", |burn_s| burn_s <= 600.0)?;
        finite(&named!(self; column_base_m, normal_force_slope, static_margin, drag))
    }

    /// Thrust at a time of the burn (s), in N, and the share of the propellant that has burnt.
    pub(crate) fn burn_at(&self, time_s: f64) -> (f64, f64) {
        let share = time_s / self.burn_s;
        self.curve.map_or((self.thrust_n, share), |curve| {
            let (thrust, burnt) = curve.at(share);
            (self.thrust_n * thrust, burnt)
        })
    }

    /// Mass and inertia at a time since ignition (s), held within the burn.
    pub fn mass_at(&self, time_s: f64) -> MassProperties {
        let left = 1.0 - self.burn_at(time_s.clamp(0.0, self.burn_s)).1;
        let propellant = self.propellant_kg * left;
        let column = self.column_m * left;
        let column_cm = self.column_base_m + 0.5 * column;
        let mass_kg = self.dry_mass_kg + propellant;
        let cm_m = (self.dry_mass_kg * self.dry_cm_m + propellant * column_cm) / mass_kg;
        let (dry, wet) = (self.dry_cm_m - cm_m, column_cm - cm_m);
        let column_inertia = column * column / 12.0 + wet * wet;
        MassProperties {
            mass_kg,
            cm_m,
            inertia_kg_m2: self.dry_inertia_kg_m2
                + self.dry_mass_kg * dry * dry
                + propellant * column_inertia,
        }
    }

    /// How far the centre of pressure lies behind the centre of mass, in m.
    pub(crate) fn behind_m(&self, mass: &MassProperties) -> f64 {
        self.static_margin * self.diameter_m + mass.cm_m - self.mass_at(0.0).cm_m
    }

    /// What the jet takes of a rate across the axis, in 1/s, at a time of the burn (s). The flow
    /// `m'` leaves at the gimbal with its angular momentum, and the inertia `I` shrinks:
    /// `(I' + m' x_cm^2) / I`.
    pub(crate) fn jet_damping_per_s(&self, time_s: f64) -> f64 {
        let step_s = 1e-4 * self.burn_s;
        let middle_s = time_s.clamp(step_s, self.burn_s - step_s);
        let [before, now, after] =
            [-step_s, 0.0, step_s].map(|from_s| self.mass_at(middle_s + from_s));
        let per_s = 0.5 / step_s;
        let inertia_kg_m2_s = (after.inertia_kg_m2 - before.inertia_kg_m2) * per_s;
        let flow_kg_s = (before.mass_kg - after.mass_kg) * per_s;
        (inertia_kg_m2_s + flow_kg_s * now.cm_m * now.cm_m) / now.inertia_kg_m2
    }

    /// Area to which pressures refer, in m2.
    pub(crate) fn area_m2(&self) -> f64 {
        std::f64::consts::FRAC_PI_4 * self.diameter_m * self.diameter_m
    }

    /// Density of the air at an altitude (m), in kg/m3.
    pub(crate) fn density_kg_m3(&self, altitude_m: f64) -> f64 {
        SEA_LEVEL_KG_M3 * (-altitude_m / self.scale_height_m).exp()
    }
}

/// Mass and inertia at a time of the burn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Centre of mass, from the gimbal, in m.
    pub cm_m: f64,
    /// Inertia across the axis about the centre of mass, in kg m2.
    pub inertia_kg_m2: f64,
}

/// The rocket at a time of its burn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Mass and inertia.
    pub mass: MassProperties,
    /// Angular acceleration for each radian of gimbal, in 1/s2, with 0.4 of the mean thrust at
    /// least.
    pub mu_c: f64,
    /// Restoring angular acceleration for each radian of angle of attack, in 1/s2.
    pub mu_a: f64,
    /// Dynamic pressure, in Pa.
    pub pressure_pa: f64,
    /// Speed, in m/s.
    pub speed_m_s: f64,
    /// Altitude, in m.
    pub altitude_m: f64,
}

/// Gains on attitude and rate: gimbal angle `kp error + kd rate`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// On the attitude's error, rad/rad.
    pub kp: f64,
    /// On the rate, rad s/rad.
    pub kd: f64,
}

impl Flight {
    /// The gains that give a natural frequency (rad/s) and damping here. The airframe's own
    /// stiffness is used, but the gimbal keeps at least a fifth of the stiffness to itself.
    pub fn gains(&self, natural_rad_s: f64, damping: f64) -> Gains {
        let stiffness = natural_rad_s * natural_rad_s;
        Gains {
            kp: (stiffness - self.mu_a).max(0.2 * stiffness) / self.mu_c,
            kd: 2.0 * damping * natural_rad_s / self.mu_c,
        }
    }
}

/// A rocket and its vertical ascent.
#[derive(Clone, Debug)]
pub struct Rocket {
    parameters: RocketParameters,
    /// Speed and altitude every [`ASCENT_STEP_S`].
    ascent: Vec<[f64; 2]>,
}

impl Rocket {
    /// Computes the ascent and keeps it.
    ///
    /// # Errors
    /// As [`RocketParameters::validate`].
    pub fn new(parameters: &RocketParameters) -> Checked<Self> {
        parameters.validate()?;
        let p = parameters;
        let area = p.area_m2();
        let steps = (p.burn_s / ASCENT_STEP_S).ceil() as usize;
        let mut ascent = Vec::with_capacity(steps + 1);
        let mut state = [0.0, 0.0];
        ascent.push(state);
        for i in 0..steps {
            let now = i as f64 * ASCENT_STEP_S;
            let slope = |t: f64, &[speed, altitude]: &[f64; 2]| {
                let (thrust, burnt) = p.burn_at(t);
                let mass = p.dry_mass_kg + p.propellant_kg * (1.0 - burnt);
                let drag = pressure(p, speed, altitude) * area * p.drag;
                [(thrust - drag) / mass - GRAVITY_M_S2, speed]
            };
            state = crate::integrate::rk4_step(slope, now, &state, ASCENT_STEP_S);
            ascent.push(state);
        }
        Ok(Self { parameters: *parameters, ascent })
    }

    /// The rocket at a time since ignition (s), held within the burn.
    pub fn at(&self, time_s: f64) -> Flight {
        let p = &self.parameters;
        let time_s = time_s.clamp(0.0, p.burn_s);
        let mass = p.mass_at(time_s);
        let thrust_n = p.burn_at(time_s).0.max(LEAST_THRUST * p.thrust_n);
        let place = time_s / ASCENT_STEP_S;
        let before = (place as usize).min(self.ascent.len() - 2);
        let part = place - before as f64;
        let between = |i: usize| {
            let (a, b) = (self.ascent[before][i], self.ascent[before + 1][i]);
            a + part * (b - a)
        };
        let (speed_m_s, altitude_m) = (between(0), between(1));
        let pressure_pa = pressure(p, speed_m_s, altitude_m);
        let area = p.area_m2();
        let lever = p.behind_m(&mass);
        Flight {
            mass,
            mu_c: thrust_n * mass.cm_m / mass.inertia_kg_m2,
            mu_a: pressure_pa * area * p.normal_force_slope * lever / mass.inertia_kg_m2,
            pressure_pa,
            speed_m_s,
            altitude_m,
        }
    }
}

/// Dynamic pressure in an exponential atmosphere, in Pa.
fn pressure(p: &RocketParameters, speed_m_s: f64, altitude_m: f64) -> f64 {
    0.5 * p.density_kg_m3(altitude_m) * speed_m_s * speed_m_s
}

#[cfg(test)]
mod tests {
    mod drift;
    mod schedule;
    mod two_axes;

    use super::*;

    fn spica() -> Rocket {
        Rocket::new(&RocketParameters::SPICA).unwrap()
    }

    /// Reference: mass, centre of mass, inertia, control and aerodynamic coefficient.
    #[test]
    fn schedule_table() {
        for (time, mass, cm, inertia, mu_c, mu_a) in [
            (0.0, 4000.0, 4.66, 37596.0, 12.4, 0.0),
            (20.0, 3422.0, 4.62, 37530.0, 12.3, 5.0),
            (32.0, 3076.0, 4.67, 37454.0, 12.5, 7.10),
            (60.0, 2267.0, 5.14, 35468.0, 14.5, 2.83),
            (75.0, 1833.0, 5.77, 31579.0, 18.3, 0.58),
            (90.0, 1400.0, 7.00, 22674.0, 30.9, 0.04),
        ] {
            let f = spica().at(time);
            assert!((f.mass.mass_kg - mass).abs() < 0.5);
            assert!((f.mass.cm_m - cm).abs() < 0.0051);
            assert!((f.mass.inertia_kg_m2 - inertia).abs() < 1.0);
            assert!((f.mu_c - mu_c).abs() < 0.051);
            assert!((f.mu_a - mu_a).abs() < 0.1, "{} {mu_a}", f.mu_a);
        }
    }

    /// Reference: a balance of angular momentum over body and jet.
    #[test]
    fn the_jet_damps_as_the_balance_of_momentum_says() {
        for (time_s, per_s) in [(0.0, 0.0164), (90.0, 0.0239)] {
            let found = RocketParameters::SPICA.jet_damping_per_s(time_s);
            assert!((found - per_s).abs() < 1e-4, "{time_s}: {found}");
        }
    }

    /// An airframe that is unstable at lift-off is stable when the propellant has gone.
    #[test]
    fn the_centre_of_pressure_stays_in_the_body() {
        let rocket = Rocket::new(&RocketParameters::SPICA_UNSTABLE).unwrap();
        for (time_s, mu_a) in [(32.0, -3.47), (60.0, -0.35), (75.0, 0.09)] {
            let found = rocket.at(time_s).mu_a;
            assert!((found - mu_a).abs() < 0.01, "{time_s}: {found}");
        }
    }

    #[test]
    fn bad_figures_are_named() {
        let p = RocketParameters { burn_s: 0.0, ..RocketParameters::SPICA };
        assert!(Rocket::new(&p).unwrap_err().to_string().contains("burn_s"));
    }
}
