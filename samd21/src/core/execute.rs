//! Every instruction of ARMv6-M (ARM DDI 0419, A5 and A6), with the Cortex-M0+ cycle counts (ARM
//! DDI 0484, 3.3; single-cycle multiplier). Here are those that `burst` leaves out.
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
//! What ARM calls unpredictable is taken as undefined where a program can only get there by mistake
//! (MSR to an unknown register, an empty register list). Elsewhere it is taken as the obvious thing
//! (CMP of two low registers in the high-register form).

use super::exception::RETURN_CYCLES;
use super::flags::Flags;
use super::system_control::SCR_SLEEPDEEP;
use super::{Core, LR, Outcome, PC, SP, Sleep, Trap, undefined};
use crate::bus::Bus;
use crate::fault::FaultKind;
use crate::memory::decode::{Instruction, Operation, high_fields};

impl Core {
    /// Executes the instruction at `pc`, one that `burst` leaves out, and returns its cycles.
    #[inline(never)]
    pub(super) fn instruction(&mut self, bus: &mut Bus<'_>, pc: u32) -> Outcome<u32> {
        let op = self.fetch(bus, pc)?;
        self.pc = pc.wrapping_add(2);
        let decoded = bus.memory.code().at(pc).copied();
        let instruction = decoded.unwrap_or_else(|| Instruction::decode(pc, op, 0));
        let rt = usize::from(instruction.a);
        let base = self.r[usize::from(instruction.b)];
        let offset = self.r[usize::from(instruction.c)].wrapping_add(instruction.imm);
        let address = base.wrapping_add(offset);
        match instruction.operation {
            Operation::LdrLiteral => self.ldr::<4>(bus, rt, instruction.imm),
            Operation::Str => self.str::<4>(bus, rt, address),
            Operation::Strh => self.str::<2>(bus, rt, address),
            Operation::Strb => self.str::<1>(bus, rt, address),
            Operation::Ldr => self.ldr::<4>(bus, rt, address),
            Operation::Ldrh => self.ldr::<2>(bus, rt, address),
            Operation::Ldrb => self.ldr::<1>(bus, rt, address),
            Operation::LdrsbRegister => {
                self.r[rt] = self.load::<1>(bus, address)? as i8 as u32;
                Ok(Self::access_cycles(address))
            }
            Operation::LdrshRegister => {
                self.r[rt] = self.load::<2>(bus, address)? as i16 as u32;
                Ok(Self::access_cycles(address))
            }
            Operation::Push | Operation::Stm => self.store_block(bus, instruction),
            Operation::Pop | Operation::PopPc | Operation::Ldm => {
                self.load_block(bus, instruction, pc)
            }
            Operation::Bx => Ok(2 + self.branch_exchange(bus, base, pc)?),
            Operation::Blx => self.call(base, pc),
            _ => self.other(bus, op, pc),
        }
    }

    /// What is not decoded beforehand: high-register forms that write SP or touch PC, CPS, BKPT,
    /// SVC, hints, 32-bit encodings, and what is undefined.
    fn other(&mut self, bus: &mut Bus<'_>, op: u16, pc: u32) -> Outcome<u32> {
        let (rd, rm) = high_fields(op);
        match op >> 6 {
            0x110..=0x113 => {
                let sum = self.any(rd, pc).wrapping_add(self.any(rm, pc));
                Ok(self.set_any(rd, sum, pc))
            }
            0x114..=0x117 => {
                let (a, b) = (self.any(rd, pc), self.any(rm, pc));
                self.flags.sub(a, b);
                Ok(1)
            }
            0x118..=0x11B => Ok(self.set_any(rd, self.any(rm, pc), pc)),
            0x11C..=0x11D => Ok(2 + self.branch_exchange(bus, self.any(rm, pc), pc)?),
            0x11E..=0x11F => self.call(self.any(rm, pc), pc),
            // Interrupts (bit 1) is all that there is to enable and disable.
            0x2D9 if op & 0xFFEF == 0xB662 => {
                self.primask = op & 0x10 != 0;
                self.ask_attention();
                Ok(1)
            }
            0x2F8..=0x2FB => Err(Trap::Breakpoint.into()),
            0x2FC..=0x2FF => self.hint(op),
            0x37C..=0x37F => Err(Trap::SupervisorCall.into()),
            0x3A0..=0x3FF => self.wide(bus, op, pc),
            _ => Err(undefined(op.into())),
        }
    }

    /// BLX.
    fn call(&mut self, target: u32, pc: u32) -> Outcome<u32> {
        self.r[LR] = pc.wrapping_add(2) | 1;
        self.interwork(target);
        self.note_branch(pc);
        Ok(2)
    }

