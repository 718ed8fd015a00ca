//! Runs of instructions that need nothing but registers, flags, SRAM and flash: nearly all of them.
//!
//! A burst goes on until the deadline, or until an instruction needs a peripheral, faults, or may
//! change what interrupts the core. `execute` runs that one from its start. Its half-word is then
//! fetched twice; the second fetch hits the cache and costs nothing.

use super::access::{Ram, block, read, word, write};
use super::execute::bits;
use super::flags::{CONDITIONS, RULES};
use super::{Core, FLASH_LINES, LR, REGISTERS, SP, TRAIL};
use crate::memory::decode::{Instruction, Operation};
use crate::memory::{FLASH_SIZE, Memory, RAM_BASE};

/// No line of the flash.
const NO_LINE: u32 = u32::MAX;

/// The instruction at `pc` of the SRAM, decoded each time: its contents change.
fn from_ram(ram: &Ram, pc: u32) -> Option<Instruction> {
    let at = pc.wrapping_sub(RAM_BASE);
    let op = read::<2, _>(ram, at)?;
    let second = read::<2, _>(ram, at.wrapping_add(2)).unwrap_or(0);
    Some(Instruction::decode(pc, op as u16, second as u16))
}

impl Core {
    /// Executes instructions until the deadline, or until one is left out: whether that is so, and
    /// the next instruction, fetched already, is to be executed in another way.
    #[inline(always)]
    pub(super) fn burst(&mut self, memory: &mut Memory) -> bool {
        if self.pc < FLASH_SIZE {
            self.burst_from::<true>(memory)
        } else {
            self.burst_from::<false>(memory)
        }
    }

