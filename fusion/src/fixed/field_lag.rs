//! The field's lag, learned beside the steps: see [`crate::Config::mag_lag_sd_s`].

use super::counts::Counts;
use super::estimator::Estimator;
use super::filters::Filter;
use super::orientation::Orientation;
use super::sensors::Late;
use super::state::State;
use crate::config::Config;
use crate::error::ConfigError;
use crate::lag;
use crate::real::Real;

/// The lag of the field, learned as the float filters learn it. It computes in float, five times a
/// second at most, so a program may call it outside of the control loop.
///
/// ```
/// use tvc_fusion::{Config, fixed};
///
/// let config = Config::default();
/// let mut estimator =
///     fixed::Estimator::<fixed::Vqf>::new(&config, &fixed::Scale::BNO055, 10_000)?;
/// let (mut state, mut lag) = (estimator.start(), fixed::FieldLag::new(&config)?);
/// let counts = fixed::Counts { gyr: [0; 3], acc: [0, 0, -981], mag: Some([272, 0, 752]) };
/// estimator.update(&mut state, 10_000, &counts);
/// lag.learn(&mut estimator, &state, 10_000, &counts);
/// # Ok::<(), tvc_fusion::ConfigError>(())
/// ```
#[derive(Clone, Debug)]
pub struct FieldLag {
    lag: lag::FieldLag<f32>,
    /// Time since the field was last looked at, us.
    waited_us: u32,
}

impl FieldLag {
    /// The lag of the configuration.
    ///
    /// # Errors
    /// The name of the lag or its standard deviation if it is out of range.
    pub fn new<G>(config: &Config<G>) -> Result<Self, ConfigError> {
        let lag = lag::FieldLag::new(config.mag_lag_s, config.mag_lag_sd_s)?;
        Ok(Self { lag, waited_us: 0 })
    }

    /// The lag now, s.
    pub fn lag_s(&self) -> f32 {
        self.lag.lag_s()
    }

    /// Learns from a sample that the estimator has just taken, `dt_us` microseconds after the
    /// sample before. The estimator's next step knows the lag.
    pub fn learn<F: Filter>(
        &mut self,
        estimator: &mut Estimator<F, Late>,
        state: &State,
        dt_us: u32,
        counts: &Counts,
    ) {
        self.waited_us = self.waited_us.saturating_add(dt_us);
        if let Some(mag) = counts.mag
            && let Some([north, down]) = state.compass.trusted()
            && self.lag.is_due(core::mem::take(&mut self.waited_us) as f32 * 1e-6)
        {
            let [north, down] = [north, down].map(|part| part as f32);
            let strength = Real::sqrt(north * north + down * down);
            let rows = Orientation { wxyz_q30: state.rotation.q30() }.quaternion().half_rows();
            let rate = estimator.rate(state, &counts.gyr);
            self.lag.learn(&rows, &mag.map(f32::from), &rate, 1.0 / strength);
            estimator.set_mag_lag_s(self.lag.lag_s());
        }
    }
}
