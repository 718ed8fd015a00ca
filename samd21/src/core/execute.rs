//! Every instruction of ARMv6-M (ARM DDI 0419, A5 and A6), with the Cortex-M0+ cycle counts (ARM
//! DDI 0484, 3.3; single-cycle multiplier). Block transfers are in `transfer`; hints, 32-bit
//! encodings and special registers in `special`.
//!
//! | instruction | cycles |
//! |---|---|
//! | data processing, MULS, CPS, SEV, NOP, YIELD | 1 |
//! | ADD, MOV to PC; B taken; BX, BLX | 2 |
//! | B not taken | 1 |
//! | BL | 3 |
//! | loads and stores | 2, in the IOBUS (0x6000_0000) 1 |
//! | LDM, STM, PUSH, POP of N registers | 1 + N, with PC 3 + N |
//! | MRS, MSR, DMB, DSB, ISB | 3 |
//! | WFI, WFE | 2 and the sleep |
//! | exception return | 11 on top of the branch |
//!
//! What ARM calls unpredictable is taken as undefined where a program can only get there by
//! mistake (MSR to an unknown register, an empty register list), and as the obvious thing
//! elsewhere (CMP of two low registers in the high-register form).

use super::decode::{Operation, field};
use super::exception::RETURN_CYCLES;
use super::{Core, LR, Outcome, PC, SP, Trap, undefined};
use crate::bus::Bus;

impl Core {
    /// Executes the instruction at `pc` and returns its cycles.
    #[inline(always)]
    pub(super) fn instruction(&mut self, bus: &mut Bus<'_>, pc: u32) -> Outcome<u32> {
        let op = self.fetch(bus, pc)?;
        self.pc = pc.wrapping_add(2);
        self.execute(bus, op, pc)
    }

