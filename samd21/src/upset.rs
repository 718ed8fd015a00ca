//! What radiation, a disturbed supply and broken silicon do to a chip beside its memories: bits of
//! registers that flip, interrupt lines that stick, a clock that stops or runs at another rate.
//!
//! Memories are open to anybody ([`Chip::memory`], [`Chip::load_flash`]), and so are the core's
//! registers ([`Chip::set_registers`]).
//!
//! | peripheral | registers whose bits flip, by offset |
//! |---|---|
//! | TCC | all that it has but SYNCBUSY; a bit of CMD is a command |
//! | SERCOM | CTRLA (all but MODE), BAUD, INTEN, ADDR |
//! | GCLK | GENCTRL of generator n at 40+4n, GENDIV at 80+4n, CLKCTRL of clock n at 100+4n: the chip has one address for all |
//! | PM | CPUSEL, AHBMASK, APBxMASK |
//! | SYSCTRL | DFLLCTRL (ENABLE), DFLLVAL as the DFLL uses it, BOD33 |
//! | PORT | DIR, OUT, PMUX, PINCFG; a pin that is led to a TC is released |
//! | USB | CTRLA (ENABLE), CTRLB (DETACH), DADD, INTEN, DESCADD, EPCFGn, EPINTENn |
//! | DSU | STATUSA (DONE), ADDR, LENGTH, DATA |
//! | WDT | CTRL, CONFIG, EWCTRL, INTEN |
//! | core | SysTick's CSR (ENABLE, TICKINT) and RVR, the NVIC's enables and priorities |

use crate::Chip;
use crate::board::Board;

/// Addresses of the core's registers whose bits flip: SysTick's, the NVIC's enables, and its
/// priorities, a word for four interrupts.
pub mod core_registers {
    /// SysTick control and status.
    pub const SYST_CSR: u32 = 0xE000_E010;
    /// SysTick reload value.
    pub const SYST_RVR: u32 = 0xE000_E014;
    /// Enabled interrupts.
    pub const NVIC_ISER: u32 = 0xE000_E100;
    /// The first word of the priorities.
    pub const NVIC_IPR: u32 = 0xE000_E400;
}

impl Chip {
    /// Flips a bit of a register; `false`, and nothing happens, if the model has no such bit.
    pub fn flip_register(&mut self, address: u32, bit: u8, board: &mut dyn Board) -> bool {
        let now = self.now();
        if address >> 28 == 0xE {
            return self.core.flip_register(address, bit);
        }
        self.peripherals.flip(now, address, bit, board)
    }

    /// Holds an interrupt line of the NVIC at a level, or lets go of it.
    pub fn stick_interrupt(&mut self, line: u8, level: Option<bool>) {
        self.core.stick_line(line, level);
    }

    /// Stops the DFLL, and with it whatever it clocks, the CPU too if that is so; or starts it
    /// again.
    pub fn stop_dfll(&mut self, stopped: bool) {
        let now = self.now();
        self.peripherals.disturb(now, |sysctrl| sysctrl.dfll_stopped = stopped);
    }

    /// Moves the DFLL's frequency by a relative error, ppm, beside what it has already.
    pub fn shift_dfll(&mut self, ppm: f64) {
        let now = self.now();
        self.peripherals.disturb(now, |sysctrl| sysctrl.dfll.shift(ppm));
    }

    /// Lets OSCULP32K run at another rate, Hz. What its clocks have counted stays counted.
    pub fn set_slow_oscillator(&mut self, hz: f64) {
        let now = self.now();
        let hz = hz.round().max(1.0) as u32;
        self.peripherals.set_slow_oscillator(now, hz);
    }

    /// The supply of the chip goes to `volts`, 1.6 to 3.6. `true` if the brown-out detector resets
    /// the chip, which the caller then does.
    pub fn set_supply(&mut self, volts: f64) -> bool {
        let now = self.now();
        self.peripherals.set_supply(now, (volts * 1e3).round() as u32)
    }

    /// Whether the brown-out detector holds the chip in reset.
    pub fn is_held_in_reset(&self) -> bool {
        self.peripherals.sysctrl.bod33.holds_reset()
    }

