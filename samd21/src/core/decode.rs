//! From a half-word to the operation it stands for (ARM DDI 0419, A5.2).
//!
//! The upper 10 bits decide it, but for a few operations that look at further bits themselves:
//! CPS, hints and the 32-bit encodings. The table has one byte for each value of these bits.

/// Defines the operations with the half-words' bits 15:6 that stand for them.
macro_rules! operations {
    ($($top:pat => $name:ident,)*) => {
        /// What an instruction does, one for each encoding that ARMv6-M has (T1, T2 ... as ARM
        /// numbers them where there are several).
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Operation {
            $($name,)*
            Undefined,
        }

        const fn decode(top: u16) -> Operation {
            match top {
                $($top => Operation::$name,)*
                _ => Operation::Undefined,
            }
        }
    };
}

operations! {
    0x000..=0x01F => LslImmediate,
    0x020..=0x03F => LsrImmediate,
    0x040..=0x05F => AsrImmediate,
    0x060..=0x067 => AddRegister,
    0x068..=0x06F => SubRegister,
    0x070..=0x077 => AddImmediate3,
    0x078..=0x07F => SubImmediate3,
    0x080..=0x09F => MovImmediate,
    0x0A0..=0x0BF => CmpImmediate,
    0x0C0..=0x0DF => AddImmediate8,
    0x0E0..=0x0FF => SubImmediate8,
    0x100 => And,
    0x101 => Eor,
    0x102 => LslRegister,
    0x103 => LsrRegister,
    0x104 => AsrRegister,
    0x105 => Adc,
    0x106 => Sbc,
    0x107 => RorRegister,
    0x108 => Tst,
    0x109 => Rsb,
    0x10A => CmpRegister,
    0x10B => Cmn,
    0x10C => Orr,
    0x10D => Mul,
    0x10E => Bic,
    0x10F => Mvn,
    0x110..=0x113 => AddHigh,
    0x114..=0x117 => CmpHigh,
    0x118..=0x11B => MovHigh,
    0x11C..=0x11D => Bx,
    0x11E..=0x11F => Blx,
    0x120..=0x13F => LdrLiteral,
    0x140..=0x147 => StrRegister,
    0x148..=0x14F => StrhRegister,
    0x150..=0x157 => StrbRegister,
    0x158..=0x15F => LdrsbRegister,
    0x160..=0x167 => LdrRegister,
    0x168..=0x16F => LdrhRegister,
    0x170..=0x177 => LdrbRegister,
    0x178..=0x17F => LdrshRegister,
    0x180..=0x19F => StrImmediate,
    0x1A0..=0x1BF => LdrImmediate,
    0x1C0..=0x1DF => StrbImmediate,
    0x1E0..=0x1FF => LdrbImmediate,
    0x200..=0x21F => StrhImmediate,
    0x220..=0x23F => LdrhImmediate,
    0x240..=0x25F => StrSp,
    0x260..=0x27F => LdrSp,
    0x280..=0x29F => Adr,
    0x2A0..=0x2BF => AddSpTo,
    0x2C0..=0x2C1 => AddSp,
    0x2C2..=0x2C3 => SubSp,
    0x2C8 => Sxth,
    0x2C9 => Sxtb,
    0x2CA => Uxth,
    0x2CB => Uxtb,
    0x2D0..=0x2D7 => Push,
    0x2D9 => Cps,
    0x2E8 => Rev,
    0x2E9 => Rev16,
    0x2EB => Revsh,
    0x2F0..=0x2F7 => Pop,
    0x2F8..=0x2FB => Bkpt,
    0x2FC..=0x2FF => Hint,
    0x300..=0x31F => Stm,
    0x320..=0x33F => Ldm,
    0x340..=0x377 => BranchIf,
    0x37C..=0x37F => Svc,
    0x380..=0x39F => Branch,
    0x3A0..=0x3FF => Wide,
}

impl Operation {
    /// The operation of a half-word.
    #[inline(always)]
    pub(super) fn of(op: u16) -> Self {
        TABLE[usize::from(op >> 6)]
    }
}

static TABLE: [Operation; 1024] = {
    let mut table = [Operation::Undefined; 1024];
    let mut top = 0;
    while top < table.len() {
        table[top] = decode(top as u16);
        top += 1;
    }
    table
};

/// A low register's number, at bit `shift`.
#[inline(always)]
pub(super) fn field(op: u16, shift: u32) -> usize {
    usize::from(op >> shift & 7)
}
