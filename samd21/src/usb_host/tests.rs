mod remote;
mod systems;

use super::*;
use crate::board::Unconnected;
use crate::peripherals::Width;
use crate::tests::Bench;

const USB: u32 = 0x4100_5000;
const DESCRIPTORS: u32 = 0x2000_0000;
const BUFFERS: u32 = 0x2000_0200;

const CONFIGURATION: [u8; 67] = [
    9, 2, 67, 0, 2, 1, 0, 0x80, 50, // configuration
    9, 4, 0, 0, 1, 2, 2, 0, 0, // communication interface
    5, 0x24, 0, 0x10, 1, // header
    4, 0x24, 2, 0, // ACM
    5, 0x24, 6, 0, 1, // union
    5, 0x24, 1, 0, 1, // call management
    7, 5, 0x81, 3, 8, 0, 255, // interrupt IN 1
    9, 4, 1, 0, 2, 10, 0, 0, 0, // data interface
    7, 5, 0x82, 2, 64, 0, 0, // bulk IN 2
    7, 5, 0x02, 2, 64, 0, 0, // bulk OUT 2
];
const DEVICE: [u8; 18] = [18, 1, 0, 2, 2, 0, 0, 64, 0x41, 0x23, 0x57, 0x80, 0, 1, 1, 2, 3, 1];

fn endpoint(number: u32) -> u32 {
    USB + 0x100 + 0x20 * number
}

fn bank(number: u32, bank: u32) -> u32 {
    DESCRIPTORS + 32 * number + 16 * bank
}

fn buffer(number: u32, bank: u32) -> u32 {
    BUFFERS + 128 * (2 * number + bank)
}

/// A CDC device of the simplest kind: it echoes what comes on its port.
struct Device {
    bench: Bench,
    reply: Vec<u8>,
    expects_data: bool,
    new_address: Option<u8>,
    line_coding: Vec<u8>,
    lines: Option<u16>,
    echo: bool,
    unsent: Vec<u8>,
    got: Vec<u8>,
    refuses_strings: bool,
    poll_every: Ticks,
    setups: Vec<Ticks>,
    /// bmRequestType, bRequest and wValue of every request.
    requests: Vec<(u8, u8, u16)>,
    resets: usize,
    /// bmCapabilities of its abstract control model.
    capabilities: u8,
}

impl Device {
    fn new(hold: Ticks) -> Self {
        let mut bench = Bench::new(hold, Unconnected);
        bench.start_clocks();
        bench.route(6, 0);
        bench.multiplex(0, 24, 6);
        bench.multiplex(0, 25, 6);
        bench.w8(USB, 1);
        bench.wait(USB + 2, Width::Byte, 1, false);
        bench.w32(USB + 0x24, DESCRIPTORS);
        bench.w16(USB + 0x28, 29 | 5 << 6 | 3 << 12);
        bench.w8(USB, 4);
        bench.w8(USB, 4 | 2);
        bench.wait(USB + 2, Width::Byte, 2, false);
        bench.w16(USB + 0x18, 1 << 3);
        let mut device = Self {
            bench,
            reply: Vec::new(),
            expects_data: false,
            new_address: None,
            line_coding: Vec::new(),
            lines: None,
            echo: true,
            unsent: Vec::new(),
            got: Vec::new(),
            refuses_strings: false,
            poll_every: Ticks::from_us(200),
            setups: Vec::new(),
            requests: Vec::new(),
            resets: 0,
            capabilities: 0,
        };
        device.configure();
        device.bench.w16(USB + 8, 0);
        device
    }

    fn configure(&mut self) {
        for (number, kinds) in [(0, 0x11), (1, 0x40), (2, 0x33)] {
            for side in 0..2 {
                let size = if number == 1 { 0 } else { 3 << 28 };
                self.set_word(bank(number, side), buffer(number, side));
                self.set_word(bank(number, side) + 4, size);
            }
            self.bench.w8(endpoint(number), kinds);
            self.bench.w8(endpoint(number) + 9, 0x13);
        }
    }

    fn set_word(&mut self, addr: u32, value: u32) {
        self.bench.memory.write_u32(addr, value).unwrap();
    }

