//! The boards that an image can be for: what is led to which pin of the chip.

use samd21::board::{I2cPins, Pin};
use tvc_nano::Axis;

/// What is connected where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The sensor's bus.
    pub i2c: I2cPins,
    /// The servos' pins by axis. A jumper may lead the first one's signal to the second one.
    pub servos: [Pin; Axis::COUNT],
    /// The channels of TCC0 that make their pulses.
    pub channels: [u8; Axis::COUNT],
    /// High while a control step runs.
    pub probe: Pin,
}

impl Wiring {
    /// Arduino Nano 33 IoT: A4 (SDA), A5 (SCL), D3, D2 and D4.
    pub const NANO_33_IOT: Self = Self {
        i2c: I2cPins { sda: Pin::b(8), scl: Pin::b(9) },
        servos: [Pin::b(11), Pin::b(10)],
        channels: [1, 0],
        probe: Pin::a(7),
    };

    /// Seeed XIAO M0: D4 (SDA), D5 (SCL), D2, D3 and D8.
    pub const XIAO_M0: Self = Self {
        i2c: I2cPins { sda: Pin::a(8), scl: Pin::a(9) },
        servos: [Pin::a(10), Pin::a(11)],
        channels: [2, 3],
        probe: Pin::a(7),
    };

    /// Adafruit QT Py M0: SDA, SCL, A2, A3 and RX.
    pub const QT_PY_M0: Self = Self {
        i2c: I2cPins { sda: Pin::a(16), scl: Pin::a(17) },
        servos: [Pin::a(4), Pin::a(5)],
        channels: [0, 1],
        probe: Pin::a(7),
    };
}
