//! What the emulated core does not decode beforehand: the PC as an operand, hints, special
//! registers, and what is undefined.

use samd21::code::{Instruction, Operation, ZERO, high_fields};

use super::super::value::{SP, State, Value};
use super::table::Place;
use super::{Next, Walk};

impl Walk<'_> {
    /// Takes such an instruction.
    pub(super) fn other(&mut self, place: Place, length: u32, op: u16, state: &mut State) -> Next {
        let at = place.1;
        let (to, from) = high_fields(op);
        let pc = at + 4;
        match op >> 8 {
            0x44 if to == 15 => match state.register(from as u8) {
                Value::Entry(table) => self.jump_by(place, table, Some(pc), state),
                Value::Number(offset) => self.jump(place, pc.wrapping_add(offset), state),
                _ => self.lost(at),
            },
            0x44 if from == 15 && to != SP => {
                let sum = Instruction {
                    operation: Operation::AddHigh,
                    a: to as u8,
                    b: to as u8,
                    c: ZERO,
                    imm: pc,
                };
                state.step(&sum, self.program);
                return Next::Behind;
            }
            0x46 if to == 15 => match state.register(from as u8) {
                Value::Entry(table) if table.width == 4 && table.shift == 0 => {
                    self.jump_by(place, table, None, state);
                }
                value @ (Value::AtEntry(14) | Value::Number(_)) => self.leave(place, value, state),
                _ => self.lost(at),
            },
            0x46 if from == 15 && to != SP => {
                state.set(to as u8, Value::Number(pc));
                return Next::Behind;
            }
            // CMP with PC; BKPT; hints; SVC, whose handler is one of the exceptions.
            0x45 | 0xBE | 0xBF | 0xDF => return Next::Behind,
            0xDE => {}
            _ if length == 4 => return self.special(at, op, state),
            _ => self.problem(at, "is reached and is no instruction"),
        }
        Next::Over
    }

    /// MRS and MSR (ARM DDI 0419, A6.7.43 and A6.7.44), and what is undefined.
    fn special(&mut self, at: u32, op: u16, state: &mut State) -> Next {
        /// MSP, PSP and CONTROL, by which the stack would become another one.
        const STACKS: [u16; 3] = [8, 9, 20];
        let second = self.program.half(at + 2).unwrap_or(0);
        if op == 0xF3EF && second & 0xF000 == 0x8000 {
            state.set((second >> 8 & 15) as u8, Value::Unknown);
            return Next::Behind;
        }
        if op & 0xFFF0 == 0xF380 && second & 0xFF00 == 0x8800 {
            if !STACKS.contains(&(second & 0xFF)) {
                return Next::Behind;
            }
            self.problem(at, "writes a stack pointer, or CONTROL, which chooses one");
        } else if op & 0xFFF0 != 0xF7F0 {
            // UDF, the wide one, ends as the narrow one does.
            self.problem(at, "is reached and is no instruction");
        }
        Next::Over
    }
}
