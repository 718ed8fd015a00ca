//! What is soldered round the chip, seen from the chip's pins.
//!
//! The chip calls; the board answers. Every call carries the time of the event, which may lie a
//! little before the CPU's own time (hardware acts between instructions) but never goes back.

use core::fmt;
use core::ops::{Add, AddAssign, Div, Mul, Sub};

/// A time or a duration in 1/48 us: one cycle of a 48 MHz clock. Times count from power-on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticks(pub u64);

impl Ticks {
    /// Power-on, or no time at all.
    pub const ZERO: Self = Self(0);
    /// Later than anything that happens.
    pub const NEVER: Self = Self(u64::MAX);
    /// Ticks in a microsecond.
    pub const PER_US: u64 = 48;
    /// Ticks in a second.
    pub const PER_SECOND: u64 = 48_000_000;

    /// A duration of whole microseconds.
    pub const fn from_us(us: u64) -> Self {
        Self(us * Self::PER_US)
    }

    /// A duration of whole milliseconds.
    pub const fn from_ms(ms: u64) -> Self {
        Self::from_us(ms * 1000)
    }

    /// The nearest tick to a duration in seconds; negative durations give zero.
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * Self::PER_SECOND as f64).round() as u64)
    }

    /// Whole microseconds, rounded down.
    pub const fn as_us(self) -> u64 {
        self.0 / Self::PER_US
    }

    /// Microseconds with their fraction.
    pub fn as_us_f64(self) -> f64 {
        self.0 as f64 / Self::PER_US as f64
    }

    /// Seconds with their fraction.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / Self::PER_SECOND as f64
    }

    /// `self - earlier`, or zero if `earlier` is later.
    pub const fn saturating_sub(self, earlier: Self) -> Self {
        Self(self.0.saturating_sub(earlier.0))
    }

    /// `self + other`, or [`Ticks::NEVER`] where that overflows.
    pub const fn saturating_add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Add for Ticks {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl AddAssign for Ticks {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl Sub for Ticks {
    type Output = Self;
    fn sub(self, earlier: Self) -> Self {
        Self(self.0 - earlier.0)
    }
}

impl Mul<u64> for Ticks {
    type Output = Self;
    fn mul(self, factor: u64) -> Self {
        Self(self.0 * factor)
    }
}

impl Div<u64> for Ticks {
    type Output = Self;
    fn div(self, divisor: u64) -> Self {
        Self(self.0 / divisor)
    }
}

impl fmt::Display for Ticks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} us", self.as_us_f64())
    }
}

/// A pin of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pin {
    /// 0 is port A, 1 is port B.
    pub group: u8,
    /// 0 to 31.
    pub index: u8,
}

impl Pin {
    /// Pin `index` of port A.
    pub const fn a(index: u8) -> Self {
        Self { group: 0, index }
    }

    /// Pin `index` of port B.
    pub const fn b(index: u8) -> Self {
        Self { group: 1, index }
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let group = if self.group == 0 { 'A' } else { 'B' };
        write!(f, "P{group}{:02}", self.index)
    }
}

/// The pins that the lines of the board's I2C bus are soldered to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cPins {
    /// Data.
    pub sda: Pin,
    /// Clock.
    pub scl: Pin,
}

impl I2cPins {
    /// Whether `pin` is one of the lines.
    pub fn contain(&self, pin: Pin) -> bool {
        pin == self.sda || pin == self.scl
    }
}

/// What the bus master does, as a slave sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum I2cEvent {
    /// START or repeated START with the address byte; called at the ninth clock, where the slave
    /// acknowledges.
    Start {
        /// 7-bit address.
        address: u8,
        /// The master wants to read.
        read: bool,
    },
    /// A byte from the master; called at the ninth clock.
    Write(u8),
    /// The master clocks a byte out of the addressed slave; called at the first clock.
    Read,
    /// The master lets go of SCL for the STOP. Only [`I2cReply::stretch`] counts in the reply: the
    /// STOP comes when the slave, too, lets go of SCL.
    Stop,
}

/// A slave's answer. With no slave at the address: [`I2cReply::NAK`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct I2cReply {
    /// The byte is acknowledged (`Start`, `Write`).
    pub ack: bool,
    /// The byte read (`Read`); 0xFF with nobody driving the line.
    pub data: u8,
    /// How long the slave holds SCL low in this byte, or before this STOP, beyond the master's own
    /// timing.
    pub stretch: Ticks,
}