    #[inline(always)]
    fn execute(&mut self, bus: &mut Bus<'_>, op: u16, pc: u32) -> Outcome<u32> {
        use Operation::*;
        let rd = field(op, 0);
        let rn = field(op, 3);
        let rm = field(op, 6);
        let r8 = field(op, 8);
        let imm5 = u32::from(op >> 6) & 31;
        let imm8 = u32::from(op) & 0xFF;
        match Operation::of(op) {
            // Shift by immediate, add, subtract.
            LslImmediate => self.shift(rd, self.r[rn], imm5, lsl),
            LsrImmediate => self.shift(rd, self.r[rn], if imm5 == 0 { 32 } else { imm5 }, lsr),
            AsrImmediate => self.shift(rd, self.r[rn], if imm5 == 0 { 32 } else { imm5 }, asr),
            AddRegister => self.r[rd] = self.add(self.r[rn], self.r[rm], false),
            SubRegister => self.r[rd] = self.add(self.r[rn], !self.r[rm], true),
            AddImmediate3 => self.r[rd] = self.add(self.r[rn], rm as u32, false),
            SubImmediate3 => self.r[rd] = self.add(self.r[rn], !(rm as u32), true),
            // Move, compare, add, subtract an 8-bit immediate.
            MovImmediate => self.set_nz(r8, imm8),
            CmpImmediate => {
                self.add(self.r[r8], !imm8, true);
            }
            AddImmediate8 => self.r[r8] = self.add(self.r[r8], imm8, false),
            SubImmediate8 => self.r[r8] = self.add(self.r[r8], !imm8, true),
            // Data processing.
            And => self.set_nz(rd, self.r[rd] & self.r[rn]),
            Eor => self.set_nz(rd, self.r[rd] ^ self.r[rn]),
            LslRegister => self.shift(rd, self.r[rd], self.r[rn] & 0xFF, lsl),
            LsrRegister => self.shift(rd, self.r[rd], self.r[rn] & 0xFF, lsr),
            AsrRegister => self.shift(rd, self.r[rd], self.r[rn] & 0xFF, asr),
            Adc => self.r[rd] = self.add(self.r[rd], self.r[rn], self.c),
            Sbc => self.r[rd] = self.add(self.r[rd], !self.r[rn], self.c),
            RorRegister => self.shift(rd, self.r[rd], self.r[rn] & 0xFF, ror),
            Tst => self.flag_nz(self.r[rd] & self.r[rn]),
            Rsb => self.r[rd] = self.add(!self.r[rn], 0, true),
            CmpRegister => {
                self.add(self.r[rd], !self.r[rn], true);
            }
            Cmn => {
                self.add(self.r[rd], self.r[rn], false);
            }
            Orr => self.set_nz(rd, self.r[rd] | self.r[rn]),
            Mul => self.set_nz(rd, self.r[rd].wrapping_mul(self.r[rn])),
            Bic => self.set_nz(rd, self.r[rd] & !self.r[rn]),
            Mvn => self.set_nz(rd, !self.r[rn]),
            // High registers.
            AddHigh => {
                let (rdn, rm) = high_fields(op);
                let sum = self.any(rdn, pc).wrapping_add(self.any(rm, pc));
                return Ok(self.set_any(rdn, sum, pc));
            }
            CmpHigh => {
                let (rn, rm) = high_fields(op);
                self.add(self.any(rn, pc), !self.any(rm, pc), true);
            }
            MovHigh => {
                let (rd, rm) = high_fields(op);
                return Ok(self.set_any(rd, self.any(rm, pc), pc));
            }
            Bx => {
                let (_, rm) = high_fields(op);
                let target = self.any(rm, pc);
                return Ok(2 + self.branch_exchange(bus, target, pc)?);
            }
            Blx => {
                let (_, rm) = high_fields(op);
                let target = self.any(rm, pc);
                self.r[LR] = pc.wrapping_add(2) | 1;
                self.interwork(target);
                self.note_branch(pc);
                return Ok(2);
            }
            // Loads and stores.
            LdrLiteral => {
                let address = (pc.wrapping_add(4) & !3).wrapping_add(4 * imm8);
                return self.ldr::<4>(bus, r8, address);
            }
            StrRegister => return self.str::<4>(bus, rd, self.indexed(rn, rm)),
            StrhRegister => return self.str::<2>(bus, rd, self.indexed(rn, rm)),
            StrbRegister => return self.str::<1>(bus, rd, self.indexed(rn, rm)),
            LdrsbRegister => {
                let address = self.indexed(rn, rm);
                self.r[rd] = self.load::<1>(bus, address)? as i8 as u32;
                return Ok(Self::access_cycles(address));
            }
            LdrRegister => return self.ldr::<4>(bus, rd, self.indexed(rn, rm)),
            LdrhRegister => return self.ldr::<2>(bus, rd, self.indexed(rn, rm)),
            LdrbRegister => return self.ldr::<1>(bus, rd, self.indexed(rn, rm)),
            LdrshRegister => {
                let address = self.indexed(rn, rm);
                self.r[rd] = self.load::<2>(bus, address)? as i16 as u32;
                return Ok(Self::access_cycles(address));
            }
            StrImmediate => return self.str::<4>(bus, rd, self.r[rn].wrapping_add(4 * imm5)),
            LdrImmediate => return self.ldr::<4>(bus, rd, self.r[rn].wrapping_add(4 * imm5)),
            StrbImmediate => return self.str::<1>(bus, rd, self.r[rn].wrapping_add(imm5)),
            LdrbImmediate => return self.ldr::<1>(bus, rd, self.r[rn].wrapping_add(imm5)),
            StrhImmediate => return self.str::<2>(bus, rd, self.r[rn].wrapping_add(2 * imm5)),
            LdrhImmediate => return self.ldr::<2>(bus, rd, self.r[rn].wrapping_add(2 * imm5)),
            StrSp => return self.str::<4>(bus, r8, self.r[SP].wrapping_add(4 * imm8)),
            LdrSp => return self.ldr::<4>(bus, r8, self.r[SP].wrapping_add(4 * imm8)),
            // Addresses and the stack pointer.
            Adr => self.r[r8] = (pc.wrapping_add(4) & !3).wrapping_add(4 * imm8),
            AddSpTo => self.r[r8] = self.r[SP].wrapping_add(4 * imm8),
            AddSp => self.set_sp(self.r[SP].wrapping_add(4 * (imm8 & 0x7F))),
            SubSp => self.set_sp(self.r[SP].wrapping_sub(4 * (imm8 & 0x7F))),
            // Extend and reverse.
            Sxth => self.r[rd] = self.r[rn] as i16 as u32,
            Sxtb => self.r[rd] = self.r[rn] as i8 as u32,
            Uxth => self.r[rd] = self.r[rn] & 0xFFFF,
            Uxtb => self.r[rd] = self.r[rn] & 0xFF,
            Rev => self.r[rd] = self.r[rn].swap_bytes(),
            Rev16 => self.r[rd] = self.r[rn].swap_bytes().rotate_left(16),
            Revsh => self.r[rd] = (self.r[rn] as u16).swap_bytes() as i16 as u32,
            // Stack, block transfers.
            Push => return self.push(bus, op),
            Pop => return self.pop(bus, op, pc),
            Stm => return self.store_multiple(bus, op),
            Ldm => return self.load_multiple(bus, op),
            Cps => {
                // Interrupts (bit 1) is all that there is to enable and disable.
                if op & 0xFFEF != 0xB662 {
                    return Err(undefined(op));
                }
                self.primask = op & 0x10 != 0;
                self.ask_attention();
            }
            Bkpt => return Err(Trap::Breakpoint.into()),
            Hint => return self.hint(op),
            // Branches.
            BranchIf => {
                if self.condition(op >> 8 & 15) {
                    let offset = (op as i8 as i32 as u32) << 1;
                    self.branch(pc, offset);
                    return Ok(2);
                }
            }
            Svc => return Err(Trap::SupervisorCall.into()),
            Branch => {
                let offset = (u32::from(op) << 21) as i32 >> 20;
                self.branch(pc, offset as u32);
                return Ok(2);
            }
            Wide => return self.wide(bus, op, pc),
            Undefined => return Err(undefined(op)),
        }
        Ok(1)
    }

