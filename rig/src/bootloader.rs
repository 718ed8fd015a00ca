//! The bootloader between a reset and the image: how long it takes, what it leaves in RAM and what
//! it looks for there.
//!
//! Both bootloaders start the image after a power-on. After any other reset they leave a word of
//! their own at the end of RAM, wait for a second tap on the reset button, clear the word and start
//! the image. Whoever finds the word there stays in control: after a second tap, or because the
//! image put it there before it reset the chip. Neither has touched clocks, USB or interrupts when
//! it starts the image.
//!
//! | | Arduino's of the Nano 33 IoT | UF2 |
//! |---|---|---|
//! | word at 0x2000_7FFC | 0x0773_8135 | 0xF016_69EF; 0xF026_69EF starts the image without waiting |
//! | its literal in flash | at 0x724 | where the compiler put it, here at 0x600 |
//! | from power-on to the image | 1.79 ms | 1.79 ms (as the other, an estimate) |
//! | from another reset to the image | 501.8 ms | 600 ms (128,000 rounds of 4 to 5 cycles at 1 MHz, an estimate) |
//! | RAM that it uses | variables at the start, stack at the end | variables and stack at the start, below 0x2000_5000 |
//! | source | ArduinoCore-samd 1.8.14, the shipped binary run on the emulated chip | uf2-samdx1, `main.c`, `uf2.h`, linker script |
//!
//! Their programs are not emulated. Flash holds the literal alone, by which firmware can tell them
//! apart. Left out: the UF2 bootloader sets BOD33 to level 39 on some boards.

use samd21::Chip;
use samd21::board::Ticks;
use samd21::peripherals::ResetCause;
use std::ops::Range;

/// Where the word lies, as an offset in RAM.
const WORD_AT: usize = 0x7FFC;
/// What a bootloader leaves in RAM that it has used.
const RUBBISH: u8 = 0xB0;

/// A bootloader in the first 8 KB of flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bootloader {
    /// Arduino's with even times: the image at once after a power-on, half a second after another
    /// reset.
    #[default]
    Even,
    /// Arduino's of the Nano 33 IoT.
    Arduino,
    /// UF2.
    Uf2,
    /// None that waits or leaves anything: the image starts at once after every reset.
    None,
}

/// What there is to know about a bootloader.
struct Figures {
    /// The word for which it stays in control.
    word: u32,
    /// The word for which it starts the image without waiting.
    quick_word: Option<u32>,
    /// Where the literal of `word` lies in flash.
    literal_at: u32,
    from_power_on: Ticks,
    from_reset: Ticks,
    /// RAM that it uses, as offsets.
    ram: [Range<usize>; 2],
}

const ARDUINO: Figures = Figures {
    word: 0x0773_8135,
    quick_word: None,
    literal_at: 0x724,
    from_power_on: Ticks::from_us(1790),
    from_reset: Ticks::from_us(501_800),
    ram: [0..0x800, 0x7A00..WORD_AT],
};
const EVEN: Figures =
    Figures { from_power_on: Ticks::ZERO, from_reset: Ticks::from_ms(500), ..ARDUINO };
const UF2: Figures = Figures {
    word: 0xF016_69EF,
    quick_word: Some(0xF026_69EF),
    literal_at: 0x600,
    from_power_on: Ticks::from_us(1790),
    from_reset: Ticks::from_ms(600),
    ram: [0..0x5000, 0..0],
};

/// What a bootloader does with a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It starts the image after this time.
    StartsImage(Ticks),
    /// It waits for a programmer until the next reset.
    Stays,
}

impl Bootloader {
    fn figures(self) -> Option<Figures> {
        match self {
            Self::Even => Some(EVEN),
            Self::Arduino => Some(ARDUINO),
            Self::Uf2 => Some(UF2),
            Self::None => None,
        }
    }

    /// Puts its literal into the chip's flash.
    pub(crate) fn install(self, chip: &mut Chip) {
        if let Some(figures) = self.figures() {
            chip.load_flash(figures.literal_at, &figures.word.to_le_bytes());
        }
    }

    /// What it does after a reset, and what it leaves in RAM at first.
    pub(crate) fn enter(self, cause: ResetCause, ram: &mut [u8]) -> Verdict {
        let Some(figures) = self.figures() else {
            return Verdict::StartsImage(Ticks::ZERO);
        };
        for used in figures.ram {
            ram[used].fill(RUBBISH);
        }
        let found = u32::from_le_bytes([0, 1, 2, 3].map(|i| ram[WORD_AT + i]));
        let (left, verdict) = if cause == ResetCause::PowerOn {
            (0, Verdict::StartsImage(figures.from_power_on))
        } else if found == figures.word {
            (0, Verdict::Stays)
        } else if Some(found) == figures.quick_word {
            (0, Verdict::StartsImage(figures.from_power_on))
        } else {
            (figures.word, Verdict::StartsImage(figures.from_reset))
        };
        put_word(ram, left);
        verdict
    }

    /// What it does to RAM last before it starts the image.
    pub(crate) fn leave(self, ram: &mut [u8]) {
        if self.figures().is_some() {
            put_word(ram, 0);
        }
    }
}

fn put_word(ram: &mut [u8], word: u32) {
    ram[WORD_AT..WORD_AT + 4].copy_from_slice(&word.to_le_bytes());
}

#[cfg(test)]
mod tests;
