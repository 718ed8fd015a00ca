//! What can fail, by name, and how hard.

use super::Fault;
use rand::Rng;
use samd21::board::Ticks;
use std::fmt;
use std::str::FromStr;

/// The kinds of faults, each with its name.
macro_rules! fault_kinds {
    ($($kind:ident = $name:literal,)*) => {
        /// A kind of fault; how hard it strikes is drawn for every run.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[allow(missing_docs, reason = "each is the fault of the same name")]
        pub enum FaultKind {
            $($kind,)*
        }

        impl FaultKind {
            /// All of them.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$kind),*];

            /// Its name on the command line, in files and in tables.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $name,)*
                }
            }
        }
    };
}

fault_kinds! {
    Unplugged = "unplugged",
    Hung = "hung",
    SdaStuck = "sda-stuck",
    SclStuck = "scl-stuck",
    SdaHeld = "sda-held",
    ConfigReset = "config-reset",
    PowerDip = "power-dip",
    AllOnes = "all-ones",
    AllZero = "all-zero",
    CorruptWords = "corrupt-words",
    BitFlips = "bit-flips",
    BusErrors = "bus-errors",
    ArbitrationLosses = "arbitration-losses",
    Frozen = "frozen",
    LongStretch = "long-stretch",
    Spikes = "spikes",
    GyroDead = "gyro-dead",
    RevertedAxisMap = "reverted-axis-map",
    SwappedAxes = "swapped-axes",
    RevertedUnits = "reverted-units",
    FixedPattern = "fixed-pattern",
    Naks = "naks",
    TornWords = "torn-words",
    ClockHang = "clock-hang",
}

impl FaultKind {
    /// A fault of this kind. Those that strike words, bytes or bits do so with a share between one in
    /// three thousand and one in three; a stretched byte takes 1 to 40 ms. Both are drawn evenly by
    /// their logarithm.
    pub fn draw(self, dice: &mut impl Rng) -> Fault {
        let share = 1.0 / 3.0 * f64::exp(-dice.random_range(0.0..f64::ln(1000.0)));
        let stretch = Ticks::from_secs_f64(1e-3 * f64::exp(dice.random_range(0.0..f64::ln(40.0))));
        match self {
            Self::Unplugged => Fault::Unplugged,
            Self::Hung => Fault::Hung,
            Self::SdaStuck => Fault::SdaStuck,
            Self::SclStuck => Fault::SclStuck,
            Self::SdaHeld => Fault::SdaHeld {
                clocks: dice.random_range(1..=9),
            },
            Self::ConfigReset => Fault::ConfigReset,
            Self::PowerDip => Fault::PowerDip,
            Self::AllOnes => Fault::AllOnes,
            Self::AllZero => Fault::AllZero,
            Self::CorruptWords => Fault::CorruptWords { probability: share },
            Self::BitFlips => Fault::BitFlips { probability: share },
            Self::BusErrors => Fault::BusErrors { probability: share },
            Self::ArbitrationLosses => Fault::ArbitrationLosses { probability: share },
            Self::Frozen => Fault::Frozen,
            Self::LongStretch => Fault::LongStretch {
                stretch,
                probability: share,
            },
            Self::Spikes => Fault::Spikes { probability: share },
            Self::GyroDead => Fault::GyroDead,
            Self::RevertedAxisMap => Fault::RevertedAxisMap,
            Self::SwappedAxes => Fault::SwappedAxes,
            Self::RevertedUnits => Fault::RevertedUnits,
            Self::FixedPattern => Fault::FixedPattern,
            Self::Naks => Fault::Naks { probability: share },
            Self::TornWords => Fault::TornWords { probability: share },
            Self::ClockHang => Fault::ClockHang,
        }
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for FaultKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == text)
            .ok_or_else(|| {
                let names = Self::ALL.map(Self::name).join(", ");
                format!("there is no fault {text}; there are {names}")
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, generator};

    #[test]
    fn every_kind_has_a_name_of_its_own_and_is_found_by_it() {
        for (index, kind) in FaultKind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, index);
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert!(
            "gremlins"
                .parse::<FaultKind>()
                .unwrap_err()
                .contains("sda-held")
        );
    }

    #[test]
    fn the_manual_has_every_kind() {
        let manual = include_str!("../../../docs/faults.md");
        for kind in FaultKind::ALL {
            assert!(manual.contains(&format!("| `{kind}` |")), "{kind}");
        }
    }

    #[test]
    fn shares_and_stretches_lie_in_their_ranges() {
        let mut dice = generator(1, Stream::Campaign);
        for _ in 0..1000 {
            match FaultKind::LongStretch.draw(&mut dice) {
                Fault::LongStretch {
                    stretch,
                    probability,
                } => {
                    assert!((1000..=40_000).contains(&stretch.as_us()));
                    assert!((0.0003..0.334).contains(&probability));
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
