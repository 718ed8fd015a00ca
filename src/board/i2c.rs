//! The sensor bus: an I2C master on a SERCOM that is driven by its interrupt and cannot hang.
//!
//! A transfer is a write to a register, or a write of its number, a repeated start and a read. Once started it runs in
//! the SERCOM's interrupt, one byte at a time, and the main loop collects its outcome with [`Bus::poll`]. Each transfer
//! has a deadline. Whatever fails ends with a STOP, where the master still owns the bus, or with the peripheral reset
//! and the lines looked at; only a data line that a slave holds low is clocked free ([`recovery`]).
//!
//! ```text
//!         address+W acknowledged      register acknowledged, read          byte 1..n-1: acknowledge
//!  start ──────────────────────▶ Register ─────────────────────▶ Reading ──┐ byte n: refuse, STOP ▶ done
//!                                   │  register acknowledged, write        └─┘
//!                                   └─────────────────────▶ Writing ── all acknowledged: STOP ▶ done
//! ```
//!
//! What the data sheet's chapter 28 asks for and drivers have tripped over: BUSSTATE must be forced to idle after enabling;
//! every command waits for SYNCBUSY.SYSOP; a refused address of a read shows as MB, not SB; flags are cleared by writing
//! ones to them; a START while the STOP before is still on the wire would be a repeated start; BAUD counts from 10 cycles
//! and the lines' rise time, and holds one byte. Time-outs of the hardware are left off: the BNO055 stretches the clock
//! for longer than they allow.

use core::cell::RefCell;
use core::ops::Deref;

use atsamd_hal::pac;
use bno055_driver::{BusError, Micros, READ_MAX, TRANSFER_DEADLINE_US, Transfer};
use critical_section::Mutex;

use super::nano33iot::{I2C_FUNCTION, SCL, SDA, i2c_registers};
use super::recovery;
use super::time::{now, soon};

/// BUSSTATE of an idle bus.
const IDLE: u8 = 1;
/// CTRLB.CMD: go on with the next byte; end with a STOP.
const CONTINUE: u8 = 2;
/// See [`CONTINUE`].
const STOP: u8 = 3;
/// MODE of CTRLA for an I2C master.
const MASTER_MODE: u8 = 5;
/// SDA holds for 300 to 600 ns after SCL falls, as slaves of either speed can rely on.
const SDA_HOLD: u8 = 2;

/// A bus that could not be repaired is tried again after this long.
const REPAIR_PERIOD_US: u64 = 10_000;

/// Clock cycles of SCL's high and low phase, as BAUD takes them.
///
/// `f_scl = f_gclk / (10 + BAUD + BAUDLOW + f_gclk t_rise)` (data sheet 28.6.2.4); each phase lasts its own value and
/// 5 cycles.
#[derive(Clone, Copy)]
struct Baud {
    high: u8,
    low: u8,
}

/// SCL's period is 120 or 480 cycles of 48 MHz. Fast mode asks for 1.3 us low and 0.6 us high, so low is longer there.
/// Rise times: 100 ns on a short bus, 300 ns on a long cable, which is what the slow speed is for.
const fn baud(khz: u32) -> Baud {
    let (rise_ns, low_share_percent) = if khz > 100 { (100, 59) } else { (300, 50) };
    let counted = 48_000 / khz - 10 - rise_ns * 48 / 1_000;
    let low = counted * low_share_percent / 100;
    Baud {
        high: (counted - low) as u8,
        low: low as u8,
    }
}

const _: () = {
    let fast = baud(400);
    // 10 + 106 cycles and 4.8 of rise: 397 kHz, and 414 kHz with no rise at all; low 67 cycles = 1.4 us.
    assert!(fast.low == 62 && fast.high == 44);
    let slow = baud(100);
    assert!(slow.low == 228 && slow.high == 228);
};

/// What a read gave.
#[derive(Clone, Copy)]
pub(super) struct Answer {
    bytes: [u8; READ_MAX],
    len: usize,
}

impl Deref for Answer {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.bytes[..self.len.min(READ_MAX)]
    }
}

/// Who started a transfer.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// The tick's interrupt.
    Tick,
    /// The main loop.
    Loop,
}

