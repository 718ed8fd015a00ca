//! Pending, enabled and active exceptions and their priorities: NVIC with 32 interrupts and the
//! system exceptions, both with 2 priority bits (ARM DDI 0419, B1.5 and B3.4).
//!
//! Interrupt lines are level-sensitive as on this chip: a line pends its interrupt while it is
//! high and the interrupt is not active, and when it rises while the interrupt is active.
//!
//! Left out: the NMI line of EIC (NMI can be pended by ICSR), and the cycle or two by which a
//! real line falls late after the register write that clears its cause.

/// Exceptions are numbered as in IPSR: 16 + n is interrupt n.
pub(super) const NMI: u8 = 2;
pub(super) const HARD_FAULT: u8 = 3;
pub(super) const SVCALL: u8 = 11;
pub(super) const PENDSV: u8 = 14;
pub(super) const SYSTICK: u8 = 15;
/// Exception number of interrupt 0.
pub(super) const IRQ0: u8 = 16;
/// Exceptions, numbered from 0: of these 0 is none, and 1 is the reset.
pub const EXCEPTIONS: usize = 48;

/// Priority of code that no exception interrupts: lower (numerically higher) than any exception.
pub(super) const THREAD_PRIORITY: i8 = 4;

const SYSTEM: u64 = 1 << NMI | 1 << HARD_FAULT | 1 << SVCALL | 1 << PENDSV | 1 << SYSTICK;

/// The exception state; bit n of a mask is exception n.
#[derive(Clone)]
pub(super) struct Nvic {
    pub(super) pending: u64,
    active: u64,
    pub(super) enabled: u64,
    lines: u32,
    /// 0 to 3; NMI -2, HardFault -1.
    pub(super) priorities: [i8; EXCEPTIONS],
}

impl Default for Nvic {
    /// The state after reset.
    fn default() -> Self {
        let mut priorities = [0; EXCEPTIONS];
        priorities[usize::from(NMI)] = -2;
        priorities[usize::from(HARD_FAULT)] = -1;
        Self { pending: 0, active: 0, enabled: SYSTEM, lines: 0, priorities }
    }
}

impl Nvic {
    /// Takes the level of the 32 interrupt lines.
    pub(super) fn sample(&mut self, lines: u32) {
        let rising = lines & !self.lines;
        let idle = lines & !irqs(self.active);
        self.lines = lines;
        self.pending |= exceptions(rising | idle);
    }

    pub(super) fn pend(&mut self, exception: u8) {
        self.pending |= 1 << exception;
    }

    pub(super) fn is_pending(&self, exception: u8) -> bool {
        self.pending >> exception & 1 != 0
    }

    /// Pending moves to active.
    pub(super) fn activate(&mut self, exception: u8) {
        self.pending &= !(1 << exception);
        self.active |= 1 << exception;
    }

    pub(super) fn deactivate(&mut self, exception: u8) {
        self.active &= !(1 << exception);
    }

    /// How many exceptions are active.
    pub(super) fn nesting(&self) -> u32 {
        self.active.count_ones()
    }

    /// The enabled pending exception that goes first, with its priority: the lowest number among
    /// those of the highest priority.
    pub(super) fn first_pending(&self) -> Option<(u8, i8)> {
        let mut waiting = self.pending & self.enabled;
        let mut first: Option<(u8, i8)> = None;
        while waiting != 0 {
            let exception = waiting.trailing_zeros() as u8;
            let priority = self.priority(exception);
            if first.is_none_or(|(_, best)| priority < best) {
                first = Some((exception, priority));
            }
            waiting &= waiting - 1;
        }
        first
    }

    /// The priority of the active exceptions together, without PRIMASK.
    pub(super) fn active_priority(&self) -> i8 {
        let mut active = self.active;
        let mut priority = THREAD_PRIORITY;
        while active != 0 {
            priority = priority.min(self.priority(active.trailing_zeros() as u8));
            active &= active - 1;
        }
        priority
    }

    pub(super) fn priority(&self, exception: u8) -> i8 {
        self.priorities[usize::from(exception) % EXCEPTIONS]
    }

    /// Four priorities from exception `first` up as a priority register holds them: bits 7:6 of
    /// each byte.
    pub(super) fn priority_word(&self, first: u8) -> u32 {
        let bytes = (0..4).filter(|byte| settable(first + byte));
        bytes.fold(0, |word, byte| word | (self.priority(first + byte) as u32) << (8 * byte + 6))
    }

    /// Writes a priority register; exceptions of fixed priority are left alone.
    pub(super) fn set_priority_word(&mut self, first: u8, word: u32) {
        for byte in (0..4).filter(|byte| settable(first + byte)) {
            self.priorities[usize::from(first + byte) % EXCEPTIONS] =
                (word >> (8 * byte + 6) & 3) as i8;
        }
    }
}

/// Interrupts (bit n is interrupt n) as a mask of exceptions.
pub(super) fn exceptions(irqs: u32) -> u64 {
    u64::from(irqs) << IRQ0
}

/// A mask of exceptions as the interrupts in it.
pub(super) fn irqs(exceptions: u64) -> u32 {
    (exceptions >> IRQ0) as u32
}

fn settable(exception: u8) -> bool {
    matches!(exception, SVCALL | PENDSV | SYSTICK) || exception >= IRQ0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_number_of_the_highest_priority_goes_first() {
        let mut nvic = Nvic::default();
        nvic.enabled |= exceptions(0b111);
        nvic.set_priority_word(IRQ0, 0x0040_4080);
        nvic.pending |= exceptions(0b1111);
        assert_eq!(nvic.first_pending(), Some((IRQ0 + 1, 1)), "irq 3 is not enabled");
        nvic.pend(PENDSV);
        assert_eq!(nvic.first_pending(), Some((PENDSV, 0)));
        nvic.pend(HARD_FAULT);
        assert_eq!(nvic.first_pending(), Some((HARD_FAULT, -1)));
        nvic.pend(NMI);
        assert_eq!(nvic.first_pending(), Some((NMI, -2)));
    }

    #[test]
    fn a_level_pends_again_only_once_its_handler_is_left() {
        let mut nvic = Nvic::default();
        nvic.sample(1);
        nvic.activate(IRQ0);
        nvic.sample(1);
        assert_eq!(irqs(nvic.pending), 0);
        nvic.deactivate(IRQ0);
        nvic.sample(1);
        assert_eq!(irqs(nvic.pending), 1);
    }

    #[test]
    fn an_edge_in_the_handler_pends_again() {
        let mut nvic = Nvic::default();
        nvic.sample(1);
        nvic.activate(IRQ0);
        nvic.sample(0);
        nvic.sample(1);
        nvic.sample(0);
        assert_eq!(irqs(nvic.pending), 1);
    }

    #[test]
    fn priority_registers_keep_two_bits_a_byte() {
        let mut nvic = Nvic::default();
        nvic.set_priority_word(IRQ0 + 28, 0xFFFF_FFFF);
        assert_eq!(nvic.priority_word(IRQ0 + 28), 0xC0C0_C0C0);
        nvic.set_priority_word(12, 0xFFFF_FFFF);
        assert_eq!(nvic.priority_word(12), 0xC0C0_0000, "12 and 13 do not exist");
        nvic.set_priority_word(0, 0xFFFF_FFFF);
        assert_eq!(nvic.priority(HARD_FAULT), -1);
    }
}