    fn send(&mut self, number: u32, bytes: &[u8]) {
        let target = buffer(number, 1);
        self.bench.memory.ram_bytes_mut(target, bytes.len()).unwrap().copy_from_slice(bytes);
        self.set_word(bank(number, 1) + 4, 3 << 28 | bytes.len() as u32);
        self.bench.w8(endpoint(number) + 7, 0x0A);
        self.bench.w8(endpoint(number) + 5, 0x80);
    }

    /// What is in bank 0, which is then free again.
    fn take(&mut self, number: u32) -> Vec<u8> {
        let count = self.bench.memory.read_u32(bank(number, 0) + 4).unwrap() & 0x3FFF;
        let bytes = self.bench.memory.bytes(buffer(number, 0), count as usize).unwrap().to_vec();
        self.set_word(bank(number, 0) + 4, 3 << 28);
        self.bench.w8(endpoint(number) + 7, 0x15);
        self.bench.w8(endpoint(number) + 4, 0x40);
        bytes
    }

    fn poll(&mut self) {
        if self.bench.r16(USB + 0x1C) & 1 << 3 != 0 {
            self.bench.w16(USB + 0x1C, 1 << 3);
            self.resets += 1;
            self.reply.clear();
            self.expects_data = false;
            self.configure();
            return;
        }
        let flags = self.bench.r8(endpoint(0) + 7);
        if flags & 1 << 4 != 0 {
            let setup = self.take(0);
            self.setups.push(self.bench.now);
            self.request(&setup);
        } else if self.bench.r8(endpoint(0) + 6) & 0x40 != 0 {
            let data = self.take(0);
            if self.expects_data {
                self.expects_data = false;
                self.line_coding = data;
                self.send(0, &[]);
            }
        } else if flags & 2 != 0 {
            self.bench.w8(endpoint(0) + 7, 2);
            if let Some(address) = self.new_address.take() {
                self.bench.w8(USB + 0x0A, address | 0x80);
            }
            self.send_reply();
        }
        if self.bench.r8(endpoint(2) + 6) & 0x40 != 0 {
            let bytes = self.take(2);
            self.got.extend(&bytes);
            if self.echo {
                self.unsent.extend(bytes);
            }
        }
        if !self.unsent.is_empty() && self.bench.r8(endpoint(2) + 6) & 0x80 == 0 {
            let count = self.unsent.len().min(64);
            let chunk: Vec<u8> = self.unsent.drain(..count).collect();
            self.send(2, &chunk);
        }
    }

    fn send_reply(&mut self) {
        if !self.reply.is_empty() {
            let count = self.reply.len().min(64);
            let chunk: Vec<u8> = self.reply.drain(..count).collect();
            self.send(0, &chunk);
        }
    }

    fn request(&mut self, setup: &[u8]) {
        let value = u16::from_le_bytes([setup[2], setup[3]]);
        self.requests.push((setup[0], setup[1], value));
        let length = usize::from(u16::from_le_bytes([setup[6], setup[7]]));
        self.reply = match (setup[0], setup[1], value >> 8) {
            (0x80, 6, 1) => DEVICE.to_vec(),
            (0x80, 6, 2) => {
                let mut configuration = CONFIGURATION.to_vec();
                configuration[26] = self.capabilities;
                configuration
            }
            (0x80, 6, kind)
                if matches!(kind, 6 | 15)
                    || kind == 3 && (value == 0x03EE || self.refuses_strings) =>
            {
                self.bench.w8(endpoint(0) + 5, 0x20);
                return;
            }
            (0x80, 6, 3) => {
                let text = ["\u{409}", "Maker", "Thing", "0001"][usize::from(value & 0xFF)];
                let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                let mut descriptor = vec![units.len() as u8 + 2, 3];
                descriptor.extend(units);
                descriptor
            }
            (0x00, 5, _) => {
                self.new_address = Some(value as u8);
                Vec::new()
            }
            (0xA1, 0x21, _) => vec![0, 0xC2, 1, 0, 0, 0, 8],
            (0x21, 0x20, _) => {
                self.expects_data = true;
                return;
            }
            (0x21, 0x22, _) => {
                self.lines = Some(value);
                Vec::new()
            }
            _ => Vec::new(),
        };
        self.reply.truncate(length);
        if length == 0 {
            self.send(0, &[]);
        } else {
            self.send_reply();
        }
    }

