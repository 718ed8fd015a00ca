//! The magnetic field as a compass: when to believe it, and how far the heading is off.
//!
//! Only the heading is ever taken from the magnetometer, so that no disturbance reaches roll or pitch. The
//! field is split, in the estimated earth frame, into its horizontal and its vertical part; both are
//! compared with a reference that is averaged at start-up and followed slowly. A field that differs is a
//! disturbance and is passed over, until either it has stayed the same while the body turned (then the
//! place has changed, and it becomes the reference) or it has lasted so long that the drift of the heading
//! would be worse than the field's error.

use crate::config::{ConfigError, in_range, positive};
use crate::real::Real;
use nalgebra::Vector3;

/// Handling of the magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldConfig {
    /// A field that is further than this from the reference, horizontally or vertically, is disturbed: as
    /// a fraction of the reference's magnitude. `f32::INFINITY` lets every field pass.
    pub gate: f32,
    /// Time constant with which the reference follows an undisturbed field, s.
    pub tau_s: f32,
    /// A different field becomes the reference when it has stayed the same for this long while turning, s.
    pub adopt_s: f32,
    /// Slowest turning that counts for adopting, rad/s.
    pub adopt_rate_rad_s: f32,
    /// A disturbance is passed over for at most this long, s; after it the heading follows at half the gain.
    pub reject_s: f32,
}

impl Default for FieldConfig {
    fn default() -> Self {
        Self {
            gate: 0.1,
            tau_s: 20.0,
            adopt_s: 20.0,
            adopt_rate_rad_s: 0.35,
            reject_s: 60.0,
        }
    }
}

/// How far the heading is off: the angle from the estimated direction of the horizontal field to where it
/// should be, positive from north to east.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingError<T> {
    /// Sine of the angle for a field as strong as the reference, at most 1 in size; +-1 beyond a right angle.
    pub sin: T,
    /// How much it is to be believed, 0..1.
    pub weight: T,
}

/// Horizontal part squared and vertical part of the field, both taken with half rows (uT^2/4, uT/2).
#[derive(Clone, Copy, Debug)]
struct Parts<T> {
    horizontal2: T,
    vertical: T,
}

/// Declination other than zero.
#[derive(Clone, Copy, Debug)]
struct Declination<T> {
    rad: T,
    sin: T,
    cos: T,
}

#[derive(Clone, Debug)]
pub(crate) struct Field<T> {
    gate: T,
    tau_s: T,
    adopt_s: T,
    adopt_rate: T,
    reject_s: T,
    declination: Option<Declination<T>>,
    reference: Option<Reference<T>>,
    /// Field samples that the reference stands on, while it is being averaged.
    averaged: u32,
    candidate: Option<(Reference<T>, T)>,
    rejected_s: T,
    since_refresh_s: T,
}

#[derive(Clone, Copy, Debug)]
struct Reference<T> {
    parts: Parts<T>,
    /// Tolerances of the two parts.
    tolerance: Parts<T>,
    /// One over the horizontal part.
    inverse_horizontal: T,
}

/// Interval at which the reference follows the field, s: it is slow, and costs a root and a division.
const REFRESH_S: f32 = 0.25;

/// Horizontal field below which a compass has no direction, uT.
const LEAST_HORIZONTAL_UT: f32 = 1.0;

/// Largest field component taken for one, uT: a thousand times the earth's.
const MOST_UT: f32 = 50_000.0;

/// Field samples averaged into the reference before the gate works.
const AVERAGED: u32 = 16;

impl<T: Real> Reference<T> {
    fn new(parts: Parts<T>, gate: T) -> Option<Self> {
        let least = T::from_f32(0.5 * LEAST_HORIZONTAL_UT);
        if parts.horizontal2.within(least * least) {
            return None;
        }
        let horizontal = parts.horizontal2.sqrt();
        let total = (parts.horizontal2 + parts.vertical * parts.vertical).sqrt();
        let vertical = gate * total;
        Some(Self {
            parts,
            // d(h^2) = 2 h dh
            tolerance: Parts {
                horizontal2: (horizontal + horizontal) * vertical,
                vertical,
            },
            inverse_horizontal: horizontal.recip(),
        })
    }

    fn matches(&self, parts: &Parts<T>) -> bool {
        (parts.horizontal2 - self.parts.horizontal2).within(self.tolerance.horizontal2)
            && (parts.vertical - self.parts.vertical).within(self.tolerance.vertical)
    }

    fn moved(&self, parts: &Parts<T>, share: T, gate: T) -> Option<Self> {
        let own = &self.parts;
        Self::new(
            Parts {
                horizontal2: own.horizontal2 + (parts.horizontal2 - own.horizontal2) * share,
                vertical: own.vertical + (parts.vertical - own.vertical) * share,
            },
            gate,
        )
    }
}

