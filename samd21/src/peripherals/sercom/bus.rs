//! What the I2C master does on the bus.
//!
//! ```text
//! ADDR ─▶ START ─▶ address ─┬─ write, or not acknowledged ─▶ MB, SCL held
//!                           └─ read ─▶ byte ─▶ SB, SCL held
//! DATA ─▶ byte ─▶ MB, SCL held          CMD 2 ─▶ (N)ACK ─▶ byte ─▶ SB, SCL held
//! CMD 1 ─▶ repeated START, address      CMD 3 ─▶ (N)ACK, STOP ─▶ IDLE
//! ```
//!
//! A slave may hold SCL before the STOP too, as one does whose firmware releases the line: the bus
//! stays OWNER until it lets go.
//!
//! A bit takes (10 + 2 BAUD) / f, or (10 + BAUD + BAUDLOW) / f with BAUDLOW, plus the rise time of
//! SCL (data sheet, SERCOM I2C, BAUD). The slave is asked at the ninth clock of a byte that it
//! receives and at the first clock of one that it sends; its stretching lengthens that byte.
//!
//! SCL held low by others stops everything before the next clock: MB never comes. SDA held low
//! makes the master lose arbitration at the first 1 that it sends, and a STOP impossible; then the
//! bus is BUSY until SDA is released, which is a STOP. SDA falling while the bus is IDLE is a START
//! of another master: BUSY.
//!
//! A reset, SWRST or a change of ENABLE lets go of both lines. The board is told where the slave
//! stands, if it holds a line then: as it sends a byte, acknowledges one or stretches the clock.
//!
//! With GCLK_SERCOM_SLOW running, LOWTOUTEN ends 30 ms of low SCL (25 to 35 on the chip) with
//! LOWTOUT, BUSERR and a STOP, and INACTOUT makes a BUSY bus IDLE after its time.

use super::{ACKACT, ARBLOST, BUSERR, ERROR, LOWTOUT, LOWTOUTEN, MB, RXNACK, SB, Sercom};
use crate::board::{Board, I2cCut, I2cEvent, I2cReply, Lines, Ticks};
use crate::peripherals::access::Bus;

/// Rise time of SCL: 4.7 kOhm with 75 pF.
const RISE: Ticks = Ticks(14);
/// How often held lines are looked at.
const POLL: Ticks = Ticks::from_us(10);
/// SCL low time-out.
const LOW_TIMEOUT: Ticks = Ticks::from_ms(30);
/// CTRLA.INACTOUT: off, 55, 105, 205 us.
const INACTIVE_TIMEOUT: [Ticks; 4] =
    [Ticks::NEVER, Ticks::from_us(55), Ticks::from_us(105), Ticks::from_us(205)];

/// STATUS.BUSSTATE.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum BusState {
    #[default]
    Unknown = 0,
    Idle = 1,
    Owner = 2,
    Busy = 3,
}

/// Who sends the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    Write,
    Read,
}

/// A byte on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Byte {
    Address,
    Write,
    Read,
}

/// What the master is doing; it goes on when `due`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Motion {
    /// Nothing.
    #[default]
    None,
    /// ADDR waits for an idle bus.
    AwaitIdle,
    /// The first clock of a byte.
    First(Byte),
    /// The ninth clock of a byte that the master sends.
    Ninth(Byte),
    /// The end of a byte.
    End(Byte, I2cReply),
    /// The master sends a 1 and reads a 0.
    LoseArbitration,
    /// The master lets go of SCL for a STOP; then a START, if ADDR was written meanwhile.
    Stop,
    /// The slave, which held SCL before the STOP for this long, lets go of it.
    LateStop(Ticks),
}

impl Sercom {
    pub(crate) fn next(&self) -> Ticks {
        self.due.min(self.low_timeout())
    }

    fn low_timeout(&self) -> Ticks {
        match self.scl_low_since {
            Some(since) if self.ctrla & LOWTOUTEN != 0 && self.slow_clock => since + LOW_TIMEOUT,
            _ => Ticks::NEVER,
        }
    }

    /// Does what is due at `bus.now`.
    pub(crate) fn advance(&mut self, bus: &mut Bus<'_>) {
        if let Some(usart) = &mut self.usart {
            usart.advance(bus, self.index, self.clock);
            self.due = usart.next();
            return;
        }
        if self.low_timeout() <= bus.now {
            self.time_out(bus);
        } else if self.due <= bus.now {
            self.proceed(bus);
        }
    }

