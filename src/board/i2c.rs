//! The sensor bus: an I2C master on a SERCOM that is driven by its interrupt and cannot hang.
//!
//! A transfer is a write to a register, or a write of its number, a repeated start and a read. Once
//! started it runs in the SERCOM's interrupt, one byte at a time, and the main loop collects its
//! outcome with [`Bus::poll`]. Each transfer has a deadline. Whatever fails ends with a STOP, where
//! the master still owns the bus, or with the peripheral reset and the lines looked at; only a data
//! line that a slave holds low is clocked free ([`recovery`]).
//!
//! ```text
//!      address+W acknowledged      register acknowledged, read    byte 1..n-1: acknowledge
//! start ─────────────────▶ Register ───────────────────▶ Reading ─┐ byte n: refuse, STOP ▶ done
//!                             │  register acknowledged, write     └┘
//!                             └─────────────▶ Writing ── all acknowledged: STOP ▶ done
//! ```
//!
//! What the data sheet's chapter 28 asks for and drivers have tripped over: BUSSTATE must be forced
//! to idle after enabling; every command waits for the one before; a refused address of a read
//! shows as MB, not SB; flags are cleared by writing ones to them; a START while the STOP before is
//! still on the wire would be a repeated start; BAUD counts from 10 cycles and the lines' rise
//! time, and holds one byte. Time-outs of the hardware are left off: the BNO055 stretches the clock
//! for longer than they allow.

mod recovery;
mod sercom;

use core::cell::RefCell;

use critical_section::{CriticalSection, Mutex};
use tvc_imu::{Bursts, BusError, Micros, READ_MAX, TRANSFER_DEADLINE_US, Transfer, WRITE_MAX};
use tvc_nano::SelfCheck;
use tvc_nano::application::{self, Outcome};

use super::nano33iot::{I2C_FUNCTION, SCL, SDA, i2c_registers, on_i2c_interrupt};
use super::time::{now, within};
use super::{crash, log, wake};
use sercom::{Command, NotSynchronised};

/// The address's last bit, for a read.
const READ: u8 = 1;

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

/// Bytes of a transfer's payload. In words: the chip copies them by words where they are aligned.
#[derive(Clone, Copy)]
#[repr(align(4))]
struct Payload([u8; PAYLOAD_BYTES]);

const PAYLOAD_BYTES: usize = READ_MAX.next_multiple_of(4);

const _: () = assert!(WRITE_MAX <= READ_MAX);

/// Who started a transfer.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// The tick's interrupt, for the rates `alone` or for all.
    Tick { alone: bool },
    /// The main loop.
    Loop,
}

/// A transfer that is over.
pub(super) struct Completion {
    pub(super) origin: Origin,
    pub(super) outcome: Outcome,
    /// From its start to its last byte.
    pub(super) took_us: u32,
}

#[derive(Clone, Copy)]
enum Step {
    /// The address is on its way.
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

/// A transfer without the bytes that it writes.
#[derive(Clone, Copy)]
struct Outline {
    register: u8,
    is_read: bool,
    /// Bytes of payload.
    len: u8,
}

impl Outline {
    fn of(transfer: &Transfer) -> Self {
        match transfer {
            Transfer::Read { register, len } => Self {
                register: *register,
                is_read: true,
                len: (*len).min(READ_MAX as u8),
            },
            Transfer::Write { register, bytes } => Self {
                register: *register,
                is_read: false,
                len: bytes.len() as u8,
            },
        }
    }

