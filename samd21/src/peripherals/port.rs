//! PORT: pins, their multiplexers, and the lines of the board's I2C bus.
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
//! The pins that the board names as its I2C lines have pull-ups there and are wired-AND with what
//! others hold low.
//!
//! | left out | why |
//! |---|---|
//! | input synchroniser and its two cycles | far below what firmware can see |
//! | TC waveforms | TC3 to TC5 are modelled as time bases: routing one to a pin faults |
//! | analogue functions, drive strength, continuous sampling | no model depends on them |

use super::access::{Bus, DONE, Lanes, RESERVED, Read, Refusal, Write};
use super::multiplexer::{FUNCTION_A, FUNCTION_G, Waveform, sercom_pad, waveform};
use crate::board::{Board, I2cPins, Pin, Ticks};

const PMUXEN: u8 = 1 << 0;
const INEN: u8 = 1 << 1;
const PULLEN: u8 = 1 << 2;

#[derive(Clone, Debug, Default)]
struct Group {
    dir: u32,
    out: u32,
    ctrl: u32,
    pmux: [u8; 16],
    pincfg: [u8; 32],
}

/// What a timer drives its outputs WO\[0\] to WO\[7\] to, bit n for output n: those in `driven` to
/// their level in `high`. The others are released.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Waveforms {
    pub(crate) high: u8,
    pub(crate) driven: u8,
}

impl Waveforms {
    /// The level of an output, `None` if it is released.
    pub(crate) fn level(self, output: u8) -> Option<bool> {
        (self.driven >> output & 1 != 0).then_some(self.high >> output & 1 != 0)
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Port {
    groups: [Group; 2],
    /// What each TCC drives.
    waveforms: [Waveforms; 3],
    /// Where each TCC's outputs are routed: changes with the multiplexers.
    routes: Vec<(Pin, u8)>,
    /// Pins of each group that lead to a TC's waveform, which is never driven.
    to_tc: [u32; 2],
    /// Pins whose level, as the board knows it, is not their level at power-on; of each group.
    changed: [u32; 2],
    /// A reset has changed levels that the board does not know of.
    unpublished: bool,
}

impl Port {
    /// All pins.
    pub(crate) fn pins() -> impl Iterator<Item = Pin> {
        (0..64).map(|number| Pin { group: number / 32, index: number % 32 })
    }

    /// Registers as after a reset; the board is yet to learn of the pins that thereby change.
    pub(crate) fn reset(&mut self) {
        *self = Self { changed: self.changed, unpublished: true, ..Self::default() };
    }

    /// Tells the board what a reset has changed.
    pub(crate) fn publish_pending(&mut self, now: Ticks, board: &mut dyn Board) {
        if self.unpublished {
            self.unpublished = false;
            self.publish_group(now, 0, u32::MAX, board);
            self.publish_group(now, 1, u32::MAX, board);
        }
    }

    /// The SERCOM whose pads 0 (SDA) and 1 (SCL) lead to the lines of the board's I2C bus.
    pub(crate) fn i2c_master(&self, lines: I2cPins) -> Option<usize> {
        let pad = |pin| sercom_pad(pin, self.function(pin)?);
        match (pad(lines.sda)?, pad(lines.scl)?) {
            ((sercom, 0), (same, 1)) if sercom == same => Some(sercom),
            _ => None,
        }
    }

    /// Whether PA24 and PA25 belong to USB.
    pub(crate) fn usb_routed(&self) -> bool {
        [Pin::a(24), Pin::a(25)].iter().all(|&pin| self.function(pin) == Some(FUNCTION_G))
    }

    /// The multiplexer's choice for external interrupts.
    pub(crate) fn interrupt_routed(&self, pin: Pin) -> bool {
        self.function(pin) == Some(FUNCTION_A)
    }

    /// TCC `tcc` drives `waveforms` from now on.
    pub(crate) fn drive(
        &mut self,
        now: Ticks,
        tcc: u8,
        waveforms: Waveforms,
        board: &mut dyn Board,
    ) {
        let before = std::mem::replace(&mut self.waveforms[usize::from(tcc)], waveforms);
        if before == waveforms {
            return;
        }
        for index in 0..self.routes.len() {
            let (pin, source) = self.routes[index];
            if source == tcc {
                self.publish(now, pin, board);
            }
        }
    }

    /// The level at a pin.
    pub(crate) fn level(&self, now: Ticks, pin: Pin, board: &dyn Board) -> bool {
        if let Some(lines) = board.i2c_pins()
            && lines.contain(pin)
        {
            let held = board.i2c_held_low(now);
            let low = if pin == lines.sda { held.sda } else { held.scl };
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
                Some(Waveform::Tcc(tcc, output)) => self.waveforms[usize::from(tcc)].level(output),
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
        let i2c = board.i2c_pins().is_some_and(|lines| lines.contain(pin));
        let level = match self.driven(pin) {
            Some(level) => level,
            None if i2c => true,
            None => self.pull(pin).unwrap_or(false),
        };
        let changed = &mut self.changed[usize::from(pin.group)];
        let mask = 1 << pin.index;
        // At power-on the I2C lines are high and all others low.
        let known = (*changed & mask != 0) != i2c;
        if known != level {
            *changed ^= mask;
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
                let pin = Pin { group: index, index: pin };
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
                lanes.store(&mut group.pmux[(at - 0x30) as usize..], 0xFF);
                return self.reroute(bus, index, 0xFF << ((at - 0x30) * 2));
            }
            at @ 0x40..=0x5C => {
                lanes.store(&mut group.pincfg[(at - 0x40) as usize..], 0x47);
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

    /// The multiplexers of `pins` of a group may have changed. Whoever leads a pin to a TC's
    /// waveform is refused, behind the change: a pin that a flipped bit has led there is released.
    fn reroute(&mut self, bus: &mut Bus<'_>, group: u8, pins: u32) -> Write {
        self.routes.retain(|(pin, _)| pin.group != group);
        let before = std::mem::take(&mut self.to_tc[usize::from(group)]);
        for index in 0..32 {
            let pin = Pin { group, index };
            let Some(function) = self.function(pin) else {
                continue;
            };
            match waveform(pin, function) {
                Some(Waveform::Tcc(tcc, _)) => self.routes.push((pin, tcc)),
                Some(Waveform::Tc) => self.to_tc[usize::from(group)] |= 1 << index,
                None => {}
            }
        }
        self.publish_group(bus.now, group, pins, bus.board);
        if self.to_tc[usize::from(group)] & !before != 0 {
            return Err(Refusal::Unmodelled("a TC waveform on a pin"));
        }
        DONE
    }
}

/// The bit of the register at `offset` that shows the level at `pin`, if any does.
pub(crate) fn input_mask(pin: Pin, offset: u32) -> u32 {
    if offset == 0x80 * u32::from(pin.group) + 0x20 { 1 << pin.index } else { 0 }
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
    (0..4).fold(0, |word, byte| word | u32::from(bytes[(start + byte) as usize]) << (8 * byte))
}

#[cfg(test)]
mod tests;
