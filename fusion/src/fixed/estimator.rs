//! Settings and state in one.

use super::counts::{Counts, Scale};
use super::filters::Filter;
use super::orientation::Orientation;
use super::sensors::{Late, Sensors};
use super::settings::Settings;
use super::state::State;
use crate::config::Config;
use crate::error::ConfigError;
use crate::estimator::{Attitude, Flags};
use crate::quality::{BiasState, Quality};

/// An attitude estimator in fixed point: [`Settings`], and the [`State`] that they change. `S` is
/// what the sensors are like.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Estimator<F, S: Sensors = Late> {
    state: State,
    settings: Settings<F, S>,
    memory: S::Memory,
    /// Rates of the newest sample, counts.
    gyr: [i16; 3],
}

impl<F: Filter, S: Sensors> Estimator<F, S> {
    /// An estimator that waits for its first sample; see [`Settings::new`].
    ///
    /// # Errors
    /// As [`Settings::new`].
    #[inline(always)]
    pub fn new(
        config: &Config<F::Gains>,
        scale: &Scale,
        period_us: u32,
    ) -> Result<Self, ConfigError> {
        let settings = Settings::<F, S>::new(config, scale, period_us)?;
        Ok(Self {
            state: settings.start(),
            memory: settings.sensors.start(),
            settings,
            gyr: [0; 3],
        })
    }

    /// See [`Settings::update`].
    #[inline]
    pub fn update(&mut self, dt_us: u32, counts: &Counts) {
        self.gyr = counts.gyr;
        self.settings
            .step(&mut self.state, &mut self.memory, dt_us, counts);
    }

    /// See [`Settings::coast`].
    pub fn coast(&mut self, dt_us: u32, gyr: &[i16; 3]) {
        self.gyr = *gyr;
        self.settings.coast(&mut self.state, dt_us, gyr);
    }

    /// See [`Settings::level`].
    pub fn level(&mut self) {
        self.settings.level(&mut self.state);
    }

    /// See [`Settings::orientation`].
    pub fn orientation(&self) -> Orientation {
        self.settings.orientation(&self.state)
    }

    /// See [`Settings::bias_q9`].
    pub fn bias_q9(&self) -> [i32; 3] {
        self.settings.bias_q9(&self.state)
    }

    /// The whole estimate in float.
    pub fn attitude(&self) -> Attitude {
        Attitude {
            flags: self.flags(),
            ..self.settings.attitude(&self.state, &self.gyr)
        }
    }

    /// See [`Settings::flags`]; with whether a rate is clipped, or was within the last seconds.
    pub fn flags(&self) -> Flags {
        Flags {
            over_range: S::is_over_range(&self.memory),
            ..self.settings.flags(&self.state)
        }
    }

    /// See [`Settings::quality`].
    #[inline(always)]
    pub fn quality(&self) -> Quality {
        self.settings.quality(&self.state)
    }

    /// What is known of the gyroscope's offset.
    pub fn bias_state(&self) -> BiasState {
        self.settings.bias_state(&self.state)
    }

    /// See [`Settings::tilt_is_within`].
    pub fn tilt_is_within(&self, variance_q28: i32) -> bool {
        self.settings.tilt_is_within(&self.state, variance_q28)
    }

    /// What is remembered, to go on from later.
    pub fn state(&self) -> State {
        self.state
    }

    /// Goes on from a state that an estimator with the same configuration has told. What
    /// [`Clipped`](super::Clipped) sensors remember is found anew.
    ///
    /// # Errors
    /// The state is damaged or another configuration's; nothing changes.
    pub fn restore(&mut self, state: &State) -> Result<(), ConfigError> {
        if !self.settings.accepts(state) {
            return Err(ConfigError::OutOfRange("state"));
        }
        self.state = *state;
        self.memory = self.settings.sensors.start();
        Ok(())
    }

    /// See [`Settings::reset`].
    pub fn reset(&mut self) {
        self.settings.reset(&mut self.state);
        self.memory = self.settings.sensors.start();
    }
}

#[cfg(test)]
mod tests;