    fn run(&mut self, time: Ticks) {
        let end = self.bench.now + time;
        while self.bench.now < end {
            self.poll();
            self.bench.pass(self.poll_every);
        }
    }

    fn host(&mut self) -> &mut Host {
        &mut self.bench.usb_host
    }

    fn on(system: System) -> Self {
        let mut device = Self::new(Ticks::ZERO);
        device.bench.usb_host = Host::of(system);
        device
    }

    fn configured() -> Self {
        let mut device = Self::new(Ticks::ZERO);
        device.run(Ticks::from_ms(200));
        assert!(device.host().is_configured(), "{:?}", device.host().errors);
        device
    }
}

#[test]
fn the_port_is_enumerated_and_opened() {
    for hold in [Ticks::ZERO, Ticks(500)] {
        let mut device = Device::new(hold);
        device.run(Ticks::from_ms(95));
        assert_eq!(device.host().statistics().frames, 0, "debounce and reset");
        device.run(Ticks::from_ms(100));
        let host = device.host();
        assert_eq!(host.errors(), []);
        assert!(host.is_configured());
        assert_eq!(host.enumeration.device_descriptor, DEVICE);
        assert_eq!(host.enumeration.configuration, CONFIGURATION);
        assert_eq!(host.enumeration.strings, ["Maker", "Thing", "0001"]);
        assert_eq!(device.line_coding, [0x00, 0xC2, 0x01, 0, 0, 0, 8]);
        assert_eq!(device.lines, Some(3));
        assert_eq!(device.bench.peripherals.violations.first, []);
        // SOF has locked the DFLL, FNUM counts.
        assert_ne!(device.bench.r32(0x4000_080C) & 1 << 6, 0);
        let frame = device.bench.r16(USB + 0x10) >> 3;
        device.run(Ticks::from_ms(10));
        assert_eq!(device.bench.r16(USB + 0x10) >> 3, frame + 10);
    }
}

#[test]
fn requests_keep_a_frame_apart() {
    let mut device = Device::new(Ticks::ZERO);
    device.poll_every = Ticks::from_us(5);
    device.run(Ticks::from_ms(200));
    assert!(device.setups.len() > 10, "{:?}", device.setups);
    for pair in device.setups.windows(2) {
        assert!(pair[1] - pair[0] >= Ticks::from_ms(1), "{pair:?}");
    }
}

#[test]
fn bytes_go_both_ways_whole_and_in_order() {
    let mut device = Device::configured();
    let sent: Vec<u8> = (0..1000u32).map(|byte| (byte * 7) as u8).collect();
    device.host().write(&sent);
    device.run(Ticks::from_ms(30));
    assert_eq!(device.got, sent);
    let host = device.host();
    assert_eq!(host.read(), sent);
    assert_eq!(host.read(), []);
    assert_eq!(host.unsent(), 0);
    assert_eq!(host.errors(), []);
}

#[test]
fn a_frame_carries_several_packets_at_full_speed_pace() {
    let mut device = Device::configured();
    device.echo = false;
    device.poll_every = Ticks::from_us(5);
    device.unsent = vec![0x55; 64 * 1000];
    device.run(Ticks::from_ms(1));
    let before = device.host().statistics().packets_in;
    device.run(Ticks::from_ms(10));
    let packets = device.host().statistics().packets_in - before;
    // At most 18 a frame at 53 us each; every second token meets a bank not yet refilled.
    assert!((80..=180).contains(&packets), "{packets} packets in 10 ms");
}

#[test]
fn a_device_that_does_not_take_its_data_is_asked_again_and_loses_nothing() {
    let mut device = Device::configured();
    device.host().write(&[1; 200]);
    device.bench.pass(Ticks::from_ms(20));
    assert_eq!(device.host().unsent(), 200 - 64);
    assert!(device.host().statistics().naks > 100);
    assert_eq!(device.bench.r8(endpoint(2) + 7) & 0x04, 0x04, "TRFAIL0");
    device.run(Ticks::from_ms(10));
    assert_eq!(device.got, [1; 200]);
}

