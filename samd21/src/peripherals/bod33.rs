//! BOD33, the detector of a low supply: register BOD33 of SYSCTRL.
//!
//! | field | behaviour |
//! |---|---|
//! | ENABLE, LEVEL | BOD33DET while the supply is below the level's threshold |
//! | HYST | once below it, the supply has to rise 70 mV higher |
//! | ACTION | reset: the chip is reset, and held so while the supply is low; else only the flag |
//!
//! | left out | why |
//! |---|---|
//! | MODE, CEN, PSEL | it looks all the time |
//! | BOD12 and power-on reset | the supply of 3.3 V stays above 1.6 V |
//! | what flash and core do wrong at a low supply | no figures |

/// All that the register has.
pub(crate) const BITS: u32 = 0x003F_F35E;
const ENABLE: u32 = 1 << 1;
const HYST: u32 = 1 << 2;
const ACTION: u32 = 3 << 3;
const ACTION_RESET: u32 = 1 << 3;

/// Rising threshold of level 0 and a step, mV: 1.715 V at level 6 and 2.84 V at level 39 (data
/// sheet, table 37-22).
const LEVEL_0_MV: u32 = 1_511;
const STEP_MV: u32 = 34;
/// What the falling threshold of a detector with hysteresis is lower, mV.
const HYSTERESIS_MV: u32 = 70;

/// The detector and what it looks at.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bod33 {
    pub(crate) register: u32,
    supply_mv: u32,
    is_low: bool,
    /// The reset that has begun is yet to be made.
    asks_reset: bool,
}

impl Bod33 {
    /// At 3.3 V.
    pub(crate) fn new(register: u32) -> Self {
        Self { register, supply_mv: 3_300, ..Self::default() }
    }

    /// After a reset, with the register as the user row has it.
    pub(crate) fn after_reset(&self, register: u32) -> Self {
        let mut fresh = Self { register, supply_mv: self.supply_mv, ..Self::default() };
        // It is in reset already.
        fresh.look(true);
        fresh
    }

    pub(crate) fn write(&mut self, register: u32) {
        let was_held = self.holds_reset();
        self.register = register;
        self.look(was_held);
    }

    pub(crate) fn set_supply(&mut self, mv: u32) {
        let was_held = self.holds_reset();
        self.supply_mv = mv;
        self.look(was_held);
    }

    fn look(&mut self, was_held: bool) {
        let rising_mv = LEVEL_0_MV + (self.register >> 16 & 0x3F) * STEP_MV;
        let has_hysteresis = self.register & HYST != 0 && !self.is_low;
        let threshold_mv = rising_mv - if has_hysteresis { HYSTERESIS_MV } else { 0 };
        self.is_low = self.is_enabled() && self.supply_mv < threshold_mv;
        self.asks_reset |= self.holds_reset() && !was_held;
    }

    /// Whether a reset is to be made, once.
    pub(crate) fn take_reset(&mut self) -> bool {
        std::mem::take(&mut self.asks_reset)
    }

    pub(crate) fn is_enabled(&self) -> bool {
        self.register & ENABLE != 0
    }

    /// BOD33DET.
    pub(crate) fn is_low(&self) -> bool {
        self.is_low
    }

    /// Whether the chip is held in reset.
    pub(crate) fn holds_reset(&self) -> bool {
        self.is_low && self.register & ACTION == ACTION_RESET
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: level 39 rises at 1511 + 39 * 34 = 2837 mV, and falls 70 mV lower.
    #[test]
    fn the_supply_is_low_below_the_level_and_until_it_is_above_the_hysteresis() {
        let mut bod33 = Bod33::new(39 << 16 | ENABLE | HYST);
        let low = [2_768, 2_766, 2_800, 2_836, 2_838, 2_800].map(|mv| {
            bod33.set_supply(mv);
            bod33.is_low()
        });
        assert_eq!(low, [false, true, true, true, false, false]);
        bod33.write(39 << 16 | ENABLE);
        assert!(bod33.is_low() && !bod33.holds_reset());
        assert!(!bod33.take_reset());
        bod33.write(39 << 16 | ENABLE | ACTION_RESET);
        assert!(bod33.holds_reset() && bod33.take_reset() && !bod33.take_reset());
        // The user row's level.
        assert!(!bod33.after_reset(7 << 16 | ENABLE | ACTION_RESET).is_low());
        bod33.write(39 << 16);
        assert!(!bod33.is_low());
    }
}
