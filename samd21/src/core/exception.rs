//! Exception entry and return, HardFault and lockup (ARM DDI 0419, B1.5).
//!
//! Cycle counts: entry 15 (DDI 0484), return 13 in place of the 2 of the branch. The tail-chaining
//! cost is not published for this core; 7 is the entry without its 8 stores.
//!
//! Simplified: a fault while unstacking is taken at the return instruction, and one that ARM calls
//! unpredictable (an EXC_RETURN that fits neither nesting nor stacked xPSR) raises HardFault.

use super::flags::Flags;
use super::nvic::{HARD_FAULT, SVCALL};
use super::system_control::SCR_SLEEPONEXIT;
use super::view::Stop;
use super::{Core, LR, Outcome, SP, Sleep, Trap};
use crate::bus::Bus;
use crate::fault::{Fault, FaultKind};

const ENTRY_CYCLES: u32 = 15;
const TAIL_CHAIN_CYCLES: u32 = 7;
/// Beyond the branch's own 2.
pub(super) const RETURN_CYCLES: u32 = 13 - 2;

const FRAME_BYTES: u32 = 32;
const XPSR_ALIGNED: u32 = 1 << 9;
const XPSR_THUMB: u32 = 1 << 24;
const XPSR_IPSR: u32 = 0x3F;

const RETURN_TO_HANDLER: u32 = 0xFFFF_FFF1;
const RETURN_TO_THREAD_MSP: u32 = 0xFFFF_FFF9;
const RETURN_TO_THREAD_PSP: u32 = 0xFFFF_FFFD;

impl Core {
    /// Whether a pending exception interrupts what runs now.
    pub(super) fn preempted(&self) -> bool {
        self.nvic.first_pending().is_some_and(|(_, priority)| priority < self.execution_priority())
    }

    fn execution_priority(&self) -> i8 {
        let priority = self.nvic.active_priority();
        if self.primask { priority.min(0) } else { priority }
    }

    /// Stacks the registers, then starts the handler of the exception that has the highest priority
    /// when that is done.
    pub(super) fn enter_exception(&mut self, bus: &mut Bus<'_>) {
        let return_value = match (self.ipsr, self.spsel) {
            (0, false) => RETURN_TO_THREAD_MSP,
            (0, true) => RETURN_TO_THREAD_PSP,
            _ => RETURN_TO_HANDLER,
        };
        if let Err(kind) = self.stack(bus) {
            if self.nvic.is_pending(HARD_FAULT) {
                return self.lock_up(kind);
            }
            self.pend_hard_fault(kind);
        }
        self.elapse(ENTRY_CYCLES);
        self.start_handler(bus, return_value);
    }

    fn stack(&mut self, bus: &mut Bus<'_>) -> Result<(), FaultKind> {
        let sp = self.r[SP];
        let aligned = if sp & 4 != 0 { XPSR_ALIGNED } else { 0 };
        let frame = sp.wrapping_sub(FRAME_BYTES) & !7;
        self.set_sp(frame);
        let [r0, r1, r2, r3, ..] = self.r;
        let words = [r0, r1, r2, r3, self.r[12], self.r[LR], self.pc, self.xpsr() | aligned];
        for (address, word) in (frame..).step_by(4).zip(words) {
            self.store::<4>(bus, address, word).map_err(|trap| kind(*trap))?;
        }
        Ok(())
    }

    fn start_handler(&mut self, bus: &mut Bus<'_>, return_value: u32) {
        // What arrived while the registers were stacked and has a higher priority goes first.
        self.catch_up(bus);
        let Some((exception, _)) = self.nvic.first_pending() else {
            return;
        };
        self.nvic.activate(exception);
        self.counters.exceptions += 1;
        if self.uses_psp() {
            std::mem::swap(&mut self.r[SP], &mut self.other_sp);
        }
        self.spsel = false;
        self.ipsr = exception;
        self.event = true;
        self.r[LR] = return_value;
        let from = self.pc;
        match self.load::<4>(bus, self.vtor.wrapping_add(4 * u32::from(exception))) {
            Ok(vector) => {
                self.interwork(vector);
                self.note_branch(from);
            }
            Err(trap) => {
                // HardFault's own vector lies in the same table.
                self.lock_up(kind(*trap));
            }
        }
        self.ask_attention();
    }

