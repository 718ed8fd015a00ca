use super::*;
use crate::board::{I2cCut, I2cEvent, I2cReply};
use crate::peripherals::violations::Violations;

const IDLE: u16 = 1 << 4;
const OWNER: u16 = 2 << 4;
const BUSY: u16 = 3 << 4;

/// A slave at 0x29 with auto-incrementing registers, and lines to hold.
#[derive(Default)]
struct Slave {
    registers: Vec<u8>,
    pointer: Option<usize>,
    stretch: Ticks,
    /// How long it holds SCL before a STOP.
    stop_stretch: Ticks,
    held: Lines,
    glitch: bool,
    addressed: bool,
    log: Vec<(u64, I2cEvent)>,
    cuts: Vec<(u8, u64)>,
    /// What a USART has sent, and what comes in at it, the first at the end.
    sent: Vec<(u64, u8)>,
    incoming: Vec<u8>,
}

impl Board for Slave {
    fn i2c(&mut self, now: Ticks, event: I2cEvent) -> I2cReply {
        self.log.push((now.0, event));
        match event {
            I2cEvent::Start { address, read } => {
                self.addressed = address == 0x29;
                if self.addressed && !read {
                    self.pointer = None;
                }
                I2cReply { ack: self.addressed, ..I2cReply::NAK }.stretched(self.stretch)
            }
            I2cEvent::Write(byte) => {
                match self.pointer {
                    None => self.pointer = Some(usize::from(byte)),
                    Some(pointer) => {
                        self.registers[pointer] = byte;
                        self.pointer = Some(pointer + 1);
                    }
                }
                I2cReply::ACK.stretched(self.stretch)
            }
            I2cEvent::Read => {
                let pointer = self.pointer.unwrap_or(0);
                self.pointer = Some(pointer + 1);
                I2cReply::data(self.registers[pointer]).stretched(self.stretch)
            }
            I2cEvent::Stop => I2cReply::ACK.stretched(self.stop_stretch),
        }
    }

    fn i2c_cut(&mut self, _now: Ticks, cut: I2cCut) {
        self.cuts.push((cut.clocks, cut.stretch.0));
    }

    fn serial(&mut self, now: Ticks, sercom: usize, byte: u8) {
        assert_eq!(sercom, 4);
        self.sent.push((now.0, byte));
    }

    fn serial_input(&mut self, _now: Ticks, _sercom: usize) -> Option<u8> {
        self.incoming.pop()
    }

    fn i2c_held_low(&self, _now: Ticks) -> Lines {
        self.held
    }

    fn i2c_glitch(&mut self, _now: Ticks) -> bool {
        self.glitch
    }
}

struct Rig {
    sercom: Sercom,
    slave: Slave,
    violations: Violations,
    now: Ticks,
}

impl Rig {
    /// SERCOM4 at 48 MHz with BAUD 59 as the HAL sets it for 400 kHz, bus idle.
    fn new(hold: Ticks) -> Self {
        let mut sercom = Sercom::new(4, hold);
        sercom.set_clocks(Ticks::ZERO, Some(Rate::from_hz(48_000_000)), false);
        sercom.connected = true;
        let mut rig = Self {
            sercom,
            slave: Slave {
                registers: (0..64).map(|index| index ^ 0xA0).collect(),
                ..Slave::default()
            },
            violations: Violations::default(),
            now: Ticks(1000),
        };
        rig.write(0x00, SWRST);
        rig.pass(Ticks(500));
        rig.write(0x00, MODE_I2C_MASTER);
        rig.write(0x0C, 59);
        rig
    }

    fn ready() -> Self {
        let mut rig = Self::new(Ticks::ZERO);
        rig.enable(0);
        rig
    }

    fn enable(&mut self, ctrla: u32) {
        self.write(0x00, ctrla | MODE_I2C_MASTER | ENABLE);
        self.pass(Ticks(500));
        self.half(0x18, 1, IDLE);
        self.pass(Ticks(500));
    }

    fn access(&mut self, offset: u32, lanes: Lanes) -> Write {
        let mut bus =
            Bus { now: self.now, board: &mut self.slave, violations: &mut self.violations };
        self.sercom.write(&mut bus, offset, lanes)
    }

    fn write(&mut self, offset: u32, value: u32) {
        self.access(offset, Lanes::word(value)).unwrap();
    }

    fn half(&mut self, offset: u32, index: u32, value: u16) {
        self.access(offset, Lanes::new(u32::from(value), 2 * index, 2)).unwrap();
    }

