//! The sensor bus: an I2C master that its interrupt drives and that cannot hang, apart from the
//! registers that it does it with ([`Wire`]).
//!
//! A transfer is a write to a register, or a write of its number, a repeated start and a read. Once
//! started it runs in the interrupt, one byte at a time, and the main loop
//! [collects](Master::collect) its outcome. Each transfer has a deadline. Whatever fails ends with
//! a STOP, where the master still owns the bus, or with a bus that is [to be
//! repaired](Master::is_broken).
//!
//! ```text
//!      address+W acknowledged      register acknowledged, read    byte 1..n-1: acknowledge
//! start ─────────────────▶ Register ───────────────────▶ Reading ─┐ byte n: refuse, STOP ▶ done
//!                             │  register acknowledged, write     └┘
//!                             └─────────────▶ Writing ── all acknowledged: STOP ▶ done
//! ```

use tvc_imu::{Bursts, BusError, Micros, READ_MAX, TRANSFER_DEADLINE_US, Transfer, WRITE_MAX};

use crate::application::{Bus, Outcome};

/// The address's last bit, for a read.
pub const READ: u8 = 1;

/// Bytes of a transfer's payload. In words: the chip copies them by words where they are aligned.
#[derive(Clone, Copy, Debug)]
#[repr(align(4))]
struct Payload([u8; PAYLOAD_BYTES]);

const PAYLOAD_BYTES: usize = READ_MAX.next_multiple_of(4);

const _: () = assert!(WRITE_MAX <= READ_MAX);

impl Payload {
    const EMPTY: Self = Self([0; PAYLOAD_BYTES]);
}

/// The wire did not take what it was told in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotSynchronised;

/// What to answer to a byte that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Acknowledge it and fetch the next.
    Continue = 2,
    /// Refuse it and end with a STOP. After a write: just the STOP.
    Stop = 3,
}

/// What the wire interrupts for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Nothing.
    Nothing,
    /// A START or STOP in the middle of a byte, or another error of the bus.
    Error,
    /// Another master has the bus.
    Lost,
    /// The slave has not acknowledged.
    Refused,
    /// What was written has been acknowledged.
    Acknowledged,
    /// A byte has come.
    Byte(u8),
}

/// The registers of an I2C master. What waits in these calls does so for a bounded time.
#[allow(clippy::missing_errors_doc, reason = "all for the one reason of its type")]
pub trait Wire {
    /// Wait for the STOP before to have gone out: a START on top of it would be a repeated start.
    fn wait_idle(&mut self) -> Result<(), NotSynchronised>;

    /// START or repeated START and the address, [`READ`] set in it or not.
    fn write_address(&mut self, address: u8) -> Result<(), NotSynchronised>;

    /// Send a byte.
    fn write_data(&mut self, byte: u8) -> Result<(), NotSynchronised>;

    /// Answer the byte that has come, or end a write.
    fn command(&mut self, command: Command) -> Result<(), NotSynchronised>;

    /// Take a byte that has come and have the next one fetched, if nothing else has happened;
    /// without a wait.
    fn next_byte(&mut self) -> Option<u8>;

    /// What it interrupts for.
    fn signal(&mut self) -> Signal;

    /// Interrupt, or not.
    fn listen(&mut self, on: bool);

    /// Whether nobody is on the bus: the STOP before has gone out.
    fn is_idle(&self) -> bool;
}

/// Who started a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The tick's interrupt.
    Tick {
        /// The burst reads the rates alone.
        rates_only: bool,
    },
    /// The main loop.
    Loop,
}

/// A transfer that is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completion {
    /// Who started it.
    pub origin: Origin,
    /// How it ended.
    pub outcome: Outcome,
    /// From its start to its last byte.
    pub took_us: u32,
}

/// What a transfer has read.
#[derive(Clone, Copy, Debug)]
pub struct Answer(Payload, usize);

impl Answer {
    /// Nothing.
    pub const NONE: Self = Self(Payload::EMPTY, 0);

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        let Self(Payload(bytes), len) = self;
        bytes.get(..*len).unwrap_or_default()
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    /// The address is on its way.
    Address,
    /// The register's number is on its way.
    Register,
    /// The number of payload bytes on their way or acknowledged.
    Writing(usize),
    /// The repeated start or a byte is on its way. The number of bytes that have come.
    Reading(usize),
    /// Over; the main loop has not collected it.
    Done(Result<(), BusError>),
}

/// A transfer without the bytes that it writes.
#[derive(Clone, Copy, Debug)]
struct Outline {
    register: u8,
    is_read: bool,
    /// Bytes of payload.
    len: u8,
}

impl Outline {
    fn of(transfer: &Transfer) -> Self {
        match transfer {
            Transfer::Read { register, len } => {
                Self { register: *register, is_read: true, len: (*len).min(READ_MAX as u8) }
            }
            Transfer::Write { register, bytes } => {
                Self { register: *register, is_read: false, len: bytes.len() as u8 }
            }
        }
    }

