//! What is known of registers and stack at an instruction.
//!
//! Every register holds one of a few kinds of [`Value`]. That is enough to follow the stack pointer
//! through frames that are too large for an immediate (`ldr r6, =-2324; add sp, r6`), and to find
//! it again through a frame pointer (`subs r6, r7, #12; mov sp, r6`). It is enough, too, to tell a
//! return from a call by a register, and to find the tables that jumps go by.

use std::collections::BTreeMap;

use samd21::code::{Instruction, Operation, ZERO};

use super::program::Program;

pub const SP: usize = 13;
pub const LR: usize = 14;
/// Registers that a called function may change (AAPCS, 6.1.1): R0 to R3, R12, LR.
const SCRATCH: [usize; 6] = [0, 1, 2, 3, 12, 14];

/// What is known of a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// Nothing.
    Unknown,
    /// It is this.
    Number(u32),
    /// The stack pointer at the function's entry and this number of bytes.
    Stack(i32),
    /// What this register held at the function's entry: of LR, the return address.
    AtEntry(u8),
    /// As it was loaded from memory, or returned by a call.
    Loaded(Origin),
    /// A pointer that was passed or loaded and this number of bytes.
    Within(u32),
    /// The sum of two words of which neither is known: as a pointer and an index.
    Indexed,
    /// An unknown distance from an address of flash.
    Near(u32),
    /// An entry of a table in flash.
    Entry(Table),
}

/// Where a word was loaded from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// This offset of what a pointer leads to that was itself passed, loaded or returned.
    Offset(u32),
    /// An array, by an index.
    Indexed,
    /// Not known.
    Unknown,
}

/// A table in flash, and what was made of one of its entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Table {
    /// Its first entry.
    pub address: u32,
    /// Bytes of an entry: 1, 2 or 4.
    pub width: u32,
    /// How far an entry was shifted to the left.
    pub shift: u32,
}

use Value::{AtEntry, Entry, Indexed, Loaded, Near, Number, Stack, Unknown, Within};

impl Value {
    fn join(self, other: Self) -> Self {
        match (self, other) {
            (a, b) if a == b => a,
            (Loaded(_), Loaded(_)) => Loaded(Origin::Unknown),
            _ => Unknown,
        }
    }

    fn plus(self, other: Self, program: &Program) -> Self {
        match (self, other) {
            (Number(a), Number(b)) => Number(a.wrapping_add(b)),
            (Number(0), value) | (value, Number(0)) => value,
            (Stack(at), Number(n)) | (Number(n), Stack(at)) => Stack(at.wrapping_add_unsigned(n)),
            (Near(at), Number(n)) | (Number(n), Near(at)) => Near(at.wrapping_add(n)),
            (Number(at), _) | (_, Number(at)) if program.contains(at) => Near(at),
            (AtEntry(_) | Loaded(_), Number(n)) => Within(n),
            (Within(at), Number(n)) => Within(at.wrapping_add(n)),
            (Indexed, Number(_)) | (Number(_), Indexed) => Indexed,
            (Number(_), _) | (_, Number(_)) => Unknown,
            _ => Indexed,
        }
    }

    fn minus(self, other: Self, program: &Program) -> Self {
        match other {
            Number(n) => self.plus(Number(n.wrapping_neg()), program),
            _ => Unknown,
        }
    }

    /// The place at an offset of what this leads to. It is no mere sum: in an image at 0 a small
    /// number is an address as well.
    fn displaced(self, offset: u32, program: &Program) -> Self {
        match self {
            AtEntry(_) | Loaded(_) => Within(offset),
            _ => self.plus(Number(offset), program),
        }
    }

    /// What is computed of two numbers.
    fn combined(self, other: Self, compute: fn(u32, u32) -> u32) -> Self {
        match (self, other) {
            (Number(a), Number(b)) => Number(compute(a, b)),
            _ => Unknown,
        }
    }

    fn shifted(self, by: u32) -> Self {
        match self {
            Number(n) => Number(n << by),
            Entry(table) => Entry(Table { shift: table.shift + by, ..table }),
            _ => Unknown,
        }
    }
}

