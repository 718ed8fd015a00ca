//! A filter that is chosen while the program runs.

use super::filters::{Complementary, Correction, Filter, Madgwick, Mahony, View, Vqf};
use super::memory::all;
use crate::complementary::ComplementaryGains;
use crate::error::ConfigError;
use crate::madgwick::MadgwickGains;
use crate::mahony::MahonyGains;
use crate::vqf::VqfGains;

/// Which filter, and its gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyGains {
    /// [`Vqf`].
    Vqf(VqfGains),
    /// [`Mahony`].
    Mahony(MahonyGains),
    /// [`Madgwick`].
    Madgwick(MadgwickGains),
    /// [`Complementary`].
    Complementary(ComplementaryGains),
}

impl Default for AnyGains {
    fn default() -> Self {
        Self::Vqf(VqfGains::default())
    }
}

/// The filter that its gains name: the same bits as from that filter itself.
#[derive(Clone, Debug)]
pub enum AnyFilter {
    /// See [`Vqf`].
    Vqf(Vqf),
    /// See [`Mahony`].
    Mahony(Mahony),
    /// See [`Madgwick`].
    Madgwick(Madgwick),
    /// See [`Complementary`].
    Complementary(Complementary),
}

impl Filter for AnyFilter {
    type Gains = AnyGains;

    #[inline(always)]
    fn new(gains: &AnyGains, period_s: f32, per_g: f32) -> Result<Self, ConfigError> {
        Ok(match gains {
            AnyGains::Vqf(gains) => Self::Vqf(Vqf::new(gains, period_s, per_g)?),
            AnyGains::Mahony(gains) => Self::Mahony(Mahony::new(gains, period_s, per_g)?),
            AnyGains::Madgwick(gains) => Self::Madgwick(Madgwick::new(gains, period_s, per_g)?),
            AnyGains::Complementary(gains) => {
                Self::Complementary(Complementary::new(gains, period_s, per_g)?)
            }
        })
    }

    #[inline(always)]
    fn rates(gains: &AnyGains, period_s: f32) -> (f32, f32) {
        match gains {
            AnyGains::Vqf(gains) => Vqf::rates(gains, period_s),
            AnyGains::Mahony(gains) => Mahony::rates(gains, period_s),
            AnyGains::Madgwick(gains) => Madgwick::rates(gains, period_s),
            AnyGains::Complementary(gains) => Complementary::rates(gains, period_s),
        }
    }

    #[inline(always)]
    fn counts(gains: &AnyGains, per_g: f32) -> f32 {
        match gains {
            AnyGains::Vqf(gains) => Vqf::counts(gains, per_g),
            AnyGains::Mahony(gains) => Mahony::counts(gains, per_g),
            AnyGains::Madgwick(gains) => Madgwick::counts(gains, per_g),
            AnyGains::Complementary(gains) => Complementary::counts(gains, per_g),
        }
    }

    #[inline(always)]
    fn correction(&mut self, view: &View<'_>) -> Correction {
        match self {
            Self::Vqf(filter) => filter.correction(view),
            Self::Mahony(filter) => filter.correction(view),
            Self::Madgwick(filter) => filter.correction(view),
            Self::Complementary(filter) => filter.correction(view),
        }
    }

    /// As many words for each filter, so that their number does not depend on the choice.
    fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        match self {
            Self::Vqf(filter) => filter.memory(each),
            Self::Mahony(_) | Self::Madgwick(_) | Self::Complementary(_) => all(&mut [0; 6], each),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::fixed::{Counts, Estimator, Scale};

    /// Ten seconds of turning, with a field in every second sample.
    fn samples() -> impl Iterator<Item = Counts> {
        (0..1_500_i32).map(|k| Counts {
            gyr: [300 - k % 600, (k * k) as i16 as i32 % 400, 150].map(|rate| rate as i16),
            acc: [(k % 700) as i16 - 350, 200 - (k % 300) as i16, -900],
            mag: (k % 2 == 0).then_some([(k % 500) as i16, 320, 640]),
        })
    }

    fn same<F: Filter<Gains: Default>>(any: fn(F::Gains) -> AnyGains) {
        let (config, chosen) = (
            Config::<F::Gains>::default(),
            Config::with_gains(any(F::Gains::default())),
        );
        let mut one = Estimator::<F>::new(&config, &Scale::BNO055, 6_667).expect("in range");
        let mut other =
            Estimator::<AnyFilter>::new(&chosen, &Scale::BNO055, 6_667).expect("in range");
        for counts in samples() {
            one.update(6_667, &counts);
            other.update(6_667, &counts);
            assert_eq!(one.orientation().wxyz_q30, other.orientation().wxyz_q30);
        }
        let mut words = 0;
        other.memory(&mut |word| {
            words += 1;
            word
        });
        assert_eq!(words, crate::fixed::MEMORY_WORDS);
    }

    #[test]
    fn a_chosen_filter_is_that_filter() {
        same::<Vqf>(AnyGains::Vqf);
        same::<Mahony>(AnyGains::Mahony);
        same::<Madgwick>(AnyGains::Madgwick);
        same::<Complementary>(AnyGains::Complementary);
    }
}