    fn len(&self) -> usize {
        self.len.into()
    }
}

#[derive(Clone, Copy, Debug)]
struct Active {
    /// Shifted as it goes on the wire.
    address: u8,
    outline: Outline,
    origin: Origin,
    started: Micros,
    /// When its last byte had come; as `started` before that.
    ended: Micros,
    step: Step,
}

/// What interrupt and main loop share. Whoever gets `true` from a call wakes the main loop.
#[derive(Debug)]
pub struct Master<W> {
    wire: W,
    /// The address of the armed reads, shifted as it goes on the wire.
    address: u8,
    /// The reads that the next tick may start: of everything, and of the rates alone.
    armed: [Option<Outline>; 2],
    active: Option<Active>,
    /// What the newest transfer writes or has read.
    payload: Payload,
    /// The wire must be set up anew before it is used again.
    broken: bool,
}

impl<W: Wire> Master<W> {
    /// On a wire that has not been set up.
    pub const fn new(wire: W) -> Self {
        Self {
            wire,
            address: 0,
            armed: [None; 2],
            active: None,
            payload: Payload::EMPTY,
            broken: true,
        }
    }

    /// Have the next tick start one of these.
    pub fn arm(&mut self, bursts: &Bursts) {
        self.address = bursts.address << 1;
        self.armed = [&bursts.whole, &bursts.rates].map(|burst| burst.as_ref().map(Outline::of));
    }

    /// The 7-bit address of the armed reads.
    pub fn address(&self) -> u8 {
        self.address >> 1
    }

    /// Start `transfer` to a 7-bit address for the main loop, unless there is one.
    #[must_use]
    pub fn begin(&mut self, address: u8, transfer: &Transfer, now: Micros) -> bool {
        if self.active.is_some() {
            return false;
        }
        if let Transfer::Write { bytes, .. } = transfer {
            let Payload(payload) = &mut self.payload;
            for (to, from) in payload.iter_mut().zip(bytes.as_slice()) {
                *to = *from;
            }
        }
        self.start(address << 1, Outline::of(transfer), Origin::Loop, now)
    }

    /// Start the armed burst, from the tick's interrupt, unless the bus is busy. A transfer that
    /// went well and that the main loop, being late, has not collected is overtaken: the burst is
    /// worth more, and the driver asks again.
    #[must_use]
    pub fn start_burst(&mut self, now: Micros, rates_only: bool) -> bool {
        let active = self.active.as_ref();
        let free = active.is_none_or(|active| matches!(active.step, Step::Done(Ok(()))));
        // A STOP that takes longer than is waited for here costs the burst.
        if free
            && let Some(&Some(burst)) = self.armed.get(usize::from(rates_only))
            && (self.broken || self.wire.wait_idle().is_ok())
        {
            // The loop arms the next when it has seen this one.
            self.armed = [None; 2];
            return self.start(self.address, burst, Origin::Tick { rates_only }, now);
        }
        false
    }

    /// Start a transfer; what it writes is in the payload. One that cannot start is over at once.
    fn start(&mut self, address: u8, outline: Outline, origin: Origin, started: Micros) -> bool {
        let wire = &mut self.wire;
        let begun =
            !self.broken && wire.wait_idle().and_then(|()| wire.write_address(address)).is_ok();
        let step = if begun {
            wire.listen(true);
            Step::Address
        } else {
            self.broken = true;
            Step::Done(Err(BusError::Stuck))
        };
        self.active = Some(Active { address, outline, origin, started, ended: started, step });
        !begun
    }

    /// Take the next step of the transfer under way.
    #[must_use]
    pub fn advance(&mut self, now: impl FnOnce() -> Micros) -> bool {
        self.take_byte().is_none() && self.take_step(now)
    }

    /// What most interrupts are for, before anything else is looked at: a byte that is not the last
    /// has come, and nothing is wrong. `None`, and nothing done, for any other.
    fn take_byte(&mut self) -> Option<()> {
        let Active { outline, step, .. } = self.active.as_mut()?;
        let Step::Reading(count) = step else {
            return None;
        };
        let Payload(bytes) = &mut self.payload;
        let place = bytes.get_mut(*count)?;
        if *count + 1 >= outline.len() {
            return None;
        }
        *place = self.wire.next_byte()?;
        *count += 1;
        Some(())
    }