    fn read(&mut self, offset: u32) -> u32 {
        self.sercom.read(self.now, offset, &self.slave).unwrap()
    }

    fn flags(&mut self) -> u32 {
        self.read(0x18) & 0xFF
    }

    fn status(&mut self) -> u16 {
        (self.read(0x18) >> 16) as u16
    }

    fn pass(&mut self, time: Ticks) {
        let until = self.now + time;
        while self.sercom.next() <= until {
            self.now = self.sercom.next();
            let mut bus =
                Bus { now: self.now, board: &mut self.slave, violations: &mut self.violations };
            self.sercom.advance(&mut bus);
        }
        self.now = until;
    }

    /// Until MB or SB, at most a millisecond at tick accuracy.
    fn wait(&mut self) -> Ticks {
        let begin = self.now;
        while self.flags() & (MB | SB) == 0 {
            assert!(self.now < begin + Ticks::from_ms(1), "no MB and no SB");
            self.pass(Ticks(1));
        }
        self.now - begin
    }

    fn command(&mut self, command: u32, nack: bool) {
        self.write(0x04, command << 16 | if nack { ACKACT } else { 0 });
    }
}

const START_W: I2cEvent = I2cEvent::Start { address: 0x29, read: false };
const START_R: I2cEvent = I2cEvent::Start { address: 0x29, read: true };

#[test]
fn registers_are_read_by_repeated_start_as_the_data_sheet_asks() {
    let mut rig = Rig::ready();
    assert_eq!(rig.status(), IDLE);
    rig.write(0x24, 0x29 << 1);
    let bit = 128 + 14;
    assert_eq!(rig.wait(), Ticks(bit * 10), "START and nine clocks");
    assert_eq!(rig.flags(), MB);
    assert_eq!(rig.status(), OWNER | CLKHOLD);
    rig.write(0x28, 0x08);
    assert_eq!(rig.flags(), 0);
    assert_eq!(rig.wait(), Ticks(bit * 9));
    // As the HAL does: clear the flags, then the repeated START.
    rig.access(0x18, Lanes::new(MB, 0, 1)).unwrap();
    rig.write(0x24, 0x29 << 1 | 1);
    assert_eq!(rig.wait(), Ticks(bit * (10 + 8)));
    assert_eq!(rig.flags(), SB);
    assert_eq!(rig.read(0x28), 0xA8);
    assert_eq!(rig.flags(), SB, "without smart mode reading DATA does nothing");
    rig.command(2, false);
    assert_eq!(rig.read(0x04), 0, "CMD reads 0");
    assert_eq!(rig.wait(), Ticks(bit * 9), "acknowledge and eight clocks");
    assert_eq!(rig.read(0x28), 0xA9);
    rig.command(3, true);
    assert_eq!(rig.read(0x04), ACKACT);
    assert_eq!(rig.flags(), 0);
    rig.pass(Ticks(bit * 5 / 2 - 1));
    assert_eq!(rig.status(), OWNER);
    rig.pass(Ticks(1));
    assert_eq!(rig.status(), IDLE);
    let events: Vec<_> = rig.slave.log.iter().map(|entry| entry.1).collect();
    assert_eq!(
        events,
        [START_W, I2cEvent::Write(8), START_R, I2cEvent::Read, I2cEvent::Read, I2cEvent::Stop]
    );
    assert_eq!(rig.violations.count, 0);
}

#[test]
fn stretching_lengthens_every_byte() {
    let mut rig = Rig::ready();
    rig.slave.stretch = Ticks::from_us(180);
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.wait(), Ticks(142 * 10 + 180 * 48));
    rig.write(0x24, 0x29 << 1 | 1);
    assert_eq!(rig.wait(), Ticks(142 * 18 + 2 * 180 * 48));
}

#[test]
fn the_bus_stays_owned_until_the_slave_lets_the_stop_through() {
    let mut rig = Rig::ready();
    rig.slave.stop_stretch = Ticks::from_us(180);
    rig.write(0x24, 0x29 << 1 | 1);
    rig.wait();
    rig.command(3, true);
    // Acknowledge bit and STOP without the slave, then its 180 us.
    rig.pass(Ticks(142 * 5 / 2 + 180 * 48 - 1));
    assert_eq!((rig.flags(), rig.status()), (0, OWNER));
    rig.pass(Ticks(1));
    assert_eq!(rig.status(), IDLE);
    let stops = rig.slave.log.iter().filter(|entry| entry.1 == I2cEvent::Stop);
    assert_eq!(stops.count(), 1, "the slave is asked once");
}

