//! The flags N, Z, C and V, kept as the results that they follow from: nearly every instruction
//! sets them, and few look at them.

/// The flags of the APSR.
#[derive(Clone, Copy)]
pub(super) struct Flags {
    /// N is the sign, Z whether the lower 32 bits are zero; so any pair of the two has a value.
    nz: i64,
    pub(super) c: bool,
    /// V is the sign.
    v: u32,
}

impl Default for Flags {
    /// All clear.
    fn default() -> Self {
        Self { nz: 1, c: false, v: 0 }
    }
}

impl Flags {
    /// The flags in bits 31 to 28.
    pub(super) fn of(apsr: u32) -> Self {
        let n = apsr & 1 << 31 != 0;
        let z = apsr & 1 << 30 != 0;
        Self {
            nz: i64::from(!z) | if n { i64::MIN } else { 0 },
            c: apsr & 1 << 29 != 0,
            v: (apsr & 1 << 28) << 3,
        }
    }

    /// The flags in bits 31 to 28.
    pub(super) fn bits(self) -> u32 {
        u32::from(self.nz < 0) << 31
            | u32::from(self.z()) << 30
            | u32::from(self.c) << 29
            | self.v >> 31 << 28
    }

    #[inline(always)]
    pub(super) fn z(self) -> bool {
        self.nz as u32 == 0
    }

    /// N and Z of a result, which is returned.
    #[inline(always)]
    pub(super) fn nz(&mut self, result: u32) -> u32 {
        self.nz = i64::from(result as i32);
        result
    }

    /// `a + b` with all flags.
    #[inline(always)]
    pub(super) fn add(&mut self, a: u32, b: u32) -> u32 {
        let (sum, carry) = a.overflowing_add(b);
        self.c = carry;
        self.v = (a ^ sum) & (b ^ sum);
        self.nz(sum)
    }

    /// `a - b` with all flags; C is set where nothing is borrowed.
    #[inline(always)]
    pub(super) fn sub(&mut self, a: u32, b: u32) -> u32 {
        let (difference, borrow) = a.overflowing_sub(b);
        self.c = !borrow;
        self.v = (a ^ b) & (a ^ difference);
        self.nz(difference)
    }

    /// `a + b + C` with all flags; with `!b`, `a - b` less what was borrowed before.
    #[inline(always)]
    pub(super) fn adc(&mut self, a: u32, b: u32) -> u32 {
        let (partial, c1) = a.overflowing_add(b);
        let (sum, c2) = partial.overflowing_add(u32::from(self.c));
        self.c = c1 | c2;
        self.v = (a ^ sum) & (b ^ sum);
        self.nz(sum)
    }

    /// `value` shifted left by 1 to 255.
    #[inline(always)]
    pub(super) fn lsl(&mut self, value: u32, by: u32) -> u32 {
        let wide = u64::from(value) << by.min(33);
        self.c = wide >> 32 & 1 != 0;
        self.nz(wide as u32)
    }

    /// `value` shifted right by 1 to 255.
    #[inline(always)]
    pub(super) fn lsr(&mut self, value: u32, by: u32) -> u32 {
        let wide = u64::from(value) << 1 >> by.min(33);
        self.c = wide & 1 != 0;
        self.nz((wide >> 1) as u32)
    }

    /// `value` shifted right by 1 to 255, with its sign.
    #[inline(always)]
    pub(super) fn asr(&mut self, value: u32, by: u32) -> u32 {
        let wide = i64::from(value as i32) << 1 >> by.min(33);
        self.c = wide & 1 != 0;
        self.nz((wide >> 1) as u32)
    }

    /// `value` rotated right by 1 to 255.
    #[inline(always)]
    pub(super) fn ror(&mut self, value: u32, by: u32) -> u32 {
        let result = value.rotate_right(by & 31);
        self.c = result >> 31 != 0;
        self.nz(result)
    }
}

/// How logic comes from the same steps: operations that are told apart by data cost the host no
/// jump that it cannot foresee.
pub(super) struct Rule {
    /// Inverts the second operand.
    pub(super) invert: u32,
    /// Whether the result has bits that one operand has, and those that both have.
    pub(super) exclusive: u32,
    pub(super) both: u32,
}

/// By the order of `Operation`: AND, EOR, BIC, MVN.
pub(super) static RULES: [Rule; 4] = [
    Rule { invert: 0, exclusive: 0, both: !0 },
    Rule { invert: 0, exclusive: !0, both: 0 },
    Rule { invert: !0, exclusive: 0, both: !0 },
    Rule { invert: !0, exclusive: !0, both: !0 },
];

/// Where a condition holds: bit n for NZCV being n. By the order of `Operation`, from BMI on.
pub(super) static CONDITIONS: [u16; 16] = {
    let mut table = [0; 16];
    let mut nzcv = 0;
    while nzcv < 16 {
        let (n, z, c, v) = (nzcv & 8 != 0, nzcv & 4 != 0, nzcv & 2 != 0, nzcv & 1 != 0);
        let holds = [n, v, c && !z, n == v, n == v && !z];
        let mut index = 0;
        while index < 2 * holds.len() {
            if holds[index / 2] == (index % 2 == 0) {
                table[index] |= 1 << nzcv;
            }
            index += 1;
        }
        nzcv += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_is_kept() {
        for bits in 0..16 {
            assert_eq!(Flags::of(bits << 28).bits(), bits << 28);
        }
        assert_eq!(Flags::default().bits(), 0);
    }
}
