//! Bending and slosh: oscillations across the rocket's axis, the same in either plane.
//!
//! # Bending
//! The airframe is a uniform beam, free at both ends, of which two modes oscillate (Blevins,
//! Formulas for natural frequency and mode shape, table 8-1). With the shape `phi`, 1 at the
//! gimbal, a mode has a quarter of the mass:
//!
//! ```text
//! eta'' = -W^2 eta - 2 zeta W eta' + 4 F / m
//! ```
//!
//! with the thrust's part `F` across the axis. The sensor turns with the beam, by `phi'` of its
//! place. Left out: the thrust that turns with the tail, the air's forces on the bent airframe, and
//! frequencies that rise as propellant burns.
//!
//! # Slosh
//! The propellant is a liquid of the depth `h` in a cylinder of the rocket's radius `R`. Its first
//! mode is a mass that slides across it (NASA SP-106, chapter 6), here at the surface:
//!
//! ```text
//! ms  = propellant R / (2.199 h) tanh(1.841 h / R)
//! W^2 = 1.841 f / R tanh(1.841 h / R)
//! s'' = -W^2 s - 2 zeta W s' - a
//! ```
//!
//! with the felt acceleration `f` along the axis and `a` of the tank across it.

use nalgebra::{Vector2, Vector3};

use super::Load;
use crate::rocket::RocketParameters;

/// An oscillation's place and speed across the axis, along the body's x and y; or their slopes.
#[derive(Clone, Copy, Debug, Default)]
struct Oscillation {
    place: Vector2<f64>,
    speed: Vector2<f64>,
}

impl Oscillation {
    fn ahead(&self, slope: &Self, dt_s: f64) -> Self {
        Self { place: self.place + slope.place * dt_s, speed: self.speed + slope.speed * dt_s }
    }

    /// Its slope, where `driven` acts on it and resists its change with a share of its own.
    fn slope(&self, rad_s: f64, damping: f64, driven: Vector2<f64>, resisted: f64) -> Self {
        let free = -rad_s * rad_s * self.place - 2.0 * damping * rad_s * self.speed;
        Self { place: self.speed, speed: (free + driven) / (1.0 - resisted) }
    }
}

/// All oscillations, or their slopes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flexible {
    /// The first mode's and the second's, in m at the gimbal.
    bending: [Oscillation; 2],
    /// The sliding mass, in m.
    slosh: Oscillation,
}

/// A uniform free beam's first two modes: wave number times length, and the ratio of its
/// hyperbolic parts.
const MODES: [(f64, f64); 2] = [(4.730_041, 0.982_502), (7.853_205, 1.000_777)];

impl Flexible {
    pub(super) fn ahead(&self, slope: &Self, dt_s: f64) -> Self {
        Self {
            bending: [0, 1].map(|mode| self.bending[mode].ahead(&slope.bending[mode], dt_s)),
            slosh: self.slosh.ahead(&slope.slosh, dt_s),
        }
    }

    /// Its slope at a time of the burn (s), with the thrust's part across the axis (N). The liquid
    /// adds to the load.
    pub(super) fn slope(
        &self,
        p: &RocketParameters,
        time_s: f64,
        across_n: Vector2<f64>,
        load: &mut Load,
    ) -> Self {
        let mut slope = Self::default();
        if let Some(bending) = p.bending {
            let driven = 4.0 * across_n / load.mass.mass_kg;
            for ((mode, slope), (wave, _)) in self.bending.iter().zip(&mut slope.bending).zip(MODES)
            {
                let rad_s = std::f64::consts::TAU * p.bending_hz * (wave / MODES[0].0).powi(2);
                *slope = mode.slope(rad_s, bending.damping, driven, 0.0);
            }
        }
        let left = 1.0 - p.burn_at(time_s.clamp(0.0, p.burn_s)).1;
        if let Some(damping) = p.slosh_damping
            && left > 1e-3
        {
            let (mass_kg, inertia_kg_m2) = (load.mass.mass_kg, load.mass.inertia_kg_m2);
            let (radius, depth) = (0.5 * p.diameter_m, p.column_m * left);
            let filled = (1.841 * depth / radius).tanh();
            let sliding_kg = p.propellant_kg * left * radius / (2.199 * depth) * filled;
            let felt = load.force / mass_kg;
            let rad_s = (1.841 * (-felt.z).max(0.0) / radius * filled).sqrt();
            let displaced = Vector3::new(self.slosh.place.x, self.slosh.place.y, 0.0);
            load.moment -= sliding_kg * displaced.cross(&felt);
            // The surface is this far behind the centre of mass.
            let z = load.mass.cm_m - p.column_base_m - depth;
            let turning = load.moment / inertia_kg_m2;
            let tank = Vector2::new(felt.x + turning.y * z, felt.y - turning.x * z);
            let resisted = sliding_kg * (1.0 / mass_kg + z * z / inertia_kg_m2);
            slope.slosh = self.slosh.slope(rad_s, damping, -tank, resisted);
            let pushed = -sliding_kg * slope.slosh.speed;
            let pushed = Vector3::new(pushed.x, pushed.y, 0.0);
            load.force += pushed;
            load.moment += Vector3::new(0.0, 0.0, z).cross(&pushed);
        }
        slope
    }

    /// How far the airframe's bending turns what sits `from_gimbal_m` towards the nose about the
    /// body's x and y, in rad, and the rates of that, in rad/s.
    pub(super) fn turned(&self, p: &RocketParameters, from_gimbal_m: f64) -> [Vector2<f64>; 2] {
        let mut turned = [Vector2::zeros(); 2];
        let Some(bending) = p.bending else { return turned };
        for (mode, (wave, ratio)) in self.bending.iter().zip(MODES) {
            let k = wave / bending.length_m;
            let (sin, cos) = (k * from_gimbal_m).sin_cos();
            let (sinh, cosh) = ((k * from_gimbal_m).sinh(), (k * from_gimbal_m).cosh());
            let steep = 0.5 * k * (sinh - sin - ratio * (cosh + cos));
            for (turned, of) in turned.iter_mut().zip([mode.place, mode.speed]) {
                *turned += steep * Vector2::new(of.y, -of.x);
            }
        }
        turned
    }
}

#[cfg(test)]
impl Flexible {
    /// Displaced along x by these of the two modes, m at the gimbal.
    pub(super) fn pushed(modes_m: [f64; 2]) -> Self {
        let bending = modes_m.map(|place_m| Oscillation {
            place: Vector2::new(place_m, 0.0),
            ..Oscillation::default()
        });
        Self { bending, ..Self::default() }
    }

    pub(super) fn slosh_speed(&self) -> Vector2<f64> {
        self.slosh.speed
    }
}
