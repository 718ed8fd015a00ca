//! The faults and their kinds by name, and how their severity is drawn.

use crate::named_enum::named_enum;
use rand::Rng;
use samd21::board::Ticks;

/// The faults, each with its parameters and the name of its kind.
macro_rules! faults {
    ($(
        $(#[$doc:meta])*
        $kind:ident = $name:literal $({ $($parameter:ident: $type:ty),* })?,
    )*) => {
        /// A fault of the sensor, its supply or its cable.
        /// `probability` is the share of the bytes or words in question that it strikes, 0 to 1;
        /// `stretch` is how long a byte is stretched; `clocks` are the pulses until the data line
        /// is let go, 1 to 9.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[allow(missing_docs, reason = "the parameters are described once")]
        pub enum Fault {
            $($(#[$doc])* $kind $({ $($parameter: $type),* })?,)*
        }

        named_enum! {
            /// A kind of fault; its severity is drawn for every run.
            FaultKind, "fault";
            $($(#[$doc])* $kind = $name,)*
        }

        impl FaultKind {
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

faults! {
    /// The cable is off: no power, no acknowledge. Clearing plugs it in again, and the chip boots.
    Unplugged = "unplugged",
    /// The chip has power and does not acknowledge, as some do after a reset by command or after
    /// unexpected clocks. Clearing cuts its power, and it boots.
    Hung = "hung",
    /// Something holds the data line low.
    SdaStuck = "sda-stuck",
    /// Something holds the clock line low.
    SclStuck = "scl-stuck",
    /// The chip was interrupted inside a byte and holds the data line until it has seen this many
    /// clock pulses.
    SdaHeld = "sda-held" { clocks: u8 },
    /// At once: every register returns to its reset value, mode CONFIG, without the time of a boot.
    /// There is nothing to clear.
    ConfigReset = "config-reset",
    /// At once: the supply dips, and the chip boots again. There is nothing to clear.
    PowerDip = "power-dip",
    /// Every byte reads 0xFF though the chip acknowledges.
    AllOnes = "all-ones",
    /// The data registers read zero in a mode that is kept; SYS_STATUS and SYS_ERR read 1, as with
    /// a grounded BL_IND pin.
    AllZero = "all-zero",
    /// Some words of the data registers read 0xFFFF.
    CorruptWords = "corrupt-words" { probability: f64 },
    /// A single bit of some bytes read is inverted.
    BitFlips = "bit-flips" { probability: f64 },
    /// A START or STOP lies inside some bytes: the master sees a bus error.
    BusErrors = "bus-errors" { probability: f64 },
    /// Another master pulls the data line low while some bytes are sent.
    ArbitrationLosses = "arbitration-losses" { probability: f64 },
    /// The data registers are no longer refreshed.
    Frozen = "frozen",
    /// Long clock stretching on some bytes.
    LongStretch = "long-stretch" { stretch: Ticks, probability: f64 },
    /// The most significant bit of some data words is inverted.
    Spikes = "spikes" { probability: f64 },
    /// The gyroscope and its id read zero, and its self-test fails.
    GyroDead = "gyro-dead",
    /// At once: the axis map returns to its reset value, and SYS_ERR reads 2. There is nothing to
    /// clear.
    RevertedAxisMap = "reverted-axis-map",
    /// At once: the axis map swaps X and Y, a valid map that nobody wrote. There is nothing to
    /// clear.
    SwappedAxes = "swapped-axes",
    /// At once: UNIT_SEL returns to its reset value. There is nothing to clear.
    RevertedUnits = "reverted-units",
    /// The data that users saw around crashes: acceleration 19.62, 5.68, 0 m/s^2; field 0, 320,
    /// 240.19 uT; rate zero.
    FixedPattern = "fixed-pattern",
    /// The acknowledge of some addresses and bytes written is lost.
    Naks = "naks" { probability: f64 },
    /// The high byte of some data words is that of the refresh before: the shadowing fails.
    TornWords = "torn-words" { probability: f64 },
    /// The chip was interrupted inside a byte and holds the data line; the first clock pulse hangs
    /// it: the line is free then, and nothing acknowledges. Clearing cuts the power of a chip that
    /// hangs, and it boots.
    ClockHang = "clock-hang",
}

impl FaultKind {
    /// A fault of this kind as hard as one that is drawn can be.
    pub fn hardest(self) -> Fault {
        self.with(&Drawn { probability: 1.0 / 3.0, stretch: Ticks::from_ms(40), clocks: 9 })
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
        assert!("gremlins".parse::<FaultKind>().unwrap_err().contains("sda-held"));
    }

    #[test]
    fn the_manual_has_every_kind() {
        let manual = include_str!("../../../docs/reference/faults.md");
        for kind in FaultKind::ALL {
            assert!(manual.contains(&format!("| `{kind}` |")), "{kind}");
        }
    }

    #[test]
    fn shares_and_stretches_lie_in_their_ranges() {
        let mut dice = generator(1, Stream::Campaign);
        for _ in 0..1000 {
            match FaultKind::LongStretch.draw(&mut dice) {
                Fault::LongStretch { stretch, probability } => {
                    assert!((1000..=40_000).contains(&stretch.as_us()));
                    assert!((0.0003..0.334).contains(&probability));
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