/// What is known at an instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    registers: [Value; 15],
    /// Words of the stack by their distance from the stack pointer at the entry.
    stack: BTreeMap<i32, Value>,
    /// The lowest word of the stack whose address is in a register other than SP or was: from
    /// there on, others may write.
    shared: Option<i32>,
}

impl State {
    /// At a function's entry.
    pub fn at_entry() -> Self {
        let mut registers: [Value; 15] = std::array::from_fn(|register| AtEntry(register as u8));
        registers[SP] = Stack(0);
        Self { registers, stack: BTreeMap::new(), shared: None }
    }

    /// What is known of a register, in the numbers of an [`Instruction`].
    pub fn register(&self, register: u8) -> Value {
        match register {
            ZERO => Number(0),
            _ => (self.registers.get(usize::from(register))).map_or(Unknown, |value| *value),
        }
    }

    /// Sets a register.
    pub fn set(&mut self, register: u8, value: Value) {
        if let (Stack(at), true) = (value, register != SP as u8) {
            self.share(at);
        }
        // There is none for ZERO and NOBODY.
        if let Some(slot) = self.registers.get_mut(usize::from(register)) {
            *slot = value;
        }
    }

    fn share(&mut self, at: i32) {
        self.shared = Some(self.shared.map_or(at, |lowest| lowest.min(at)));
    }

    /// Bytes of the function's stack in use; `None` if that is not known.
    pub fn depth(&self) -> Option<i32> {
        match self.registers[SP] {
            Stack(at) => Some(-at),
            _ => None,
        }
    }

    /// Whether the function may return now: its stack is as it was.
    pub fn is_unwound(&self) -> bool {
        self.registers[SP] == Stack(0)
    }

    /// Whether what is called by a jump returns to this function's own caller.
    pub fn would_return(&self) -> bool {
        self.is_unwound() && self.registers[LR] == AtEntry(LR as u8)
    }

    /// What is known where two paths meet.
    pub fn join(&self, other: &Self) -> Self {
        let registers =
            std::array::from_fn(|index| self.registers[index].join(other.registers[index]));
        let both = self.stack.iter().filter_map(|(at, value)| {
            let joined = value.join(*other.stack.get(at)?);
            (joined != Unknown).then_some((*at, joined))
        });
        Self {
            registers,
            stack: both.collect(),
            shared: self.shared.into_iter().chain(other.shared).min(),
        }
    }

    /// After a call.
    pub fn called(&mut self) {
        for register in SCRATCH {
            self.registers[register] = Loaded(Origin::Unknown);
        }
        self.others_wrote();
    }

    /// Something wrote to where its pointer led: not to what the entry has saved.
    fn others_wrote(&mut self) {
        if let Some(lowest) = self.shared {
            self.stack.retain(|at, value| *at < lowest || matches!(value, AtEntry(_)));
        }
    }

    /// Pops a word.
    pub fn pop(&mut self) -> Value {
        let Stack(at) = self.registers[SP] else {
            return Unknown;
        };
        self.registers[SP] = Stack(at + 4);
        self.stack.get(&at).map_or(Unknown, |value| *value)
    }

    fn push(&mut self, value: Value) {
        if let Stack(at) = self.registers[SP] {
            self.registers[SP] = Stack(at - 4);
            self.stack.insert(at - 4, value);
        }
    }

    fn load(&self, instruction: &Instruction, width: u32, program: &Program) -> Value {
        let base = self.register(instruction.b);
        let at = match instruction.c {
            ZERO => base.displaced(instruction.imm, program),
            index => {
                let sum = base.plus(self.register(index), program);
                sum.plus(Number(instruction.imm), program)
            }
        };
        self.read(at, width, program)
    }

    /// A word, half-word or byte of memory.
    fn read(&self, at: Value, width: u32, program: &Program) -> Value {
        let number = |at| match width {
            1 => program.byte(at).map(u32::from),
            2 => program.half(at).map(u32::from),
            _ => program.word(at),
        };
        match at {
            Number(at) if program.contains(at) => number(at).map_or(Unknown, Number),
            Near(address) => Entry(Table { address, width, shift: 0 }),
            _ if width < 4 => Unknown,
            Stack(at) => self.stack.get(&at).map_or(Unknown, |value| *value),
            Within(offset) => Loaded(Origin::Offset(offset)),
            Indexed => Loaded(Origin::Indexed),
            _ => Loaded(Origin::Unknown),
        }
    }