    /// Any step. Says whether it was the last one.
    fn take_step(&mut self, now: impl FnOnce() -> Micros) -> bool {
        let Some(active) = &mut self.active else {
            self.wire.listen(false);
            return false;
        };
        let signal = self.wire.signal();
        if signal == Signal::Nothing || matches!(active.step, Step::Done(_)) {
            // Pending since before the transfer was aborted.
            return false;
        }
        active.step = match signal {
            Signal::Error => {
                self.broken = true;
                Step::Done(Err(BusError::Protocol))
            }
            Signal::Lost => {
                self.broken = true;
                Step::Done(Err(BusError::Arbitration))
            }
            Signal::Refused => {
                self.broken |= self.wire.command(Command::Stop).is_err();
                Step::Done(Err(BusError::Nak))
            }
            _ => proceed(active, &mut self.wire, signal, &mut self.payload).unwrap_or_else(
                |NotSynchronised| {
                    self.broken = true;
                    Step::Done(Err(BusError::Protocol))
                },
            ),
        };
        let is_over = matches!(active.step, Step::Done(_));
        if is_over {
            active.ended = now();
            self.wire.listen(false);
        }
        is_over
    }

    /// Whether the transfer under way is to be given up.
    pub fn is_late(&self, now: Micros) -> bool {
        self.active.as_ref().is_some_and(|active| {
            !matches!(active.step, Step::Done(_))
                && now.since(active.started) >= TRANSFER_DEADLINE_US
        })
    }

    /// Whether there is nothing to see to: no transfer, or one that has time left.
    pub fn is_well(&self, now: Micros) -> bool {
        let is_well = match &self.active {
            None => self.wire.is_idle(),
            Some(active) => !matches!(active.step, Step::Done(_)) && !self.is_late(now),
        };
        is_well && !self.broken
    }

    /// The transfer that is over, once. What it has read goes to `answer`.
    pub fn collect(&mut self, answer: &mut Answer) -> Option<Completion> {
        let active = self.active.take_if(|active| matches!(active.step, Step::Done(_)))?;
        let Step::Done(result) = active.step else {
            return None;
        };
        *answer = match result {
            Ok(()) if active.outline.is_read => Answer(self.payload, active.outline.len()),
            _ => Answer::NONE,
        };
        Some(Completion {
            origin: active.origin,
            took_us: active.ended.since(active.started) as u32,
            outcome: Outcome { started: active.started, result },
        })
    }

    /// End the transfer under way. The wire is of no use until it is repaired.
    pub fn abort(&mut self, error: BusError) {
        self.wire.listen(false);
        self.broken = true;
        if let Some(active) = &mut self.active {
            active.step = Step::Done(Err(error));
        }
    }

    /// What the bus is doing.
    pub fn state(&self) -> Bus {
        if self.active.is_some() {
            Bus::Busy
        } else if self.broken {
            Bus::Broken
        } else if self.wire.is_idle() {
            Bus::Free
        } else {
            Bus::Stopping
        }
    }

    /// Whether a STOP is still on its way: the clock is held, or another master is on the bus.
    pub fn awaits_stop(&self) -> bool {
        self.state() == Bus::Stopping
    }

    /// Whether the wire must be set up anew.
    pub fn is_broken(&self) -> bool {
        self.broken
    }

    /// The wire is to be set up anew, or has been.
    pub fn set_broken(&mut self, broken: bool) {
        self.broken = broken;
    }
}

/// The next step of a transfer whose last one was acknowledged or brought a byte.
fn proceed(
    active: &Active,
    wire: &mut impl Wire,
    signal: Signal,
    payload: &mut Payload,
) -> Result<Step, NotSynchronised> {
    let Payload(bytes) = payload;
    let outline = &active.outline;
    match (active.step, signal) {
        (Step::Reading(count), Signal::Byte(byte)) => {
            if let Some(place) = bytes.get_mut(count) {
                *place = byte;
            }
            let count = count + 1;
            if count < outline.len() {
                wire.command(Command::Continue)?;
                Ok(Step::Reading(count))
            } else {
                wire.command(Command::Stop)?;
                Ok(Step::Done(Ok(())))
            }
        }
        (Step::Address, Signal::Acknowledged) => {
            wire.write_data(outline.register)?;
            Ok(Step::Register)
        }
        (Step::Register, Signal::Acknowledged) if outline.is_read => {
            wire.write_address(active.address | READ)?;
            Ok(Step::Reading(0))
        }
        (Step::Register, Signal::Acknowledged) => send(wire, bytes, outline.len(), 0),
        (Step::Writing(sent), Signal::Acknowledged) => send(wire, bytes, outline.len(), sent),
        // A signal that no step waits for.
        _ => Err(NotSynchronised),
    }
}

fn send(
    wire: &mut impl Wire,
    bytes: &[u8],
    len: usize,
    sent: usize,
) -> Result<Step, NotSynchronised> {
    match bytes.get(sent) {
        Some(byte) if sent < len => {
            wire.write_data(*byte)?;
            Ok(Step::Writing(sent + 1))
        }
        _ => {
            wire.command(Command::Stop)?;
            Ok(Step::Done(Ok(())))
        }
    }
}

#[cfg(test)]
mod tests;
