//! PORT: pins, their multiplexers, and the lines of the I2C bus.
//!
//! Two groups, A at 00 and B at 80; the same registers at 0x6000_0000 (IOBUS).
//!
//! | offset | register | behaviour |
//! |---|---|---|
//! | 00-0C | DIR, DIRCLR, DIRSET, DIRTGL | direction |
//! | 10-1C | OUT, OUTCLR, OUTSET, OUTTGL | level, or the direction of the pull |
//! | 20 | IN | level at pins with INEN, 0 elsewhere |
//! | 24 | CTRL | stored |
//! | 28 | WRCONFIG | writes PINCFG and PMUX of up to 16 pins |
//! | 30-3F | PMUX | function of each pin |
//! | 40-5F | PINCFG | PMUXEN, INEN, PULLEN, DRVSTR |
//!
//! A pin is driven by the function that its multiplexer selects (TCC waveforms), else by DIR and
//! OUT, else it is released: then what the board drives decides, then its pull, then it is low.
//! The I2C lines have pull-ups on the board and are wired-AND with what others hold low.
//!
//! | left out | why |
//! |---|---|
//! | input synchroniser and its two cycles | far below what firmware can see |
//! | TC waveforms | our timers TC3-TC5 are time bases: routing one to a pin faults |
//! | analogue functions, drive strength, continuous sampling | no model depends on them |

use super::access::{Bus, DONE, Lanes, RESERVED, Read, Refusal, Write};
use crate::board::{Board, Pin, Ticks};

const PMUXEN: u8 = 1 << 0;
const INEN: u8 = 1 << 1;
const PULLEN: u8 = 1 << 2;

/// SERCOM's second choice of pads.
const FUNCTION_D: u8 = 3;
/// Timer waveforms, two choices.
const FUNCTION_E: u8 = 4;
const FUNCTION_F: u8 = 5;
/// USB pads.
const FUNCTION_G: u8 = 6;

/// A waveform output of a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Waveform {
    /// Output `1` of TCC `0`.
    Tcc(u8, u8),
    /// One of a TC's outputs.
    Tc,
}

#[derive(Clone, Debug)]
struct Group {
    dir: u32,
    out: u32,
    ctrl: u32,
    pmux: [u8; 16],
    pincfg: [u8; 32],
    /// Levels last told to the board.
    level: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Port {
    groups: [Group; 2],
    /// Levels of each TCC's outputs, `None` while it drives none.
    waveforms: [Option<u8>; 3],
    /// Where each TCC's outputs are routed: changes with the multiplexers.
    routes: Vec<(Pin, u8)>,
    /// A reset has changed levels that the board does not know of.
    unpublished: bool,
}

impl Port {
    pub(crate) fn new() -> Self {
        let group = Group {
            dir: 0,
            out: 0,
            ctrl: 0,
            pmux: [0; 16],
            pincfg: [0; 32],
            level: 0,
        };
        let mut port = Self {
            groups: [group.clone(), group],
            waveforms: [None; 3],
            routes: Vec::new(),
            unpublished: false,
        };
        // The board's pull-ups.
        port.groups[1].level = 1 << Pin::I2C_SDA.index | 1 << Pin::I2C_SCL.index;
        port
    }

    /// Registers as after a reset; the board is yet to learn of the pins that thereby change.
    pub(crate) fn reset(&mut self) {
        let levels = [self.groups[0].level, self.groups[1].level];
        *self = Self::new();
        for (group, level) in self.groups.iter_mut().zip(levels) {
            group.level = level;
        }
        self.unpublished = true;
    }

    /// Tells the board what a reset has changed.
    pub(crate) fn publish_pending(&mut self, now: Ticks, board: &mut dyn Board) {
        if self.unpublished {
            self.unpublished = false;
            self.publish_group(now, 0, u32::MAX, board);
            self.publish_group(now, 1, u32::MAX, board);
        }
    }

    /// Whether the pads of the I2C bus belong to SERCOM4.
    pub(crate) fn i2c_routed(&self) -> bool {
        [Pin::I2C_SDA, Pin::I2C_SCL]
            .iter()
            .all(|&pin| self.function(pin) == Some(FUNCTION_D))
    }