    fn len(&self) -> usize {
        self.len.into()
    }
}

#[derive(Clone, Copy)]
struct Active {
    outline: Outline,
    origin: Origin,
    started: Micros,
    /// When its last byte had come; as `started` before that.
    ended: Micros,
    step: Step,
}

/// What interrupt and main loop share.
struct Master {
    /// The slave's address, shifted as it goes on the wire.
    address: u8,
    /// The reads that the next tick may start: of everything, and of the rates alone.
    armed: [Option<Outline>; 2],
    active: Option<Active>,
    /// What the newest transfer writes or has read.
    payload: Payload,
    /// The peripheral must be set up anew before it is used again.
    broken: bool,
}

static MASTER: Mutex<RefCell<Master>> = Mutex::new(RefCell::new(Master {
    address: 0,
    armed: [None; 2],
    active: None,
    payload: Payload([0; PAYLOAD_BYTES]),
    broken: true,
}));

/// Access the shared state with interrupts held off.
fn with_master<R>(action: impl FnOnce(&mut Master) -> R) -> R {
    critical_section::with(|cs| with_master_held(cs, action))
}

/// The same for who holds interrupts off already.
fn with_master_held<R>(held: CriticalSection<'_>, action: impl FnOnce(&mut Master) -> R) -> R {
    match MASTER.borrow(held).try_borrow_mut() {
        Ok(mut master) => action(&mut master),
        // An action that asks for the master again; there is none.
        Err(_) => crash::stop(SelfCheck::TakenTwice),
    }
}

impl Master {
    /// Start a transfer; what it writes is in the payload. One that cannot start is over at once.
    fn start(&mut self, outline: Outline, origin: Origin, started: Micros) {
        let mut active = Active {
            outline,
            origin,
            started,
            ended: started,
            step: Step::Address,
        };
        let begun = !self.broken
            && sercom::wait_idle()
                .and_then(|()| sercom::write_address(self.address))
                .is_ok();
        if begun {
            sercom::listen();
        } else {
            self.broken = true;
            active.step = Step::Done(Err(BusError::Stuck));
            wake::request();
        }
        self.active = Some(active);
    }

    /// Take the next step of the transfer under way.
    fn advance(&mut self) {
        if self.take_byte().is_none() {
            self.take_step();
        }
    }

    /// What most interrupts are for, before anything else is looked at: a byte that is not the last
    /// has come, and nothing is wrong. `None`, and nothing done, for any other.
    #[inline]
    fn take_byte(&mut self) -> Option<()> {
        let Active { outline, step, .. } = self.active.as_mut()?;
        let Step::Reading(count) = step else {
            return None;
        };
        let Payload(bytes) = &mut self.payload;
        let place = bytes.get_mut(*count)?;
        if *count + 1 < outline.len() && sercom::has_brought_byte() {
            *place = sercom::read_data();
            *count += 1;
            sercom::command_arrived(Command::Continue);
            return Some(());
        }
        None
    }

    /// Any step.
    #[inline(never)]
    fn take_step(&mut self) {
        let registers = i2c_registers();
        let flags = registers.intflag().read();
        let status = registers.status().read();
        let Some(active) = &mut self.active else {
            return sercom::silence();
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
            self.broken |= sercom::command(Command::Stop).is_err();
            Step::Done(Err(BusError::Nak))
        } else {
            let received = flags.sb().bit_is_set().then(sercom::read_data);
            proceed(active, self.address, received, &mut self.payload).unwrap_or_else(
                |NotSynchronised| {
                    self.broken = true;
                    Step::Done(Err(BusError::Protocol))
                },
            )
        };
        if matches!(active.step, Step::Done(_)) {
            active.ended = now();
            sercom::silence();
            wake::request();
        }
    }

    /// Whether the transfer under way is to be given up.
    fn is_late(&self, now: Micros) -> bool {
        self.active.as_ref().is_some_and(|active| {
            !matches!(active.step, Step::Done(_))
                && now.since(active.started) >= TRANSFER_DEADLINE_US
        })
    }

    /// Whether there is nothing to see to: no transfer, or one that has time left.
    fn is_well(&self, now: Micros) -> bool {
        let is_well = match &self.active {
            None => sercom::is_idle(),
            Some(active) => !matches!(active.step, Step::Done(_)) && !self.is_late(now),
        };
        is_well && !self.broken
    }

    /// The transfer that is over, once. What it has read goes to `answer`.
    fn collect(&mut self, answer: &mut (Payload, usize)) -> Option<Completion> {
        let active = self
            .active
            .take_if(|active| matches!(active.step, Step::Done(_)))?;
        let Step::Done(result) = active.step else {
            return None;
        };
        let outline = active.outline;
        *answer = match result {
            Ok(()) if outline.is_read => (self.payload, outline.len()),
            _ => (Payload([0; PAYLOAD_BYTES]), 0),
        };
        Some(Completion {
            origin: active.origin,
            took_us: active.ended.since(active.started) as u32,
            outcome: Outcome {
                started: active.started,
                result,
            },
        })
    }

