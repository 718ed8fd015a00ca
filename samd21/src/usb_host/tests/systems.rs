//! What operating systems do differently.

use super::*;

const SET_LINE_CODING: (u8, u8) = (0x21, 0x20);
const SET_LINES: (u8, u8) = (0x21, 0x22);

impl Host {
    /// Opens the port anew at 1200 baud and closes it, as a program does that asks an Arduino board
    /// into its bootloader and leaves DTR to the system.
    fn touch(&mut self) {
        self.set_open(true);
        self.set_line_coding(1200);
        self.set_open(false);
    }
}

#[test]
fn every_system_configures_a_device_that_refuses_what_it_need_not_have() {
    for system in [System::Bare, System::Linux, System::Windows, System::MacOs] {
        let mut device = Device::on(system);
        device.run(Ticks::from_ms(300));
        assert!(device.host().is_configured(), "{system:?}");
        assert_eq!(device.host().errors(), [], "{system:?}");
        assert_eq!(device.host().enumeration.strings[2], "0001");
        let resets = if system.resets_twice() { 2 } else { 1 };
        assert_eq!(device.resets, resets, "{system:?}");
        device.host().write(b"echo");
        device.run(Ticks::from_ms(5));
        assert_eq!(device.host().read(), b"echo");
        assert_eq!(device.bench.peripherals.violations.first, []);
    }
}

#[test]
fn windows_asks_for_its_string_and_leaves_dtr_low() {
    let mut device = Device::on(System::Windows);
    device.run(Ticks::from_ms(300));
    assert!(device.requests.contains(&(0x80, 6, 0x03EE)));
    assert!(device.requests.contains(&(0x80, 6, 0x0600)));
    assert_eq!(device.lines, Some(0));
    assert_eq!(device.line_coding[..4], 115_200u32.to_le_bytes());
    device.host().set_dtr(true);
    device.run(Ticks::from_ms(5));
    assert_eq!(device.lines, Some(3), "a program asks for it");
}

#[test]
fn macos_sends_lines_only_to_a_device_that_announces_them() {
    let sent = |capabilities| {
        let mut device = Device::on(System::MacOs);
        device.capabilities = capabilities;
        device.run(Ticks::from_ms(300));
        device.host().touch();
        device.run(Ticks::from_ms(20));
        let class = |request: &(u8, u8, u16)| {
            [SET_LINES, SET_LINE_CODING].contains(&(request.0, request.1))
        };
        device.requests.iter().filter(|request| class(request)).count()
    };
    assert_eq!(sent(0), 0);
    assert_eq!(sent(2), 5, "two to open the port, three for the touch");
}

#[test]
fn the_touch_raises_dtr_before_it_drops_it_but_on_windows() {
    for (system, lines) in
        [(System::Bare, vec![3, 0]), (System::Linux, vec![3, 0]), (System::Windows, vec![0, 0])]
    {
        let mut device = Device::on(system);
        device.run(Ticks::from_ms(300));
        let before = device.requests.len();
        device.host().touch();
        device.run(Ticks::from_ms(20));
        let sent = device.requests[before..].iter();
        let dtr = sent.filter(|request| (request.0, request.1) == SET_LINES);
        assert_eq!(dtr.map(|request| request.2).collect::<Vec<_>>(), lines);
        assert_eq!(device.line_coding[..4], 1200u32.to_le_bytes());
    }
}
