//! The wind that the rocket meets: steady, a gust, and turbulence.

use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::parameters::{Checked, finite, named, not_negative, positive};

/// Velocity of the air, north-east-down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wind {
    /// The same everywhere, in m/s.
    pub steady_m_s: [f64; 3],
    /// A gust on top of it.
    pub gust: Option<Gust>,
    /// Turbulence on top of both.
    pub turbulence: Option<Turbulence>,
}

/// A gust in a layer of the air: `peak (1 - cos(2 pi (h - from) / depth)) / 2` at altitude `h`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gust {
    /// Altitude of the layer's base, in m.
    pub from_m: f64,
    /// Depth of the layer, in m; the gust is strongest in its middle.
    pub depth_m: f64,
    /// Velocity there, north-east-down, in m/s.
    pub peak_m_s: [f64; 3],
}

/// Turbulence, alike in all directions. Each of the three velocities is noise through a first-order
/// lag along the path, as Dryden's spectrum has it for the velocity along the path: its correlation
/// over a path `s` is `exp(-s / length)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turbulence {
    /// Root mean square of each velocity, in m/s.
    pub rms_m_s: f64,
    /// Length scale, in m.
    pub length_m: f64,
    /// Seed of the noise: the same seed and steps give the same turbulence.
    pub seed: u64,
}

impl Wind {
    /// Checks that every figure is finite and in range.
    ///
    /// # Errors
    /// The first figure out of range, by name.
    pub fn validate(&self) -> Checked {
        finite(&named!(self; steady_m_s[0], steady_m_s[1], steady_m_s[2]))?;
        if let Some(gust) = &self.gust {
            finite(&named!(gust; from_m, peak_m_s[0], peak_m_s[1], peak_m_s[2]))?;
            positive(&named!(gust; depth_m))?;
        }
        if let Some(turbulence) = &self.turbulence {
            not_negative(&named!(turbulence; rms_m_s))?;
            positive(&named!(turbulence; length_m))?;
        }
        Ok(())
    }
}

impl Gust {
    fn at(&self, altitude_m: f64) -> Vector3<f64> {
        let place = (altitude_m - self.from_m) / self.depth_m;
        if !(0.0..=1.0).contains(&place) {
            return Vector3::zeros();
        }
        0.5 * (1.0 - (std::f64::consts::TAU * place).cos()) * Vector3::from(self.peak_m_s)
    }
}

/// The air round a rocket that flies.
#[derive(Clone, Debug)]
pub(super) struct Air {
    wind: Wind,
    noise: ChaCha8Rng,
    /// The turbulence now, in m/s.
    turbulence: Vector3<f64>,
}

impl Air {
    pub(super) fn new(wind: &Wind) -> Self {
        let seed = wind.turbulence.map_or(0, |turbulence| turbulence.seed);
        let mut air = Self {
            wind: *wind,
            noise: ChaCha8Rng::seed_from_u64(seed),
            turbulence: Vector3::zeros(),
        };
        if let Some(Turbulence { rms_m_s, .. }) = air.wind.turbulence {
            air.turbulence = rms_m_s * air.draw();
        }
        air
    }

    /// Moves on along a path of this length, in m.
    pub(super) fn pass(&mut self, path_m: f64) {
        if let Some(Turbulence { rms_m_s, length_m, .. }) = self.wind.turbulence {
            let kept = (-path_m / length_m).exp();
            let new = rms_m_s * (1.0 - kept * kept).sqrt();
            self.turbulence = kept * self.turbulence + new * self.draw();
        }
    }

    /// Velocity of the air at an altitude (m), north-east-down, in m/s.
    pub(super) fn velocity(&self, altitude_m: f64) -> Vector3<f64> {
        let gust = self.wind.gust.map(|gust| gust.at(altitude_m));
        Vector3::from(self.wind.steady_m_s) + gust.unwrap_or_default() + self.turbulence
    }

    fn draw(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.noise.sample(StandardNormal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gust_rises_and_fades_within_its_layer() {
        let wind = Wind {
            steady_m_s: [1.0, 0.0, 0.0],
            gust: Some(Gust { from_m: 1000.0, depth_m: 400.0, peak_m_s: [0.0, 8.0, 0.0] }),
            turbulence: None,
        };
        let air = Air::new(&wind);
        for (altitude, east) in [
            (0.0, 0.0),
            (1000.0, 0.0),
            (1100.0, 4.0),
            (1200.0, 8.0),
            (1300.0, 4.0),
            (1400.0, 0.0),
            (5000.0, 0.0),
        ] {
            let expected = Vector3::new(1.0, east, 0.0);
            assert!((air.velocity(altitude) - expected).norm() < 1e-12, "{altitude}");
        }
    }

    /// Over 2000 lengths, in steps of a twentieth of one: the mean square and the correlation a
    /// length apart.
    #[test]
    fn turbulence_has_its_strength_and_length() {
        let wind = Wind {
            turbulence: Some(Turbulence { rms_m_s: 3.0, length_m: 200.0, seed: 7 }),
            ..Wind::default()
        };
        let (mut air, mut again) = (Air::new(&wind), Air::new(&wind));
        let mut seen = Vec::new();
        for _ in 0..40_000 {
            air.pass(10.0);
            again.pass(10.0);
            assert_eq!(air.velocity(0.0), again.velocity(0.0));
            seen.push(air.velocity(0.0));
        }
        let count = seen.len() as f64;
        for axis in 0..3 {
            let mean_square = seen.iter().map(|v| v[axis] * v[axis]).sum::<f64>() / count;
            assert!((mean_square.sqrt() - 3.0).abs() < 0.15, "{mean_square}");
            let apart = seen.iter().zip(&seen[20..]).map(|(a, b)| a[axis] * b[axis]);
            let correlation = apart.sum::<f64>() / count / mean_square;
            assert!((correlation - (-1.0_f64).exp()).abs() < 0.1, "{correlation}");
        }
    }
}
