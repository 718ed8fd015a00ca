//! The sensor bus on a SERCOM: what [`tvc_nano::bus`] leaves to the chip. The interrupt takes a
//! transfer's steps, the main loop looks after its deadline, and only a data line that a slave
//! holds low is clocked free ([`recovery`]).
//!
//! What the data sheet's chapter 28 asks for, and drivers have missed:
//!
//! - BUSSTATE must be forced to idle after enabling, and every command waits for the one before.
//! - A refused address of a read shows as MB, not SB. Flags are cleared by writing ones to them.
//! - A START while the STOP before is still on the wire would be a repeated start.
//! - BAUD counts from 10 cycles and the lines' rise time, and holds one byte.
//!
//! Time-outs of the hardware are left off: the BNO055 stretches the clock for longer than they
//! allow.

mod recovery;
mod sercom;

use core::cell::RefCell;

use tvc_imu::{Bursts, BusError, Micros, Transfer};
use tvc_nano::SelfCheck;
use tvc_nano::application;
use tvc_nano::bus::{Answer, Completion, Master};

use super::interrupts::{Shared, TicksHeld, hold_ticks};
use super::time::{now, within};
use super::{crash, log, wake};
use crate::boards::WIRING;
use sercom::Sercom;
pub(crate) use sercom::{BUS_CLOCK, CLOCK_ID, INTERRUPT};

/// A bus that could not be repaired is tried again after this long: often enough that a glitch of
/// 40 ms ends before the data are too old, and seldom enough for the half millisecond that it
/// takes.
const REPAIR_PERIOD_US: u64 = 4_000;
/// A step that is due before this is taken first: longer than a repair, for which the main loop
/// waits.
const REPAIR_US: u64 = 1_200;

/// How long a STOP may take to go out. The BNO055 holds the clock after the last byte of a read as
/// it does after every other, for some 180 us.
const STOP_LIMIT_US: u64 = 2_000;
/// How long a step waits for it at most.
const STOP_HURRIED_US: u64 = 550;

static MASTER: Shared<RefCell<Master<Sercom>>> = Shared::new(RefCell::new(Master::new(Sercom)));

/// Access the state that the main loop shares with the interrupts.
fn with_master<R>(action: impl FnOnce(&mut Master<Sercom>) -> R) -> R {
    hold_ticks(|held| with_master_held(held, action))
}

/// The same for who holds the interrupts off already.
fn with_master_held<R>(held: TicksHeld<'_>, action: impl FnOnce(&mut Master<Sercom>) -> R) -> R {
    match MASTER.borrow(held).try_borrow_mut() {
        Ok(mut master) => action(&mut master),
        // An action that asks for the master again; there is none.
        Err(_) => crash::stop(SelfCheck::TakenTwice),
    }
}

/// The main loop is told of a transfer that is over.
fn wake_if(is_over: bool) {
    if is_over {
        wake::request();
    }
}

/// The bus as the main loop uses it.
pub(crate) struct Bus {
    khz: u32,
    /// Ticks start reads.
    sampling: bool,
    /// What the transfer that was collected last has read.
    answer: Answer,
    /// When a bus without a transfer must be idle at last; `None` while it is, or has a transfer.
    idle_by: Option<Micros>,
    /// How long the STOP of a read takes, us: the longest of the newest that were waited for.
    stop_us: u32,
    /// When a broken bus is looked at next.
    repair_at: Micros,
    /// Times that the peripheral was set up anew since start-up.
    recoveries: u16,
}

impl Bus {
    /// Bring the bus up, clocking a slave off its data line first where a reset of this chip left
    /// it in mid-byte.
    pub(crate) fn start(khz: u32) -> Self {
        let mut bus = Self {
            khz,
            sampling: false,
            answer: Answer::NONE,
            idle_by: None,
            stop_us: 0,
            repair_at: Micros(0),
            recoveries: 0,
        };
        bus.repair();
        bus
    }

    /// Change the speed, once no transfer is under way.
    pub(crate) fn set_speed_when_free(&mut self, khz: u32) {
        if self.khz != khz && self.state() != application::Bus::Busy {
            self.khz = khz;
            self.repair();
        }
    }

    /// Have the next tick start one of these.
    pub(crate) fn arm(&mut self, bursts: &Bursts) {
        self.sampling = bursts.whole.is_some();
        with_master(|master| master.arm(bursts));
    }

    /// Whether ticks start reads.
    pub(crate) fn is_sampling(&self) -> bool {
        self.sampling
    }

    /// Start `transfer` to a 7-bit address now. The bus must be free.
    pub(crate) fn begin(&mut self, address: u8, transfer: &Transfer) {
        let started = now();
        wake_if(with_master(|master| master.begin(address, transfer, started)));
    }

