//! A filter that is chosen while the program runs.

use super::filters::sealed::Sealed;
use super::filters::{Complementary, Correction, Filter, FilterState, Made, Madgwick, Mahony};
use super::filters::{View, Vqf};
use crate::complementary::ComplementaryGains;
use crate::madgwick::MadgwickGains;
use crate::mahony::MahonyGains;
use crate::vqf::VqfGains;

/// The choice between filters, with the coefficients of each.
macro_rules! any {
    ($($name:ident: $gains:ident),+) => {
        /// Which filter, and its gains.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum AnyGains {
            $(#[doc = concat!("[`", stringify!($name), "`].")] $name($gains),)+
        }

        /// The filter that its gains name, with the same bits as that filter.
        #[derive(Clone, Debug, PartialEq)]
        pub enum AnyFilter {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name),)+
        }

        $(impl Sealed for $name {})+
        impl Sealed for AnyFilter {}

        impl Filter for AnyFilter {
            type Gains = AnyGains;

            #[inline(always)]
            fn new(gains: &AnyGains, period_s: f32, per_g: f32) -> Made<Self> {
                match gains {
                    $(AnyGains::$name(gains) => {
                        let (filter, pace) = $name::new(gains, period_s, per_g)?;
                        Ok((Self::$name(filter), pace))
                    })+
                }
            }

            #[inline(always)]
            fn correction(&self, state: &mut FilterState, view: &View<'_>) -> Correction {
                match self {
                    $(Self::$name(filter) => filter.correction(state, view),)+
                }
            }
        }
    };
}

any!(
    Vqf: VqfGains,
    Mahony: MahonyGains,
    Madgwick: MadgwickGains,
    Complementary: ComplementaryGains
);

impl Default for AnyGains {
    fn default() -> Self {
        Self::Vqf(VqfGains::default())
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
        let (config, chosen) =
            (Config::<F::Gains>::default(), Config::with_gains(any(F::Gains::default())));
        let one = Estimator::<F>::new(&config, &Scale::BNO055, 6_667).expect("in range");
        let other = Estimator::<AnyFilter>::new(&chosen, &Scale::BNO055, 6_667).expect("in range");
        let (mut first, mut second) = (one.start(), other.start());
        for counts in samples() {
            one.update(&mut first, 6_667, &counts);
            other.update(&mut second, 6_667, &counts);
            assert_eq!(first, second);
        }
    }

    #[test]
    fn a_chosen_filter_is_that_filter() {
        same::<Vqf>(AnyGains::Vqf);
        same::<Mahony>(AnyGains::Mahony);
        same::<Madgwick>(AnyGains::Madgwick);
        same::<Complementary>(AnyGains::Complementary);
    }
}
