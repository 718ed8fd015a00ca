//! One random program as `differential.py` writes it, and its outcome on the emulated core.
//!
//! Little-endian. First the number of half-words to write, and each with its address. Then R0 to
//! R15, the flags in bits 31:28, PRIMASK, CONTROL, MSP, PSP. An outcome uses two more words: the
//! number of instructions, and how the run ended (0: at the BKPT behind the last one).

use samd21::board::{Ticks, Unconnected};
use samd21::chip::{Registers, Stop};
use samd21::memory::{FLASH_SIZE, RAM_BASE};
use samd21::{Chip, Options};

/// Where programs find constant data in flash.
const FLASH_DATA: u32 = 0x1_0000;
/// Words of an outcome.
pub const OUTCOME_WORDS: usize = 23;
/// Nothing that terminates takes longer.
const LIMIT: Ticks = Ticks::from_ms(10);

/// A program and the state it starts from.
pub struct Case {
    writes: Vec<(u32, u16)>,
    start: [u32; OUTCOME_WORDS],
}

impl Case {
    /// Takes a case off the front of `bytes`; `None` if they end before it does.
    pub fn parse(bytes: &mut &[u8]) -> Option<Self> {
        let count = u32::from_le_bytes(take(bytes)?);
        let writes = (0..count)
            .map(|_| {
                let address = u32::from_le_bytes(take(bytes)?);
                Some((address, u16::from_le_bytes(take(bytes)?)))
            })
            .collect::<Option<_>>()?;
        let start = words(bytes)?;
        Some(Self { writes, start })
    }

    /// Runs the program; SRAM goes on from what the last one left.
    pub fn run(&self, chip: &mut Chip) -> [u32; OUTCOME_WORDS] {
        for &(address, half_word) in &self.writes {
            let bytes = half_word.to_le_bytes();
            if address < FLASH_SIZE {
                chip.load_flash(address, &bytes);
            } else {
                let at = (address - RAM_BASE) as usize;
                chip.memory.ram_mut()[at..at + 2].copy_from_slice(&bytes);
            }
        }
        let s = &self.start;
        let mut r = [0; 16];
        r.copy_from_slice(&s[..16]);
        chip.set_registers(&Registers {
            r,
            xpsr: s[16],
            primask: s[17] != 0,
            spsel: s[18] != 0,
            msp: s[19],
            psp: s[20],
        });
        let before = chip.counters().instructions;
        let stop = chip.run_until(chip.now() + LIMIT, &mut Unconnected);
        if stop != Stop::Breakpoint {
            eprintln!("{stop}; last HardFault: {:?}", chip.last_hard_fault());
        }
        let after = chip.registers();
        let mut outcome = [0; OUTCOME_WORDS];
        outcome[..16].copy_from_slice(&after.r);
        outcome[16..].copy_from_slice(&[
            after.xpsr & 0xF000_0000,
            u32::from(after.primask),
            u32::from(after.spsel) << 1,
            after.msp,
            after.psp,
            (chip.counters().instructions - before) as u32,
            u32::from(stop != Stop::Breakpoint),
        ]);
        outcome
    }
}

/// The chip that the programs of `seed` start on.
pub fn chip(seed: u64) -> Chip {
    let mut chip = Chip::new(Options { seed, ..Options::default() });
    let noise = *chip.memory.ram();
    chip.load_flash(FLASH_DATA, &noise);
    chip
}

/// Takes an outcome off the front of `bytes`.
pub fn words(bytes: &mut &[u8]) -> Option<[u32; OUTCOME_WORDS]> {
    let mut words = [0; OUTCOME_WORDS];
    for word in &mut words {
        *word = u32::from_le_bytes(take(bytes)?);
    }
    Some(words)
}

/// Takes `N` bytes off the front of `bytes`.
pub fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}
