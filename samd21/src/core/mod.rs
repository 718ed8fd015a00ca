//! The ARMv6-M core (Cortex-M0+ r0p1 as the SAM D21 has it) and its run loop.
//!
//! Modelled: every instruction, exceptions with priorities, nesting, tail-chaining and late
//! arrival, both stack pointers, SysTick, sleep, lockup, and ARM's published cycle counts
//! (DDI 0484, fast multiplier). Time advances instruction by instruction; all accesses of an
//! instruction happen at its first cycle.
//!
//! Left out: unprivileged mode and the MPU (this chip has neither), deep sleep, and everything
//! that only a debugger sees. A BKPT stops the run as with a debugger attached.

mod access;
mod burst;
mod exception;
mod execute;
mod flags;
mod nvic;
mod profile;
mod system_control;
mod systick;
mod view;

pub use self::nvic::EXCEPTIONS;
pub use self::profile::Profile;
pub use self::view::{Counters, Registers, Stop};

use self::flags::Flags;
use self::nvic::Nvic;
use self::systick::SysTick;
use crate::board::Ticks;
use crate::bus::Bus;
use crate::fault::{Fault, FaultKind};
use crate::memory::Memory;
use crate::options::Options;
use crate::peripherals::{FRACTION, ResetCause};

const SP: usize = 13;
const LR: usize = 14;
const PC: usize = 15;

/// Registers, as many as make an index cheap.
const REGISTERS: usize = 32;
/// Taken branches that are remembered.
const TRAIL: usize = 32;
/// Lines of the flash controller's cache, 8 bytes each.
const FLASH_LINES: usize = 8;

/// Why an instruction did not complete.
enum Trap {
    /// What it does raises a HardFault.
    Fault(FaultKind),
    /// It needs what is not modelled: the chip stops.
    Unmodelled(FaultKind),
    SupervisorCall,
    Breakpoint,
}

/// Boxed, so that what nearly always succeeds returns in registers.
type Outcome<T> = Result<T, Box<Trap>>;

#[cold]
fn undefined(encoding: u32) -> Box<Trap> {
    Trap::Fault(FaultKind::Undefined { encoding }).into()
}