impl<T: Real> Field<T> {
    pub(crate) fn new(config: &FieldConfig, declination_rad: f32) -> Result<Self, ConfigError> {
        if config.gate.is_nan() || config.gate <= 0.0 {
            return Err(ConfigError::OutOfRange("field.gate"));
        }
        positive(config.tau_s, "field.tau_s")?;
        positive(config.adopt_s, "field.adopt_s")?;
        in_range(
            config.adopt_rate_rad_s,
            0.0,
            100.0,
            "field.adopt_rate_rad_s",
        )?;
        positive(config.reject_s, "field.reject_s")?;
        in_range(
            declination_rad,
            -core::f32::consts::PI,
            core::f32::consts::PI,
            "declination_rad",
        )?;
        Ok(Self {
            // Infinity times zero would be NaN: a gate a million times the field is as good as none.
            gate: T::from_f32(config.gate.min(1e6)),
            tau_s: T::from_f32(config.tau_s),
            adopt_s: T::from_f32(config.adopt_s),
            adopt_rate: T::from_f32(config.adopt_rate_rad_s),
            reject_s: T::from_f32(config.reject_s),
            declination: (declination_rad != 0.0).then(|| {
                let rad = T::from_f32(declination_rad);
                let (sin, cos) = rad.sin_cos();
                Declination { rad, sin, cos }
            }),
            reference: None,
            averaged: 0,
            candidate: None,
            rejected_s: T::ZERO,
            since_refresh_s: T::ZERO,
        })
    }

    /// Whether a field has been seen that can serve as a compass.
    pub(crate) fn is_known(&self) -> bool {
        self.reference.is_some()
    }

    /// Declination in rad, `None` when it is zero.
    pub(crate) fn declination_rad(&self) -> Option<T> {
        self.declination.map(|declination| declination.rad)
    }

    /// Judge one field sample, given in the estimated earth frame **at half its length** (uT). `dt` is the
    /// time since the last field sample, `rate` the rotation rate now (rad/s). `None`: disturbed.
    #[inline]
    pub(crate) fn judge(
        &mut self,
        dt: T,
        half_ut: &Vector3<T>,
        rate: &Vector3<T>,
    ) -> Option<HeadingError<T>> {
        let horizontal2 = half_ut.x * half_ut.x + half_ut.y * half_ut.y;
        let parts = Parts {
            horizontal2,
            vertical: half_ut.z,
        };
        let Some(reference) = self.reference else {
            self.reference = Reference::new(parts, self.gate);
            self.averaged = 1;
            return self
                .reference
                .map(|reference| self.heading_error(half_ut, &reference, T::ONE));
        };
        if self.averaged < AVERAGED {
            self.averaged += 1;
            let share = T::from_f32(self.averaged as f32).recip();
            self.reference = reference.moved(&parts, share, self.gate);
            return Some(self.heading_error(half_ut, &reference, T::ONE));
        }
        if reference.matches(&parts) {
            self.candidate = None;
            self.rejected_s = T::ZERO;
            self.since_refresh_s += dt;
            if !self.since_refresh_s.within(T::from_f32(REFRESH_S)) {
                self.follow(&reference, &parts);
            }
            return Some(self.heading_error(half_ut, &reference, T::ONE));
        }
        self.rejected_s += dt;
        if self.adopt(dt, &parts, rate) {
            return None;
        }
        let weary = !self.rejected_s.within(self.reject_s);
        (weary && !parts.horizontal2.within(T::from_f32(0.25)))
            .then(|| self.heading_error(half_ut, &reference, T::HALF))
    }

    #[cold]
    #[inline(never)]
    fn follow(&mut self, reference: &Reference<T>, parts: &Parts<T>) {
        let share = self.since_refresh_s * (self.tau_s + self.since_refresh_s).recip();
        self.since_refresh_s = T::ZERO;
        if let Some(moved) = reference.moved(parts, share, self.gate) {
            self.reference = Some(moved);
        }
    }

    /// A field unlike the reference: does it stay the same while the body turns?
    #[cold]
    #[inline(never)]
    fn adopt(&mut self, dt: T, parts: &Parts<T>, rate: &Vector3<T>) -> bool {
        match &mut self.candidate {
            Some((candidate, turned_s)) if candidate.matches(parts) => {
                let turning = [rate.x, rate.y, rate.z]
                    .iter()
                    .any(|r| !r.within(self.adopt_rate));
                if turning {
                    *turned_s += dt;
                }
                if turned_s.within(self.adopt_s) {
                    return false;
                }
                self.reference = Some(*candidate);
                self.candidate = None;
                self.rejected_s = T::ZERO;
                true
            }
            _ => {
                self.candidate =
                    Reference::new(*parts, self.gate).map(|candidate| (candidate, T::ZERO));
                false
            }
        }
    }

    fn heading_error(
        &self,
        half_ut: &Vector3<T>,
        reference: &Reference<T>,
        weight: T,
    ) -> HeadingError<T> {
        let (along, across) = match self.declination {
            None => (half_ut.x, -half_ut.y),
            Some(Declination { sin, cos, .. }) => (
                cos * half_ut.x + sin * half_ut.y,
                sin * half_ut.x - cos * half_ut.y,
            ),
        };
        let sin = across * reference.inverse_horizontal;
        let behind = along < T::ZERO;
        let sin = match (behind || !sin.within(T::ONE), sin < T::ZERO) {
            (false, _) => sin,
            (true, true) => -T::ONE,
            (true, false) => T::ONE,
        };
        HeadingError { sin, weight }
    }
}

/// Whether a magnetometer sample can be used at all: finite and of a size that the earth, a magnet or a
/// motor can have.
pub(crate) fn plausible<T: Real>(mag: &Vector3<T>) -> bool {
    let most = T::from_f32(MOST_UT);
    mag.x.within(most) && mag.y.within(most) && mag.z.within(most)
}
