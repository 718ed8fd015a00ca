//! Block transfers: PUSH, POP, STM and LDM.

use super::decode::field;
use super::{Core, LR, Outcome, SP, undefined};
use crate::bus::Bus;

impl Core {
    pub(super) fn push(&mut self, bus: &mut Bus<'_>, op: u16) -> Outcome<u32> {
        // Bit 8 stands for LR.
        let list = op & 0x1FF;
        let count = list.count_ones();
        if count == 0 {
            return Err(undefined(op));
        }
        let base = self.r[SP].wrapping_sub(4 * count);
        let mut address = base;
        for bit in bits(list) {
            let register = if bit == 8 { LR } else { bit };
            self.store::<4>(bus, address, self.r[register])?;
            address = address.wrapping_add(4);
        }
        self.set_sp(base);
        Ok(1 + count)
    }

    pub(super) fn pop(&mut self, bus: &mut Bus<'_>, op: u16, pc: u32) -> Outcome<u32> {
        let list = op & 0xFF;
        let with_pc = op & 0x100 != 0;
        let count = list.count_ones() + u32::from(with_pc);
        if count == 0 {
            return Err(undefined(op));
        }
        let mut address = self.r[SP];
        let mut loaded = [0; 9];
        let mut slots = loaded.iter_mut();
        for slot in slots.by_ref().take(count as usize) {
            *slot = self.load::<4>(bus, address)?;
            address = address.wrapping_add(4);
        }
        for (register, value) in bits(list).zip(loaded) {
            self.r[register] = value;
        }
        self.set_sp(address);
        if !with_pc {
            return Ok(1 + count);
        }
        let target = loaded[count as usize - 1];
        Ok(3 + count + self.branch_exchange(bus, target, pc)?)
    }

    pub(super) fn store_multiple(&mut self, bus: &mut Bus<'_>, op: u16) -> Outcome<u32> {
        let (rn, list) = (usize::from(field(op, 8)), op & 0xFF);
        if list == 0 {
            return Err(undefined(op));
        }
        let mut address = self.r[rn];
        for register in bits(list) {
            self.store::<4>(bus, address, self.r[register])?;
            address = address.wrapping_add(4);
        }
        self.r[rn] = address;
        Ok(1 + list.count_ones())
    }

    pub(super) fn load_multiple(&mut self, bus: &mut Bus<'_>, op: u16) -> Outcome<u32> {
        let (rn, list) = (usize::from(field(op, 8)), op & 0xFF);
        if list == 0 {
            return Err(undefined(op));
        }
        let mut address = self.r[rn];
        let mut loaded = [0; 8];
        for slot in loaded.iter_mut().take(list.count_ones() as usize) {
            *slot = self.load::<4>(bus, address)?;
            address = address.wrapping_add(4);
        }
        // A base in the list gets the loaded word, any other the address behind the last.
        self.r[rn] = address;
        for (register, value) in bits(list).zip(loaded) {
            self.r[register] = value;
        }
        Ok(1 + list.count_ones())
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
