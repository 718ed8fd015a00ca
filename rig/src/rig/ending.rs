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
    /// The stack grows into the statics: what guards them is overwritten.
    StackOverflow,
}

impl Rig {
    /// Ends the run of the image; gives the address at which it ends. `None`, and nothing happens,
    /// for an image that does not say where its statics end.
    pub fn end_program(&mut self, end: ProgramEnd) -> Option<u32> {
        let mut registers = self.chip.registers();
        let named = match end {
            // A branch to itself, and an undefined instruction.
            ProgramEnd::Hang => self.spare(0xE7FE),
            ProgramEnd::HardFault => self.spare(0xDE00),
            ProgramEnd::StackOverflow => return self.overflow_stack(),
        };
        registers.r[15] = named;
        registers.primask = false;
        self.chip.set_registers(&registers);
        Some(named)
    }

    /// Overwrites the lowest word of the stack's RAM.
    fn overflow_stack(&mut self) -> Option<u32> {
        let place = self.image.symbol("_stack_end")?.checked_sub(RAM)? as usize;
        self.chip.memory.ram_mut().get_mut(place..place + 4)?.fill(0);
        Some(self.chip.registers().r[15])
    }

    /// Puts one instruction into spare RAM; its address.
    fn spare(&mut self, instruction: u16) -> u32 {
        let place = SPARE_RAM..SPARE_RAM + 2;
        self.chip.memory.ram_mut()[place].copy_from_slice(&instruction.to_le_bytes());
        RAM + SPARE_RAM as u32
    }

    /// Single bits of every stored set of parameters flip: none of them can be read any more.
    pub fn spoil_store(&mut self) {
        for slot in [0, store::SLOT_BYTES] {
            let address = store::STORE_ADDRESS + slot as u32 + 20;
            let spoilt = self.chip.memory.flash()[address as usize] ^ 4;
            self.chip.load_flash(address, &[spoilt]);
        }
    }

    /// The stored parameters are erased, as by a programmer that erases everything.
    pub fn erase_store(&mut self) {
        self.chip.load_flash(store::STORE_ADDRESS, &[0xFF; store::STORE_BYTES]);
    }
}