    /// Whether PA24 and PA25 belong to USB.
    pub(crate) fn usb_routed(&self) -> bool {
        [Pin::a(24), Pin::a(25)]
            .iter()
            .all(|&pin| self.function(pin) == Some(FUNCTION_G))
    }

    /// The multiplexer's choice for external interrupts.
    pub(crate) fn interrupt_routed(&self, pin: Pin) -> bool {
        self.function(pin) == Some(0)
    }

    /// TCC `tcc` drives `levels` (bit n = WO\[n\]) from now on, or nothing.
    pub(crate) fn drive(&mut self, now: Ticks, tcc: u8, levels: Option<u8>, board: &mut dyn Board) {
        if self.waveforms[usize::from(tcc)] == levels {
            return;
        }
        self.waveforms[usize::from(tcc)] = levels;
        for index in 0..self.routes.len() {
            let (pin, source) = self.routes[index];
            if source == tcc {
                self.publish(now, pin, board);
            }
        }
    }

    /// The level at a pin.
    pub(crate) fn level(&self, now: Ticks, pin: Pin, board: &dyn Board) -> bool {
        if pin == Pin::I2C_SDA || pin == Pin::I2C_SCL {
            let held = board.i2c_held_low(now);
            let low = if pin == Pin::I2C_SDA {
                held.sda
            } else {
                held.scl
            };
            return !low && self.driven(pin).unwrap_or(true);
        }
        self.driven(pin)
            .or_else(|| board.input(now, pin))
            .or_else(|| self.pull(pin))
            .unwrap_or(false)
    }

    fn function(&self, pin: Pin) -> Option<u8> {
        let group = &self.groups[usize::from(pin.group)];
        let index = usize::from(pin.index);
        (group.pincfg[index] & PMUXEN != 0)
            .then(|| group.pmux[index / 2] >> (4 * (index & 1)) & 0xF)
    }

    /// The level that the chip drives, `None` if it releases the pin.
    fn driven(&self, pin: Pin) -> Option<bool> {
        if let Some(function) = self.function(pin) {
            return match waveform(pin, function) {
                Some(Waveform::Tcc(tcc, output)) => {
                    self.waveforms[usize::from(tcc)].map(|levels| levels >> output & 1 != 0)
                }
                _ => None,
            };
        }
        let group = &self.groups[usize::from(pin.group)];
        (group.dir >> pin.index & 1 != 0).then(|| group.out >> pin.index & 1 != 0)
    }

    fn pull(&self, pin: Pin) -> Option<bool> {
        let group = &self.groups[usize::from(pin.group)];
        (group.pincfg[usize::from(pin.index)] & PULLEN != 0)
            .then(|| group.out >> pin.index & 1 != 0)
    }

    /// Tells the board if the pin's level, as the chip makes it, has changed.
    fn publish(&mut self, now: Ticks, pin: Pin, board: &mut dyn Board) {
        let i2c = pin == Pin::I2C_SDA || pin == Pin::I2C_SCL;
        let level = match self.driven(pin) {
            Some(level) => level,
            None if i2c => true,
            None => self.pull(pin).unwrap_or(false),
        };
        let group = &mut self.groups[usize::from(pin.group)];
        let mask = 1 << pin.index;
        if (group.level & mask != 0) != level {
            group.level ^= mask;
            board.pin(now, pin, level);
        }
    }

    fn publish_group(&mut self, now: Ticks, group: u8, mask: u32, board: &mut dyn Board) {
        let mut rest = mask;
        while rest != 0 {
            let index = rest.trailing_zeros() as u8;
            rest &= rest - 1;
            self.publish(now, Pin { group, index }, board);
        }
    }

    /// `offset` counts over both groups.
    pub(crate) fn read(&self, now: Ticks, offset: u32, board: &dyn Board) -> Read {
        let index = group_of(offset)?;
        let group = &self.groups[usize::from(index)];
        Ok(match offset & 0x7F {
            0x00..=0x0C => group.dir,
            0x10..=0x1C => group.out,
            0x20 => (0..32).fold(0, |levels, pin| {
                let pin = Pin {
                    group: index,
                    index: pin,
                };
                let sampled = group.pincfg[usize::from(pin.index)] & INEN != 0;
                levels | u32::from(sampled && self.level(now, pin, board)) << pin.index
            }),
            0x24 => group.ctrl,
            0x28 => 0,
            at @ 0x30..=0x3C => word(&group.pmux, at - 0x30),
            at @ 0x40..=0x5C => word(&group.pincfg, at - 0x40),
            _ => return Err(RESERVED),
        })
    }