impl I2cReply {
    /// Nobody answers: released lines read as ones.
    pub const NAK: Self = Self { ack: false, ..Self::ACK };
    /// Acknowledged without stretching.
    pub const ACK: Self = Self::data(0xFF);

    /// The byte of a `Read`, without stretching.
    pub const fn data(data: u8) -> Self {
        Self { ack: true, data, stretch: Ticks::ZERO }
    }

    /// The same answer with SCL held low for `stretch` more.
    pub const fn stretched(self, stretch: Ticks) -> Self {
        Self { stretch, ..self }
    }
}

/// The master lets go of both lines in the middle of a transfer, without a STOP: a reset of the
/// chip or its SERCOM, or ENABLE taken away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cCut {
    /// Clocks of the last event's byte that have passed, 0 to 8. Behind the eighth one the slave
    /// acknowledges a byte from the master, and the master one from the slave.
    pub clocks: u8,
    /// For how long the slave goes on to hold SCL low.
    pub stretch: Ticks,
}

/// A set of I2C lines: true for each line in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lines {
    /// Data.
    pub sda: bool,
    /// Clock.
    pub scl: bool,
}

/// What is soldered round the chip. What a board does not implement it does not have.
///
/// Calls to the methods with `&mut self` come in the order of their times.
pub trait Board {
    /// The pins of the board's I2C bus, if it has one; always the same. The bus has pull-ups, and
    /// its master is the SERCOM that the chip's multiplexers connect to these pins, SDA being
    /// pad 0 and SCL pad 1.
    fn i2c_pins(&self) -> Option<I2cPins> {
        None
    }

    /// The chip, as I2C master, does `event` on the bus.
    fn i2c(&mut self, _now: Ticks, _event: I2cEvent) -> I2cReply {
        I2cReply::NAK
    }

    /// The chip, as I2C master, lets go of the bus while the slave of the last event sends a byte,
    /// acknowledges one or stretches the clock. The slave goes on as far as it is clocked.
    fn i2c_cut(&mut self, _now: Ticks, _cut: I2cCut) {}

    /// Which I2C lines others than the chip hold low at `now`: stuck lines, a slave whose byte was
    /// [cut](Self::i2c_cut). Clock stretching is part of [`I2cReply`] and not reported here.
    fn i2c_held_low(&self, _now: Ticks) -> Lines {
        Lines::default()
    }

    /// A glitch puts a START or STOP inside the byte that begins at `now`: the master sees a bus
    /// error. Asked once a byte.
    fn i2c_glitch(&mut self, _now: Ticks) -> bool {
        false
    }

    /// A SERCOM as USART has sent a byte.
    fn serial(&mut self, _now: Ticks, _sercom: usize, _byte: u8) {}

    /// What comes in at a SERCOM that is a USART: asked once for the length of a byte.
    fn serial_input(&mut self, _now: Ticks, _sercom: usize) -> Option<u8> {
        None
    }

    /// The chip changes the level at a pin: PORT or a TCC's waveform. An I2C line counts as high
    /// when the chip releases it; another pin that is released goes where the chip's pull resistor
    /// takes it, else low.
    fn pin(&mut self, _now: Ticks, _pin: Pin, _level: bool) {}

    /// The program gives a channel of a TCC another count to compare with, at once or through its
    /// buffer. No pin shows that: it is for a board that holds pulses against what was asked for.
    fn compare(&mut self, _now: Ticks, _tcc: u8, _channel: u8, _count: u32) {}

    /// The level that something outside drives onto `pin`, `None` if it floats: then the chip's
    /// pull resistor decides, and without one it is low. Not asked for the I2C lines.
    fn input(&self, _now: Ticks, _pin: Pin) -> Option<bool> {
        None
    }
}

/// Nothing is soldered round the chip: there is no I2C bus, and inputs float.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unconnected;

impl Board for Unconnected {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_convert_exactly() {
        assert_eq!(Ticks::from_us(20_000).0, 960_000);
        assert_eq!(Ticks::from_ms(20), Ticks::from_us(20_000));
        assert_eq!(Ticks(959_999).as_us(), 19_999);
        assert_eq!(Ticks::from_secs_f64(0.02), Ticks::from_ms(20));
        assert_eq!(Ticks(5).saturating_sub(Ticks(7)), Ticks::ZERO);
    }

    #[test]
    fn pins_print_as_the_data_sheet_names_them() {
        assert_eq!(Pin::b(8).to_string(), "PB08");
        assert_eq!(Pin::a(25).to_string(), "PA25");
    }
}