/// A transfer that is over.
pub(super) struct Completion {
    pub(super) origin: Origin,
    pub(super) started: Micros,
    pub(super) outcome: Result<Answer, BusError>,
}

#[derive(Clone, Copy)]
enum Step {
    /// The address is on its way; the register's number is next.
    Address,
    /// The register's number is on its way.
    Register,
    /// So many payload bytes are on their way or acknowledged.
    Writing(usize),
    /// The repeated start or a byte is on its way; so many have come.
    Reading(usize),
    /// Over; the main loop has not collected it.
    Done(Result<(), BusError>),
}

#[derive(Clone, Copy)]
struct Active {
    transfer: Transfer,
    origin: Origin,
    started: Micros,
    step: Step,
}

/// What interrupt and main loop share.
struct Master {
    /// The slave's address, shifted as it goes on the wire.
    address: u8,
    /// What the next tick starts.
    armed: Option<Transfer>,
    active: Option<Active>,
    received: [u8; READ_MAX],
    /// The peripheral must be set up anew before it is used again.
    broken: bool,
}

static MASTER: Mutex<RefCell<Master>> = Mutex::new(RefCell::new(Master {
    address: 0,
    armed: None,
    active: None,
    received: [0; READ_MAX],
    broken: true,
}));

impl Master {
    /// Start a transfer. One that cannot start is over at once.
    fn start(&mut self, transfer: Transfer, origin: Origin, started: Micros) {
        let mut active = Active {
            transfer,
            origin,
            started,
            step: Step::Address,
        };
        let registers = i2c_registers();
        // The STOP of the transfer before may still be on the wire.
        let idle = || registers.status().read().busstate().bits() == IDLE;
        if self.broken || !soon(idle) || !write_address(self.address) {
            self.broken = true;
            active.step = Step::Done(Err(BusError::Stuck));
        } else {
            registers
                .intenset()
                .write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
        }
        self.active = Some(active);
    }

    /// The interrupt: the wire has done what it was told.
    fn advance(&mut self) {
        let registers = i2c_registers();
        let flags = registers.intflag().read();
        let status = registers.status().read();
        let Some(active) = &mut self.active else {
            return silence();
        };
        if flags.bits() == 0 || matches!(active.step, Step::Done(_)) {
            // Pending since before the transfer was aborted.
            return;
        }
        active.step = if flags.error().bit_is_set() || status.buserr().bit_is_set() {
            self.broken = true;
            Step::Done(Err(BusError::Protocol))
        } else if status.arblost().bit_is_set() {
            self.broken = true;
            Step::Done(Err(BusError::Arbitration))
        } else if flags.mb().bit_is_set() && status.rxnack().bit_is_set() {
            self.broken |= !command(STOP, false);
            Step::Done(Err(BusError::Nak))
        } else {
            match proceed(active, self.address, &mut self.received, &flags) {
                Ok(step) => step,
                Err(NotSynchronised) => {
                    self.broken = true;
                    Step::Done(Err(BusError::Protocol))
                }
            }
        };
        if matches!(active.step, Step::Done(_)) {
            silence();
        }
    }
}

/// SYSOP stayed set.
struct NotSynchronised;

/// The next step of a transfer whose last one was acknowledged.
fn proceed(
    active: &Active,
    address: u8,
    received: &mut [u8; READ_MAX],
    flags: &pac::sercom0::i2cm::intflag::R,
) -> Result<Step, NotSynchronised> {
    let done = |synchronised| {
        if synchronised {
            Ok(())
        } else {
            Err(NotSynchronised)
        }
    };
    match (active.step, &active.transfer) {
        (Step::Address, Transfer::Read { register, .. } | Transfer::Write { register, .. }) => {
            done(write_data(*register))?;
            Ok(Step::Register)
        }
        (Step::Register, Transfer::Read { .. }) => {
            done(write_address(address | 1))?;
            Ok(Step::Reading(0))
        }
        (Step::Register, Transfer::Write { bytes, .. }) => send(bytes, 0),
        (Step::Writing(sent), Transfer::Write { bytes, .. }) => send(bytes, sent),
        (Step::Reading(count), Transfer::Read { len, .. }) if flags.sb().bit_is_set() => {
            let byte = i2c_registers().data().read().data().bits();
            if let Some(place) = received.get_mut(count) {
                *place = byte;
            }
            let last = count + 1 >= usize::from(*len).min(READ_MAX);
            // Acknowledging asks the slave for another byte; the last one is refused and followed by the STOP.
            done(if last {
                command(STOP, false)
            } else {
                command(CONTINUE, true)
            })?;
            Ok(if last {
                Step::Done(Ok(()))
            } else {
                Step::Reading(count + 1)
            })
        }
        // A flag that no step waits for.
        _ => Err(NotSynchronised),
    }
}

