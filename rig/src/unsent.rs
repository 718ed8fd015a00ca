//! What a slave on the I2C bus has not sent yet when its master lets go of the lines in the middle
//! of a byte (I2C specification UM10204, 3.1.16). It holds SDA as its next bit says until it is
//! clocked through the byte, which nobody acknowledges, or sees a START or STOP. Behind such a byte
//! it stretches the clock once more.

use samd21::board::{I2cCut, I2cEvent, I2cReply, Lines, Ticks};

/// The bits that are left, and how the slave holds SCL.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Unsent {
    /// Bits for SDA, the next one at the top.
    bits: u32,
    /// Number of them.
    left: u8,
    scl_until: Ticks,
    /// How long SCL is held behind the ninth clock, and whether that is yet to come.
    stretch: Option<Ticks>,
    /// The master, as a GPIO, drives SCL low.
    scl_driven: bool,
}

impl Unsent {
    /// Behind this event, which the slave answered. `next` is the byte that it would send then.
    pub(crate) fn new(
        now: Ticks,
        (event, reply): (I2cEvent, I2cReply),
        cut: I2cCut,
        next: impl FnOnce() -> u8,
    ) -> Self {
        let byte = |byte: u8| u32::from(byte) << 24;
        let (bits, left) = match event {
            I2cEvent::Read => {
                (byte(reply.data) << cut.clocks.min(8), 8_u8.saturating_sub(cut.clocks))
            }
            I2cEvent::Start { read: true, .. } if reply.ack => (byte(next()) >> 1, 9),
            I2cEvent::Start { .. } | I2cEvent::Write(_) if reply.ack => (0, 1),
            _ => (0, 0),
        };
        Self {
            bits,
            left,
            scl_until: now + cut.stretch,
            stretch: (left > 1).then_some(reply.stretch),
            scl_driven: false,
        }
    }

    /// The lines that it holds low.
    pub(crate) fn held_low(&self, now: Ticks) -> Lines {
        Lines { sda: self.left > 0 && self.bits >> 31 == 0, scl: now < self.scl_until }
    }

    /// The master drives SCL low or lets go of it.
    pub(crate) fn clock(&mut self, now: Ticks, level: bool) {
        self.scl_driven = !level;
        if level {
            return;
        }
        if self.left > 0 {
            self.bits <<= 1;
            self.left -= 1;
        } else if let Some(stretch) = self.stretch.take() {
            self.scl_until = now + stretch;
        }
    }

    /// The master lets go of SDA. With SCL high that is a STOP.
    pub(crate) fn data_released(&mut self, now: Ticks) {
        let held = self.held_low(now);
        if !self.scl_driven && !held.scl && !held.sda {
            *self = Self { scl_until: self.scl_until, ..Self::default() };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRETCH: Ticks = Ticks::from_us(180);

    /// Levels of SDA: when the lines are let go, and at each clock from then on.
    fn levels(event: I2cEvent, data: u8, clocks: u8) -> String {
        let cut = I2cCut { clocks, stretch: Ticks::ZERO };
        let reply = I2cReply::data(data);
        let mut unsent = Unsent::new(Ticks::ZERO, (event, reply), cut, || 0xA5);
        let mut clock = || {
            let level = if unsent.held_low(Ticks::ZERO).sda { '0' } else { '1' };
            unsent.clock(Ticks::ZERO, false);
            unsent.clock(Ticks::ZERO, true);
            level
        };
        (0..11).map(|_| clock()).collect()
    }

    #[test]
    fn sda_shows_the_bits_that_are_left_and_then_nothing() {
        let start = |read| I2cEvent::Start { address: 0x28, read };
        assert_eq!(levels(I2cEvent::Read, 0x12, 0), "00010010111");
        assert_eq!(levels(I2cEvent::Read, 0x12, 5), "01011111111");
        assert_eq!(levels(I2cEvent::Read, 0x12, 8), "11111111111");
        assert_eq!(levels(start(true), 0xFF, 8), "01010010111");
        assert_eq!(levels(start(false), 0xFF, 8), "01111111111");
        assert_eq!(levels(I2cEvent::Write(3), 0xFF, 8), "01111111111");
        assert_eq!(levels(I2cEvent::Stop, 0xFF, 8), "11111111111");
    }

    #[test]
    fn scl_is_held_for_the_rest_of_a_stretch_and_once_behind_the_ninth_clock() {
        let cut = I2cCut { clocks: 6, stretch: Ticks(7) };
        let reply = I2cReply::data(0).stretched(STRETCH);
        let mut unsent = Unsent::new(Ticks(100), (I2cEvent::Read, reply), cut, || 0);
        let scl = |unsent: &Unsent, now| unsent.held_low(now).scl;
        assert!(scl(&unsent, Ticks(106)) && !scl(&unsent, Ticks(107)));
        for _ in 0..2 {
            unsent.clock(Ticks(200), false);
            unsent.clock(Ticks(300), true);
            assert!(!scl(&unsent, Ticks(200)));
        }
        unsent.clock(Ticks(400), false);
        assert!(scl(&unsent, Ticks(400) + STRETCH - Ticks(1)));
        unsent.clock(Ticks(400) + STRETCH, false);
        assert!(!scl(&unsent, Ticks(400) + STRETCH));
    }

    /// A STOP needs a 1 of the slave: its 0 holds SDA when the master lets go.
    #[test]
    fn a_stop_ends_the_byte() {
        let cut = I2cCut { clocks: 6, stretch: Ticks::ZERO };
        for (data, ends) in [(0b01, false), (0b10, true)] {
            let answered = (I2cEvent::Read, I2cReply::data(data));
            let mut unsent = Unsent::new(Ticks::ZERO, answered, cut, || 0);
            unsent.data_released(Ticks::ZERO);
            unsent.clock(Ticks::ZERO, false);
            unsent.data_released(Ticks::ZERO);
            unsent.clock(Ticks::ZERO, true);
            assert_eq!(unsent.left, if ends { 0 } else { 1 }, "{data:b}");
        }
    }
}
