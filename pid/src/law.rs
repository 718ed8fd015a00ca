//! A law: settings that stay, and a state that changes from sample to sample.

use crate::config::ConfigError;
use crate::pid::Coefficients;
use crate::scalar::Scalar;
use crate::state::State;

/// Measurements of a sample for a [`Law`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<T> {
    /// The measured value.
    pub value: T,
    /// Its measured rate, per s.
    pub rate: T,
    /// Age of the rate, sample periods, without the sensor's own lag. `None` for a reading that
    /// repeats the last one.
    pub age: Option<T>,
    /// Age of the rate less the value's age, sample periods.
    pub value_lead: T,
}

/// A control law. The law has the settings, which no sample changes. The state is a separate value,
/// to be [read and restored](State).
pub trait Law<T: Scalar>: Sized {
    /// Configuration, in SI units.
    type Config;
    /// The memory from one sample to the next.
    type State: State<T> + Default;

    /// The law of a configuration.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    fn new(config: &Self::Config) -> Result<Self, ConfigError>;

    /// The state at rest: output zero, or the nearest limit.
    fn at_rest(&self) -> Self::State {
        Self::State::default()
    }

    /// One sample: setpoint, reading, and whether its output is sent to the actuator. An output
    /// that is not sent stands in for a missing next sample. Inputs that are NaN leave the output
    /// as it was.
    fn update(
        &self,
        state: &mut Self::State,
        setpoint: T,
        reading: &Reading<T>,
        is_sent: bool,
    ) -> T;

    /// A sample without a reading: the output stays.
    fn coast(&self, _state: &mut Self::State, _is_sent: bool) {}

    /// Start again from rest, where the actuator goes to zero.
    fn reset(&self, state: &mut Self::State, _setpoint: T) {
        *state = self.at_rest();
    }

    /// Take another configuration without a bump of the output.
    ///
    /// # Errors
    /// A parameter out of its range, by name; everything stays as it was.
    fn retune(&mut self, state: &mut Self::State, config: &Self::Config)
    -> Result<(), ConfigError>;

    /// Takes prepared gains, if the law has any, as a schedule does every sample. Nothing absorbs
    /// the change, because a schedule's steps are small and intended.
    fn set_gains(&mut self, _gains: &Coefficients<T>) {}
}

/// A law with its state.
#[derive(Clone, Debug)]
pub struct Controller<T: Scalar, L: Law<T>> {
    /// The settings.
    pub law: L,
    /// State that changes from sample to sample.
    pub state: L::State,
}

impl<T: Scalar, L: Law<T>> Controller<T, L> {
    /// A controller at rest.
    ///
    /// # Errors
    /// A parameter out of its range, by name.
    pub fn new(config: &L::Config) -> Result<Self, ConfigError> {
        let law = L::new(config)?;
        let state = law.at_rest();
        Ok(Self { law, state })
    }

    /// As [`Law::update`], with a present reading, and an output that is sent.
    #[inline]
    pub fn update(&mut self, setpoint: T, value: T, rate: T) -> T {
        let reading = Reading { value, rate, age: Some(T::ZERO), value_lead: T::ZERO };
        self.read(setpoint, &reading, true)
    }

    /// See [`Law::update`].
    #[inline]
    pub fn read(&mut self, setpoint: T, reading: &Reading<T>, is_sent: bool) -> T {
        self.law.update(&mut self.state, setpoint, reading, is_sent)
    }

    /// See [`Law::coast`].
    pub fn coast(&mut self, is_sent: bool) {
        self.law.coast(&mut self.state, is_sent);
    }

    /// See [`Law::reset`].
    pub fn reset(&mut self, setpoint: T) {
        self.law.reset(&mut self.state, setpoint);
    }

    /// See [`Law::retune`].
    ///
    /// # Errors
    /// A parameter out of its range, by name; everything stays as it was.
    pub fn retune(&mut self, config: &L::Config) -> Result<(), ConfigError> {
        self.law.retune(&mut self.state, config)
    }
}
