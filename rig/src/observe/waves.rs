//! The sensor's bus, the servos' pins and the probe pin, as a logic analyser records them: edges in
//! a VCD file (IEEE 1364-2005, 18.2), which sigrok and GTKWave open.
//!
//! The emulated bus knows bytes, when each began or ended, and for how long the sensor held the
//! clock. This module makes the edges of them, with the master's bit time: each bit has a low half
//! of the clock and a high half, and data change within the low half. Between two bytes master or
//! sensor hold the clock low. Lines that a fault holds low are not shown.

use crate::wiring::Wiring;
use samd21::board::{I2cEvent, I2cReply, Pin, Ticks};
use std::io;
use vcd::{IdCode, SimulationCommand, TimescaleUnit, Value};

/// The signals: data and clock of the bus, then the other pins.
const NAMES: [&str; 5] = ["sda", "scl", "servo", "servo2", "probe"];
const SDA: usize = 0;
const SCL: usize = 1;
/// The bit time where no byte shows it: 400 kHz.
const BIT: Ticks = Ticks(120);

/// What was recorded.
#[derive(Clone, Debug, Default)]
pub struct Waves {
    bus: Vec<(Ticks, I2cEvent, I2cReply)>,
    pins: Vec<Edge>,
}

/// When, which of [`NAMES`], and its level from then on.
type Edge = (Ticks, usize, bool);

impl Waves {
    /// Begins anew.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    /// What the master did on the bus, and the sensor's answer.
    pub(crate) fn i2c(&mut self, now: Ticks, event: I2cEvent, reply: I2cReply) {
        self.bus.push((now, event, reply));
    }

    /// An edge at a pin of the chip.
    pub(crate) fn pin(&mut self, now: Ticks, pin: Pin, level: bool, wiring: &Wiring) {
        let [servo, servo2] = wiring.servos;
        let signals = [servo, servo2, wiring.probe].into_iter().zip(2..);
        let found = signals.clone().find(|(place, _)| *place == pin);
        self.pins.extend(found.map(|(_, signal)| (now, signal, level)));
    }

    /// Writes the VCD file.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, out: impl io::Write) -> io::Result<()> {
        let mut edges = self.bus_edges();
        edges.extend(&self.pins);
        // Stable: of one instant, in the order in which they were made.
        edges.sort_by_key(|(at, ..)| *at);
        let mut out = vcd::Writer::new(io::BufWriter::new(out));
        out.timescale(1, TimescaleUnit::NS)?;
        out.add_module("board")?;
        let mut wires = [IdCode::FIRST; NAMES.len()];
        for (wire, name) in wires.iter_mut().zip(NAMES) {
            *wire = out.add_wire(1, name)?;
        }
        out.upscope()?;
        out.enddefinitions()?;
        let begin = edges.first().map_or(Ticks::ZERO, |(at, ..)| *at);
        let mut levels = [true, true, false, false, false];
        out.timestamp(0)?;
        out.begin(SimulationCommand::Dumpvars)?;
        for (wire, level) in wires.iter().zip(levels) {
            out.change_scalar(*wire, value(level))?;
        }
        out.end()?;
        let mut last_ns = 0;
        for (at, signal, level) in edges {
            if std::mem::replace(&mut levels[signal], level) == level {
                continue;
            }
            let ns = (at - begin).0 * 1_000 / Ticks::PER_US;
            if ns != last_ns {
                out.timestamp(ns)?;
                last_ns = ns;
            }
            out.change_scalar(wires[signal], value(level))?;
        }
        out.flush()
    }

    /// The master's bit time: the shortest ninth of a written byte.
    fn bit(&self) -> Ticks {
        let pairs = self.bus.windows(2).filter(|pair| matches!(pair[1].1, I2cEvent::Write(_)));
        let ninths = pairs.map(|pair| {
            let [(begin, _, reply), (end, ..)] = pair else { return BIT };
            end.saturating_sub(*begin + reply.stretch) / 9
        });
        ninths.min().filter(|bit| *bit >= Ticks(8)).unwrap_or(BIT)
    }

    fn bus_edges(&self) -> Vec<Edge> {
        let mut pen = Pen { bit: self.bit(), edges: Vec::new(), at: Ticks::ZERO, is_free: true };
        // The rest of a transaction that had begun before is left out.
        let is_start = |(_, event, _): &_| matches!(event, I2cEvent::Start { .. });
        let first = self.bus.iter().position(is_start).unwrap_or(self.bus.len());
        for (index, (now, event, reply)) in self.bus.iter().enumerate().skip(first) {
            let next = self.bus.get(index + 1).map(|(at, event, _)| (*at, *event));
            pen.draw(*now, *event, reply, next);
        }
        pen.edges
    }
}

fn value(level: bool) -> Value {
    if level { Value::V1 } else { Value::V0 }
}

/// Draws the edges of the bus.
struct Pen {
    bit: Ticks,
    edges: Vec<Edge>,
    /// The last edge.
    at: Ticks,
    /// No transaction is under way: the clock is high.
    is_free: bool,
}

impl Pen {
    /// An edge at a time, or as soon as the edges before allow it.
    fn edge(&mut self, at: Ticks, signal: usize, level: bool) {
        self.at = self.at.max(at);
        self.edges.push((self.at, signal, level));
    }

    /// A clock of the bus, with this level of the data, from `begin` on.
    fn clock(&mut self, begin: Ticks, data: bool) {
        self.edge(begin + self.bit / 4, SDA, data);
        self.edge(begin + self.bit / 2, SCL, true);
        self.edge(begin + self.bit, SCL, false);
    }

    fn byte(&mut self, begin: Ticks, byte: u8) {
        for bit in 0..8 {
            self.clock(begin + self.bit * bit, byte << bit & 0x80 != 0);
        }
    }

