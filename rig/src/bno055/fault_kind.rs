//! The kinds of faults by name, and how their severity is drawn.

use super::Fault;
use rand::Rng;
use samd21::board::Ticks;
use std::fmt;
use std::str::FromStr;

/// The kinds of faults, each with its name and the parameters that are drawn for it.
macro_rules! fault_kinds {
    ($($kind:ident = $name:literal $({ $($parameter:ident),* })?,)*) => {
        /// A kind of fault; its severity is drawn for every run.
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

            /// The kind of a fault.
            pub fn of(fault: &Fault) -> Self {
                match fault {
                    $(Fault::$kind { .. } => Self::$kind,)*
                }
            }

            fn with(self, drawn: &Drawn) -> Fault {
                match self {
                    $(Self::$kind => Fault::$kind $({
                        $($parameter: drawn.$parameter),*
                    })?,)*
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
    SdaHeld = "sda-held" { clocks },
    ConfigReset = "config-reset",
    PowerDip = "power-dip",
    AllOnes = "all-ones",
    AllZero = "all-zero",
    CorruptWords = "corrupt-words" { probability },
    BitFlips = "bit-flips" { probability },
    BusErrors = "bus-errors" { probability },
    ArbitrationLosses = "arbitration-losses" { probability },
    Frozen = "frozen",
    LongStretch = "long-stretch" { stretch, probability },
    Spikes = "spikes" { probability },
    GyroDead = "gyro-dead",
    RevertedAxisMap = "reverted-axis-map",
    SwappedAxes = "swapped-axes",
    RevertedUnits = "reverted-units",
    FixedPattern = "fixed-pattern",
    Naks = "naks" { probability },
    TornWords = "torn-words" { probability },
    ClockHang = "clock-hang",
}

impl FaultKind {
    /// A fault of this kind as hard as one that is drawn can be.
    pub fn hardest(self) -> Fault {
        self.with(&Drawn {
            probability: 1.0 / 3.0,
            stretch: Ticks::from_ms(40),
            clocks: 9,
        })
    }

    /// Draws a fault of this kind. Kinds that strike words or bytes get a share between one in
    /// three thousand and one in three; a stretched byte takes 1 to 40 ms. The logarithm of either
    /// is drawn uniformly.
    pub fn draw(self, dice: &mut impl Rng) -> Fault {
        let decay = dice.random_range(0.0..f64::ln(1000.0));
        let stretch_ms = f64::exp(dice.random_range(0.0..f64::ln(40.0)));
        self.with(&Drawn {
            probability: 1.0 / 3.0 * f64::exp(-decay),
            stretch: Ticks::from_secs_f64(1e-3 * stretch_ms),
            // Drawn for its own kind only, so that it shifts no other kind's numbers.
            clocks: match self {
                Self::SdaHeld => dice.random_range(1..=9),
                _ => 0,
            },
        })
    }
}

/// Parameters of a fault; each kind takes those that it has.
struct Drawn {
    probability: f64,
    stretch: Ticks,
    clocks: u8,
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
            assert_eq!(FaultKind::of(&kind.hardest()), kind);
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