    /// Leaves the handler by EXC_RETURN `value`, for another one that waits or for the code that
    /// was interrupted.
    pub(super) fn exception_return(&mut self, bus: &mut Bus<'_>, value: u32) -> Outcome<()> {
        let misfit = Trap::Fault(FaultKind::ExceptionReturn { value });
        let nested = self.nvic.nesting() > 1;
        let (to_thread, psp) = match value {
            RETURN_TO_HANDLER if nested => (false, false),
            RETURN_TO_THREAD_MSP if !nested => (true, false),
            RETURN_TO_THREAD_PSP if !nested => (true, true),
            _ => return Err(misfit.into()),
        };
        let frame = if psp { self.other_sp } else { self.r[SP] };
        let words = self.frame(bus, frame)?;
        if (words[7] & XPSR_IPSR == 0) != to_thread {
            return Err(misfit.into());
        }
        self.nvic.deactivate(self.ipsr);
        self.catch_up(bus);
        self.ask_attention();
        if self.preempted() {
            // The frame stays for the next handler's return.
            self.elapse(TAIL_CHAIN_CYCLES);
            self.start_handler(bus, value);
            return Ok(());
        }
        let [r0, r1, r2, r3, r12, lr, pc, xpsr] = words;
        if psp {
            self.other_sp = self.r[SP];
        }
        self.spsel = psp;
        self.ipsr = (xpsr & XPSR_IPSR) as u8;
        self.r[..4].copy_from_slice(&[r0, r1, r2, r3]);
        self.r[12] = r12;
        self.r[LR] = lr;
        self.pc = pc & !1;
        self.thumb = xpsr & XPSR_THUMB != 0;
        self.flags = Flags::of(xpsr);
        let padding = if xpsr & XPSR_ALIGNED != 0 { 4 } else { 0 };
        self.set_sp(frame.wrapping_add(FRAME_BYTES) | padding);
        self.event = true;
        if to_thread && self.scr & SCR_SLEEPONEXIT != 0 {
            self.sleep = Some(Sleep::ForInterrupt);
        }
        Ok(())
    }

    fn frame(&mut self, bus: &mut Bus<'_>, frame: u32) -> Outcome<[u32; 8]> {
        let mut words = [0; 8];
        for (address, word) in (frame..).step_by(4).zip(&mut words) {
            *word = self.load::<4>(bus, address)?;
        }
        Ok(words)
    }

    /// Handles an instruction that did not complete; `pc` is its address.
    pub(super) fn take_trap(&mut self, trap: Trap) -> Option<Stop> {
        self.ask_attention();
        match trap {
            Trap::Breakpoint => return Some(Stop::Breakpoint),
            Trap::Unmodelled(kind) => return Some(Stop::Fault(Fault { pc: self.pc, kind })),
            Trap::Fault(kind) => self.raise_hard_fault(kind),
            Trap::SupervisorCall => {
                if self.nvic.priority(SVCALL) < self.execution_priority() {
                    self.counters.instructions += 1;
                    self.pc = self.pc.wrapping_add(2);
                    self.nvic.pend(SVCALL);
                } else {
                    self.raise_hard_fault(FaultKind::SupervisorCall);
                }
            }
        }
        None
    }

    fn raise_hard_fault(&mut self, kind: FaultKind) {
        if self.nvic.active_priority() < 0 {
            self.lock_up(kind);
        } else {
            self.pend_hard_fault(kind);
        }
    }

    fn pend_hard_fault(&mut self, kind: FaultKind) {
        self.nvic.pend(HARD_FAULT);
        self.counters.hard_faults += 1;
        self.last_hard_fault = Some(Fault { pc: self.pc, kind });
    }

    /// A fault that cannot be taken: the core stands still until it is reset.
    fn lock_up(&mut self, kind: FaultKind) {
        self.lockup = Some(Fault { pc: self.pc, kind });
        self.lockup_reported = false;
        self.ask_attention();
    }
}

/// The fault of an access for stacking, unstacking or a vector.
fn kind(trap: Trap) -> FaultKind {
    match trap {
        Trap::Fault(kind) | Trap::Unmodelled(kind) => kind,
        Trap::SupervisorCall | Trap::Breakpoint => unreachable!("only accesses are made here"),
    }
}
