//! The chip: core, memories and peripherals together, and how to run it.
//!
//! The bootloader is left out. [`Chip::boot`] does what a bootloader does last. Whoever models one
//! (half a second after each reset, a double tap of the button) waits for [`Stop::Reset`], lets its
//! time pass with [`Chip::hold_until`] and boots again.

use crate::board::{Board, Ticks};
use crate::bus::Bus;
use crate::core::Core;
pub use crate::core::{Counters, EXCEPTIONS, Profile, Registers, Stop};
use crate::fault::Fault;
use crate::memory::{FLASH_SIZE, Memory};
use crate::options::Options;
use crate::peripherals::{Peripherals, ResetCause, Violations, Width};
use crate::usb_host::Host;

/// Times at which a stopped CPU is looked at again.
const STOPPED_STEP: Ticks = Ticks::from_us(100);

/// An ATSAMD21 with 256 KB of flash and 32 KB of SRAM.
#[derive(Clone)]
pub struct Chip {
    pub(crate) core: Core,
    /// Flash and SRAM, for a bootloader's model and for debuggers too.
    pub memory: Memory,
    pub(crate) peripherals: Peripherals,
    /// The USB host at the other end of the cable.
    pub usb_host: Host,
}

impl Chip {
    /// A chip at power-on, flash erased. It runs once it is booted.
    pub fn new(options: Options) -> Self {
        let peripherals = Peripherals::new(&options);
        Self {
            core: Core::new(&options, peripherals.cycle),
            memory: Memory::new(options.seed),
            peripherals,
            usb_host: Host::of(options.host),
        }
    }

    /// Puts bytes into flash as a programmer does.
    ///
    /// # Panics
    /// If they do not fit.
    pub fn load_flash(&mut self, address: u32, bytes: &[u8]) {
        assert!(
            self.memory.load(address, bytes).is_some(),
            "{} bytes at 0x{address:x} do not fit into 0x{FLASH_SIZE:x} bytes of flash",
            bytes.len()
        );
    }

    /// Starts the image at `vector_table`: its first word is the stack pointer, its second the
    /// entry point, and VTOR points to it. A bootloader does this last; after a reset the core does
    /// it with address 0.
    pub fn boot(&mut self, vector_table: u32) {
        self.core.boot(vector_table, &self.memory);
    }

    /// Runs until `until`, or until something stops the chip. The last instruction may end some
    /// cycles after `until`; everything due until then has happened.
    pub fn run_until(&mut self, until: Ticks, board: &mut dyn Board) -> Stop {
        self.run_by(until, board, Core::run)
    }

    /// The same, more slowly, up to an instruction at whose address `stops` says so: then it is
    /// [`Stop::Breakpoint`], and the chip stands before it.
    pub fn run_watched(
        &mut self,
        until: Ticks,
        board: &mut dyn Board,
        stops: &dyn Fn(u32) -> bool,
    ) -> Stop {
        self.run_by(until, board, |core, bus, until| core.run_watched(bus, until, stops))
    }

