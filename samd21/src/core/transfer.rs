//! Block transfers: PUSH, POP, STM and LDM.

use super::decode::{Instruction, Operation};
use super::{Core, LR, Outcome};
use crate::bus::Bus;

impl Core {
    /// PUSH and STM.
    pub(super) fn store_block(&mut self, bus: &mut Bus<'_>, i: Instruction) -> Outcome<u32> {
        let (base, count) = (self.r[usize::from(i.a)], u32::from(i.c));
        let pushes = i.operation == Operation::Push;
        let mut address = if pushes { base.wrapping_sub(4 * count) } else { base };
        let lowest = address;
        for bit in bits(i.imm as u16) {
            let register = if bit == 8 { LR } else { bit };
            self.store::<4>(bus, address, self.r[register])?;
            address = address.wrapping_add(4);
        }
        if pushes {
            self.set_sp(lowest);
        } else {
            self.r[usize::from(i.a)] = address;
        }
        Ok(1 + count)
    }

    /// POP and LDM.
    pub(super) fn load_block(
        &mut self,
        bus: &mut Bus<'_>,
        i: Instruction,
        pc: u32,
    ) -> Outcome<u32> {
        let with_pc = i.operation == Operation::PopPc;
        let count = usize::from(i.c) + usize::from(with_pc);
        let mut address = self.r[usize::from(i.a)];
        let mut loaded = [0; 9];
        for slot in &mut loaded[..count] {
            *slot = self.load::<4>(bus, address)?;
            address = address.wrapping_add(4);
        }
        // A base in the list gets the loaded word, any other the address behind the last.
        if i.operation == Operation::Ldm {
            self.r[usize::from(i.a)] = address;
        } else {
            self.set_sp(address);
        }
        for (register, value) in bits(i.imm as u16).zip(loaded) {
            self.r[register] = value;
        }
        if !with_pc {
            return Ok(1 + count as u32);
        }
        Ok(3 + count as u32 + self.branch_exchange(bus, loaded[count - 1], pc)?)
    }
}

/// The set bits' numbers, lowest first.
#[inline(always)]
pub(super) fn bits(mut list: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (list != 0).then(|| list.trailing_zeros() as usize);
        list &= list.wrapping_sub(1);
        lowest
    })
}
