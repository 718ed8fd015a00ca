//! The chip's I/O multiplexing (D21: I/O multiplexing and considerations, SAM D21G): what each
//! peripheral function of a pin leads to.

use crate::board::Pin;

/// External interrupts.
pub(super) const FUNCTION_A: u8 = 0;
/// SERCOM pads, two choices.
const FUNCTION_C: u8 = 2;
const FUNCTION_D: u8 = 3;
/// Timer waveforms, two choices.
const FUNCTION_E: u8 = 4;
const FUNCTION_F: u8 = 5;
/// USB pads.
pub(super) const FUNCTION_G: u8 = 6;

/// A waveform output of a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Waveform {
    /// A TCC and the number of its output.
    Tcc(u8, u8),
    /// One of a TC's outputs.
    Tc,
}

/// The EIC line that function A of a pin leads to.
pub(super) fn interrupt_line(pin: Pin) -> Option<u8> {
    match (pin.group, pin.index) {
        (0, 0..=7 | 9..=15) | (1, 2 | 3 | 8..=11) => Some(pin.index),
        (0, 16..=23) | (1, 22 | 23) => Some(pin.index - 16),
        (0, 24 | 25 | 27) => Some(pin.index - 12),
        (0, 28 | 30 | 31) => Some(pin.index - 20),
        _ => None,
    }
}

/// The SERCOM and the number of its pad that functions C and D of a pin lead to.
pub(super) fn sercom_pad(pin: Pin, function: u8) -> Option<(usize, u8)> {
    let Pin { group, index } = pin;
    let sercom = match (function, group, index) {
        (FUNCTION_C, 0, 8..=11) => 0,
        (FUNCTION_C, 0, 12..=15) => 2,
        (FUNCTION_C, 0, 16..=19) => 1,
        (FUNCTION_C, 0, 20 | 21) => 5,
        (FUNCTION_C, 0, 22..=25) => 3,
        (FUNCTION_D, 0, 0 | 1 | 30 | 31) => 1,
        (FUNCTION_D, 0, 4..=7) => 0,
        (FUNCTION_D, 0, 8..=11) => 2,
        (FUNCTION_D, 0, 12..=15) => 4,
        (FUNCTION_D, 0, 16..=21) => 3,
        (FUNCTION_D, 0, 22..=25) => 5,
        (FUNCTION_D, 1, 2 | 3 | 22 | 23) => 5,
        (FUNCTION_D, 1, 8..=11) => 4,
        _ => return None,
    };
    // Pads follow the pin's number but on PA20 to PA25, PB02 and PB03.
    let pad = match (group, index) {
        (0, 20..=25) | (1, 2 | 3) => index + 2,
        _ => index,
    };
    Some((sercom, pad & 3))
}

/// The waveform that functions E and F of a pin lead to.
pub(super) fn waveform(pin: Pin, function: u8) -> Option<Waveform> {
    use Waveform::{Tc, Tcc};
    let Pin { group, index } = pin;
    match (function, group, index) {
        (FUNCTION_E, 0, 0 | 1) => Some(Tcc(2, index)),
        (FUNCTION_E, 0, 4 | 5) => Some(Tcc(0, index - 4)),
        (FUNCTION_E, 0, 6 | 7) => Some(Tcc(1, index - 6)),
        (FUNCTION_E, 0, 8 | 9) => Some(Tcc(0, index - 8)),
        (FUNCTION_E, 0, 10 | 11) => Some(Tcc(1, index - 10)),
        (FUNCTION_E, 0, 12 | 13) => Some(Tcc(2, index - 12)),
        (FUNCTION_E, 0, 16 | 17) => Some(Tcc(2, index - 16)),
        (FUNCTION_E, 0, 30 | 31) => Some(Tcc(1, index - 30)),
        (FUNCTION_E, 0, 14 | 15 | 18..=25) => Some(Tc),
        (FUNCTION_E, 1, 2 | 3 | 8..=11 | 22 | 23) => Some(Tc),
        (FUNCTION_F, 0, 8 | 9) => Some(Tcc(1, index - 6)),
        (FUNCTION_F, 0, 10 | 11) => Some(Tcc(0, index - 8)),
        (FUNCTION_F, 0, 12 | 13) => Some(Tcc(0, index - 6)),
        (FUNCTION_F, 0, 14 | 15) => Some(Tcc(0, index - 10)),
        (FUNCTION_F, 0, 16 | 17) => Some(Tcc(0, index - 10)),
        (FUNCTION_F, 0, 18 | 19) => Some(Tcc(0, index - 16)),
        (FUNCTION_F, 0, 20 | 21) => Some(Tcc(0, index - 14)),
        (FUNCTION_F, 0, 22 | 23) => Some(Tcc(0, index - 18)),
        (FUNCTION_F, 0, 24 | 25) => Some(Tcc(1, index - 22)),
        (FUNCTION_F, 1, 10 | 11) => Some(Tcc(0, index - 6)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sercom_pads_are_those_of_the_data_sheet() {
        // Pin, then SERCOM and pad by function C and by function D.
        let table = "\
            A00 -- 10, A01 -- 11, A04 -- 00, A05 -- 01, A06 -- 02, A07 -- 03, A08 00 20, \
            A09 01 21, A10 02 22, A11 03 23, A12 20 40, A13 21 41, A14 22 42, A15 23 43, \
            A16 10 30, A17 11 31, A18 12 32, A19 13 33, A20 52 32, A21 53 33, A22 30 50, \
            A23 31 51, A24 32 52, A25 33 53, A30 -- 12, A31 -- 13, B02 -- 50, B03 -- 51, \
            B08 -- 40, B09 -- 41, B10 -- 42, B11 -- 43, B22 -- 52, B23 -- 53";
        let mut expected = table.split(", ");
        for pin in (0..64).map(|n| Pin { group: n / 32, index: n % 32 }) {
            let pads = [FUNCTION_C, FUNCTION_D].map(|function| sercom_pad(pin, function));
            if pads == [None; 2] {
                continue;
            }
            let [c, d] = pads
                .map(|pad| pad.map_or("--".to_string(), |(sercom, pad)| format!("{sercom}{pad}")));
            let row = format!("{} {c} {d}", &pin.to_string()[1..]);
            assert_eq!(Some(row.as_str()), expected.next());
        }
        assert_eq!(expected.next(), None);
    }

    #[test]
    fn interrupt_lines_are_those_of_the_data_sheet() {
        let line = |pin| interrupt_line(pin);
        assert_eq!(line(Pin::a(7)), Some(7));
        assert_eq!(line(Pin::a(8)), None, "the non-maskable interrupt");
        assert_eq!(line(Pin::a(16)), Some(0));
        assert_eq!(line(Pin::a(25)), Some(13));
        assert_eq!(line(Pin::a(27)), Some(15));
        assert_eq!(line(Pin::a(28)), Some(8));
        assert_eq!(line(Pin::a(31)), Some(11));
        assert_eq!(line(Pin::b(23)), Some(7));
        assert_eq!(line(Pin::b(11)), Some(11));
    }
}