    /// Where the slave stands if the lines are let go now, and it may hold one.
    pub(crate) fn cut(&self, now: Ticks) -> Option<I2cCut> {
        let left = self.due.saturating_sub(now);
        let (clocks, stretch) = match self.motion {
            _ if !self.connected => return None,
            Motion::End(Byte::Read, reply) => {
                let bits = left.saturating_sub(reply.stretch).0.div_ceil(self.bit().0.max(1));
                (8_u64.saturating_sub(bits) as u8, if bits == 0 { left } else { Ticks::ZERO })
            }
            Motion::End(_, reply) => (8, left.min(reply.stretch)),
            Motion::LateStop(stretch) => (8, left.min(stretch)),
            _ => return None,
        };
        Some(I2cCut { clocks, stretch })
    }

    /// Whether the master or the slave that it talks to holds SCL low.
    pub(crate) fn holds_scl(&self, now: Ticks) -> bool {
        self.connected && self.scl_low_since.is_some_and(|since| since <= now)
    }

    /// The lines are let go.
    pub(super) fn tell_cut(&self, bus: &mut Bus<'_>) {
        if let Some(cut) = self.cut(bus.now) {
            bus.board.i2c_cut(bus.now, cut);
        }
    }

    /// ENABLE has changed: the lines are released, nobody knows the bus.
    pub(super) fn release_lines(&mut self, bus: &mut Bus<'_>) {
        self.tell_cut(bus);
        self.state = BusState::Unknown;
        self.held = None;
        self.rest();
        self.lines = self.held_low(bus.now, bus.board);
        if self.is_enabled() && !self.connected {
            self.note(bus, "enabled without its pads on the board's I2C lines: no bus");
        }
    }

    pub(super) fn write_address(&mut self, bus: &mut Bus<'_>, address: u8) {
        self.observe(bus.now, bus.board);
        self.status &= !(BUSERR | ARBLOST | LOWTOUT);
        self.interrupts.flags &= !(MB | SB);
        self.address = address;
        match (self.state, self.motion) {
            (BusState::Unknown, _) => {
                self.status |= BUSERR;
                self.interrupts.flags |= MB | ERROR;
            }
            (BusState::Busy, _) => self.wait(bus.now, Motion::AwaitIdle, POLL),
            (BusState::Idle, _) => self.start(bus.now),
            (BusState::Owner, Motion::Stop | Motion::LateStop(_)) => self.restarts = true,
            (BusState::Owner, _) if self.held.is_some() => self.start(bus.now),
            (BusState::Owner, _) => {
                self.note(bus, "ADDR written in the middle of a byte: ignored");
            }
        }
    }

    pub(super) fn write_data(&mut self, bus: &mut Bus<'_>, data: u8) {
        if self.state == BusState::Owner && self.held == Some(Direction::Write) {
            self.data = data;
            self.interrupts.flags &= !MB;
            self.release(bus.now, Motion::First(Byte::Write), Ticks::ZERO);
        } else {
            self.note(bus, "DATA written without a byte to send: ignored");
        }
    }

    pub(super) fn command(&mut self, bus: &mut Bus<'_>, command: u32) {
        let now = bus.now;
        let direction = match self.held {
            Some(direction) if self.interrupts.flags & (MB | SB) != 0 => direction,
            _ => {
                self.note(bus, "CMD without MB or SB: ignored");
                return;
            }
        };
        // After a byte read, the acknowledge bit goes first.
        let acknowledge = match direction {
            Direction::Read => self.bit(),
            Direction::Write => Ticks::ZERO,
        };
        match (command, direction) {
            (1, _) => {
                self.interrupts.flags &= !(MB | SB);
                self.release(now, Motion::First(Byte::Address), acknowledge + self.bit());
            }
            (2, Direction::Read) => {
                if self.ctrlb & ACKACT != 0 {
                    self.note(bus, "CMD 2 with ACKACT 1: the slave has let go");
                }
                self.interrupts.flags &= !SB;
                self.release(now, Motion::First(Byte::Read), acknowledge);
            }
            (3, _) => {
                self.interrupts.flags &= !(MB | SB);
                let stop = acknowledge + self.bit() + self.bit() / 2;
                self.restarts = false;
                self.release(now, Motion::Stop, stop);
            }
            _ => self.note(bus, "CMD 2 after a byte written: does nothing"),
        }
    }