#[test]
fn an_address_written_before_a_late_stop_waits_for_it() {
    let mut rig = Rig::ready();
    rig.slave.stop_stretch = Ticks::from_us(180);
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.command(3, true);
    rig.pass(Ticks::from_us(100));
    rig.write(0x24, 0x29 << 1);
    let stop = 142 * 3 / 2 + 180 * 48 - 100 * 48;
    assert_eq!(rig.wait(), Ticks(stop + 142 * 10), "STOP, START, nine clocks");
    assert_eq!(rig.violations.count, 0);
}

#[test]
fn sda_that_sticks_before_a_late_stop_leaves_the_bus_busy() {
    let mut rig = Rig::ready();
    rig.slave.stop_stretch = Ticks::from_us(180);
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.command(3, true);
    rig.pass(Ticks::from_us(100));
    rig.slave.held.sda = true;
    rig.pass(Ticks::from_ms(1));
    assert_eq!(rig.status(), BUSY);
}

#[test]
fn a_stop_that_never_comes_ends_with_the_low_time_out() {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.sercom.set_clocks(rig.now, Some(Rate::from_hz(48_000_000)), true);
    rig.enable(LOWTOUTEN);
    rig.slave.stop_stretch = Ticks::from_ms(500);
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.command(3, true);
    rig.pass(Ticks::from_ms(29));
    assert_eq!(rig.status(), OWNER);
    rig.pass(Ticks::from_ms(2));
    assert_eq!(rig.status() & (LOWTOUT | BUSERR), LOWTOUT | BUSERR);
}

/// The slave acknowledges with the ninth clock, stretches, sends eight bits, stretches: SWRST and
/// DISABLE at any time tell where it stands.
#[test]
fn a_transfer_that_is_cut_tells_where_the_slave_stands() {
    let (bit, stretch) = (142, 9_000);
    let acknowledges = bit * 9 + bit / 2;
    let reads = bit * 10 + stretch;
    for (after, told) in [
        (acknowledges - 1, vec![]),
        (acknowledges, vec![(8, stretch)]),
        (acknowledges + bit / 2 + 100, vec![(8, stretch - 100)]),
        (reads, vec![(0, 0)]),
        (reads + bit * 3 - 1, vec![(2, 0)]),
        (reads + bit * 3, vec![(3, 0)]),
        (reads + bit * 8 + 10, vec![(8, stretch - 10)]),
        // SB: the master holds SCL, and the slave has let go of SDA.
        (reads + bit * 8 + stretch, vec![]),
    ] {
        for ctrla in [SWRST, MODE_I2C_MASTER] {
            let mut rig = Rig::ready();
            rig.slave.stretch = Ticks(stretch);
            rig.write(0x24, 0x29 << 1 | 1);
            rig.pass(Ticks(after));
            rig.write(0x00, ctrla);
            assert_eq!(rig.slave.cuts, told, "{after}");
        }
    }
}

/// Without its clock the master does not see the slave let go, which holds SCL no longer for that.
#[test]
fn a_stop_that_is_cut_leaves_the_slave_to_hold_scl() {
    for (clock, told) in [(Some(Rate::from_hz(48_000_000)), 400), (None, 500)] {
        let mut rig = Rig::ready();
        rig.slave.stop_stretch = Ticks(500);
        rig.write(0x24, 0x29 << 1);
        rig.wait();
        assert!(rig.sercom.holds_scl(rig.now), "MB");
        rig.command(3, true);
        rig.sercom.set_clocks(rig.now, clock, false);
        rig.pass(Ticks(142 * 3 / 2 + 100));
        assert!(rig.sercom.holds_scl(rig.now), "the slave");
        rig.write(0x00, SWRST);
        assert!(!rig.sercom.holds_scl(rig.now));
        assert_eq!(rig.slave.cuts, [(8, told)]);
    }
}

#[test]
fn nobody_at_the_address_gives_mb_and_rxnack_for_read_and_write() {
    for read in [0, 1] {
        let mut rig = Rig::ready();
        rig.write(0x24, 0x28 << 1 | read);
        rig.wait();
        assert_eq!(rig.flags(), MB);
        assert_eq!(rig.status(), OWNER | CLKHOLD | RXNACK);
        rig.command(3, true);
        rig.pass(Ticks::from_us(20));
        assert_eq!(rig.status(), IDLE | RXNACK);
    }
}

