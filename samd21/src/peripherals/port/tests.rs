use super::*;
use crate::board::{Lines, Unconnected};
use crate::peripherals::violations::Violations;

/// Records edges; drives one pin; holds one line.
#[derive(Default)]
struct Probe {
    edges: Vec<(u64, String, bool)>,
    driven: Option<(Pin, bool)>,
    held: Lines,
}

/// The Nano 33 IoT's wiring.
const LINES: I2cPins = I2cPins { sda: Pin::b(8), scl: Pin::b(9) };

impl Board for Probe {
    fn i2c_pins(&self) -> Option<I2cPins> {
        Some(LINES)
    }
    fn i2c_held_low(&self, _now: Ticks) -> Lines {
        self.held
    }
    fn pin(&mut self, now: Ticks, pin: Pin, level: bool) {
        self.edges.push((now.0, pin.to_string(), level));
    }
    fn input(&self, _now: Ticks, pin: Pin) -> Option<bool> {
        self.driven.and_then(|(driven, level)| (driven == pin).then_some(level))
    }
}

fn write(port: &mut Port, probe: &mut Probe, now: u64, offset: u32, lanes: Lanes) {
    let mut bus = Bus { now: Ticks(now), board: probe, violations: &mut Violations::default() };
    port.write(&mut bus, offset, lanes).unwrap();
}

/// WRCONFIG as the HAL writes it for one pin.
fn configuration(pin: u8, pmux: u32, pincfg: u32) -> Lanes {
    let half = u32::from(pin >> 4);
    Lanes::word(half << 31 | 1 << 30 | 1 << 28 | pmux << 24 | pincfg << 16 | 1 << (pin & 15))
}

#[test]
fn outputs_reach_the_board_as_edges() {
    let mut port = Port::default();
    let mut probe = Probe::default();
    write(&mut port, &mut probe, 10, 0x18, Lanes::word(1 << 7));
    assert_eq!(probe.edges, [], "OUT without DIR drives nothing");
    write(&mut port, &mut probe, 20, 0x08, Lanes::word(1 << 7));
    write(&mut port, &mut probe, 30, 0x1C, Lanes::word(1 << 7));
    write(&mut port, &mut probe, 40, 0x18, Lanes::new(0x80, 0, 1));
    let edge = |at, level| (at, "PA07".to_string(), level);
    assert_eq!(probe.edges, [edge(20, true), edge(30, false), edge(40, true)]);
}

#[test]
fn inputs_need_inen_and_see_board_then_pull() {
    let mut port = Port::default();
    let mut probe = Probe::default();
    let pin = Pin::a(27);
    probe.driven = Some((pin, true));
    let read = |port: &Port, probe: &Probe| port.read(Ticks(0), 0x20, probe).unwrap() >> 27 & 1;
    assert_eq!(read(&port, &probe), 0, "INEN is off");
    write(&mut port, &mut probe, 0, 0x28, configuration(27, 0, u32::from(INEN)));
    assert_eq!(read(&port, &probe), 1);
    probe.driven = None;
    assert_eq!(read(&port, &probe), 0);
    let pulled = u32::from(INEN | PULLEN);
    write(&mut port, &mut probe, 0, 0x28, configuration(27, 0, pulled));
    write(&mut port, &mut probe, 0, 0x18, Lanes::word(1 << 27));
    assert_eq!(read(&port, &probe), 1);
}

fn all_driven(high: u8) -> Waveforms {
    Waveforms { high, driven: 0xFF }
}

#[test]
fn a_tcc_drives_only_the_pins_routed_to_it() {
    let mut port = Port::default();
    let mut probe = Probe::default();
    port.drive(Ticks(1), 0, all_driven(1 << 5), &mut probe);
    assert_eq!(probe.edges, []);
    // PB11 to TCC0/WO[5], PB10 to TCC0/WO[4].
    write(&mut port, &mut probe, 2, 0xA8, configuration(11, 5, 1));
    write(&mut port, &mut probe, 3, 0xA8, configuration(10, 5, 1));
    port.drive(Ticks(4), 0, all_driven(1 << 4), &mut probe);
    port.drive(Ticks(5), 0, Waveforms::default(), &mut probe);
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
    let mut port = Port::default();
    let mut probe = Probe::default();
    write(&mut port, &mut probe, 0, 0xA8, configuration(8, 0, u32::from(INEN)));
    write(&mut port, &mut probe, 0, 0xA8, configuration(9, 0, u32::from(INEN)));
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
fn routing_a_tc_to_a_pin_is_refused() {
    let mut port = Port::default();
    let lanes = configuration(18, 4, 1);
    assert!(Bus::alone(Ticks(0), |bus| port.write(bus, 0x28, lanes)).is_err());
}

#[test]
fn the_sercom_with_pads_0_and_1_on_the_lines_owns_the_bus() {
    let mut port = Port::default();
    let mut probe = Probe::default();
    write(&mut port, &mut probe, 0, 0xA8, configuration(8, 3, 1));
    assert_eq!(port.i2c_master(LINES), None);
    write(&mut port, &mut probe, 0, 0xA8, configuration(9, 3, 1));
    assert_eq!(port.i2c_master(LINES), Some(4));
    let swapped = I2cPins { sda: LINES.scl, scl: LINES.sda };
    assert_eq!(port.i2c_master(swapped), None, "SDA is pad 0");
    // PA22 and PA23: function C is SERCOM3, D is SERCOM5.
    let lines = I2cPins { sda: Pin::a(22), scl: Pin::a(23) };
    write(&mut port, &mut probe, 0, 0x28, configuration(22, 2, 1));
    write(&mut port, &mut probe, 0, 0x28, configuration(23, 3, 1));
    assert_eq!(port.i2c_master(lines), None, "pads of two SERCOMs");
    write(&mut port, &mut probe, 0, 0x28, configuration(23, 2, 1));
    assert_eq!(port.i2c_master(lines), Some(3));
}