    fn run_by(
        &mut self,
        until: Ticks,
        board: &mut dyn Board,
        run: impl FnOnce(&mut Core, &mut Bus<'_>, Ticks) -> Stop,
    ) -> Stop {
        while self.is_stopped() {
            let step = until.min(self.now() + STOPPED_STEP);
            let stop = self.hold_until(step, board);
            if stop != Stop::Reached || self.now() >= until {
                return stop;
            }
        }
        let (core, mut bus) = self.parts(board);
        let stop = run(core, &mut bus, until);
        bus.settle(core.now());
        stop
    }

    /// Lets time pass for the peripherals while the core stands still: what a bootloader that is
    /// not emulated does with it. Ends early with [`Stop::Reset`] only.
    pub fn hold_until(&mut self, until: Ticks, board: &mut dyn Board) -> Stop {
        let (core, mut bus) = self.parts(board);
        let stop = core.hold(&mut bus, until);
        bus.settle(core.now());
        stop
    }

    /// Resets core and peripherals; memories, time and counters go on, but flash that is being
    /// erased or written is left half done. The core waits to be booted.
    pub fn reset(&mut self, cause: ResetCause) {
        self.core.reset();
        self.peripherals.reset(self.core.now(), cause, &mut self.memory);
        self.usb_host.observe(self.core.now(), &self.peripherals.usb);
    }

    /// Counts cycles by address from now on. The chip does the same as without, more slowly.
    pub fn begin_profile(&mut self) {
        self.core.profile = Some(Box::default());
    }

    /// Ends the profile and gives it; an empty one if none was begun.
    pub fn end_profile(&mut self) -> Profile {
        self.core.profile.take().map_or_else(Profile::default, |profile| *profile)
    }

    /// Time since power-on.
    pub fn now(&self) -> Ticks {
        self.core.now()
    }

    /// What has been counted since power-on.
    pub fn counters(&self) -> Counters {
        self.core.counters()
    }

    /// The lowest value that MSP has had since it was booted.
    pub fn lowest_sp(&self) -> u32 {
        self.core.lowest_sp
    }

    /// Priorities of the exceptions by their number, as NVIC_IPR and SHPR hold them: 0 to 3, the
    /// lowest first; NMI (exception 2) has -2 and HardFault (3) -1.
    pub fn priorities(&self) -> [i8; EXCEPTIONS] {
        self.core.priorities()
    }

    /// Address of the next instruction.
    pub fn pc(&self) -> u32 {
        self.core.pc
    }

    /// Whether the core sleeps in WFI or WFE.
    pub fn is_asleep(&self) -> bool {
        self.core.is_asleep()
    }

    /// The core's registers.
    pub fn registers(&self) -> Registers {
        self.core.registers()
    }

    /// Sets R0 to R12, LR, PC, the flags, PRIMASK, CONTROL.SPSEL (in Thread mode), MSP and PSP.
    /// The stack pointer in use comes from `msp` or `psp`, not from `r[13]`.
    pub fn set_registers(&mut self, registers: &Registers) {
        self.core.set_registers(registers);
    }

    /// What led to the last HardFault since power-on.
    pub fn last_hard_fault(&self) -> Option<&Fault> {
        self.core.last_hard_fault.as_ref()
    }

    /// The fault in which the core has locked up: one that could not be taken. What led to the
    /// handler in which it happened is [`Chip::last_hard_fault`].
    pub fn lockup(&self) -> Option<&Fault> {
        self.core.lockup.as_ref()
    }

    /// The last taken branches, from and to, oldest first: how the core got here.
    pub fn trail(&self) -> impl Iterator<Item = (u32, u32)> {
        self.core.trail()
    }

    /// A word of a peripheral, as a debugger reads it; `None` where there is none, or it is not
    /// clocked.
    pub fn peek(&mut self, address: u32, board: &mut dyn Board) -> Option<u32> {
        let now = self.now();
        self.peripherals.read(now, address, Width::Word, board).ok()
    }

    /// Misuse of peripherals since power-on that the real chip would have swallowed.
    pub fn violations(&self) -> &Violations {
        &self.peripherals.violations
    }

    fn parts<'a>(&'a mut self, board: &'a mut dyn Board) -> (&'a mut Core, Bus<'a>) {
        (
            &mut self.core,
            Bus {
                memory: &mut self.memory,
                peripherals: &mut self.peripherals,
                usb_host: &mut self.usb_host,
                board,
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Unconnected;
    use crate::tests::Bench;

    #[test]
    fn a_slow_clock_makes_fewer_cycles_in_the_same_time() {
        let options = Options { dfll_error_ppm: -31_000, ..Options::default() };
        let mut bench = Bench::with(&options, Unconnected);
        bench.start_clocks();
        let mut chip = Chip::new(options);
        chip.peripherals = bench.peripherals;
        // Stack pointer and entry point; B to itself, 3 cycles.
        chip.load_flash(0, &[0, 0x80, 0, 0x20, 9, 0, 0, 0, 0xFE, 0xE7]);
        chip.boot(0);
        chip.run_until(bench.now, &mut Unconnected);
        let before = chip.counters().cycles;
        chip.run_until(bench.now + Ticks::from_ms(100), &mut Unconnected);
        let cycles = chip.counters().cycles - before;
        // 100 ms at 46.512 MHz, to 20 ppm and the last instruction.
        assert!(cycles.abs_diff(4_651_200) < 100, "{cycles}");
    }

    /// The core is stalled while it erases, but a reset comes at its own time.
    #[test]
    fn a_reset_comes_in_the_midst_of_a_stall() {
        let mut chip = Chip::new(Options::default());
        // Stack pointer and entry point; LDR R0, ADDR; LDR R1, row; STR R1, [R0]; LDR R0, CTRLA;
        // LDR R1, command; STRH R1, [R0]; B to itself; and the words.
        let code: [u16; 12] =
            [0x8000, 0x2000, 9, 0, 0x4803, 0x4904, 0x6001, 0x4804, 0x4904, 0x8001, 0xE7FE, 0];
        let words = [0x4100_401C_u32, 0x3F00 / 2, 0x4100_4000, 0xA502];
        let halves = code.iter().flat_map(|half| half.to_le_bytes());
        let image: Vec<u8> =
            halves.chain(words.iter().flat_map(|word| word.to_le_bytes())).collect();
        chip.load_flash(0, &image);
        chip.load_flash(0x3F00, &[0; 256]);
        chip.boot(0);
        let middle = Ticks::from_ms(3);
        assert_eq!(chip.run_until(middle, &mut Unconnected), Stop::Reached);
        assert!(chip.now() < middle + Ticks(8), "{:?}", chip.now());
        let counters = chip.counters();
        assert!(counters.cycles < 1000 && counters.stall_ticks > Ticks::from_ms(2).0);
        chip.reset(ResetCause::BrownOut33);
        let ones = |chip: &Chip| {
            let row = &chip.memory.flash()[0x3F00..0x4000];
            row.iter().map(|byte| byte.count_ones()).sum::<u32>()
        };
        assert!(ones(&chip).abs_diff(1024) < 113, "{}", ones(&chip));
        // The stall is over with the reset.
        chip.boot(0);
        chip.run_until(middle + Ticks::from_us(100), &mut Unconnected);
        assert!(chip.counters().instructions > counters.instructions);
    }

    #[test]
    fn changed_flash_runs_as_it_is_now() {
        let mut chip = Chip::new(Options::default());
        // Stack pointer and entry point; MOVS R0, #3; BKPT.
        chip.load_flash(0, &[0, 0x80, 0, 0x20, 9, 0, 0, 0, 3, 0x20, 0, 0xBE]);
        let result = |chip: &mut Chip| {
            chip.boot(0);
            let stop = chip.run_until(chip.now() + Ticks::from_ms(1), &mut Unconnected);
            assert_eq!(stop, Stop::Breakpoint);
            chip.registers().r[0]
        };
        assert_eq!(result(&mut chip), 3);
        let mut other = chip.clone();
        assert_eq!(chip.memory.program(8, &[0xFE]), Some(()));
        assert_eq!(result(&mut chip), 2);
        chip.load_flash(8, &[7]);
        assert_eq!(result(&mut chip), 7);
        assert_eq!(result(&mut other), 3);
    }
}