#[test]
fn an_address_on_an_unknown_bus_is_a_bus_error() {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.write(0x00, MODE_I2C_MASTER | ENABLE);
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.flags(), MB | ERROR);
    assert_eq!(rig.status(), BUSERR);
    assert_eq!(rig.slave.log, []);
}

#[test]
fn busstate_is_forced_from_unknown_only() {
    let mut rig = Rig::ready();
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.half(0x18, 1, IDLE);
    assert_eq!(rig.status() & BUSY, OWNER);
    assert_eq!(rig.violations.count, 1);
}

#[test]
fn scl_held_low_never_gives_mb_and_goes_on_when_let_go() {
    let mut rig = Rig::ready();
    rig.slave.held.scl = true;
    rig.write(0x24, 0x29 << 1);
    rig.pass(Ticks::from_ms(500));
    assert_eq!((rig.flags(), rig.status()), (0, OWNER));
    rig.slave.held.scl = false;
    rig.pass(Ticks::from_us(50));
    assert_eq!(rig.flags(), MB);
}

#[test]
fn low_time_out_needs_the_slow_clock() {
    for slow in [false, true] {
        let mut rig = Rig::new(Ticks::ZERO);
        rig.sercom.set_clocks(rig.now, Some(Rate::from_hz(48_000_000)), slow);
        rig.enable(LOWTOUTEN);
        rig.slave.held.scl = true;
        rig.write(0x24, 0x29 << 1);
        rig.pass(Ticks::from_ms(29));
        assert_eq!(rig.flags(), 0);
        rig.pass(Ticks::from_ms(2));
        let (flags, status) = if slow { (MB | ERROR, BUSY | LOWTOUT | BUSERR) } else { (0, OWNER) };
        assert_eq!((rig.flags(), rig.status()), (flags, status));
    }
}

#[test]
fn sda_stuck_in_a_transfer_loses_arbitration_and_idle_comes_with_its_release() {
    let mut rig = Rig::ready();
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.slave.held.sda = true;
    rig.write(0x28, 0x08);
    rig.pass(Ticks::from_us(30));
    assert_eq!(rig.flags(), MB | ERROR);
    assert_eq!(rig.status(), BUSY | ARBLOST);
    rig.write(0x24, 0x29 << 1);
    rig.pass(Ticks::from_ms(50));
    assert_eq!((rig.flags() & MB, rig.status()), (0, BUSY));
    rig.slave.held.sda = false;
    rig.pass(Ticks::from_us(60));
    assert_eq!(rig.flags() & MB, MB, "the waiting address went out");
}

#[test]
fn sda_falling_on_an_idle_bus_makes_it_busy() {
    let mut rig = Rig::ready();
    rig.slave.held.sda = true;
    assert_eq!(rig.status(), BUSY);
    rig.slave.held.sda = false;
    assert_eq!(rig.status(), IDLE);
}

#[test]
fn sda_stuck_from_the_start_loses_arbitration_at_the_first_one() {
    let mut rig = Rig::new(Ticks::ZERO);
    rig.slave.held.sda = true;
    rig.enable(0);
    rig.write(0x24, 0x29 << 1);
    rig.pass(Ticks::from_us(30));
    assert_eq!(rig.flags(), MB | ERROR);
    assert_eq!(rig.status(), BUSY | ARBLOST);
    // Off and on again, with SDA let go, the bus is there.
    rig.write(0x00, MODE_I2C_MASTER);
    rig.slave.held.sda = false;
    rig.enable(0);
    assert_eq!(rig.status() & BUSY, IDLE);
}

#[test]
fn a_stop_against_a_stuck_sda_leaves_the_bus_busy() {
    let mut rig = Rig::ready();
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    rig.slave.held.sda = true;
    rig.command(3, true);
    rig.pass(Ticks::from_ms(1));
    assert_eq!(rig.status(), BUSY);
    assert!(!rig.slave.log.iter().any(|entry| entry.1 == I2cEvent::Stop));
}

#[test]
fn a_glitch_is_a_bus_error() {
    let mut rig = Rig::ready();
    rig.slave.glitch = true;
    rig.write(0x24, 0x29 << 1);
    rig.wait();
    assert_eq!(rig.flags(), MB | ERROR);
    assert_eq!(rig.status(), BUSY | BUSERR);
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.status(), BUSY, "writing ADDR clears BUSERR");
}