    #[inline(always)]
    fn flag_nz(&mut self, result: u32) {
        self.n = (result as i32) < 0;
        self.z = result == 0;
    }

    #[inline(always)]
    fn set_nz(&mut self, rd: usize, result: u32) {
        self.flag_nz(result);
        self.r[rd] = result;
    }

    /// `a + b + carry` with all flags: a subtraction adds the complement with carry.
    #[inline(always)]
    fn add(&mut self, a: u32, b: u32, carry: bool) -> u32 {
        let (partial, c1) = a.overflowing_add(b);
        let (sum, c2) = partial.overflowing_add(u32::from(carry));
        self.flag_nz(sum);
        self.c = c1 | c2;
        self.v = ((a ^ sum) & (b ^ sum)) >> 31 != 0;
        sum
    }

    /// Shifts by 0 to 255; by 0 the carry stays.
    #[inline(always)]
    fn shift(&mut self, rd: usize, value: u32, by: u32, kind: fn(u32, u32) -> (u32, bool)) {
        let result = if by == 0 {
            value
        } else {
            let (result, carry) = kind(value, by);
            self.c = carry;
            result
        };
        self.set_nz(rd, result);
    }

    /// Any register as an operand.
    #[inline(always)]
    fn any(&self, register: usize, pc: u32) -> u32 {
        if register == PC {
            pc.wrapping_add(4)
        } else {
            self.r[register]
        }
    }

    /// Writes any register and returns the cycles of the instruction that does.
    #[inline(always)]
    fn set_any(&mut self, register: usize, value: u32, pc: u32) -> u32 {
        match register {
            PC => {
                self.pc = value & !1;
                self.note_branch(pc);
                return 2;
            }
            SP => self.set_sp(value),
            _ => self.r[register] = value,
        }
        1
    }

    #[inline(always)]
    fn indexed(&self, rn: usize, rm: usize) -> u32 {
        self.r[rn].wrapping_add(self.r[rm])
    }

    #[inline(always)]
    fn ldr<const N: usize>(&mut self, bus: &mut Bus<'_>, rt: usize, address: u32) -> Outcome<u32> {
        self.r[rt] = self.load::<N>(bus, address)?;
        Ok(Self::access_cycles(address))
    }

    #[inline(always)]
    fn str<const N: usize>(&mut self, bus: &mut Bus<'_>, rt: usize, address: u32) -> Outcome<u32> {
        self.store::<N>(bus, address, self.r[rt])?;
        Ok(Self::access_cycles(address))
    }

    #[inline(always)]
    fn condition(&self, condition: u16) -> bool {
        let holds = match condition >> 1 {
            0 => self.z,
            1 => self.c,
            2 => self.n,
            3 => self.v,
            4 => self.c && !self.z,
            5 => self.n == self.v,
            _ => self.n == self.v && !self.z,
        };
        holds != (condition & 1 != 0)
    }

    #[inline(always)]
    fn branch(&mut self, pc: u32, offset: u32) {
        self.pc = pc.wrapping_add(4).wrapping_add(offset);
        self.note_branch(pc);
    }

    /// BX and POP to PC: a branch, or in a handler perhaps an exception return. Returns the cycles
    /// beyond those of the branch.
    pub(super) fn branch_exchange(
        &mut self,
        bus: &mut Bus<'_>,
        target: u32,
        pc: u32,
    ) -> Outcome<u32> {
        if self.ipsr != 0 && target >> 28 == 0xF {
            self.exception_return(bus, target)?;
            self.note_branch(pc);
            return Ok(RETURN_CYCLES);
        }
        self.interwork(target);
        self.note_branch(pc);
        Ok(0)
    }
}

/// Rd or Rn (bits 7, 2:0) and Rm (bits 6:3) of the high-register forms.
#[inline(always)]
fn high_fields(op: u16) -> (usize, usize) {
    (usize::from(op >> 4 & 8 | op & 7), usize::from(op >> 3 & 15))
}

/// The shifts: result and carry, for 1 to 255 places.
fn lsl(value: u32, by: u32) -> (u32, bool) {
    let wide = u64::from(value) << by.min(33);
    (wide as u32, wide >> 32 & 1 != 0)
}

fn lsr(value: u32, by: u32) -> (u32, bool) {
    let wide = u64::from(value) << 1 >> by.min(33);
    ((wide >> 1) as u32, wide & 1 != 0)
}

fn asr(value: u32, by: u32) -> (u32, bool) {
    let wide = i64::from(value as i32) << 1 >> by.min(33);
    ((wide >> 1) as u32, wide & 1 != 0)
}

fn ror(value: u32, by: u32) -> (u32, bool) {
    let result = value.rotate_right(by & 31);
    (result, result >> 31 != 0)
}
