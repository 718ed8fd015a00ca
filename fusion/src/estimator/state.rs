//! What an estimator has learned: read, stored and set from outside.

use super::{Estimator, Phase, SETTLED_S};
#[cfg(feature = "offline")]
use crate::consistency::Consistency;
use crate::error::{ConfigError, require};
use crate::filter::Filter;
use crate::motion_bias::MotionBias;
use crate::quaternion::Quaternion;
use crate::real::Real;
use crate::recovery::Recovery;

use crate::vector::{within, zero};

/// Strength of the field that counts as undisturbed, uT (or the magnetometer's own unit).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FieldReference<T = f32> {
    /// Its horizontal part, above 0.
    pub horizontal: T,
    /// Its vertical part, positive down.
    pub down: T,
}

/// What an estimator has learned: enough to go on after a restart.
///
/// [`Estimator::state`] gives it, [`Estimator::restore`] takes it. A part that is `None` is not
/// known.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State<T = f32> {
    /// Body to earth (north, east, down), of the instant of the last rates.
    pub orientation: Option<Quaternion<T>>,
    /// Gyroscope offset, rad/s.
    pub bias: Option<[T; 3]>,
    /// The field's reference.
    pub field: Option<FieldReference<T>>,
    /// Lag of the field behind the rates, s.
    pub mag_lag_s: Option<T>,
}

impl<F: Filter> Estimator<F> {
    /// The state learned so far.
    pub fn state(&self) -> State<F::Real> {
        State {
            orientation: self.flags.initialised.then_some(self.orientation),
            bias: self.rest.is_bias_known().then_some(self.bias),
            field: self.field.reference(),
            mag_lag_s: Some(self.field.lag_s()),
        }
    }

    /// Goes on from a state; a part that is `None` leaves the estimator's own.
    ///
    /// The attitude counts as the present one. Give the next [`Estimator::update`] the time that
    /// has passed since the state was taken. As a gap in the samples, that time makes the attitude
    /// uncertain and corrections faster.
    ///
    /// # Errors
    /// The name of a part that is not finite or out of range; nothing changes then.
    pub fn restore(&mut self, state: &State<F::Real>) -> Result<(), ConfigError> {
        let finite = |v: &F::Real| v.within(F::Real::from_f32(f32::MAX));
        if let Some(orientation) = &state.orientation {
            let off = orientation.norm2() - F::Real::ONE;
            require(off.within(F::Real::from_f32(0.01)), "state.orientation")?;
        }
        if let Some(bias) = &state.bias {
            require(within(bias, F::Real::from_f32(MAX_BIAS)), "state.bias")?;
        }
        if let Some(field) = &state.field {
            let whole = field.horizontal > F::Real::ZERO && finite(&field.horizontal);
            require(whole && finite(&field.down), "state.field")?;
        }
        if let Some(lag_s) = &state.mag_lag_s {
            require(lag_s.within(F::Real::from_f32(0.1)), "state.mag_lag_s")?;
        }

        if let Some(Quaternion { w, x, y, z }) = state.orientation {
            self.motion_bias.iter_mut().for_each(MotionBias::interrupt);
            self.orientation = Quaternion::normalised(w, x, y, z);
            self.pending = zero();
            self.phase = Phase::Settling;
            self.age = F::Real::from_f32(SETTLED_S);
            self.skipped_s = 0.0;
            self.flags.initialised = true;
            self.uncertainty.know_attitude();
        }
        if let Some(bias) = state.bias {
            self.set_bias(bias);
        }
        if let Some(field) = &state.field {
            self.field.know(field);
        }
        if let Some(lag_s) = state.mag_lag_s {
            self.field.set_lag_s(lag_s);
        }
        Ok(())
    }

    /// Sets the gyroscope's offset, rad/s, as if a shortest rest had shown it.
    pub fn set_bias(&mut self, bias: [F::Real; 3]) {
        self.bias = bias;
        self.rest.know();
        self.uncertainty.know_bias();
    }

    /// Turns the estimate about the vertical to a heading, rad from north to east, for use without
    /// a magnetometer. A field turns it back.
    pub fn set_heading(&mut self, yaw_rad: F::Real) {
        let turn = yaw_rad - self.orientation.euler().yaw_rad;
        let (sin, cos) = (turn * F::Real::HALF).sin_cos();
        let about_down = Quaternion::new(cos, F::Real::ZERO, F::Real::ZERO, sin);
        self.motion_bias.iter_mut().for_each(MotionBias::interrupt);
        self.orientation = about_down.mul(&self.orientation);
        self.orientation.restore_norm();
    }

    /// Takes other gains from the next update on; attitude and offset go on from where they are.
    ///
    /// # Errors
    /// The name of a gain out of range; nothing changes then.
    pub fn set_gains(&mut self, gains: &F::Gains) -> Result<(), ConfigError> {
        self.filter.retune(gains)
    }

    /// Takes the attitude from the next sample, as after [`Estimator::new`]. Learned offset, field,
    /// lag and ranges stay.
    pub fn reset(&mut self) {
        self.rest.interrupt();
        self.motion_bias.iter_mut().for_each(MotionBias::interrupt);
        self.recovery = Recovery::default();
        self.orientation = Quaternion::IDENTITY;
        (self.pending, self.rate) = (zero(), zero());
        self.flags = Default::default();
        self.phase = Phase::Blank;
        self.skipped_s = 0.0;
        (self.age, self.mag_dt) = (F::Real::ZERO, F::Real::ZERO);
    }

    /// The estimator that goes back in time from here. It keeps its state, with the sense of every
    /// rate reversed.
    #[cfg(feature = "offline")]
    pub(crate) fn reversed(&self, gains: &F::Gains) -> Result<Self, ConfigError> {
        Ok(Self {
            filter: F::new(gains)?,
            field: self.field.reversed(),
            rest: self.rest.reversed(),
            motion_bias: None,
            range: self.range.reversed(),
            recovery: Recovery::default(),
            consistency: Consistency::new(),
            rate: self.rate.map(|rate| -rate),
            bias: self.bias.map(|bias| -bias),
            half_gyr_lag_s: -self.half_gyr_lag_s,
            mag_dt: F::Real::ZERO,
            uncertainty: self.uncertainty.clone(),
            ..*self
        })
    }

    /// The orientation at the time of the rates.
    #[cfg(feature = "offline")]
    pub(crate) fn orientation(&self) -> Quaternion<F::Real> {
        self.orientation
    }

    /// Weight of the estimate: the time of its averaging, s, up to the slowest filter's.
    #[cfg(feature = "offline")]
    pub(crate) fn standing_s(&self) -> F::Real {
        match self.phase {
            Phase::Blank => F::Real::ZERO,
            Phase::Settling => self.age,
            Phase::Running => F::Real::from_f32(SETTLED_S),
        }
    }
}

/// Largest offset, rad/s: more than any gyroscope's full scale.
const MAX_BIAS: f32 = 100.0;