/// Whether the host is stopped at every tick or left alone over many frames, the same comes of it:
/// what it is told by the device, and by the program, at any instant.
#[test]
fn what_is_left_out_comes_to_the_same() {
    let mut watched = Device::configured();
    watched.echo = false;
    watched.run(Ticks::from_ms(3));
    let mut alone = watched.bench.clone();
    let packets: [&[u8]; 3] = [b"first", &[7; 63], b""];
    for (index, bytes) in packets.into_iter().enumerate() {
        // Into the midst of a frame, another one each time.
        let time = Ticks::from_us(2_345) + Ticks(1_117 * index as u64);
        for _ in 0..time.0 {
            watched.bench.pass(Ticks(1));
        }
        alone.pass(time);
        for bench in [&mut watched.bench, &mut alone] {
            bench.memory.ram_bytes_mut(buffer(2, 1), bytes.len()).unwrap().copy_from_slice(bytes);
            let size = 3 << 28 | bytes.len() as u32;
            bench.memory.write_u32(bank(2, 1) + 4, size).unwrap();
            bench.w8(endpoint(2) + 5, 0x80);
            bench.usb_host.write(&[index as u8; 3]);
        }
    }
    for _ in 0..5_000 {
        watched.bench.pass(Ticks(48));
    }
    alone.pass(Ticks(48 * 5_000));
    let [watched, alone] = [&watched.bench.usb_host, &alone.usb_host];
    assert!(watched.statistics().naks > 100 && watched.statistics().packets_in >= 3);
    assert_eq!(format!("{watched:?}"), format!("{alone:?}"));
}

#[test]
fn a_host_that_stops_reading_leaves_the_bank_full() {
    let mut device = Device::configured();
    device.host().pause_reading(true);
    device.host().write(&[9; 10]);
    device.run(Ticks::from_ms(20));
    assert_eq!(device.host().read(), []);
    assert_eq!(device.bench.r8(endpoint(2) + 6) & 0x80, 0x80, "BK1RDY");
    device.host().pause_reading(false);
    device.run(Ticks::from_ms(2));
    assert_eq!(device.host().read(), [9; 10]);
}

#[test]
fn the_1200_baud_touch_reaches_the_device() {
    let mut device = Device::configured();
    device.host().set_line_coding(1200);
    device.host().set_dtr(false);
    assert!(!device.host().is_configured());
    device.run(Ticks::from_ms(10));
    assert!(device.host().is_configured());
    assert_eq!(device.line_coding[..4], 1200u32.to_le_bytes());
    assert_eq!(device.lines, Some(0));
}

#[test]
fn the_cable_can_be_pulled_and_put_in_again() {
    let mut device = Device::configured();
    device.host().detach();
    assert!(!device.host().is_configured());
    device.run(Ticks::from_ms(10));
    assert_eq!(device.bench.r16(USB + 0x1C) & 1, 1, "SUSPEND after 3 ms");
    device.host().attach();
    device.run(Ticks::from_ms(90));
    assert!(!device.host().is_configured(), "debounce");
    device.run(Ticks::from_ms(150));
    assert!(device.host().is_configured());
    assert_eq!(device.host().statistics().enumerations, 2);
    device.host().write(b"again");
    device.run(Ticks::from_ms(3));
    assert_eq!(device.host().read(), b"again");
    assert_eq!(device.host().errors(), []);
}

#[test]
fn a_detached_device_is_forgotten() {
    let mut device = Device::configured();
    device.bench.w16(USB + 8, 1);
    assert!(!device.host().is_configured());
    let frames = device.host().statistics().frames;
    device.bench.pass(Ticks::from_ms(20));
    assert_eq!(device.host().statistics().frames, frames);
}

#[test]
fn a_dead_device_is_given_up_after_three_attempts() {
    let mut device = Device::new(Ticks::ZERO);
    device.bench.pass(Ticks::from_ms(60_000));
    let request = "GET_DESCRIPTOR device";
    assert_eq!(device.host().errors(), [HostError::NoAnswer(request); 3]);
    assert!(!device.host().is_configured());
}

#[test]
fn a_stall_refuses_a_request_and_the_next_one_goes_on() {
    let mut device = Device::new(Ticks::ZERO);
    device.refuses_strings = true;
    device.run(Ticks::from_ms(200));
    assert!(device.host().is_configured());
    let refused = HostError::Refused("GET_DESCRIPTOR string");
    assert_eq!(device.host().errors(), [refused; 4]);
    assert!(device.host().enumeration.strings.is_empty());
}