fn send(bytes: &[u8], sent: usize) -> Result<Step, NotSynchronised> {
    let (step, synchronised) = match bytes.get(sent) {
        Some(byte) => (Step::Writing(sent + 1), write_data(*byte)),
        None => (Step::Done(Ok(())), command(STOP, false)),
    };
    if synchronised {
        Ok(step)
    } else {
        Err(NotSynchronised)
    }
}

/// The main loop's end of the bus.
pub(super) struct Bus {
    khz: u32,
    /// When a broken bus is looked at next.
    repair_at: Micros,
    /// Times that the peripheral was set up anew since start-up.
    recoveries: u16,
}

impl Bus {
    /// Bring the bus up, clocking a slave off its data line first where a reset of this chip left it in mid-byte.
    pub(super) fn start(address: u8, khz: u32) -> Self {
        critical_section::with(|cs| MASTER.borrow_ref_mut(cs).address = address << 1);
        let mut bus = Self {
            khz,
            repair_at: Micros(0),
            recoveries: 0,
        };
        bus.repair();
        bus
    }

    /// Change the speed. A transfer under way is lost.
    pub(super) fn set_speed(&mut self, khz: u32) {
        if self.khz != khz {
            self.khz = khz;
            self.abort(BusError::Protocol);
            self.repair();
        }
    }

    /// Have the next tick start `transfer`; `None` has it start nothing.
    pub(super) fn arm(&mut self, transfer: Option<Transfer>) {
        critical_section::with(|cs| MASTER.borrow_ref_mut(cs).armed = transfer);
    }

    /// Start `transfer` now. The bus must be free.
    pub(super) fn begin(&mut self, transfer: Transfer) {
        let started = now();
        critical_section::with(|cs| {
            let mut master = MASTER.borrow_ref_mut(cs);
            if master.active.is_none() {
                master.start(transfer, Origin::Loop, started);
            }
        });
    }

    /// Times that the bus had to be repaired since start-up, without success too.
    pub(super) fn recoveries(&self) -> u16 {
        self.recoveries
    }

    /// Whether no transfer is under way or waits to be collected.
    pub(super) fn is_free(&self) -> bool {
        critical_section::with(|cs| MASTER.borrow_ref(cs).active.is_none())
    }

    /// The transfer that is over, once; ends one that has passed its deadline, and repairs the bus.
    pub(super) fn poll(&mut self, now: Micros) -> Option<Completion> {
        let late = critical_section::with(|cs| {
            MASTER.borrow_ref(cs).active.is_some_and(|active| {
                !matches!(active.step, Step::Done(_))
                    && now.since(active.started) > TRANSFER_DEADLINE_US
            })
        });
        if late {
            let lines_free = SDA.is_high() && SCL.is_high();
            self.abort(if lines_free {
                BusError::Timeout
            } else {
                BusError::Stuck
            });
        }
        let completion = collect();
        if now >= self.repair_at && critical_section::with(|cs| MASTER.borrow_ref(cs).broken) {
            self.recoveries = self.recoveries.saturating_add(1);
            self.repair();
        }
        completion
    }

    /// End what is under way. The peripheral is useless until it is repaired.
    fn abort(&mut self, error: BusError) {
        critical_section::with(|cs| {
            let mut master = MASTER.borrow_ref_mut(cs);
            silence();
            master.broken = true;
            if let Some(active) = &mut master.active
                && !matches!(active.step, Step::Done(_))
            {
                active.step = Step::Done(Err(error));
            }
        });
    }