    /// A burst of instructions that come from flash, or of such from SRAM.
    #[inline(never)]
    fn burst_from<const IN_FLASH: bool>(&mut self, memory: &mut Memory) -> bool {
        use Operation::*;
        let budget = self.cycles_to_deadline();
        let wait_states = self.wait_states as i64;
        let uses_psp = self.uses_psp();
        // What could be taken once PRIMASK is clear changes between bursts only.
        let nothing_pends = self.nvic.first_pending().is_none();
        let (code, flash, ram) = memory.parts();
        let Self { r, flash_lines, trail, lowest_sp, primask, .. } = self;
        let mut flags = self.flags;
        let mut pc = self.pc;
        let mut branches = self.branches;
        let mut waited = 0;
        // Cycles to the deadline in the upper half, instructions executed in the lower one.
        let mut clock = budget << 32;
        // The line that the last instruction came from, while the cache holds it.
        let mut line = NO_LINE;

        // Whether an access of the flash misses its cache: that costs the wait states, and the line
        // takes the place of another.
        macro_rules! misses {
            ($address:expr) => {{
                let wanted = $address / 8;
                let held = &mut flash_lines[wanted as usize % FLASH_LINES];
                let misses = *held != wanted && wait_states != 0;
                if misses {
                    *held = wanted;
                    waited += wait_states;
                    clock -= wait_states << 32;
                }
                misses
            }};
        }
        // The second half-word of an instruction is fetched.
        macro_rules! fetch_second {
            () => {
                let second = pc.wrapping_add(2);
                if IN_FLASH && second / 8 != line && misses!(second) {
                    line = NO_LINE;
                }
            };
        }
        // The end of an instruction of 2 bytes, of a 32-bit one, and of a branch.
        macro_rules! next {
            ($cycles:expr) => {
                pc = pc.wrapping_add(2);
                clock += 1 - ($cycles << 32);
                continue;
            };
        }
        macro_rules! wide {
            () => {
                fetch_second!();
                pc = pc.wrapping_add(4);
                clock += 1 - (3 << 32);
                continue;
            };
        }
        macro_rules! reg {
            ($index:expr) => {
                r[usize::from($index) % REGISTERS]
            };
        }
        macro_rules! set_sp {
            ($value:expr) => {
                let sp = $value;
                r[SP] = sp;
                if sp < *lowest_sp && !uses_psp {
                    *lowest_sp = sp;
                }
            };
        }
        macro_rules! jump {
            ($target:expr, $cycles:expr) => {
                let target = $target;
                trail[branches % TRAIL] = (pc, target);
                branches = branches.wrapping_add(1);
                pc = target;
                clock += 1 - ($cycles << 32);
                continue;
            };
        }
        macro_rules! load {
            ($n:literal, $address:expr) => {{
                let address = $address;
                if let Some(value) = read::<$n, _>(ram, address.wrapping_sub(RAM_BASE)) {
                    value
                } else if let Some(value) = read::<$n, _>(flash, address) {
                    if misses!(address) {
                        line = NO_LINE;
                    }
                    value
                } else {
                    break true;
                }
            }};
        }
        // Words of the SRAM; an instruction that needs others is left out.
        macro_rules! words {
            ($base:expr, $count:expr) => {
                match block(ram, $base, $count) {
                    Some(words) => words,
                    None => break true,
                }
            };
        }
        macro_rules! load_words {
            ($words:expr, $list:expr) => {
                for (register, slot) in bits($list as u16).zip($words.chunks_exact(4)) {
                    reg!(register as u8) = word(slot);
                }
            };
        }
        // Shifts by a register; those by 0 leave C alone.
        macro_rules! shift {
            ($shift:ident, $i:expr) => {
                match reg!($i.b) & 0xFF {
                    0 => _ = flags.nz(reg!($i.a)),
                    by => reg!($i.a) = flags.$shift(reg!($i.a), by),
                }
            };
        }
        let leaves_out = loop {
            if clock < 1 << 32 {
                break false;
            }
            let decoded;
            let found = if IN_FLASH {
                code.at(pc)
            } else {
                decoded = from_ram(ram, pc);
                decoded.as_ref()
            };
            let Some(i) = found else {
                // Perhaps another burst can execute it.
                break clock as u32 == 0;
            };
            if IN_FLASH && pc / 8 != line {
                misses!(pc);
                line = pc / 8;
            }
            // The most frequent operations are found by comparisons, which the host's branch
            // predictor learns one by one; one jump table it learns only in small programs. The
            // order of `Operation` is made for this.
            let x = reg!(i.b);
            let y = reg!(i.c).wrapping_add(i.imm);
            if i.operation <= Sbc {
                if i.operation <= AddHigh {
                    reg!(i.a) = x.wrapping_add(y);
                } else if i.operation <= Sub {
                    if i.operation <= Add {
                        reg!(i.a) = flags.add(x, y);
                    } else {
                        reg!(i.a) = flags.sub(x, y);
                    }
                } else {
                    let y = if i.operation <= Adc { y } else { !y };
                    reg!(i.a) = flags.adc(x, y);
                }
                next!(1);
            }
            if i.operation <= AsrImmediate {
                if i.operation <= Orr {
                    reg!(i.a) = flags.nz(x | y);
                } else if i.operation <= Mvn {
                    let rule = &RULES[(i.operation as usize - And as usize) % RULES.len()];
                    let y = y ^ rule.invert;
                    reg!(i.a) = flags.nz((x ^ y) & rule.exclusive | (x & y) & rule.both);
                } else if i.operation <= LslImmediate {
                    reg!(i.a) = flags.lsl(x, i.imm & 31);
                } else if i.operation <= LsrImmediate {
                    reg!(i.a) = flags.lsr(x, i.imm & 63);
                } else {
                    reg!(i.a) = flags.asr(x, i.imm & 63);
                }
                next!(1);
            }
            let address = x.wrapping_add(y);
            if i.operation <= Ldrh {
                if i.operation <= LdrLiteral {
                    reg!(i.a) = load!(4, i.imm);
                } else if i.operation <= Ldr {
                    reg!(i.a) = load!(4, address);
                } else if i.operation <= Ldrb {
                    reg!(i.a) = load!(1, address);
                } else {
                    reg!(i.a) = load!(2, address);
                }
                next!(2);
            }
            if i.operation <= Strh {
                let at = address.wrapping_sub(RAM_BASE);
                let value = reg!(i.a);
                let is_done = if i.operation <= Str {
                    write::<4>(ram, at, value)
                } else if i.operation <= Strb {
                    write::<1>(ram, at, value)
                } else {
                    write::<2>(ram, at, value)
                };
                if !is_done {
                    break true;
                }
                next!(2);
            }
            if i.operation <= Ble {
                let is_taken = if i.operation <= Bne {
                    flags.z() == (i.operation <= Beq)
                } else if i.operation <= Bcc {
                    flags.c == (i.operation <= Bcs)
                } else {
                    let condition = CONDITIONS[(i.operation as usize - Bmi as usize) % 16];
                    condition >> (flags.bits() >> 28) & 1 != 0
                };
                if is_taken {
                    jump!(i.imm, 2);
                }
                next!(1);
            }
            if i.operation <= Pop {
                if i.operation <= Branch {
                    jump!(i.imm, 2);
                }
                if i.operation <= Bl {
                    fetch_second!();
                    r[LR] = pc.wrapping_add(4) | 1;
                    jump!(i.imm, 3);
                }
                if i.operation <= SetSp {
                    // Bits 1:0 of both stack pointers do not exist.
                    set_sp!(address & !3);
                    next!(1);
                }
                if i.operation <= Push {
                    let base = r[SP].wrapping_sub(4 * u32::from(i.c));
                    let words = words!(base, i.c);
                    for (bit, slot) in bits(i.imm as u16).zip(words.chunks_exact_mut(4)) {
                        let register = if bit == 8 { LR } else { bit };
                        slot.copy_from_slice(&reg!(register as u8).to_le_bytes());
                    }
                    set_sp!(base);
                    clock -= i64::from(i.c) << 32;
                    next!(1);
                }
                if i.operation <= PopPc {
                    let base = r[SP];
                    let words = words!(base, i.c + 1);
                    let (rest, target) = words.split_at(4 * usize::from(i.c));
                    let target = word(target);
                    if !is_plain(target) {
                        break true;
                    }
                    load_words!(rest, i.imm);
                    set_sp!(base.wrapping_add(4 * u32::from(i.c) + 4));
                    jump!(target & !1, (4 + i64::from(i.c)));
                }
                let base = r[SP];
                let words = words!(base, i.c);
                load_words!(words, i.imm);
                set_sp!(base.wrapping_add(4 * u32::from(i.c)));
                clock -= i64::from(i.c) << 32;
                next!(1);
            }
            match i.operation {
                Other => break true,
                Nop => {}
                Cpsid => *primask = true,
                Cpsie => {
                    if !nothing_pends {
                        break true;
                    }
                    *primask = false;
                }
                MrsPrimask => {
                    reg!(i.a) = u32::from(*primask);
                    wide!();
                }
                MsrPrimask => {
                    let masks = reg!(i.a) & 1 != 0;
                    if !masks && !nothing_pends {
                        break true;
                    }
                    *primask = masks;
                    wide!();
                }
                Barrier => {
                    wide!();
                }
                LslRegister => shift!(lsl, i),
                LsrRegister => shift!(lsr, i),
                AsrRegister => shift!(asr, i),
                RorRegister => shift!(ror, i),
                Mul => reg!(i.a) = flags.nz(reg!(i.a).wrapping_mul(reg!(i.b))),
                Sxth => reg!(i.a) = reg!(i.b) as i16 as u32,
                Sxtb => reg!(i.a) = reg!(i.b) as i8 as u32,
                Uxth => reg!(i.a) = reg!(i.b) & 0xFFFF,
                Uxtb => reg!(i.a) = reg!(i.b) & 0xFF,
                Rev => reg!(i.a) = reg!(i.b).swap_bytes(),
                Rev16 => reg!(i.a) = reg!(i.b).swap_bytes().rotate_left(16),
                Revsh => reg!(i.a) = (reg!(i.b) as u16).swap_bytes() as i16 as u32,
                LdrshRegister => {
                    reg!(i.a) = load!(2, address) as i16 as u32;
                    next!(2);
                }
                LdrsbRegister => {
                    reg!(i.a) = load!(1, address) as i8 as u32;
                    next!(2);
                }
                Stm => {
                    let base = reg!(i.a);
                    let words = words!(base, i.c);
                    for (register, slot) in bits(i.imm as u16).zip(words.chunks_exact_mut(4)) {
                        slot.copy_from_slice(&reg!(register as u8).to_le_bytes());
                    }
                    reg!(i.a) = base.wrapping_add(4 * u32::from(i.c));
                    clock -= i64::from(i.c) << 32;
                }
                Ldm => {
                    let base = reg!(i.a);
                    let words = words!(base, i.c);
                    // A base in the list gets the loaded word, any other the address behind.
                    reg!(i.a) = base.wrapping_add(4 * u32::from(i.c));
                    load_words!(words, i.imm);
                    clock -= i64::from(i.c) << 32;
                }
                Bx => {
                    let target = reg!(i.b);
                    if !is_plain(target) {
                        break true;
                    }
                    jump!(target & !1, 2);
                }
                Blx => {
                    let target = reg!(i.b);
                    if target & 1 == 0 {
                        break true;
                    }
                    r[LR] = pc.wrapping_add(2) | 1;
                    jump!(target & !1, 2);
                }
                _ => break true,
            }
            next!(1);
        };

        self.pc = pc;
        self.flags = flags;
        self.branches = branches;
        self.counters.instructions += u64::from(clock as u32);
        self.counters.flash_wait_cycles += waited as u64;
        self.now += (budget - (clock >> 32)) as u64 * self.cycle;
        leaves_out
    }

    /// How many cycles begin before the deadline, at most a number that leaves room to count.
    fn cycles_to_deadline(&self) -> i64 {
        let cycles = self.deadline.saturating_sub(self.now).div_ceil(self.cycle);
        cycles.min(1 << 30) as i64
    }
}

/// Whether a branch to `target` is neither an exception return nor one out of Thumb state.
#[inline(always)]
fn is_plain(target: u32) -> bool {
    target & 1 != 0 && target >> 28 != 0xF
}
