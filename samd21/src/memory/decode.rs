//! From half-words to what the core executes (ARM DDI 0419, A5.2).
//!
//! Flash is decoded before it runs: see [`Code`]. What needs more than registers, flags, SRAM and
//! flash is [`Operation::Other`], which is decoded a second time where it is executed
//! (`execute`).

use std::sync::Arc;

use super::{FLASH_SIZE, filled};

/// What an instruction does, and with which of its fields: registers `a`, `b`, `c` and `imm`.
///
/// The order counts: `burst` tells its classes from one another by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
#[expect(missing_docs, reason = "each is named after its instruction")]
pub enum Operation {
    // Sums and logic: `a = b op (c + imm)`.
    /// Without flags.
    AddHigh,
    // With all flags.
    Add,
    Sub,
    Adc,
    Sbc,
    // With N and Z.
    Orr,
    And,
    Eor,
    Bic,
    Mvn,
    // With N, Z and C: `a = b op imm`.
    LslImmediate,
    LsrImmediate,
    AsrImmediate,
    // Loads of `a` at `b + c + imm`, the first at `imm`.
    LdrLiteral,
    Ldr,
    Ldrb,
    Ldrh,
    // Stores.
    Str,
    Strb,
    Strh,
    // Branches to `imm` on a condition.
    Beq,
    Bne,
    Bcs,
    Bcc,
    Bmi,
    Bpl,
    Bvs,
    Bvc,
    Bhi,
    Bls,
    Bge,
    Blt,
    Bgt,
    Ble,
    // Branches to `imm`.
    Branch,
    Bl,
    /// `b + c + imm` to SP.
    SetSp,
    // Block transfers: `a` is the base, `imm` the list, `c` the count of its registers.
    Push,
    PopPc,
    Pop,
    /// Anything that is not here.
    Other,
    Nop,
    /// PRIMASK by CPS, and as a special register.
    Cpsid,
    Cpsie,
    MrsPrimask,
    MsrPrimask,
    /// DMB, DSB, ISB.
    Barrier,
    // Loads of `a` at `b + c`.
    LdrsbRegister,
    LdrshRegister,
    // With flags: `a = a op b`.
    LslRegister,
    LsrRegister,
    AsrRegister,
    RorRegister,
    Mul,
    // Without flags: `a = op b`.
    Sxth,
    Sxtb,
    Uxth,
    Uxtb,
    Rev,
    Rev16,
    Revsh,
    // More block transfers.
    Stm,
    Ldm,
    // Branches to `b`.
    Bx,
    Blx,
}

/// The register that is always zero, in the place of the PC.
pub const ZERO: u8 = 15;
/// The register that nobody reads.
pub const NOBODY: u8 = 16;

/// A decoded instruction; [`Operation`] says what it does with its fields.
#[derive(Clone, Copy, Debug)]
pub struct Instruction {
    /// What it does.
    pub operation: Operation,
    /// Mostly the register that is written; [`NOBODY`] if none is.
    pub a: u8,
    /// A register that is read; [`ZERO`] if none is.
    pub b: u8,
    /// Another one, or the count of registers of a block transfer.
    pub c: u8,
    /// An immediate, an address, or a list of registers, whose bit 8 is LR or PC.
    pub imm: u32,
}

use Operation::*;

/// By bits 11:9 of the loads and stores with a register offset.
const REGISTER_OFFSET: [Operation; 8] =
    [Str, Strh, Strb, LdrsbRegister, Ldr, Ldrh, Ldrb, LdrshRegister];

/// By bits 11:8 of the conditional branches.
const CONDITIONS: [Operation; 14] =
    [Beq, Bne, Bcs, Bcc, Bmi, Bpl, Bvs, Bvc, Bhi, Bls, Bge, Blt, Bgt, Ble];

