//! The figures of a rocket that ascends.

use super::wind::Wind;
use crate::parameters::{Checked, finite, named, not_negative, positive};
use crate::rocket::RocketParameters;

/// The figures of the rocket's ascent. Positions in the rocket count from its gimbal, along the
/// body's axes, so that the nose is at negative z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AscentParameters {
    /// Thrust, masses, aerodynamics and gimbal.
    pub rocket: RocketParameters,
    /// Radius of gyration about the rocket's axis, in m; an estimate.
    pub axial_gyration_m: f64,
    /// How far the rocket moves before it leaves its rail, in m.
    pub rail_m: f64,
    /// Where the sensor sits, in m.
    pub sensor_m: [f64; 3],
    /// Angles by which the thrust is off the rocket's axis while the gimbal is at zero, pitch and
    /// roll, in rad; counted as those of the gimbal.
    pub misalignment_rad: [f64; 2],
    /// The wind.
    pub wind: Wind,
}

impl AscentParameters {
    /// Spica as stated, with a static margin of 1.5 diameters.
    pub const SPICA: Self = Self::of(RocketParameters::SPICA);

    /// Spica with an unstable airframe.
    pub const SPICA_UNSTABLE: Self = Self::of(RocketParameters::SPICA_UNSTABLE);

    /// A rocket in calm air on a rail of 5 m, with its sensor on its axis 9 m above the gimbal,
    /// whose mass is spread over its cross-section as in a cylinder; rail and sensor are estimates.
    pub const fn of(rocket: RocketParameters) -> Self {
        Self {
            rocket,
            axial_gyration_m: 0.5 * std::f64::consts::FRAC_1_SQRT_2 * rocket.diameter_m,
            rail_m: 5.0,
            sensor_m: [0.0, 0.0, -9.0],
            misalignment_rad: [0.0; 2],
            wind: Wind { steady_m_s: [0.0; 3], gust: None, turbulence: None },
        }
    }

    /// Checks that every figure is finite and in range.
    ///
    /// # Errors
    /// The first figure out of range, by name.
    pub fn validate(&self) -> Checked {
        self.rocket.validate()?;
        positive(&named!(self; axial_gyration_m))?;
        not_negative(&named!(self; rail_m))?;
        finite(&named!(self;
            sensor_m[0], sensor_m[1], sensor_m[2], misalignment_rad[0], misalignment_rad[1],
        ))?;
        self.wind.validate()
    }
}