    /// Whether the CPU has no clock.
    pub fn is_stopped(&self) -> bool {
        self.peripherals.gclk.main().is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;
    use crate::board::{Ticks, Unconnected};
    use crate::chip::Stop;
    use crate::tests::Bench;

    const TCC0: u32 = 0x4200_2000;
    const WDT: u32 = 0x4000_1000;

    /// Counts in R0 for ever.
    fn counting() -> (Chip, Ticks) {
        let mut bench = Bench::with(&Options::default(), Unconnected);
        bench.start_clocks();
        let mut chip = Chip::new(Options::default());
        chip.peripherals = bench.peripherals;
        // Stack pointer and entry point; ADDS R0, #1; B back.
        chip.load_flash(0, &[0, 0x80, 0, 0x20, 9, 0, 0, 0, 1, 0x30, 0xFD, 0xE7]);
        chip.boot(0);
        chip.run_until(bench.now, &mut Unconnected);
        (chip, bench.now)
    }

    fn counts(chip: &mut Chip, ms: u64) -> u32 {
        let before = chip.registers().r[0];
        let until = chip.now() + Ticks::from_ms(ms);
        assert_eq!(chip.run_until(until, &mut Unconnected), Stop::Reached);
        chip.registers().r[0] - before
    }

    #[test]
    fn a_stopped_clock_stops_the_core_until_it_goes_on() {
        let (mut chip, _) = counting();
        let usual = counts(&mut chip, 10);
        assert!(usual > 10_000);
        chip.stop_dfll(true);
        assert!(chip.is_stopped());
        assert_eq!(counts(&mut chip, 10), 0);
        chip.stop_dfll(false);
        let after = counts(&mut chip, 10);
        assert!(after.abs_diff(usual) < usual / 100, "{after} of {usual}");
        chip.shift_dfll(-100_000.0);
        let slow = counts(&mut chip, 10);
        assert!((slow + usual / 10).abs_diff(usual) < usual / 100, "{slow}");
    }

    #[test]
    fn a_flipped_bit_is_read_back_and_flips_back() {
        let (mut chip, _) = counting();
        let read =
            |chip: &mut Chip, address| chip.peek(address, &mut Unconnected).expect("it is clocked");
        assert!(!chip.flip_register(TCC0 + 0x40, 3, &mut Unconnected), "not clocked");
        // PB08 and PB09, one byte of PMUX and each a byte of PINCFG.
        let sensor = [(0x4100_44B4, 2), (0x4100_44C8, 0), (0x4100_44C8, 8)];
        let others = [(WDT, 1), (0x4100_4400, 17), (0x4000_0420, 4)];
        for (address, bit) in others.into_iter().chain(sensor) {
            let before = read(&mut chip, address);
            assert!(chip.flip_register(address, bit, &mut Unconnected));
            assert_eq!(read(&mut chip, address), before ^ 1 << bit, "{address:#x}");
            assert!(chip.flip_register(address, bit, &mut Unconnected));
            assert_eq!(read(&mut chip, address), before);
        }
        // Registers and bits that are not there.
        assert!(!chip.flip_register(0x4100_44C8, 3, &mut Unconnected));
        assert!(!chip.flip_register(0x4000_1400, 0, &mut Unconnected));
        // Bits that the registers do not have: APBAMASK, BOD33, DESCADD, EPCFG.
        for (address, bit) in
            [(0x4000_0418, 7), (0x4000_0834, 0), (0x4100_5024, 1), (0x4100_5100, 3)]
        {
            assert!(!chip.flip_register(address, bit, &mut Unconnected), "{address:#x} {bit}");
        }
        assert!(!chip.flip_register(0xE000_ED00, 0, &mut Unconnected));
    }

    #[test]
    fn a_line_that_sticks_interrupts_again_and_again() {
        let (mut chip, _) = counting();
        // The handler of interrupt 3: ADDS R1, #1; BX LR.
        chip.load_flash(4 * 19, &[0x81, 0, 0, 0]);
        chip.load_flash(0x80, &[1, 0x31, 0x70, 0x47]);
        assert!(chip.flip_register(core_registers::NVIC_ISER, 3, &mut Unconnected));
        counts(&mut chip, 1);
        assert_eq!(chip.registers().r[1], 0);
        chip.stick_interrupt(3, Some(true));
        counts(&mut chip, 1);
        assert!(chip.registers().r[1] > 500, "{}", chip.registers().r[1]);
        chip.stick_interrupt(3, None);
        let before = chip.registers().r[1];
        counts(&mut chip, 1);
        assert!(chip.registers().r[1] <= before + 1);
    }
}