impl Instruction {
    /// The instruction at `pc`, where `op` stands and `second` behind it.
    pub fn decode(pc: u32, op: u16, second: u16) -> Self {
        let word = u32::from(op);
        let (rd, rn, rm, r8) = (field(op, 0), field(op, 3), field(op, 6), field(op, 8));
        let imm5 = word >> 6 & 31;
        let imm8 = word & 0xFF;
        let shift = if imm5 == 0 { 32 } else { imm5 };
        let two = |operation, a, b| Self::new(operation, a, b, ZERO, 0);
        let with = |operation, a, b, imm| Self::new(operation, a, b, ZERO, imm);
        let relative = (pc.wrapping_add(4) & !3).wrapping_add(4 * imm8);
        match op >> 11 {
            0b00000 if imm5 == 0 => two(Orr, rd, rn),
            0b00000 => with(LslImmediate, rd, rn, imm5),
            0b00001 => with(LsrImmediate, rd, rn, shift),
            0b00010 => with(AsrImmediate, rd, rn, shift),
            0b00011 => match op >> 9 & 3 {
                0 => Self::new(Add, rd, rn, rm, 0),
                1 => Self::new(Sub, rd, rn, rm, 0),
                2 => with(Add, rd, rn, u32::from(rm)),
                _ => with(Sub, rd, rn, u32::from(rm)),
            },
            0b00100 => with(Orr, r8, ZERO, imm8),
            0b00101 => with(Sub, NOBODY, r8, imm8),
            0b00110 => with(Add, r8, r8, imm8),
            0b00111 => with(Sub, r8, r8, imm8),
            0b01000 if op & 1 << 10 == 0 => Self::data_processing(op),
            0b01000 => {
                let (rdn, rm) = high_fields(op);
                let (rdn, rm) = (rdn as u8, rm as u8);
                // What touches PC is rare.
                match op >> 8 & 3 {
                    0 if !matches!(rdn, 13 | 15) && rm != 15 => Self::new(AddHigh, rdn, rdn, rm, 0),
                    0 if rdn == 13 && rm != 15 => Self::new(SetSp, 0, 13, rm, 0),
                    2 if rdn == 13 && rm != 15 => Self::new(SetSp, 0, ZERO, rm, 0),
                    1 if rdn != 15 && rm != 15 => Self::new(Sub, NOBODY, rdn, rm, 0),
                    2 if !matches!(rdn, 13 | 15) && rm != 15 => two(AddHigh, rdn, rm),
                    3 if rm != 15 && op & 0x80 == 0 => two(Bx, 0, rm),
                    3 if rm != 15 => two(Blx, 0, rm),
                    _ => Self::OTHER,
                }
            }
            0b01001 => with(LdrLiteral, r8, 0, relative),
            0b01010 | 0b01011 => {
                Self::new(REGISTER_OFFSET[usize::from(op >> 9 & 7)], rd, rn, rm, 0)
            }
            0b01100 => with(Str, rd, rn, 4 * imm5),
            0b01101 => with(Ldr, rd, rn, 4 * imm5),
            0b01110 => with(Strb, rd, rn, imm5),
            0b01111 => with(Ldrb, rd, rn, imm5),
            0b10000 => with(Strh, rd, rn, 2 * imm5),
            0b10001 => with(Ldrh, rd, rn, 2 * imm5),
            0b10010 => with(Str, r8, 13, 4 * imm8),
            0b10011 => with(Ldr, r8, 13, 4 * imm8),
            0b10100 => with(AddHigh, r8, ZERO, relative),
            0b10101 => with(AddHigh, r8, 13, 4 * imm8),
            0b10110 | 0b10111 => Self::miscellaneous(op),
            0b11000 | 0b11001 if imm8 == 0 => Self::OTHER,
            0b11000 => Self::transfer(Stm, r8, imm8),
            0b11001 => Self::transfer(Ldm, r8, imm8),
            0b11010 | 0b11011 => match CONDITIONS.get(usize::from(op >> 8 & 15)) {
                Some(&condition) => {
                    let offset = (op as i8 as i32 as u32) << 1;
                    with(condition, 0, 0, pc.wrapping_add(4).wrapping_add(offset))
                }
                None => Self::OTHER,
            },
            0b11100 => {
                let offset = ((word << 21) as i32 >> 20) as u32;
                with(Branch, 0, 0, pc.wrapping_add(4).wrapping_add(offset))
            }
            _ => {
                let encoding = word << 16 | u32::from(second);
                if is_bl(encoding) {
                    let target = pc.wrapping_add(4).wrapping_add(bl_offset(encoding));
                    with(Bl, 0, 0, target)
                } else {
                    Self::wide(encoding)
                }
            }
        }
    }

    fn wide(encoding: u32) -> Self {
        let is_usable = |register: u32| register != 13 && register != 15;
        let (rd, rn) = (encoding >> 8 & 15, encoding >> 16 & 15);
        if is_barrier(encoding) {
            Self::new(Barrier, 0, 0, 0, 0)
        } else if encoding & 0xFFFF_F0FF == 0xF3EF_8010 && is_usable(rd) {
            Self::new(MrsPrimask, rd as u8, 0, 0, 0)
        } else if encoding & 0xFFF0_FFFF == 0xF380_8810 && is_usable(rn) {
            Self::new(MsrPrimask, rn as u8, 0, 0, 0)
        } else {
            Self::OTHER
        }
    }

    fn data_processing(op: u16) -> Self {
        let (rd, rn) = (field(op, 0), field(op, 3));
        let sum = |operation, a, b| Self::new(operation, a, b, rn, 0);
        let shift = |operation| Self::new(operation, rd, rn, ZERO, 0);
        match op >> 6 & 15 {
            0x0 => sum(And, rd, rd),
            0x1 => sum(Eor, rd, rd),
            0x2 => shift(LslRegister),
            0x3 => shift(LsrRegister),
            0x4 => shift(AsrRegister),
            0x5 => sum(Adc, rd, rd),
            0x6 => sum(Sbc, rd, rd),
            0x7 => shift(RorRegister),
            // TST, RSB, CMP, CMN.
            0x8 => sum(And, NOBODY, rd),
            0x9 => sum(Sub, rd, ZERO),
            0xA => sum(Sub, NOBODY, rd),
            0xB => sum(Add, NOBODY, rd),
            0xC => sum(Orr, rd, rd),
            0xD => shift(Mul),
            0xE => sum(Bic, rd, rd),
            _ => sum(Mvn, rd, ZERO),
        }
    }