    /// Looks at the lines: STARTs and STOPs of others, and the inactive time-out.
    pub(super) fn observe(&mut self, now: Ticks, board: &dyn Board) {
        if !self.is_enabled() {
            return;
        }
        let before = self.lines;
        let lines = self.held_low(now, board);
        self.lines = lines;
        if self.state == BusState::Owner || lines.scl || before.scl {
            return;
        }
        match (before.sda, lines.sda) {
            (false, true) if self.state == BusState::Idle => self.lose_bus(now),
            (true, false) => self.state = BusState::Idle,
            _ => {}
        }
        let limit = INACTIVE_TIMEOUT[(self.ctrla >> 28 & 3) as usize];
        if self.state == BusState::Busy
            && self.slow_clock
            && now >= self.busy_since.saturating_add(limit)
        {
            self.state = BusState::Idle;
        }
    }

    fn proceed(&mut self, bus: &mut Bus<'_>) {
        let now = bus.now;
        match self.motion {
            Motion::None => self.rest(),
            Motion::AwaitIdle => {
                self.observe(now, bus.board);
                match self.state {
                    BusState::Idle => self.start(now),
                    _ => self.wait(now, Motion::AwaitIdle, POLL),
                }
            }
            Motion::First(byte) => self.first(bus, byte),
            Motion::Ninth(byte) => self.ninth(bus, byte),
            Motion::End(byte, reply) => self.end(now, byte, reply),
            Motion::LoseArbitration => {
                self.status |= ARBLOST;
                self.interrupts.flags |= MB | ERROR;
                self.rest();
                self.lines = self.held_low(now, bus.board);
                self.lose_bus(now);
            }
            Motion::Stop => self.stop(bus),
            Motion::LateStop(_) => self.finish_stop(bus),
        }
    }

    fn first(&mut self, bus: &mut Bus<'_>, byte: Byte) {
        let now = bus.now;
        if self.scl_is_held(bus) {
            return;
        }
        if self.connected && bus.board.i2c_glitch(now) {
            self.status |= BUSERR;
            self.interrupts.flags |= MB | ERROR;
            self.rest();
            self.lose_bus(now);
            return;
        }
        self.lines = self.held_low(now, bus.board);
        if byte == Byte::Read {
            let reply = self.ask(bus, I2cEvent::Read);
            let duration = self.bit() * 8 + reply.stretch;
            self.scl_low_since = Some(now + self.bit() * 8);
            self.wait(now, Motion::End(byte, reply), duration);
            return;
        }
        let sent = if byte == Byte::Address { self.address } else { self.data };
        if self.lines.sda && sent != 0 {
            let ones_at = u64::from(sent.leading_zeros());
            let duration = self.bit() * ones_at + self.bit() / 2;
            self.wait(now, Motion::LoseArbitration, duration);
        } else {
            let duration = self.bit() * 8 + self.bit() / 2;
            self.wait(now, Motion::Ninth(byte), duration);
        }
    }

    fn ninth(&mut self, bus: &mut Bus<'_>, byte: Byte) {
        let now = bus.now;
        if self.scl_is_held(bus) {
            return;
        }
        let event = match byte {
            Byte::Address => {
                I2cEvent::Start { address: self.address >> 1, read: self.address & 1 != 0 }
            }
            _ => I2cEvent::Write(self.data),
        };
        let mut reply = self.ask(bus, event);
        // A stuck SDA looks like an acknowledge.
        reply.ack |= self.held_low(now, bus.board).sda;
        self.scl_low_since = Some(now);
        let duration = self.bit() / 2 + reply.stretch;
        self.wait(now, Motion::End(byte, reply), duration);
    }

    fn end(&mut self, now: Ticks, byte: Byte, reply: I2cReply) {
        if byte == Byte::Read {
            self.data = if self.lines.sda { 0 } else { reply.data };
            self.interrupts.flags |= SB;
            self.hold(now, Direction::Read);
            return;
        }
        self.status &= !RXNACK;
        if !reply.ack {
            self.status |= RXNACK;
        } else if byte == Byte::Address && self.address & 1 != 0 {
            self.scl_low_since = None;
            self.wait(now, Motion::First(Byte::Read), Ticks::ZERO);
            return;
        }
        self.interrupts.flags |= MB;
        self.hold(now, Direction::Write);
    }