    fn store(&mut self, instruction: &Instruction, width: u32, program: &Program) {
        let value = self.register(instruction.a);
        let base = self.register(instruction.b);
        let address = base.plus(self.register(instruction.c), program);
        self.write(address.plus(Number(instruction.imm), program), width, value);
    }

    fn write(&mut self, address: Value, width: u32, value: Value) {
        match address {
            Stack(at) if width == 4 => {
                self.stack.insert(at, value);
            }
            Stack(at) => {
                self.stack.remove(&(at & !3));
            }
            Number(_) => {}
            _ => self.others_wrote(),
        }
    }

    /// Takes an instruction that neither branches nor calls. What it does not know makes what it
    /// writes unknown.
    pub fn step(&mut self, instruction: &Instruction, program: &Program) {
        use Operation::{
            Add, AddHigh, And, Bic, Cpsid, Cpsie, Eor, Ldm, Ldr, LdrLiteral, Ldrb, Ldrh,
            LslImmediate, MsrPrimask, Mvn, Nop, Orr, Pop, Push, SetSp, Stm, Str, Strb, Strh, Sub,
        };
        let Instruction { a, b, c, imm, .. } = *instruction;
        let (left, right) = (self.register(b), self.register(c));
        let sum = || right.plus(Number(imm), program);
        match instruction.operation {
            Add | AddHigh => self.set(a, left.plus(sum(), program)),
            SetSp => self.registers[SP] = left.plus(sum(), program),
            Sub => self.set(a, left.minus(sum(), program)),
            Orr => {
                let value = match (left, sum()) {
                    (Number(0), value) | (value, Number(0)) => value,
                    (one, other) => one.combined(other, |one, other| one | other),
                };
                self.set(a, value);
            }
            And => self.set(a, left.combined(sum(), |one, other| one & other)),
            Eor => self.set(a, left.combined(sum(), |one, other| one ^ other)),
            Bic => self.set(a, left.combined(sum(), |one, other| one & !other)),
            Mvn => self.set(a, right.combined(right, |one, _| !one)),
            LslImmediate => self.set(a, left.shifted(imm)),
            LdrLiteral => self.set(a, program.word(imm).map_or(Unknown, Number)),
            Ldr => self.set(a, self.load(instruction, 4, program)),
            Ldrh => self.set(a, self.load(instruction, 2, program)),
            Ldrb => self.set(a, self.load(instruction, 1, program)),
            Str => self.store(instruction, 4, program),
            Strh => self.store(instruction, 2, program),
            Strb => self.store(instruction, 1, program),
            // The highest register lies highest; bit 8 stands for LR.
            Push => {
                for register in listed(imm).rev() {
                    let register = if register == 8 { LR as u8 } else { register };
                    self.push(self.register(register));
                }
            }
            Pop => {
                for register in listed(imm) {
                    let value = self.pop();
                    self.set(register, value);
                }
            }
            Stm | Ldm => self.transfer(instruction, program),
            Cpsid | Cpsie | MsrPrimask | Operation::Barrier | Nop => {}
            _ => self.set(a, Unknown),
        }
    }

    /// LDM and STM.
    fn transfer(&mut self, instruction: &Instruction, program: &Program) {
        let base = self.register(instruction.a);
        let list = listed(instruction.imm);
        let behind = base.plus(Number(4 * u32::from(instruction.c)), program);
        if instruction.operation == Operation::Stm {
            for (register, offset) in list.zip((0..).step_by(4)) {
                let address = base.plus(Number(offset), program);
                self.write(address, 4, self.register(register));
            }
            return self.set(instruction.a, behind);
        }
        self.set(instruction.a, behind);
        for (register, offset) in list.zip((0..).step_by(4)) {
            self.set(register, self.read(base.displaced(offset, program), 4, program));
        }
    }
}

/// The registers of a list, lowest first.
fn listed(list: u32) -> impl DoubleEndedIterator<Item = u8> {
    (0..9).filter(move |bit| list >> bit & 1 != 0)
}