#[test]
fn wrong_states_are_ignored_and_noted() {
    let mut rig = Rig::ready();
    rig.command(3, true);
    rig.write(0x28, 1);
    assert_eq!(rig.violations.count, 2);
    rig.write(0x24, 0x29 << 1);
    rig.pass(Ticks(100));
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.violations.count, 3);
    rig.wait();
    rig.command(2, false);
    assert_eq!(rig.violations.count, 4);
    assert_eq!(rig.flags(), MB);
    assert_eq!(rig.slave.log.len(), 1);
}

#[test]
fn a_second_operation_while_sysop_synchronises_is_discarded() {
    let mut rig = Rig::new(Ticks(300));
    rig.enable(0);
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.read(0x1C), 1 << busy::SYSOP);
    rig.wait();
    rig.write(0x28, 0x10);
    rig.pass(Ticks(10));
    rig.write(0x28, 0x20);
    rig.wait();
    assert_eq!(rig.violations.count, 1);
    assert_eq!(rig.slave.log.last().unwrap().1, I2cEvent::Write(0x10));
}

#[test]
fn interrupts_follow_flags_and_enables() {
    let mut rig = Rig::ready();
    rig.access(0x14, Lanes::new(MB | SB | ERROR, 2, 1)).unwrap();
    rig.write(0x24, 0x29 << 1);
    assert_eq!(rig.sercom.interrupts.irq(), 0);
    rig.wait();
    assert_eq!(rig.sercom.interrupts.irq(), 1 << 13);
    rig.access(0x14, Lanes::new(MB, 0, 1)).unwrap();
    assert_eq!(rig.sercom.interrupts.irq(), 0);
}

#[test]
fn other_modes_and_sercoms_without_the_buss_pads_do_not_reach_the_bus() {
    let mut rig = Rig::new(Ticks::ZERO);
    assert!(rig.access(0x00, Lanes::word(3 << 2)).is_err());
    let mut rig = Rig::new(Ticks::ZERO);
    rig.sercom.connected = false;
    rig.enable(0);
    assert_eq!(rig.violations.count, 1);
    rig.write(0x24, 0x29 << 1);
    rig.pass(Ticks::from_ms(1));
    assert_eq!((rig.flags(), rig.slave.log.len()), (MB, 0));
    assert_eq!(rig.sercom.status & RXNACK, RXNACK);
}

/// 115,200 baud at 48 MHz: BAUD 63,019 makes a bit of 416.6 cycles, as drivers compute it. Two
/// bytes wait in DATA and behind it; a third must wait for DRE.
#[test]
fn a_usart_sends_and_receives_byte_by_byte() {
    const DRE: u32 = 1;
    const TXC: u32 = 2;
    const RXC: u32 = 4;
    let mut rig = Rig::new(Ticks::ZERO);
    rig.write(0x00, SWRST);
    rig.write(0x00, MODE_USART | 1 << 20 | 1 << 30);
    rig.half(0x0C, 0, 63_019);
    rig.write(0x04, 1 << 16 | 1 << 17);
    assert_eq!(rig.flags(), 0, "not enabled");
    rig.write(0x00, MODE_USART | 1 << 20 | 1 << 30 | ENABLE);
    assert_eq!(rig.flags(), DRE);
    rig.write(0x16 & !3, (DRE | RXC) << 16);
    assert_ne!(rig.sercom.irq(), 0);
    rig.write(0x28, 0x55);
    assert_eq!(rig.flags(), DRE, "one is sent, another may follow");
    rig.write(0x28, 0x0A);
    assert_eq!((rig.flags(), rig.sercom.irq()), (0, 0));
    let begun = rig.now.0;
    rig.slave.incoming = vec![7];
    rig.pass(Ticks(4_169));
    assert_eq!(rig.flags(), DRE | RXC);
    assert_eq!((rig.read(0x28), rig.flags()), (7, DRE));
    rig.pass(Ticks(4_169));
    assert_eq!(rig.flags(), DRE | TXC);
    let sent: Vec<_> = rig.slave.sent.iter().map(|(at, byte)| (at - begun, *byte)).collect();
    assert_eq!(sent, [(4_166, 0x55), (8_332, 0x0A)]);
    // What is not taken in time is kept, and what comes behind it is lost.
    rig.slave.incoming = vec![9, 8];
    rig.pass(Ticks(2 * 4_169));
    assert_eq!((rig.status() & 4, rig.read(0x28)), (4, 8));
    rig.write(0x00, MODE_USART | 1 << 20 | 1 << 30);
    assert_eq!((rig.flags(), rig.sercom.next()), (0, Ticks::NEVER));
}