    /// Asks the slave for the STOP.
    fn stop(&mut self, bus: &mut Bus<'_>) {
        let now = bus.now;
        if self.scl_is_held(bus) {
            return;
        }
        if !self.held_low(now, bus.board).sda {
            let stretch = self.ask(bus, I2cEvent::Stop).stretch;
            if stretch > Ticks::ZERO {
                self.scl_low_since = Some(now);
                self.wait(now, Motion::LateStop(stretch), stretch);
                return;
            }
        }
        self.finish_stop(bus);
    }

    /// SCL is high: SDA follows it, which is the STOP.
    fn finish_stop(&mut self, bus: &mut Bus<'_>) {
        let now = bus.now;
        if self.scl_is_held(bus) {
            return;
        }
        self.rest();
        self.lines = self.held_low(now, bus.board);
        if self.lines.sda {
            self.lose_bus(now);
            if self.restarts {
                self.wait(now, Motion::AwaitIdle, POLL);
            }
            return;
        }
        self.state = BusState::Idle;
        if self.restarts {
            self.start(now);
        }
    }

    fn time_out(&mut self, bus: &mut Bus<'_>) {
        let now = bus.now;
        self.status |= LOWTOUT | BUSERR;
        self.interrupts.flags |= ERROR;
        let reading = self.held == Some(Direction::Read)
            || matches!(self.motion, Motion::First(Byte::Read) | Motion::End(Byte::Read, _));
        self.interrupts.flags |= if reading { SB } else { MB };
        self.held = None;
        self.rest();
        self.lines = self.held_low(now, bus.board);
        if self.lines.scl || self.lines.sda {
            self.lose_bus(now);
        } else {
            self.ask(bus, I2cEvent::Stop);
            self.state = BusState::Idle;
        }
    }

    /// START, then the address.
    fn start(&mut self, now: Ticks) {
        let acknowledge = match self.held {
            Some(Direction::Read) => self.bit(),
            _ => Ticks::ZERO,
        };
        self.state = BusState::Owner;
        self.release(now, Motion::First(Byte::Address), acknowledge + self.bit());
    }

    /// Another master has the bus, or seems to.
    fn lose_bus(&mut self, now: Ticks) {
        self.state = BusState::Busy;
        self.busy_since = now;
        self.held = None;
    }

    /// Holds SCL low until the next command.
    fn hold(&mut self, now: Ticks, direction: Direction) {
        self.rest();
        self.held = Some(direction);
        self.scl_low_since = Some(now);
    }

    /// Releases SCL for what comes next.
    fn release(&mut self, now: Ticks, motion: Motion, after: Ticks) {
        self.held = None;
        self.scl_low_since = None;
        self.wait(now, motion, after);
    }

    fn wait(&mut self, now: Ticks, motion: Motion, after: Ticks) {
        self.motion = motion;
        self.due = if self.clock.is_some() { now + after } else { Ticks::NEVER };
    }

    fn rest(&mut self) {
        self.motion = Motion::None;
        self.due = Ticks::NEVER;
        self.scl_low_since = None;
    }

    /// Whether others keep SCL low; then the motion waits.
    fn scl_is_held(&mut self, bus: &mut Bus<'_>) -> bool {
        let held = self.held_low(bus.now, bus.board).scl;
        if held {
            self.scl_low_since.get_or_insert(bus.now);
            self.due = bus.now + POLL;
        } else {
            self.scl_low_since = None;
        }
        held
    }

    /// What others hold low. Pads that lead nowhere are taken for high lines at which nobody
    /// answers; the data sheet does not say, and held lines would be noticed sooner.
    fn held_low(&self, now: Ticks, board: &dyn Board) -> Lines {
        if self.connected { board.i2c_held_low(now) } else { Lines::default() }
    }

    /// The slave's reply to what the master does now.
    fn ask(&self, bus: &mut Bus<'_>, event: I2cEvent) -> I2cReply {
        if self.connected { bus.board.i2c(bus.now, event) } else { I2cReply::NAK }
    }

    /// Length of a bit.
    fn bit(&self) -> Ticks {
        let baud = u64::from(self.baud & 0xFF);
        let low = match u64::from(self.baud >> 8 & 0xFF) {
            0 => baud,
            low => low,
        };
        self.clock.map_or(Ticks::ZERO, |clock| clock.duration(10 + baud + low) + RISE)
    }
}