    /// End the transfer under way. The peripheral is of no use until it is repaired.
    fn abort(&mut self, error: BusError) {
        sercom::silence();
        self.broken = true;
        if let Some(active) = &mut self.active {
            active.step = Step::Done(Err(error));
        }
    }

    fn state(&self) -> application::Bus {
        if self.active.is_some() {
            application::Bus::Busy
        } else if self.broken {
            application::Bus::Broken
        } else if sercom::is_idle() {
            application::Bus::Free
        } else {
            application::Bus::Stopping
        }
    }

    /// Whether a STOP is still on its way: the clock is held, or another master is on the bus.
    fn awaits_stop(&self) -> bool {
        self.state() == application::Bus::Stopping
    }
}

/// The next step of a transfer whose last one was acknowledged or brought a byte.
fn proceed(
    active: &Active,
    address: u8,
    byte: Option<u8>,
    payload: &mut Payload,
) -> Result<Step, NotSynchronised> {
    let Payload(bytes) = payload;
    let outline = &active.outline;
    match (active.step, byte) {
        (Step::Reading(count), Some(byte)) => {
            if let Some(place) = bytes.get_mut(count) {
                *place = byte;
            }
            let count = count + 1;
            if count < outline.len() {
                sercom::command(Command::Continue)?;
                Ok(Step::Reading(count))
            } else {
                sercom::command(Command::Stop)?;
                Ok(Step::Done(Ok(())))
            }
        }
        (Step::Address, None) => {
            sercom::write_data(outline.register)?;
            Ok(Step::Register)
        }
        (Step::Register, None) if outline.is_read => {
            sercom::write_address(address | READ)?;
            Ok(Step::Reading(0))
        }
        (Step::Register, None) => send(bytes, outline.len(), 0),
        (Step::Writing(sent), None) => send(bytes, outline.len(), sent),
        // A flag that no step waits for.
        _ => Err(NotSynchronised),
    }
}

fn send(bytes: &[u8], len: usize, sent: usize) -> Result<Step, NotSynchronised> {
    match bytes.get(sent) {
        Some(byte) if sent < len => {
            sercom::write_data(*byte)?;
            Ok(Step::Writing(sent + 1))
        }
        _ => {
            sercom::command(Command::Stop)?;
            Ok(Step::Done(Ok(())))
        }
    }
}

/// The bus as the main loop uses it.
pub(super) struct Bus {
    khz: u32,
    /// Ticks start reads.
    sampling: bool,
    /// What the transfer that was collected last has read, and of how many bytes that is.
    answer: (Payload, usize),
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
    pub(super) fn start(khz: u32) -> Self {
        let mut bus = Self {
            khz,
            sampling: false,
            answer: (Payload([0; PAYLOAD_BYTES]), 0),
            idle_by: None,
            stop_us: 0,
            repair_at: Micros(0),
            recoveries: 0,
        };
        bus.repair();
        bus
    }

    /// Change the speed, once no transfer is under way.
    pub(super) fn set_speed_when_free(&mut self, khz: u32) {
        if self.khz != khz && self.state() != application::Bus::Busy {
            self.khz = khz;
            self.repair();
        }
    }

    /// Have the next tick start one of these. All transfers go to their address.
    pub(super) fn arm(&mut self, bursts: &Bursts) {
        self.sampling = bursts.whole.is_some();
        let armed = [&bursts.whole, &bursts.rates].map(|burst| burst.as_ref().map(Outline::of));
        with_master(|master| (master.address, master.armed) = (bursts.address << 1, armed));
    }

    /// Give the peripheral its lines once more, should a register have lost them.
    pub(super) fn connect_again(&self) {
        if self.state() != application::Bus::Broken {
            self.connect();
        }
    }

    /// Whether ticks start reads.
    pub(super) fn is_sampling(&self) -> bool {
        self.sampling
    }