    /// Reset the peripheral, free the lines, set it up anew. Nothing touches it meanwhile: it is marked broken.
    fn repair(&mut self) {
        critical_section::with(|cs| MASTER.borrow_ref_mut(cs).broken = true);
        self.repair_at = now().after(REPAIR_PERIOD_US);
        let registers = i2c_registers();
        registers.ctrla().write(|w| w.swrst().set_bit());
        let reset = soon(|| registers.syncbusy().read().swrst().bit_is_clear());
        if !reset || !recovery::free(SDA, SCL) {
            return;
        }
        SDA.connect(I2C_FUNCTION);
        SCL.connect(I2C_FUNCTION);
        if set_up(registers, baud(self.khz)) {
            critical_section::with(|cs| MASTER.borrow_ref_mut(cs).broken = false);
        }
    }
}

/// Start the armed transfer, from the tick's interrupt, unless the bus is busy.
pub(super) fn start_burst(time: Micros) {
    critical_section::with(|cs| {
        let mut master = MASTER.borrow_ref_mut(cs);
        if master.active.is_none()
            && let Some(transfer) = master.armed.take()
        {
            master.start(transfer, Origin::Tick, time);
        }
    });
}

/// Whether a transfer waits to be collected.
pub(super) fn outcome_waits(cs: critical_section::CriticalSection) -> bool {
    MASTER
        .borrow_ref(cs)
        .active
        .is_some_and(|active| matches!(active.step, Step::Done(_)))
}

/// The SERCOM's interrupt.
pub(super) fn interrupt() {
    critical_section::with(|cs| MASTER.borrow_ref_mut(cs).advance());
}

fn collect() -> Option<Completion> {
    critical_section::with(|cs| {
        let mut master = MASTER.borrow_ref_mut(cs);
        let active = master.active?;
        let Step::Done(outcome) = active.step else {
            return None;
        };
        master.active = None;
        let answer = Answer {
            bytes: master.received,
            len: active.transfer.answer_len(),
        };
        Some(Completion {
            origin: active.origin,
            started: active.started,
            outcome: outcome.map(|()| answer),
        })
    })
}

fn set_up(registers: &pac::sercom0::I2cm, baud: Baud) -> bool {
    let synchronised = || registers.syncbusy().read().bits() == 0;
    // SAFETY: field values of this mode, from the data sheet.
    unsafe {
        registers
            .ctrla()
            .write(|w| w.mode().bits(MASTER_MODE).sdahold().bits(SDA_HOLD));
        registers
            .baud()
            .write(|w| w.baud().bits(baud.high).baudlow().bits(baud.low));
        registers.ctrla().write(|w| {
            w.mode()
                .bits(MASTER_MODE)
                .sdahold()
                .bits(SDA_HOLD)
                .enable()
                .set_bit()
        });
        if !soon(synchronised) {
            return false;
        }
        registers.status().write(|w| w.busstate().bits(IDLE));
    }
    soon(synchronised) && soon(|| registers.status().read().busstate().bits() == IDLE)
}

/// START or repeated START and the address.
fn write_address(address: u8) -> bool {
    let registers = i2c_registers();
    let ready = soon(system_idle);
    if ready {
        // SAFETY: an eight-bit address in an eleven-bit field.
        registers
            .addr()
            .write(|w| unsafe { w.addr().bits(u16::from(address)) });
    }
    ready
}

fn write_data(byte: u8) -> bool {
    let ready = soon(system_idle);
    if ready {
        // SAFETY: any byte is valid.
        i2c_registers()
            .data()
            .write(|w| unsafe { w.data().bits(byte) });
    }
    ready
}

/// Acknowledge or refuse, and continue or stop.
fn command(command: u8, acknowledge: bool) -> bool {
    let ready = soon(system_idle);
    if ready {
        // SAFETY: a command of two bits.
        i2c_registers()
            .ctrlb()
            .write(|w| unsafe { w.ackact().bit(!acknowledge).cmd().bits(command) });
    }
    ready
}

fn system_idle() -> bool {
    i2c_registers().syncbusy().read().sysop().bit_is_clear()
}

fn silence() {
    i2c_registers()
        .intenclr()
        .write(|w| w.mb().set_bit().sb().set_bit().error().set_bit());
}