    /// `offset` counts over both groups.
    pub(crate) fn write(&mut self, bus: &mut Bus<'_>, offset: u32, lanes: Lanes) -> Write {
        let index = group_of(offset)?;
        let group = &mut self.groups[usize::from(index)];
        let before = (group.dir, group.out);
        match offset & 0x7F {
            0x00 => group.dir = lanes.merge(group.dir),
            0x04 => group.dir &= !lanes.bits(),
            0x08 => group.dir |= lanes.bits(),
            0x0C => group.dir ^= lanes.bits(),
            0x10 => group.out = lanes.merge(group.out),
            0x14 => group.out &= !lanes.bits(),
            0x18 => group.out |= lanes.bits(),
            0x1C => group.out ^= lanes.bits(),
            0x20 => {}
            0x24 => group.ctrl = lanes.merge(group.ctrl),
            0x28 => {
                let pins = self.write_configuration(index, lanes.merge(0));
                return self.reroute(bus, index, pins);
            }
            at @ 0x30..=0x3C => {
                for byte in 0..4 {
                    if let Some(value) = lanes.byte(byte) {
                        group.pmux[(at - 0x30 + byte) as usize] = value;
                    }
                }
                return self.reroute(bus, index, 0xFF << ((at - 0x30) * 2));
            }
            at @ 0x40..=0x5C => {
                for byte in 0..4 {
                    if let Some(value) = lanes.byte(byte) {
                        group.pincfg[(at - 0x40 + byte) as usize] = value & 0x47;
                    }
                }
                return self.reroute(bus, index, 0xF << (at - 0x40));
            }
            _ => return Err(RESERVED),
        }
        let changed = (before.0 ^ group.dir) | (before.1 ^ group.out);
        self.publish_group(bus.now, index, changed, bus.board);
        DONE
    }

    /// WRCONFIG; gives the mask of the pins concerned.
    fn write_configuration(&mut self, index: u8, value: u32) -> u32 {
        let group = &mut self.groups[usize::from(index)];
        let half = value >> 31;
        let pins = (value & 0xFFFF) << (16 * half);
        for pin in (0..32).filter(|pin| pins >> pin & 1 != 0) {
            if value >> 30 & 1 != 0 {
                group.pincfg[pin] = (value >> 16 & 0x47) as u8;
            }
            if value >> 28 & 1 != 0 {
                let shift = 4 * (pin & 1);
                let function = (value >> 24 & 0xF) as u8;
                let pmux = &mut group.pmux[pin / 2];
                *pmux = *pmux & !(0xF << shift) | function << shift;
            }
        }
        pins
    }