#[test]
fn a_halted_bulk_endpoint_is_cleared_by_the_host() {
    let mut device = Device::configured();
    device.bench.w8(endpoint(2) + 5, 0x20);
    device.run(Ticks::from_ms(2));
    assert_eq!(device.bench.r8(endpoint(2) + 7) & 0x40, 0x40, "STALL1");
    // The device clears the halt and its toggle, as CLEAR_FEATURE asks.
    device.bench.w8(endpoint(2) + 4, 0x22);
    device.host().write(b"on");
    device.run(Ticks::from_ms(5));
    assert_eq!(device.host().read(), b"on");
}

#[test]
fn a_repeated_packet_is_dropped_and_noted() {
    let mut device = Device::configured();
    device.host().write(b"one");
    device.run(Ticks::from_ms(3));
    // The device turns its toggle back: the next packet looks like the last one.
    device.bench.w8(endpoint(2) + 4, 0x02);
    device.host().write(b"two");
    device.run(Ticks::from_ms(3));
    assert_eq!(device.host().read(), b"one");
    assert_eq!(device.host().errors(), [HostError::WrongToggle]);
}

#[test]
fn a_clone_continues_as_the_original() {
    let mut device = Device::configured();
    device.host().write(&[3; 100]);
    let mut copy = device.bench.clone();
    copy.pass(Ticks::from_ms(5));
    device.bench.pass(Ticks::from_ms(5));
    let state = |bench: &Bench| format!("{:?} {:?}", bench.peripherals, bench.usb_host);
    assert_eq!(state(&copy), state(&device.bench));
    assert_eq!(copy.memory.ram(), device.bench.memory.ram());
}

#[test]
fn a_host_that_sleeps_suspends_the_device_and_goes_on_after_it() {
    let mut device = Device::configured();
    device.host().suspend();
    device.run(Ticks::from_ms(10));
    assert_eq!(device.bench.r16(USB + 0x1C) & 1, 1, "SUSPEND");
    let frames = device.host().statistics().frames;
    device.host().write(b"later");
    device.run(Ticks::from_ms(1000));
    assert_eq!(device.host().statistics().frames, frames);
    device.host().resume();
    device.run(Ticks::from_ms(10));
    assert_eq!(device.bench.r16(USB + 0x1C) >> 4 & 1, 1, "WAKEUP");
    assert_eq!(device.host().statistics().frames, frames, "still signalling");
    device.run(Ticks::from_ms(20));
    assert_eq!(device.host().read(), b"later");
    assert_eq!(device.host().errors(), []);
    assert_eq!(device.host().statistics().enumerations, 1);
}

#[test]
fn a_lost_acknowledgement_loses_and_doubles_no_byte() {
    let mut device = Device::configured();
    let sent: Vec<u8> = (0..1000u32).map(|byte| (byte * 7) as u8).collect();
    device.host().write(&sent);
    for _ in 0..100 {
        device.host().lose_acknowledgement();
        device.run(Ticks::from_us(600));
    }
    assert_eq!(device.got, sent);
    assert_eq!(device.host().read(), sent);
    assert_eq!(device.host().errors(), []);
}

#[test]
fn a_bus_reset_with_the_cable_in_enumerates_anew() {
    let mut device = Device::configured();
    let resets = device.resets;
    device.host().reset_bus();
    device.run(Ticks::from_ms(100));
    assert!(device.host().is_configured());
    assert_eq!((device.resets, device.host().statistics().enumerations), (resets + 1, 2));
    assert_eq!(device.host().errors(), []);
}

#[test]
fn a_request_that_is_aborted_is_made_anew() {
    let mut device = Device::new(Ticks::ZERO);
    let mut aborted = 0;
    for step in 0..3000 {
        device.run(Ticks::from_us(100));
        if step % 4 == 0 {
            aborted += usize::from(device.host().abort_request());
        }
    }
    assert!(aborted > 2, "{aborted}");
    assert!(device.host().is_configured());
    assert_eq!(device.host().errors(), []);
    let requests = device.requests.len();
    let mut calm = Device::new(Ticks::ZERO);
    calm.run(Ticks::from_ms(300));
    assert_eq!(requests, calm.requests.len() + aborted);
}