    fn draw(
        &mut self,
        now: Ticks,
        event: I2cEvent,
        reply: &I2cReply,
        next: Option<(Ticks, I2cEvent)>,
    ) {
        let bit = self.bit;
        // An event at the ninth clock has its byte before it.
        let begin = now.saturating_sub(bit * 9);
        match event {
            I2cEvent::Start { address, read } => {
                if !self.is_free {
                    self.edge(begin.saturating_sub(bit), SDA, true);
                    self.edge(begin.saturating_sub(bit * 3 / 4), SCL, true);
                }
                self.is_free = false;
                self.edge(begin.saturating_sub(bit / 2), SDA, false);
                self.edge(begin, SCL, false);
                self.byte(begin, address << 1 | u8::from(read));
                self.clock(begin + bit * 8, !reply.ack);
            }
            I2cEvent::Write(byte) => {
                self.byte(begin, byte);
                self.clock(begin + bit * 8, !reply.ack);
            }
            I2cEvent::Read => {
                self.byte(now + reply.stretch, reply.data);
                // The master acknowledges where it reads on, one clock before the next byte.
                let (at, goes_on) = match next {
                    Some((at, I2cEvent::Read)) => (at, true),
                    Some((at, I2cEvent::Start { .. })) => (at.saturating_sub(bit * 11), false),
                    Some((at, _)) => (at, false),
                    None => (Ticks::ZERO, false),
                };
                self.clock(self.at.max(at.saturating_sub(bit)), !goes_on);
            }
            I2cEvent::Stop => {
                self.edge(now, SDA, false);
                self.edge(now + reply.stretch + bit / 4, SCL, true);
                self.edge(now + reply.stretch + bit * 3 / 4, SDA, true);
                self.is_free = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a decoder of edges finds: S and P, bytes with + or - for their ninth bit.
    fn decoded(edges: &[Edge]) -> String {
        let (mut levels, mut text, mut bits) = ([true; 2], String::new(), Vec::new());
        for (_, signal, level) in edges {
            let before = std::mem::replace(&mut levels[*signal], *level);
            match (*signal, before, *level) {
                (SDA, true, false) if levels[SCL] => {
                    text += "S ";
                    bits.clear();
                }
                (SDA, false, true) if levels[SCL] => text += "P ",
                (SCL, false, true) => bits.push(levels[SDA]),
                _ => {}
            }
            if bits.len() == 9 {
                let byte = bits[..8].iter().fold(0, |byte, bit| byte << 1 | u8::from(*bit));
                text += &format!("{byte:02x}{} ", if bits[8] { '-' } else { '+' });
                bits.clear();
            }
        }
        text
    }

    fn us(us: u64) -> Ticks {
        Ticks::from_us(us)
    }

    /// A burst of two bytes, as the emulated SERCOM makes it at 400 kHz with 180 us of stretching,
    /// and an address that nobody acknowledges.
    fn waves() -> Waves {
        let held = us(180);
        let start = |read| I2cEvent::Start { address: 0x28, read };
        let mut waves = Waves::default();
        let mut bus = |half_us: u64, event, reply| waves.i2c(us(half_us) / 2, event, reply);
        bus(2_000, start(false), I2cReply::ACK.stretched(held));
        bus(2_405, I2cEvent::Write(0x14), I2cReply::ACK.stretched(held));
        bus(2_815, start(true), I2cReply::ACK.stretched(held));
        bus(3_180, I2cEvent::Read, I2cReply::data(0xA5).stretched(held));
        bus(3_590, I2cEvent::Read, I2cReply::data(0x0F).stretched(held));
        bus(4_000, I2cEvent::Stop, I2cReply::NAK.stretched(us(190)));
        bus(8_000, start(false), I2cReply::NAK);
        bus(8_010, I2cEvent::Stop, I2cReply::NAK);
        let wiring = Wiring::NANO_33_IOT;
        waves.pin(us(1_500), wiring.servos[0], true, &wiring);
        waves.pin(us(3_024), wiring.servos[0], false, &wiring);
        waves
    }

    #[test]
    fn a_decoder_finds_the_bytes_of_the_bus() {
        let waves = waves();
        assert_eq!(waves.bit(), Ticks(120));
        let edges = waves.bus_edges();
        assert!(edges.is_sorted_by_key(|(at, ..)| *at), "{edges:?}");
        assert_eq!(decoded(&edges), "S 50+ 14+ S 51+ a5+ 0f- P S 50- P ");
    }

    /// Between the acknowledge of the register's number and the repeated START the clock is low for
    /// as long as the sensor holds it.
    #[test]
    fn the_clock_is_low_while_the_sensor_stretches_it() {
        let edges = waves().bus_edges();
        let clock: Vec<_> = edges.iter().filter(|(_, signal, _)| *signal == SCL).collect();
        let lows = clock.windows(2).filter(|pair| !pair[0].2).map(|pair| pair[1].0 - pair[0].0);
        let stretched = lows.filter(|low| *low >= us(180)).count();
        // Behind the first address and the register, in front of two bytes, and before the STOP.
        assert_eq!(stretched, 5);
    }

    #[test]
    fn the_file_names_its_signals_and_has_the_pulse() {
        let mut file = Vec::new();
        waves().write(&mut file).unwrap();
        let text = String::from_utf8(file).unwrap();
        for name in NAMES {
            assert!(text.contains(&format!(" {name} $end")), "{text}");
        }
        let parsed: Vec<_> =
            vcd::Parser::new(text.as_bytes()).map(|command| command.unwrap()).collect();
        assert!(parsed.len() > 100, "{}", parsed.len());
        // Time counts from the first edge, half a bit before the address byte: 976.25 us.
        assert!(text.contains("#523750\n1#"), "{text}");
    }
}