    /// Start `transfer` now. The bus must be free.
    pub(super) fn begin(&mut self, transfer: &Transfer) {
        let started = now();
        with_master(|master| {
            if master.active.is_none() {
                if let Transfer::Write { bytes, .. } = transfer {
                    let Payload(payload) = &mut master.payload;
                    for (to, from) in payload.iter_mut().zip(bytes.as_slice()) {
                        *to = *from;
                    }
                }
                master.start(Outline::of(transfer), Origin::Loop, started);
            }
        });
    }

    /// Times that the bus had to be repaired since start-up, without success too.
    pub(super) fn recoveries(&self) -> u16 {
        self.recoveries
    }

    /// What it is doing.
    pub(super) fn state(&self) -> application::Bus {
        with_master(|master| master.state())
    }

    /// What the transfer that was collected last has read.
    pub(super) fn answer(&self) -> &[u8] {
        let (Payload(bytes), len) = &self.answer;
        bytes.get(..*len).unwrap_or_default()
    }

    /// The transfer that is over, once; ends one that has reached its deadline, and repairs the bus
    /// where no step is `due` meanwhile.
    pub(super) fn poll(&mut self, now: Micros, due: Option<Micros>) -> Option<Completion> {
        let Self {
            answer, idle_by, ..
        } = self;
        let (completion, is_broken) = with_master(|master| {
            if master.is_well(now) {
                *idle_by = None;
                return (None, false);
            }
            if master.is_late(now) {
                let lines_free = SDA.is_high() && SCL.is_high();
                master.abort(if lines_free {
                    BusError::Timeout
                } else {
                    BusError::Stuck
                });
            }
            let completion = master.collect(answer);
            if completion.is_some() || !master.awaits_stop() {
                *idle_by = None;
            }
            if master.awaits_stop() && now >= *idle_by.get_or_insert(now.after(STOP_LIMIT_US)) {
                master.broken = true;
            }
            (completion, master.broken)
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
    pub(super) fn stop_us(&self) -> u32 {
        self.stop_us
    }

    /// The slave's 7-bit address in the upper 8 bits, and how long a STOP takes, us.
    pub(super) fn summary(&self) -> u32 {
        let address = with_master(|master| master.address >> 1);
        u32::from(address) << 24 | self.stop_us
    }

    /// Wait for the STOP of a transfer that is over, and so learn how long the sensor holds it up
    /// after a read; after a write it may go out at once. Where the sensor is sampled there is less
    /// time for that, and none beyond the moment at which a step is `due`.
    pub(super) fn await_stop(&mut self, over: &Completion, due: Option<Micros>) {
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
        SDA.connect(I2C_FUNCTION);
        SCL.connect(I2C_FUNCTION);
    }

    /// Reset the peripheral, free the lines, set it up anew. Nothing touches it meanwhile: it is
    /// marked broken.
    fn repair(&mut self) {
        with_master(|master| master.broken = true);
        self.repair_at = now().after(REPAIR_PERIOD_US);
        if sercom::reset().is_err() || !recovery::free(SDA, SCL) {
            return;
        }
        self.connect();
        let ready = sercom::set_up(self.khz).is_ok();
        with_master(|master| master.broken = !ready);
    }
}

/// Start the armed transfer, from the tick's interrupt, unless the bus is busy. A transfer that
/// went well and that the main loop, being late, has not collected is overtaken: the burst is worth
/// more, and the driver asks again.
pub(super) fn start_burst(time: Micros, alone: bool) {
    with_master(|master| {
        let active = master.active.as_ref();
        let free = active.is_none_or(|active| matches!(active.step, Step::Done(Ok(()))));
        // A STOP that takes longer than is waited for here costs the burst.
        if free
            && let Some(&Some(burst)) = master.armed.get(usize::from(alone))
            && (master.broken || sercom::wait_idle().is_ok())
        {
            // The loop arms the next when it has seen this one.
            master.armed = [None; 2];
            master.start(burst, Origin::Tick { alone }, time);
        }
    });
}

on_i2c_interrupt!(wire_ready);

/// The wire has done what it was told.
fn wire_ready() {
    // SAFETY: what shares the master with this interrupt holds it off, or has its priority; the
    // interrupts above it do not touch the master.
    let held = unsafe { CriticalSection::new() };
    with_master_held(held, Master::advance);
}