    fn miscellaneous(op: u16) -> Self {
        let (rd, rn) = (field(op, 0), field(op, 3));
        let list = u32::from(op) & 0x1FF;
        let bytes = 4 * (u32::from(op) & 0x7F);
        let extend = |operation| Self::new(operation, rd, rn, 0, 0);
        match op >> 6 & 0x3F {
            0x00 | 0x01 => Self::new(SetSp, 0, 13, ZERO, bytes),
            0x02 | 0x03 => Self::new(SetSp, 0, 13, ZERO, bytes.wrapping_neg()),
            0x08 => extend(Sxth),
            0x09 => extend(Sxtb),
            0x0A => extend(Uxth),
            0x0B => extend(Uxtb),
            0x28 => extend(Rev),
            0x29 => extend(Rev16),
            0x2B => extend(Revsh),
            0x10..=0x17 if list != 0 => Self::transfer(Push, 13, list),
            0x30..=0x33 if list != 0 => Self::transfer(Pop, 13, list),
            0x34..=0x37 => Self::transfer(PopPc, 13, list & 0xFF),
            _ if op == 0xB672 => Self::new(Cpsid, 0, 0, 0, 0),
            _ if op == 0xB662 => Self::new(Cpsie, 0, 0, 0, 0),
            // NOP and YIELD.
            _ if op == 0xBF00 || op == 0xBF10 => Self::new(Nop, 0, 0, 0, 0),
            _ => Self::OTHER,
        }
    }

    const OTHER: Self = Self::new(Other, 0, 0, 0, 0);

    const fn new(operation: Operation, a: u8, b: u8, c: u8, imm: u32) -> Self {
        Self { operation, a, b, c, imm }
    }

    fn transfer(operation: Operation, base: u8, list: u32) -> Self {
        Self::new(operation, base, 0, list.count_ones() as u8, list)
    }
}

/// Rd or Rn (bits 7, 2:0) and Rm (bits 6:3) of the high-register forms.
pub fn high_fields(op: u16) -> (usize, usize) {
    (usize::from(op >> 4 & 8 | op & 7), usize::from(op >> 3 & 15))
}

/// Whether a 32-bit encoding is BL.
fn is_bl(encoding: u32) -> bool {
    encoding & 0xF800_D000 == 0xF000_D000
}

/// Whether a 32-bit encoding is DSB, DMB or ISB.
fn is_barrier(encoding: u32) -> bool {
    matches!(encoding & 0xFFFF_FFF0, 0xF3BF_8F40 | 0xF3BF_8F50 | 0xF3BF_8F60)
}

/// The offset of a BL from the address behind it: S:I1:I2:imm10:imm11:0.
fn bl_offset(encoding: u32) -> u32 {
    let s = encoding >> 26 & 1;
    let i1 = !(encoding >> 13 ^ s) & 1;
    let i2 = !(encoding >> 11 ^ s) & 1;
    let imm10 = encoding >> 16 & 0x3FF;
    let imm11 = encoding & 0x7FF;
    let offset = s << 24 | i1 << 23 | i2 << 22 | imm10 << 12 | imm11 << 1;
    ((offset << 7) as i32 >> 7) as u32
}

/// A low register's number, at bit `shift`.
pub(super) fn field(op: u16, shift: u32) -> u8 {
    (op >> shift & 7) as u8
}

/// Half-words of main flash.
const HALF_WORDS: usize = FLASH_SIZE as usize / 2;

/// All of main flash, decoded: for each half-word the instruction that begins there. Clones share
/// it until one of them changes its flash.
#[derive(Clone)]
pub(crate) struct Code(Arc<[Instruction; HALF_WORDS]>);

impl Code {
    /// The code of erased flash.
    pub(crate) fn erased() -> Self {
        Self(filled(Instruction::OTHER).into())
    }

    /// Decodes what `len` bytes of `flash` from `start` on, which have changed, may be part of.
    pub(crate) fn update(&mut self, flash: &[u8; FLASH_SIZE as usize], start: usize, len: usize) {
        let code = Arc::make_mut(&mut self.0);
        let half = |index: usize| match flash.get(2 * index..2 * index + 2) {
            Some(bytes) => u16::from_le_bytes([bytes[0], bytes[1]]),
            // Behind the flash: no second half of a BL.
            None => 0,
        };
        // The half-word before may be the first half of a BL.
        let first = (start / 2).saturating_sub(1);
        let behind = (start + len).div_ceil(2).min(HALF_WORDS);
        for (index, instruction) in code.iter_mut().enumerate().take(behind).skip(first) {
            *instruction = Instruction::decode(2 * index as u32, half(index), half(index + 1));
        }
    }

    /// The instruction at an even address, if that is in flash.
    #[inline(always)]
    pub(crate) fn at(&self, pc: u32) -> Option<&Instruction> {
        self.0.get(pc as usize / 2)
    }
}