    /// The multiplexers of `pins` of a group may have changed.
    fn reroute(&mut self, bus: &mut Bus<'_>, group: u8, pins: u32) -> Write {
        self.routes.retain(|(pin, _)| pin.group != group);
        for index in 0..32 {
            let pin = Pin { group, index };
            let Some(function) = self.function(pin) else {
                continue;
            };
            match waveform(pin, function) {
                Some(Waveform::Tcc(tcc, _)) => self.routes.push((pin, tcc)),
                Some(Waveform::Tc) => return Err(Refusal::Unmodelled("a TC waveform on a pin")),
                None => {}
            }
        }
        self.publish_group(bus.now, group, pins, bus.board);
        DONE
    }
}

fn group_of(offset: u32) -> Result<u8, Refusal> {
    match offset {
        0x00..=0x7F => Ok(0),
        0x80..=0xFF => Ok(1),
        _ => Err(RESERVED),
    }
}

/// Four bytes of a byte array as a register word.
fn word(bytes: &[u8], start: u32) -> u32 {
    (0..4).fold(0, |word, byte| {
        word | u32::from(bytes[(start + byte) as usize]) << (8 * byte)
    })
}

/// What functions E and F of a pin are (I/O multiplexing table, G variant).
fn waveform(pin: Pin, function: u8) -> Option<Waveform> {
    use Waveform::{Tc, Tcc};
    let Pin { group, index } = pin;
    match (function, group, index) {
        (FUNCTION_E, 0, 0 | 1) => Some(Tcc(2, index)),
        (FUNCTION_E, 0, 4 | 5) => Some(Tcc(0, index - 4)),
        (FUNCTION_E, 0, 6 | 7) => Some(Tcc(1, index - 6)),
        (FUNCTION_E, 0, 8 | 9) => Some(Tcc(0, index - 8)),
        (FUNCTION_E, 0, 10 | 11) => Some(Tcc(1, index - 10)),
        (FUNCTION_E, 0, 12 | 13) => Some(Tcc(2, index - 12)),
        (FUNCTION_E, 0, 16 | 17) => Some(Tcc(2, index - 16)),
        (FUNCTION_E, 0, 30 | 31) => Some(Tcc(1, index - 30)),
        (FUNCTION_E, 0, 14 | 15 | 18..=25) => Some(Tc),
        (FUNCTION_E, 1, 2 | 3 | 8..=11 | 22 | 23) => Some(Tc),
        (FUNCTION_F, 0, 8 | 9) => Some(Tcc(1, index - 6)),
        (FUNCTION_F, 0, 10 | 11) => Some(Tcc(0, index - 8)),
        (FUNCTION_F, 0, 12 | 13) => Some(Tcc(0, index - 6)),
        (FUNCTION_F, 0, 14 | 15) => Some(Tcc(0, index - 10)),
        (FUNCTION_F, 0, 16 | 17) => Some(Tcc(0, index - 10)),
        (FUNCTION_F, 0, 18 | 19) => Some(Tcc(0, index - 16)),
        (FUNCTION_F, 0, 20 | 21) => Some(Tcc(0, index - 14)),
        (FUNCTION_F, 0, 22 | 23) => Some(Tcc(0, index - 18)),
        (FUNCTION_F, 0, 24 | 25) => Some(Tcc(1, index - 22)),
        (FUNCTION_F, 1, 10 | 11) => Some(Tcc(0, index - 6)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{I2cEvent, I2cReply, Lines, Unconnected};
    use crate::peripherals::violations::Violations;

    /// Records edges; drives one pin; holds one line.
    #[derive(Default)]
    struct Probe {
        edges: Vec<(u64, String, bool)>,
        driven: Option<(Pin, bool)>,
        held: Lines,
    }

    impl Board for Probe {
        fn i2c(&mut self, _now: Ticks, _event: I2cEvent) -> I2cReply {
            I2cReply::NAK
        }
        fn i2c_held_low(&self, _now: Ticks) -> Lines {
            self.held
        }
        fn pin(&mut self, now: Ticks, pin: Pin, level: bool) {
            self.edges.push((now.0, pin.to_string(), level));
        }
        fn input(&self, _now: Ticks, pin: Pin) -> Option<bool> {
            self.driven
                .and_then(|(driven, level)| (driven == pin).then_some(level))
        }
    }

    fn write(port: &mut Port, probe: &mut Probe, now: u64, offset: u32, lanes: Lanes) {
        let mut bus = Bus {
            now: Ticks(now),
            board: probe,
            violations: &mut Violations::default(),
        };
        port.write(&mut bus, offset, lanes).unwrap();
    }

    /// WRCONFIG as the HAL writes it for one pin.
    fn configuration(pin: u8, pmux: u32, pincfg: u32) -> Lanes {
        let half = u32::from(pin >> 4);
        Lanes::word(half << 31 | 1 << 30 | 1 << 28 | pmux << 24 | pincfg << 16 | 1 << (pin & 15))
    }

    #[test]
    fn outputs_reach_the_board_as_edges() {
        let mut port = Port::new();
        let mut probe = Probe::default();
        write(&mut port, &mut probe, 10, 0x18, Lanes::word(1 << 7));
        assert_eq!(probe.edges, [], "OUT without DIR drives nothing");
        write(&mut port, &mut probe, 20, 0x08, Lanes::word(1 << 7));
        write(&mut port, &mut probe, 30, 0x1C, Lanes::word(1 << 7));
        write(&mut port, &mut probe, 40, 0x18, Lanes::new(0x80, 0, 1));
        let edge = |at, level| (at, "PA07".to_string(), level);
        assert_eq!(
            probe.edges,
            [edge(20, true), edge(30, false), edge(40, true)]
        );
    }

    #[test]
    fn inputs_need_inen_and_see_board_then_pull() {
        let mut port = Port::new();
        let mut probe = Probe::default();
        let pin = Pin::a(27);
        probe.driven = Some((pin, true));
        let read = |port: &Port, probe: &Probe| port.read(Ticks(0), 0x20, probe).unwrap() >> 27 & 1;
        assert_eq!(read(&port, &probe), 0, "INEN is off");
        write(
            &mut port,
            &mut probe,
            0,
            0x28,
            configuration(27, 0, u32::from(INEN)),
        );
        assert_eq!(read(&port, &probe), 1);
        probe.driven = None;
        assert_eq!(read(&port, &probe), 0);
        let pulled = u32::from(INEN | PULLEN);
        write(&mut port, &mut probe, 0, 0x28, configuration(27, 0, pulled));
        write(&mut port, &mut probe, 0, 0x18, Lanes::word(1 << 27));
        assert_eq!(read(&port, &probe), 1);
    }

    #[test]
    fn a_tcc_drives_only_the_pins_routed_to_it() {
        let mut port = Port::new();
        let mut probe = Probe::default();
        port.drive(Ticks(1), 0, Some(1 << 5), &mut probe);
        assert_eq!(probe.edges, []);
        // PB11 to TCC0/WO[5], PB10 to TCC0/WO[4].
        write(&mut port, &mut probe, 2, 0xA8, configuration(11, 5, 1));
        write(&mut port, &mut probe, 3, 0xA8, configuration(10, 5, 1));
        port.drive(Ticks(4), 0, Some(1 << 4), &mut probe);
        port.drive(Ticks(5), 0, None, &mut probe);
        let edge = |at, pin: &str, level| (at, pin.to_string(), level);
        assert_eq!(
            probe.edges,
            [
                edge(2, "PB11", true),
                edge(4, "PB10", true),
                edge(4, "PB11", false),
                edge(5, "PB10", false)
            ]
        );
        assert_eq!(port.read(Ticks(5), 0xB4, &Unconnected).unwrap() >> 8, 0x55);
    }

    #[test]
    fn the_i2c_lines_are_wired_and() {
        let mut port = Port::new();
        let mut probe = Probe::default();
        write(
            &mut port,
            &mut probe,
            0,
            0xA8,
            configuration(8, 0, u32::from(INEN)),
        );
        write(
            &mut port,
            &mut probe,
            0,
            0xA8,
            configuration(9, 0, u32::from(INEN)),
        );
        let read = |port: &Port, probe: &Probe| port.read(Ticks(0), 0xA0, probe).unwrap() >> 8 & 3;
        assert_eq!(read(&port, &probe), 0b11, "the board's pull-ups");
        probe.held.sda = true;
        assert_eq!(read(&port, &probe), 0b10);
        // A recovery clock: SCL low by DIR, then released.
        write(&mut port, &mut probe, 7, 0x88, Lanes::word(1 << 9));
        assert_eq!(read(&port, &probe), 0b00);
        write(&mut port, &mut probe, 9, 0x84, Lanes::word(1 << 9));
        assert_eq!(read(&port, &probe), 0b10);
        let edge = |at, level| (at, "PB09".to_string(), level);
        assert_eq!(probe.edges, [edge(7, false), edge(9, true)]);
    }

    #[test]
    fn routing_a_tc_to_a_pin_is_loud() {
        let mut port = Port::new();
        let mut bus = Bus {
            now: Ticks(0),
            board: &mut Unconnected,
            violations: &mut Violations::default(),
        };
        let lanes = configuration(18, 4, 1);
        assert!(port.write(&mut bus, 0x28, lanes).is_err());
    }

    #[test]
    fn sercom4_owns_the_bus_with_function_d_on_both_pads() {
        let mut port = Port::new();
        let mut probe = Probe::default();
        write(&mut port, &mut probe, 0, 0xA8, configuration(8, 3, 1));
        assert!(!port.i2c_routed());
        write(&mut port, &mut probe, 0, 0xA8, configuration(9, 3, 1));
        assert!(port.i2c_routed());
    }
}