    /// Any register as an operand.
    #[inline(always)]
    fn any(&self, register: usize, pc: u32) -> u32 {
        if register == PC { pc.wrapping_add(4) } else { self.r[register] }
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
    fn ldr<const N: usize>(&mut self, bus: &mut Bus<'_>, rt: usize, address: u32) -> Outcome<u32> {
        self.r[rt] = self.load::<N>(bus, address)?;
        Ok(Self::access_cycles(address))
    }

    #[inline(always)]
    fn str<const N: usize>(&mut self, bus: &mut Bus<'_>, rt: usize, address: u32) -> Outcome<u32> {
        self.store::<N>(bus, address, self.r[rt])?;
        Ok(Self::access_cycles(address))
    }

    /// BX and POP to PC: a branch, or in a handler perhaps an exception return. Returns the cycles
    /// beyond those of the branch.
    fn branch_exchange(&mut self, bus: &mut Bus<'_>, target: u32, pc: u32) -> Outcome<u32> {
        if self.ipsr != 0 && target >> 28 == 0xF {
            self.exception_return(bus, target)?;
            self.note_branch(pc);
            return Ok(RETURN_CYCLES);
        }
        self.interwork(target);
        self.note_branch(pc);
        Ok(0)
    }

    /// PUSH and STM.
    fn store_block(&mut self, bus: &mut Bus<'_>, i: Instruction) -> Outcome<u32> {
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
    fn load_block(&mut self, bus: &mut Bus<'_>, i: Instruction, pc: u32) -> Outcome<u32> {
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

    /// Hints.
    fn hint(&mut self, op: u16) -> Outcome<u32> {
        match op {
            0xBF20 | 0xBF30 if self.scr & SCR_SLEEPDEEP != 0 => {
                return Err(Trap::Unmodelled(FaultKind::DeepSleep).into());
            }
            0xBF20 if self.event => self.event = false,
            0xBF20 => self.fall_asleep(Sleep::ForEvent),
            0xBF30 => self.fall_asleep(Sleep::ForInterrupt),
            0xBF40 => {
                self.event = true;
                return Ok(1);
            }
            // NOP, YIELD and hints that are not allocated.
            _ if op & 0xF == 0 => return Ok(1),
            _ => return Err(undefined(op.into())),
        }
        Ok(2)
    }

    fn fall_asleep(&mut self, sleep: Sleep) {
        self.sleep = Some(sleep);
        self.ask_attention();
    }

    /// The 32-bit encodings that `burst` leaves out: MRS and MSR; everything else is undefined.
    fn wide(&mut self, bus: &mut Bus<'_>, op: u16, pc: u32) -> Outcome<u32> {
        let second = self.fetch(bus, pc.wrapping_add(2))?;
        let encoding = u32::from(op) << 16 | u32::from(second);
        self.pc = pc.wrapping_add(4);
        if encoding & 0xFFFF_F000 == 0xF3EF_8000 {
            let rd = (encoding >> 8 & 15) as usize;
            match self.special(encoding & 0xFF) {
                Some(value) if rd != SP && rd != PC => self.r[rd] = value,
                _ => return Err(undefined(encoding)),
            }
        } else if encoding & 0xFFF0_FF00 == 0xF380_8800 {
            let rn = (encoding >> 16 & 15) as usize;
            if rn == SP || rn == PC || !self.set_special(encoding & 0xFF, self.r[rn]) {
                return Err(undefined(encoding));
            }
        } else {
            return Err(undefined(encoding));
        }
        Ok(3)
    }

    /// A special register by its SYSm number; EPSR reads as zero.
    fn special(&self, number: u32) -> Option<u32> {
        let (msp, psp) = self.stack_pointers();
        Some(match number {
            0 | 2 => self.xpsr() & 0xF000_0000,
            1 | 3 => self.xpsr() & 0xF000_003F,
            5 | 7 => u32::from(self.ipsr),
            6 => 0,
            8 => msp,
            9 => psp,
            16 => u32::from(self.primask),
            20 => u32::from(self.spsel) << 1,
            _ => return None,
        })
    }

    /// Writes a special register; whether there is one with that number.
    fn set_special(&mut self, number: u32, value: u32) -> bool {
        match number {
            0..=3 => self.flags = Flags::of(value),
            // IPSR and EPSR: writes are ignored.
            5..=7 => {}
            8 if !self.uses_psp() => self.set_sp(value),
            9 if self.uses_psp() => self.set_sp(value),
            8 | 9 => self.other_sp = value & !3,
            16 => {
                self.primask = value & 1 != 0;
                self.ask_attention();
            }
            20 => {
                // In a handler the write is ignored; nPRIV does not exist on this chip.
                let spsel = value & 2 != 0;
                if self.ipsr == 0 && spsel != self.spsel {
                    std::mem::swap(&mut self.r[SP], &mut self.other_sp);
                    self.spsel = spsel;
                }
            }
            _ => return false,
        }
        true
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
