//! Bad ends of a run: a program that hangs or crashes, and flash that has lost what was stored.

use super::Rig;
use tvc_nano::store;

/// RAM that the image leaves alone.
const SPARE_RAM: usize = 0x7A00;
const RAM: u32 = 0x2000_0000;

/// How a run of the image ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramEnd {
    /// The main loop never comes back.
    Hang,
    /// The core meets what is no instruction.
    HardFault,
    /// The program indexes out of bounds.
    Panic,
}

impl Rig {
    /// Ends the run of the image; gives the address that a record of it names. Nothing happens to
    /// an image that has no such panic.
    pub fn end_program(&mut self, end: ProgramEnd) -> Option<u32> {
        let mut registers = self.chip.registers();
        let named = match end {
            // A branch to itself, and an undefined instruction.
            ProgramEnd::Hang => self.spare(0xE7FE),
            ProgramEnd::HardFault => self.spare(0xDE00),
            ProgramEnd::Panic => registers.r[15],
        };
        registers.r[15] = named;
        if end == ProgramEnd::Panic {
            let mut symbols = self.image.symbols();
            let (_, panic) = symbols.find(|(name, _)| name.contains("panic_bounds_check"))?;
            (registers.r[14], registers.r[15]) = (named | 1, panic & !1);
        }
        registers.primask = false;
        self.chip.set_registers(&registers);
        Some(named)
    }

    /// Puts one instruction into spare RAM; its address.
    fn spare(&mut self, instruction: u16) -> u32 {
        let place = SPARE_RAM..SPARE_RAM + 2;
        self.chip.ram_mut()[place].copy_from_slice(&instruction.to_le_bytes());
        RAM + SPARE_RAM as u32
    }

    /// Single bits of every stored set of parameters flip: none of them can be read any more.
    pub fn spoil_store(&mut self) {
        for slot in [0, store::SLOT_BYTES] {
            let address = store::STORE_ADDRESS + slot as u32 + 20;
            let spoilt = self.chip.flash()[address as usize] ^ 4;
            self.chip.load_flash(address, &[spoilt]);
        }
    }

    /// The stored parameters are erased, as by a programmer that erases everything.
    pub fn erase_store(&mut self) {
        let erased = [0xFF; store::STORE_BYTES];
        self.chip.load_flash(store::STORE_ADDRESS, &erased);
    }
}
