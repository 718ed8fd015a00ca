//! Registers that must not change by themselves: what a flipped bit has changed is put right, or
//! ends the run.
//!
//! A [`Register`] is a row of the chip's table. [`Patrol`] takes the values that start-up has left
//! and compares them: the table's first rows at each look, and a few of the others in turn.

/// How wide a register is read and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// 8 bits.
    Byte,
    /// 16 bits.
    Half,
    /// 32 bits.
    Word,
}

/// What to do with a register that has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Then {
    /// Write it anew.
    Restore,
    /// End the run: what it has done meanwhile is not put right by that.
    Stop,
}

/// A register, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Its address.
    pub at: u32,
    /// The bits that count.
    pub mask: u32,
    /// How it is read and written.
    pub width: Width,
    /// The byte that, written to its address, selects which of several registers shows there.
    pub select: Option<u8>,
    /// What to do.
    pub then: Then,
}

impl Register {
    /// All bits of a register that is written anew.
    pub const fn new(at: u32, width: Width) -> Self {
        Self { at, mask: u32::MAX, width, select: None, then: Then::Restore }
    }

    /// Only these bits of it.
    pub const fn bits(self, mask: u32) -> Self {
        Self { mask, ..self }
    }

    /// The one that this byte selects.
    pub const fn of(self, select: u8) -> Self {
        Self { select: Some(select), ..self }
    }

    /// A change ends the run.
    pub const fn stops(self) -> Self {
        Self { then: Then::Stop, ..self }
    }
}

/// Reads and writes registers.
pub trait Access {
    /// What is there.
    fn read(&mut self, register: &Register) -> u32;

    /// Put it there.
    fn write(&mut self, register: &Register, value: u32);
}

/// A table of registers, and what they hold.
#[derive(Debug)]
pub struct Patrol<const N: usize> {
    table: &'static [Register; N],
    /// Rows that are compared at each look.
    always: usize,
    /// Of the others, rows that are compared at each look.
    at_once: usize,
    held: [u32; N],
    /// [`seal`] of them.
    seal: u32,
    next: usize,
}

impl<const N: usize> Patrol<N> {
    /// What the registers hold now.
    pub fn new(
        table: &'static [Register; N],
        always: usize,
        at_once: usize,
        access: &mut impl Access,
    ) -> Self {
        let held = core::array::from_fn(|index| table.get(index).map_or(0, |row| access.read(row)));
        Self { table, always, at_once, held, seal: seal(&held), next: always }
    }

    /// The rows from this one on have been set to something else.
    pub fn renew(&mut self, first: usize, access: &mut impl Access) {
        let held = self.held.get_mut(first..).unwrap_or_default();
        for (register, held) in self.table.get(first..).unwrap_or_default().iter().zip(held) {
            *held = access.read(register);
        }
        self.seal = seal(&self.held);
    }

    /// Compares and puts right. `false` where something ends the run: a register whose change does,
    /// or a held value that has changed itself.
    #[must_use]
    pub fn look(&mut self, access: &mut impl Access) -> bool {
        let (first, count) = (self.next, self.at_once);
        self.next = if first + count < N { first + count } else { self.always };
        self.compare(0, self.always, access) && self.compare(first, count, access)
    }

    fn compare(&self, first: usize, count: usize, access: &mut impl Access) -> bool {
        let rows = self.table.get(first..).unwrap_or_default().iter();
        let held = self.held.get(first..).unwrap_or_default();
        for (register, held) in rows.zip(held).take(count) {
            let now = access.read(register);
            if (now ^ held) & register.mask != 0 {
                if register.then == Then::Stop || self.seal != seal(&self.held) {
                    return false;
                }
                access.write(register, now & !register.mask | held & register.mask);
            }
        }
        true
    }
}

/// A number that changes with any flipped bit of the values.
fn seal(values: &[u32]) -> u32 {
    let add = |sum: u32, value: &u32| sum.rotate_left(5).wrapping_add(*value);
    values.iter().fold(0, add)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const TABLE: [Register; 5] = [
        Register::new(0x00, Width::Word).bits(0xFF0F),
        Register::new(0x04, Width::Byte).stops(),
        Register::new(0x08, Width::Half).of(3),
        Register::new(0x08, Width::Half).of(4),
        Register::new(0x0C, Width::Word),
    ];

    /// Registers by address and selection.
    #[derive(Default)]
    struct Memory(BTreeMap<(u32, Option<u8>), u32>);

    impl Memory {
        fn at(&mut self, row: usize) -> &mut u32 {
            let register = TABLE[row];
            self.0.entry((register.at, register.select)).or_default()
        }
    }

    impl Access for Memory {
        fn read(&mut self, register: &Register) -> u32 {
            *self.0.entry((register.at, register.select)).or_default()
        }

        fn write(&mut self, register: &Register, value: u32) {
            self.0.insert((register.at, register.select), value);
        }
    }

    fn patrol() -> (Patrol<5>, Memory) {
        let mut memory = Memory::default();
        for row in 0..TABLE.len() {
            *memory.at(row) = 0x1234_5670 + row as u32;
        }
        (Patrol::new(&TABLE, 2, 2, &mut memory), memory)
    }

    #[test]
    fn a_flipped_bit_of_a_held_value_ends_the_run_and_no_register_is_written() {
        for bit in 0..32 {
            let (mut patrol, mut memory) = patrol();
            let before = memory.0.clone();
            patrol.held[4] ^= 1 << bit;
            assert!(!(0..2).all(|_| patrol.look(&mut memory)), "bit {bit}");
            assert_eq!(memory.0, before);
        }
    }

    /// Every bit of every row that counts is put right, or stops, within the looks that the table
    /// takes; no other bit is touched.
    #[test]
    fn any_flipped_bit_is_found_in_time() {
        for (row, register) in TABLE.iter().enumerate() {
            for bit in 0..32 {
                let (mut patrol, mut memory) = patrol();
                let before = *memory.at(row);
                *memory.at(row) ^= 1 << bit;
                let looks = if row < 2 { 1 } else { 2 };
                let sound = (0..looks).fold(true, |sound, _| sound & patrol.look(&mut memory));
                let counts = register.mask & 1 << bit != 0;
                assert_eq!(sound, !(counts && register.then == Then::Stop));
                let is_right = *memory.at(row) == before;
                assert_eq!(is_right, counts && register.then == Then::Restore);
            }
        }
    }

    #[test]
    fn the_rows_behind_the_first_take_turns() {
        let (mut patrol, mut memory) = patrol();
        // Rows 2 and 3, then 4, then 2 and 3 again.
        for rows in [[2, 3], [4, 4], [2, 3]] {
            for row in 2..TABLE.len() {
                *memory.at(row) ^= 1;
            }
            let flipped = [2, 3, 4].map(|row| *memory.at(row));
            assert!(patrol.look(&mut memory));
            for (row, flipped) in (2..).zip(flipped) {
                assert_eq!(*memory.at(row) != flipped, rows.contains(&row), "{row}");
                *memory.at(row) = 0x1234_5670 + row as u32;
            }
        }
    }

    #[test]
    fn what_was_set_on_purpose_is_kept() {
        let (mut patrol, mut memory) = patrol();
        for row in [3, 4] {
            *memory.at(row) ^= 1;
        }
        patrol.renew(4, &mut memory);
        let set = *memory.at(4);
        assert!(patrol.look(&mut memory) && patrol.look(&mut memory));
        assert_eq!(*memory.at(4), set);
        assert_eq!(*memory.at(3), 0x1234_5673, "not renewed");
    }
}