/// A time in parts of a tick; what is later than the core can count is never.
fn parts(time: Ticks) -> u64 {
    time.0.saturating_mul(1 << FRACTION)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Sleep {
    ForInterrupt,
    ForEvent,
}

#[derive(Clone, Default)]
pub(crate) struct Core {
    /// R0 to R12, the stack pointer in use, LR, and two for decoded instructions, zero (`ZERO`) and
    /// one that is only written (`NOBODY`).
    r: [u32; REGISTERS],
    /// Address of the next instruction (between instructions: of the one to be executed).
    pub(crate) pc: u32,
    flags: Flags,
    /// EPSR.T: clear after a branch to an even address.
    thumb: bool,
    /// Exception number; 0 in Thread mode.
    ipsr: u8,
    primask: bool,
    /// CONTROL.SPSEL: Thread mode uses PSP.
    spsel: bool,
    /// The stack pointer that is not in use.
    other_sp: u32,

    nvic: Nvic,
    /// Interrupt lines that are held high, and those that are held low.
    stuck_lines: (u32, u32),
    systick: SysTick,
    vtor: u32,
    scr: u32,

    /// The event register of WFE.
    event: bool,
    sleep: Option<Sleep>,
    /// The last WFI or WFE really put the core to sleep: it did not return at once for something
    /// that was pending.
    slept: bool,
    /// How long it takes to wake.
    wake_up: u64,
    /// SysTick stands still in sleep.
    systick_stops: bool,
    /// The fault in which the core has locked up.
    pub(crate) lockup: Option<Fault>,
    lockup_reported: bool,
    reset_request: Option<ResetCause>,

    /// Time since power-on in parts of a tick, as all of the core's own times.
    now: u64,
    /// Nothing but instructions happens before this time.
    deadline: u64,
    /// Length of a cycle.
    cycle: u64,
    /// Time asleep, held or locked up.
    asleep: u64,
    /// For so long the bus stalls the core from now on.
    stall: u64,
    /// Time stalled.
    stalled: u64,
    forced_wait_states: Option<u8>,
    /// Cycles of a flash access that misses `flash_lines`, beyond the first.
    wait_states: u64,
    /// Which 8 bytes of flash (address / 8) each line of the cache holds.
    flash_lines: [u32; FLASH_LINES],

    /// Its `cycles` are those before the clock was last changed; its `sleep_ticks` and
    /// `stall_ticks` are not used.
    counters: Counters,
    /// `awake` when the clock was last changed.
    cycles_counted_at: u64,
    pub(crate) lowest_sp: u32,
    pub(crate) last_hard_fault: Option<Fault>,
    /// Ring of taken branches, from and to.
    trail: [(u32, u32); TRAIL],
    branches: usize,
    /// What is counted by address; nothing unless it was begun.
    pub(crate) profile: Option<Box<Profile>>,
}

impl Core {
    /// A core at power-on, before it has fetched a vector.
    pub(crate) fn new(options: &Options, cycle: u64) -> Self {
        Self {
            cycle,
            wake_up: parts(options.wake_up),
            systick_stops: options.systick_stops,
            forced_wait_states: options.wait_states,
            flash_lines: [u32::MAX; FLASH_LINES],
            ..Self::default()
        }
    }

    /// Back to the reset state; time, counters and what was noted for diagnosis stay. Registers
    /// keep their values, as the architecture allows.
    pub(crate) fn reset(&mut self) {
        *self = Self {
            r: self.r,
            now: self.now,
            asleep: self.asleep,
            stalled: self.stalled,
            forced_wait_states: self.forced_wait_states,
            counters: self.counters,
            cycles_counted_at: self.cycles_counted_at,
            lowest_sp: self.lowest_sp,
            last_hard_fault: self.last_hard_fault.take(),
            trail: self.trail,
            branches: self.branches,
            wake_up: self.wake_up,
            systick_stops: self.systick_stops,
            stuck_lines: self.stuck_lines,
            profile: self.profile.take(),
            ..Self::new(&Options::default(), self.cycle)
        };
    }

    /// Fetches stack pointer and entry point from `vector_table` and leaves VTOR there.
    pub(crate) fn boot(&mut self, vector_table: u32, memory: &Memory) {
        self.vtor = vector_table & system_control::VTOR_MASK;
        let sp = memory.read_u32(vector_table).unwrap_or(0);
        let entry = memory.read_u32(vector_table.wrapping_add(4)).unwrap_or(0);
        self.r[SP] = sp & !3;
        self.lowest_sp = sp & !3;
        self.r[LR] = u32::MAX;
        self.interwork(entry);
    }

    /// The priority of each exception.
    pub(crate) fn priorities(&self) -> [i8; EXCEPTIONS] {
        self.nvic.priorities
    }

    /// Runs until `until`, or until something stops the chip. The last instruction may end a few
    /// cycles after `until`.
    pub(crate) fn run(&mut self, bus: &mut Bus<'_>, until: Ticks) -> Stop {
        if self.profile.is_some() {
            return self.run_profiled(bus, until);
        }
        self.deadline = 0;
        let until = parts(until);
        loop {
            if self.now >= self.deadline
                && let Some(stop) = self.attend(bus, until)
            {
                return stop;
            }
            if self.burst(bus.memory)
                && let Some(stop) = self.rest(bus)
            {
                return stop;
            }
        }
    }

    /// Executes an instruction that a burst has left out.
    #[inline(always)]
    fn rest(&mut self, bus: &mut Bus<'_>) -> Option<Stop> {
        let pc = self.pc;
        match self.instruction(bus, pc) {
            Ok(cycles) => {
                self.counters.instructions += 1;
                self.elapse(cycles);
                None
            }
            Err(trap) => {
                self.pc = pc;
                self.take_trap(*trap)
            }
        }
    }

    /// Time passes for the peripherals while the core stands still.
    pub(crate) fn hold(&mut self, bus: &mut Bus<'_>, until: Ticks) -> Stop {
        let until = parts(until);
        loop {
            self.catch_up(bus);
            if let Some(cause) = self.reset_request {
                return Stop::Reset(cause);
            }
            if self.now >= until {
                return Stop::Reached;
            }
            self.sleep_until(self.next_event(bus, until));
        }
    }

    /// Handles what is not a plain instruction: events that are due, resets, exceptions, sleep.
    /// Sets the next deadline.
    #[cold]
    #[inline(never)]
    fn attend(&mut self, bus: &mut Bus<'_>, until: u64) -> Option<Stop> {
        loop {
            self.catch_up(bus);
            if let Some(cause) = self.reset_request {
                return Some(Stop::Reset(cause));
            }
            if self.now >= until {
                return Some(Stop::Reached);
            }
            if self.stall > 0 {
                self.stand(self.next_event(bus, until));
                continue;
            }
            if self.lockup.is_some() {
                if !std::mem::replace(&mut self.lockup_reported, true) {
                    return Some(Stop::Lockup);
                }
                self.sleep_until(self.next_event(bus, until));
                continue;
            }
            if self.preempted() {
                if self.wakes_slowly() {
                    continue;
                }
                self.sleep = None;
                self.enter_exception(bus);
                continue;
            }
            if let Some(sleep) = self.sleep {
                if !self.wakes(sleep) {
                    self.slept = true;
                    let began = self.now;
                    self.sleep_until(self.next_event(bus, until));
                    if self.systick_stops {
                        self.systick.pause(self.now - began);
                    }
                    continue;
                }
                self.sleep = None;
                if self.wakes_slowly() {
                    continue;
                }
            }
            if !self.thumb {
                if let Some(stop) = self.take_trap(Trap::Fault(FaultKind::NotThumb)) {
                    return Some(stop);
                }
                continue;
            }
            self.deadline = self.next_event(bus, until);
            return None;
        }
    }

    /// Brings peripherals, SysTick and interrupt lines to the core's time.
    fn catch_up(&mut self, bus: &mut Bus<'_>) {
        bus.advance(self.now());
        let cycle = bus.peripherals.cycle;
        if cycle != self.cycle {
            self.counters = self.counters();
            self.cycles_counted_at = self.awake();
            self.systick.change_cycle(self.now, self.cycle, cycle);
            self.cycle = cycle;
        }
        self.wait_states = u64::from(
            self.forced_wait_states.unwrap_or_else(|| bus.peripherals.nvmctrl.wait_states()),
        );
        if let Some(cause) = bus.peripherals.pending_reset.take() {
            self.reset_request = Some(cause);
        }
        let before = self.nvic.pending;
        let (high, low) = self.stuck_lines;
        self.nvic.sample((bus.peripherals.irq_lines | high) & !low);
        if self.systick.advance(self.now, self.cycle) {
            self.nvic.pend(nvic::SYSTICK);
        }
        self.note_pending(before);
    }

    /// When something next happens by itself, `until` at the latest.
    fn next_event(&self, bus: &Bus<'_>, until: u64) -> u64 {
        until.min(parts(bus.next_event())).min(self.systick.zero_at)
    }

    fn sleep_until(&mut self, at: u64) {
        // A model whose next event is not in the future would stop time.
        let at = at.max(self.now + parts(Ticks(1)));
        self.asleep += at - self.now;
        self.now = at;
    }

    /// Lets the time of a stall pass, until `at` at the latest. No interrupt is taken in it, and a
    /// reset ends it.
    fn stand(&mut self, at: u64) {
        let passed = self.stall.min(at.saturating_sub(self.now).max(1));
        self.stall -= passed;
        self.stalled += passed;
        self.now += passed;
    }

    /// Something wakes the core from its sleep: whether that takes time, which then has passed.
    fn wakes_slowly(&mut self) -> bool {
        let takes_time = std::mem::take(&mut self.slept) && self.wake_up > 0;
        if takes_time {
            self.sleep_until(self.now + self.wake_up);
        }
        takes_time
    }

    /// Whether the sleep ends, with no exception to take.
    fn wakes(&mut self, sleep: Sleep) -> bool {
        match sleep {
            // PRIMASK keeps an exception from being taken, not from waking the core.
            Sleep::ForInterrupt => self
                .nvic
                .first_pending()
                .is_some_and(|(_, priority)| priority < self.nvic.active_priority()),
            Sleep::ForEvent => std::mem::take(&mut self.event),
        }
    }

    #[inline(always)]
    fn elapse(&mut self, cycles: u32) {
        self.now += u64::from(cycles) * self.cycle;
    }

    /// Makes `run` call `attend` before the next instruction.
    #[inline(always)]
    fn ask_attention(&mut self) {
        self.deadline = 0;
    }

    /// Branches to `target`, bit 0 of which must be set.
    fn interwork(&mut self, target: u32) {
        self.pc = target & !1;
        self.thumb = target & 1 != 0;
        if !self.thumb {
            self.ask_attention();
        }
    }

    #[inline(always)]
    fn note_branch(&mut self, from: u32) {
        self.trail[self.branches % TRAIL] = (from, self.pc);
        self.branches = self.branches.wrapping_add(1);
    }

    #[inline(always)]
    fn set_sp(&mut self, value: u32) {
        // Bits 1:0 of both stack pointers do not exist.
        let value = value & !3;
        self.r[SP] = value;
        if value < self.lowest_sp && !self.uses_psp() {
            self.lowest_sp = value;
        }
    }

    #[inline(always)]
    fn uses_psp(&self) -> bool {
        self.spsel && self.ipsr == 0
    }

    /// MSP and PSP.
    fn stack_pointers(&self) -> (u32, u32) {
        if self.uses_psp() { (self.other_sp, self.r[SP]) } else { (self.r[SP], self.other_sp) }
    }

    /// xPSR, without the stack alignment that only a stacked one has.
    fn xpsr(&self) -> u32 {
        self.flags.bits() | u32::from(self.thumb) << 24 | u32::from(self.ipsr)
    }

    pub(crate) fn now(&self) -> Ticks {
        Ticks(self.now >> FRACTION)
    }

    /// Cycles are not counted one by one: they follow from the time spent awake at one clock.
    pub(crate) fn counters(&self) -> Counters {
        let awake = self.awake() - self.cycles_counted_at;
        Counters {
            cycles: self.counters.cycles + awake / self.cycle,
            sleep_ticks: self.asleep >> FRACTION,
            stall_ticks: self.stalled >> FRACTION,
            ..self.counters
        }
    }

    fn awake(&self) -> u64 {
        self.now - self.asleep - self.stalled
    }

    pub(crate) fn is_asleep(&self) -> bool {
        self.sleep.is_some()
    }

    /// Holds an interrupt line at a level, or lets go of it.
    pub(crate) fn stick_line(&mut self, line: u8, level: Option<bool>) {
        let mask = 1_u32.checked_shl(line.into()).unwrap_or(0);
        let (high, low) = &mut self.stuck_lines;
        *high = *high & !mask | if level == Some(true) { mask } else { 0 };
        *low = *low & !mask | if level == Some(false) { mask } else { 0 };
        self.ask_attention();
    }

    /// See [`Chip::flip_register`](crate::Chip::flip_register).
    pub(crate) fn flip_register(&mut self, address: u32, bit: u8) -> bool {
        use crate::upset::core_registers::{NVIC_IPR, NVIC_ISER, SYST_CSR, SYST_RVR};
        let mask = 1_u32.checked_shl(bit.into()).unwrap_or(0);
        match address {
            SYST_CSR if bit < 2 => {
                self.systick.write_control(self.systick.control ^ mask, self.now, self.cycle);
            }
            SYST_RVR if bit < 24 => {
                self.systick.set_reload(self.systick.reload ^ mask);
            }
            NVIC_ISER => self.nvic.enabled ^= nvic::exceptions(mask),
            NVIC_IPR..0xE000_E420 if address.is_multiple_of(4) && bit % 8 >= 6 => {
                let first = nvic::IRQ0 + (address - NVIC_IPR) as u8;
                self.nvic.set_priority_word(first, self.nvic.priority_word(first) ^ mask);
            }
            _ => return false,
        }
        self.ask_attention();
        true
    }

    /// Taken branches, oldest first.
    pub(crate) fn trail(&self) -> impl Iterator<Item = (u32, u32)> {
        let kept = self.branches.min(TRAIL);
        (self.branches - kept..self.branches).map(|i| self.trail[i % TRAIL])
    }

    pub(crate) fn registers(&self) -> Registers {
        let (msp, psp) = self.stack_pointers();
        let mut r = [0; 16];
        r[..PC].copy_from_slice(&self.r[..PC]);
        r[PC] = self.pc;
        Registers { r, xpsr: self.xpsr(), primask: self.primask, spsel: self.spsel, msp, psp }
    }

    /// Sets what a debugger may set: R0 to R12, LR, PC, flags, PRIMASK, CONTROL.SPSEL in Thread
    /// mode, MSP and PSP (`r[13]` is not looked at).
    pub(crate) fn set_registers(&mut self, registers: &Registers) {
        self.r[..PC].copy_from_slice(&registers.r[..PC]);
        self.pc = registers.r[PC] & !1;
        self.flags = Flags::of(registers.xpsr);
        self.thumb = true;
        self.primask = registers.primask;
        if self.ipsr == 0 {
            self.spsel = registers.spsel;
        }
        (self.r[SP], self.other_sp) = if self.uses_psp() {
            (registers.psp & !3, registers.msp & !3)
        } else {
            (registers.msp & !3, registers.psp & !3)
        };
    }
}
