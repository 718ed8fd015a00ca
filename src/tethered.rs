//! In place of free flight, without the feature `free-flight`: a vehicle on its tether is released
//! by an order alone, its accelerometer shows the vertical, and its gains are constant.

use tvc_imu::Micros;
use tvc_pid::{Coefficients, Q16};

use crate::failsafe::{self, Command};
use crate::params::Params;

/// No fraction of a shift.
pub(crate) const SHIFT_BITS: u32 = 0;

/// The acceleration does not shift the rates.
pub(crate) fn shift(_: &Params) -> [i16; 2] {
    [0; 2]
}

/// The parameters say nothing of free flight.
#[derive(Clone, Debug)]
pub(crate) struct FreeFlight;

/// Nothing is remembered.
pub(crate) type State = [i32; 0];

impl FreeFlight {
    pub(crate) fn new(_: &Params) -> Self {
        Self
    }

    pub(crate) fn configure(&mut self, _: &Params) {}

    pub(crate) fn is_possible(&self) -> bool {
        true
    }

    pub(crate) fn is_needed(&self) -> bool {
        false
    }

    pub(crate) fn follow(
        &self,
        _: &mut State,
        _: Micros,
        _: i32,
        _: &failsafe::State,
    ) -> Option<Command> {
        None
    }

    pub(crate) fn is_free(&self, _: &State, _: &failsafe::State) -> bool {
        false
    }

    pub(crate) fn gains(&self, _: &State) -> Option<Coefficients<Q16>> {
        None
    }

    pub(crate) fn tilt_sd_deg(&self, _: &State, _: &Params) -> f32 {
        0.0
    }
}