    /// Times that the bus had to be repaired since start-up, without success too.
    pub(crate) fn recoveries(&self) -> u16 {
        self.recoveries
    }

    /// What it is doing.
    pub(crate) fn state(&self) -> application::Bus {
        with_master(|master| master.state())
    }

    /// What the transfer that was collected last has read.
    pub(crate) fn answer(&self) -> &[u8] {
        self.answer.bytes()
    }

    /// The transfer that is over, once; ends one that has reached its deadline, and repairs the bus
    /// where no step is `due` meanwhile.
    pub(crate) fn poll(&mut self, now: Micros, due: Option<Micros>) -> Option<Completion> {
        let Self { answer, idle_by, .. } = self;
        let (completion, is_broken) = with_master(|master| {
            if master.is_well(now) {
                *idle_by = None;
                return (None, false);
            }
            if master.is_late(now) {
                let lines_free = WIRING.bus.sda.is_high() && WIRING.bus.scl.is_high();
                master.abort(if lines_free { BusError::Timeout } else { BusError::Stuck });
            }
            let completion = master.collect(answer);
            if completion.is_some() || !master.awaits_stop() {
                *idle_by = None;
            }
            if master.awaits_stop() && now >= *idle_by.get_or_insert(now.after(STOP_LIMIT_US)) {
                master.set_broken(true);
            }
            (completion, master.is_broken())
        });
        let has_time = due.is_none_or(|due| due.since(now) >= REPAIR_US);
        if is_broken && has_time && now >= self.repair_at {
            self.recoveries = self.recoveries.saturating_add(1);
            log::bus_repaired(self.recoveries);
            self.repair();
        }
        completion
    }

    /// How long a STOP takes, us.
    pub(crate) fn stop_us(&self) -> u32 {
        self.stop_us
    }

    /// The slave's 7-bit address in the upper 8 bits, and how long a STOP takes, us.
    pub(crate) fn summary(&self) -> u32 {
        let address = with_master(|master| master.address());
        u32::from(address) << 24 | self.stop_us
    }

    /// Wait for the STOP of a transfer that is over, and so learn how long the sensor holds it up
    /// after a read; after a write it may go out at once. Where the sensor is sampled there is less
    /// time for that, and none beyond the moment at which a step is `due`.
    pub(crate) fn await_stop(&mut self, over: &Completion, due: Option<Micros>) {
        let limit_us = match due {
            _ if !self.sampling => STOP_LIMIT_US,
            Some(due) => due.since(now()).min(STOP_HURRIED_US),
            None => STOP_HURRIED_US,
        };
        let is_awaited = || with_master(|master| master.awaits_stop());
        // Where it has gone out already, its length is not known.
        if is_awaited() {
            let _ = within(limit_us, || !is_awaited());
            if !self.answer().is_empty() {
                let ended = over.outcome.started.after(over.took_us.into());
                let us = now().since(ended) as u32;
                self.stop_us = us.max(self.stop_us - self.stop_us / 8);
            }
        }
    }

    fn connect(&self) {
        WIRING.bus.sda.connect(WIRING.bus.function);
        WIRING.bus.scl.connect(WIRING.bus.function);
    }

    /// Reset the peripheral, free the lines, set it up anew. Nothing touches it meanwhile: it is
    /// marked broken.
    fn repair(&mut self) {
        with_master(|master| master.set_broken(true));
        self.repair_at = now().after(REPAIR_PERIOD_US);
        let is_free = sercom::reset().is_ok() && recovery::free(WIRING.bus.sda, WIRING.bus.scl);
        // A held bus, too, leaves the lines to the peripheral, where the check of registers expects
        // them.
        self.connect();
        let ready = is_free && sercom::set_up(self.khz).is_ok();
        with_master(|master| master.set_broken(!ready));
    }
}

/// A tick has come: start its burst.
pub(crate) fn start_burst(held: TicksHeld<'_>, time: Micros, rates_only: bool) {
    wake_if(with_master_held(held, |master| master.start_burst(time, rates_only)));
}

/// The wire has done what it was told; for the handler of the interrupt of the board's SERCOM.
pub(crate) fn wire_ready() {
    // SAFETY: this is the bus's interrupt.
    let held = unsafe { TicksHeld::new() };
    wake_if(with_master_held(held, |master| master.advance(now)));
}

/// Makes [`wire_ready`] the handler of the interrupt of this name, which must be that of the
/// board's SERCOM.
macro_rules! bus_interrupt {
    ($name:ident) => {
        const _: () = {
            use atsamd_hal::pac::{self, interrupt};

            assert!(pac::Interrupt::$name as u16 == crate::samd21::i2c::INTERRUPT);

            #[interrupt]
            fn $name() {
                crate::samd21::i2c::wire_ready();
            }
        };
    };
}

pub(crate) use bus_interrupt;
