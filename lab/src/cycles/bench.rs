//! An image of the package `cycles` on the emulated chip: one update at a time.

use std::ops::Range;

use anyhow::{Context, Result, bail, ensure};
use rig::Image;
use samd21::board::{Ticks, Unconnected};
use samd21::chip::{Registers, Stop};
use samd21::memory::RAM_BASE;
use samd21::{Chip, Options};

/// Breakpoints of the image: it waits for a sample, the update is over, UP is written, it panicked.
const ASKED: u16 = 0xBE00;
const OVER: u16 = 0xBE01;
const UP_KNOWN: u16 = 0xBE02;
const PANIC: u16 = 0xBE03;

/// Words that an image has room for, at most, in what an update is given.
const WORDS: usize = 10;

/// Time limit of an update and of the start; both take less.
const PATIENCE: Ticks = Ticks(20 * Ticks::PER_SECOND);

/// The byte that the stack is filled with beforehand, to see how far it was used.
const PAINT: u8 = 0xA5;

/// A chip that has stopped before an update.
#[derive(Clone)]
pub struct Bench {
    chip: Chip,
    /// Where in RAM a sample is put.
    input: usize,
    /// Address of the filter's direction of up.
    up: u32,
    asked: Registers,
    /// Where in RAM the stack lies, behind the variables.
    stack: Range<usize>,
}

impl Bench {
    /// Boots an image on a chip with these flash wait states, to where it waits for its first
    /// sample.
    pub fn boot(image: &Image, wait_states: u8) -> Result<Self> {
        let mut chip = Chip::new(Options { wait_states: Some(wait_states), ..Options::default() });
        chip.load_flash(image.address(), image.bytes());
        chip.boot(image.address());
        let symbol =
            |name: &str| image.symbol(name).with_context(|| format!("the image has no {name}"));
        let input = symbol("INPUT")?.wrapping_sub(RAM_BASE) as usize;
        ensure!(input + 4 * WORDS <= image.sizes().static_ram as usize, "INPUT is no variable");
        run_to(&mut chip, ASKED)?;
        let asked = chip.registers();
        let stack = image.sizes().static_ram as usize..(asked.msp - RAM_BASE) as usize;
        chip.memory.ram_mut()[stack.clone()].fill(PAINT);
        Ok(Self { input, up: symbol("UP")?, chip, asked, stack })
    }

    /// Cycles of the update with this sample or reading, of at most [`WORDS`] words.
    pub fn update(&mut self, words: &[u32]) -> Result<u64> {
        let (memory, _) = self.chip.memory.ram_mut()[self.input..].as_chunks_mut();
        for (place, word) in memory.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        self.chip.set_registers(&self.asked);
        step_over(&mut self.chip);
        let before = self.chip.counters().cycles;
        run_to(&mut self.chip, OVER)?;
        Ok(self.chip.counters().cycles - before)
    }

    /// The word that the last update has returned: R0, as long as the chip stands behind it.
    pub fn returned(&self) -> u32 {
        self.chip.registers().r[0]
    }

    /// The filter's direction of up after the last update, in the sensor's axes.
    pub fn up(&self) -> Result<[f64; 3]> {
        // On a copy, because this uses more of the stack than the update.
        let mut chip = self.chip.clone();
        step_over(&mut chip);
        run_to(&mut chip, UP_KNOWN)?;
        let axis = |i: u32| chip.memory.read_u32(self.up + 4 * i).map(f32::from_bits);
        match (axis(0), axis(1), axis(2)) {
            (Some(x), Some(y), Some(z)) => Ok([x, y, z].map(f64::from)),
            _ => bail!("UP lies outside of RAM"),
        }
    }

    /// Depth of the stack below the call that the updates so far have used, bytes.
    pub fn stack_bytes(&self) -> u32 {
        let stack = &self.chip.memory.ram()[self.stack.clone()];
        let painted = stack.iter().take_while(|byte| **byte == PAINT).count();
        // The stack is used in words.
        ((stack.len() - painted) as u32).next_multiple_of(4)
    }
}

/// Goes past the breakpoint that the chip stands at.
fn step_over(chip: &mut Chip) {
    let mut registers = chip.registers();
    registers.r[15] += 2;
    chip.set_registers(&registers);
}

/// Runs to the next breakpoint, which must be this one.
fn run_to(chip: &mut Chip, breakpoint: u16) -> Result<()> {
    let stop = chip.run_until(chip.now() + PATIENCE, &mut Unconnected);
    if stop != Stop::Breakpoint {
        match chip.last_hard_fault() {
            Some(fault) => bail!("the update ended in a fault: {fault}"),
            None => bail!("the update does not end ({stop})"),
        }
    }
    match chip.memory.read_u16(chip.pc()) {
        Some(found) if found == breakpoint => Ok(()),
        Some(PANIC) => bail!("the update panicked"),
        _ => bail!("the image stopped where it should not, at 0x{:x}", chip.pc()),
    }
}
