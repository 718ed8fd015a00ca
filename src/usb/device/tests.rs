//! Requests answered by hand, and any sequence of packets.

use super::*;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

const SERIAL: [u8; 16] =
    [0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF, 0, 1, 2, 3, 4, 5, 6, 0xF0];
static DESCRIPTOR: [u8; 18] = descriptors::device(0x2341, 0x8057);

/// Notes what it is told.
#[derive(Default)]
struct Note {
    packets: Vec<Vec<u8>>,
    stalls: usize,
    address: Option<u8>,
    halted: Vec<Endpoint>,
    restarted: Vec<Endpoint>,
}

impl Controller for Note {
    fn send(&mut self, packet: &[u8]) {
        assert!(packet.len() <= PACKET_BYTES);
        self.packets.push(packet.to_vec());
    }

    fn stall(&mut self) {
        self.stalls += 1;
    }

    fn set_address(&mut self, address: u8) {
        self.address = Some(address);
    }

    fn halt(&mut self, endpoint: Endpoint, halted: bool) {
        self.halted.retain(|one| *one != endpoint);
        if halted {
            self.halted.push(endpoint);
        } else {
            self.restarted.push(endpoint);
        }
    }

    fn is_halted(&self, endpoint: Endpoint) -> bool {
        self.halted.contains(&endpoint)
    }
}

fn device() -> Device {
    Device::new(&DESCRIPTOR, SERIAL)
}

fn setup(kind: u8, number: u8, value: u16, index: u16, length: u16) -> [u8; 8] {
    let [v0, v1] = value.to_le_bytes();
    let [i0, i1] = index.to_le_bytes();
    let [l0, l1] = length.to_le_bytes();
    [kind, number, v0, v1, i0, i1, l0, l1]
}

/// What a host reads by a request, and how many packets it came in; `None` for a STALL.
fn read(device: &mut Device, request: [u8; 8]) -> Option<(Vec<u8>, usize)> {
    let mut note = Note::default();
    device.setup(&mut note, request);
    if note.stalls > 0 {
        assert!(note.packets.is_empty());
        return None;
    }
    let length = usize::from(u16::from_le_bytes([request[6], request[7]]));
    // A host asks until a packet is short or it has what it wanted.
    while note.packets.last().unwrap().len() == PACKET_BYTES && note.packets.concat().len() < length
    {
        let before = note.packets.len();
        device.sent(&mut note);
        assert_eq!(note.packets.len(), before + 1, "the host waits for ever");
    }
    let packets = note.packets.len();
    let bytes = note.packets.concat();
    device.sent(&mut note);
    assert_eq!(note.packets.len(), packets, "more than the host wanted");
    device.received(&mut note, &[]);
    assert_eq!((device.stage, note.stalls), (Stage::Idle, 0));
    Some((bytes, packets))
}

/// Whether a request without data for the host is obeyed, and what the controller was told.
fn write(device: &mut Device, request: [u8; 8], data: &[u8]) -> (bool, Note) {
    let mut note = Note::default();
    device.setup(&mut note, request);
    if !data.is_empty() && note.stalls == 0 {
        device.received(&mut note, data);
    }
    let obeyed = note.stalls == 0;
    let expected: Vec<Vec<u8>> = if obeyed { vec![vec![]] } else { vec![] };
    assert_eq!(note.packets, expected);
    assert_eq!(note.address, None, "not before the transfer has ended");
    if obeyed {
        device.sent(&mut note);
        assert_eq!(device.stage, Stage::Idle);
    }
    (obeyed, note)
}

#[test]
fn a_host_reads_all_descriptors() {
    let mut device = device();
    let descriptor = |device: &mut Device, value, length| {
        read(device, setup(0x80, 6, value, 0, length)).map(|(bytes, _)| bytes)
    };
    let whole = descriptor(&mut device, 0x0100, 64).unwrap();
    assert_eq!(whole.len(), 18);
    assert_eq!(whole[8..12], [0x41, 0x23, 0x57, 0x80]);
    assert_eq!(descriptor(&mut device, 0x0100, 8).unwrap(), whole[..8]);
    let configuration = descriptor(&mut device, 0x0200, 255).unwrap();
    assert_eq!(configuration, WHOLE_CONFIGURATION);
    assert_eq!(descriptor(&mut device, 0x0300, 255).unwrap(), LANGUAGES);
    let text = |device: &mut Device, index: u16| {
        let bytes = descriptor(device, 0x0300 | index, 255).unwrap();
        assert_eq!((usize::from(bytes[0]), bytes[1]), (bytes.len(), 3));
        let units: Vec<u16> =
            bytes[2..].chunks_exact(2).map(|unit| u16::from_le_bytes([unit[0], unit[1]])).collect();
        std::string::String::from_utf16(&units).unwrap()
    };
    assert_eq!(text(&mut device, 1), "tvc-nano");
    assert_eq!(text(&mut device, 2), "tvc-nano thrust-vector control");
    assert_eq!(text(&mut device, 3), "0123456789ABCDEF00010203040506F0");
    // BOS, device qualifier, other strings, a second configuration: there are none.
    for value in [0x0F00, 0x0600, 0x0304, 0x03EE, 0x0201, 0x0101, 0x0000] {
        assert_eq!(descriptor(&mut device, value, 255), None, "{value:#x}");
    }
}

/// USB 2.0, 8.5.3.2: data end with a short packet, unless the host wanted no more.
#[test]
fn data_end_with_a_short_packet_or_with_what_was_wanted() {
    let mut device = device();
    let mut packets = |length| read(&mut device, setup(0x80, 6, 0x0200, 0, length)).unwrap().1;
    assert_eq!(packets(9), 1);
    assert_eq!(packets(64), 1, "no empty packet behind all that was wanted");
    assert_eq!(packets(65), 2);
    assert_eq!(packets(75), 2);
    assert_eq!(packets(255), 2);
}

#[test]
fn the_configuration_is_whole() {
    let mut rest = WHOLE_CONFIGURATION.as_slice();
    let mut kinds = vec![];
    while let [length, kind, ..] = *rest {
        kinds.push(kind);
        rest = &rest[usize::from(length)..];
    }
    assert!(rest.is_empty());
    assert_eq!(kinds, [2, 11, 4, 0x24, 0x24, 0x24, 0x24, 5, 4, 5, 5]);
    let [.., total, _, _, _, _, _, _] = WHOLE_CONFIGURATION[..9] else { unreachable!() };
    assert_eq!(usize::from(total), WHOLE_CONFIGURATION.len());
}

/// USB 2.0, 9.4.6: the request is answered at the old address.
#[test]
fn an_address_counts_from_the_end_of_the_request_on() {
    let mut device = device();
    let (obeyed, note) = write(&mut device, setup(0x00, 5, 17, 0, 0), &[]);
    assert!(obeyed);
    assert_eq!(note.address, Some(17));
    let (obeyed, note) = write(&mut device, setup(0x00, 5, 128, 0, 0), &[]);
    assert!(!obeyed);
    assert_eq!(note.address, None);
}

#[test]
fn the_host_chooses_the_configuration_and_a_reset_takes_it_back() {
    let mut device = device();
    let current = setup(0x80, 8, 0, 0, 1);
    assert_eq!(read(&mut device, current).unwrap().0, [0]);
    let (obeyed, note) = write(&mut device, setup(0x00, 9, 1, 0, 0), &[]);
    assert!(obeyed && device.is_configured());
    assert_eq!(note.restarted, Endpoint::ALL);
    assert_eq!(read(&mut device, current).unwrap().0, [1]);
    assert!(!write(&mut device, setup(0x00, 9, 2, 0, 0), &[]).0);
    assert!(device.is_configured());
    assert!(write(&mut device, setup(0x21, 0x22, 3, 0, 0), &[]).0);
    assert!(device.is_open());
    device.reset();
    assert!(!device.is_configured() && !device.is_open());
    assert!(write(&mut device, setup(0x00, 9, 0, 0, 0), &[]).0);
    assert!(!device.is_configured());
}

#[test]
fn the_port_obeys_and_tells_its_rate() {
    let mut device = device();
    assert_eq!(device.baud(), 9_600);
    let coding = [0xB0, 0x04, 0, 0, 2, 1, 7];
    assert!(write(&mut device, setup(0x21, 0x20, 0, 0, 7), &coding).0);
    assert_eq!(device.baud(), 1_200);
    let told = read(&mut device, setup(0xA1, 0x21, 0, 0, 7)).unwrap();
    assert_eq!(told.0, coding);
    // Too short, of another interface, and announced with another length.
    assert!(!write(&mut device, setup(0x21, 0x20, 0, 0, 7), &coding[..6]).0);
    assert!(!write(&mut device, setup(0x21, 0x20, 0, 1, 7), &coding).0);
    assert!(!write(&mut device, setup(0x21, 0x20, 0, 0, 8), &coding).0);
    assert_eq!(device.baud(), 1_200);
    // A break is not announced.
    assert!(!write(&mut device, setup(0x21, 0x23, 10, 0, 0), &[]).0);
    for (lines, open) in [(1, true), (2, false), (3, true), (0, false)] {
        assert!(write(&mut device, setup(0x21, 0x22, lines, 0, 0), &[]).0);
        assert_eq!(device.is_open(), open);
    }
}

#[test]
fn a_command_for_a_modem_is_taken_whatever_its_length() {
    let mut device = device();
    let mut note = Note::default();
    device.setup(&mut note, setup(0x21, 0x00, 0, 0, 130));
    for length in [64, 64, 2] {
        assert!(note.packets.is_empty());
        device.received(&mut note, &[0xAA; 64][..length]);
    }
    assert_eq!((note.packets.len(), note.stalls), (1, 0));
}

#[test]
fn endpoints_are_halted_and_go_on() {
    let mut device = device();
    let mut note = Note::default();
    for endpoint in Endpoint::ALL {
        let index = u16::from(endpoint.address());
        device.setup(&mut note, setup(0x02, 3, 0, index, 0));
        assert_eq!(note.halted, [endpoint]);
        device.setup(&mut note, setup(0x82, 0, 0, index, 2));
        assert_eq!(note.packets.last().unwrap(), &[1, 0]);
        device.setup(&mut note, setup(0x02, 1, 0, index, 0));
        assert_eq!(note.restarted.last(), Some(&endpoint));
        assert!(note.halted.is_empty());
    }
    assert_eq!(note.stalls, 0);
    // Endpoint 0 is never halted, and there are no others.
    assert_eq!(read(&mut device, setup(0x82, 0, 0, 0x80, 2)).unwrap().0, [0, 0]);
    assert!(write(&mut device, setup(0x02, 1, 0, 0, 0), &[]).0);
    for index in [0x02, 0x83, 0x101, 0xFFFF] {
        assert!(read(&mut device, setup(0x82, 0, 0, index, 2)).is_none());
        assert!(!write(&mut device, setup(0x02, 3, 0, index, 0), &[]).0);
    }
    // Remote wake-up is not announced, and no other feature exists.
    assert!(!write(&mut device, setup(0x00, 3, 1, 0, 0), &[]).0);
    assert!(!write(&mut device, setup(0x02, 3, 1, 0x82, 0), &[]).0);
}

#[test]
fn interfaces_have_one_setting() {
    let mut device = device();
    assert_eq!(read(&mut device, setup(0x80, 0, 0, 0, 2)).unwrap().0, [0, 0]);
    for interface in 0..2 {
        assert_eq!(read(&mut device, setup(0x81, 0, 0, interface, 2)).unwrap().0, [0, 0]);
        assert_eq!(read(&mut device, setup(0x81, 10, 0, interface, 1)).unwrap().0, [0]);
        assert!(write(&mut device, setup(0x01, 11, 0, interface, 0), &[]).0);
        assert!(!write(&mut device, setup(0x01, 11, 1, interface, 0), &[]).0);
    }
    assert!(read(&mut device, setup(0x81, 10, 0, 2, 1)).is_none());
}

#[test]
fn a_setup_ends_the_transfer_before_it() {
    let mut device = device();
    let mut note = Note::default();
    device.setup(&mut note, setup(0x80, 6, 0x0200, 0, 255));
    device.setup(&mut note, setup(0x21, 0x20, 0, 0, 7));
    device.setup(&mut note, setup(0x00, 5, 9, 0, 0));
    device.setup(&mut note, setup(0x80, 8, 0, 0, 1));
    device.sent(&mut note);
    assert_eq!(note.address, None, "that request was given up");
    device.received(&mut note, &[]);
    assert_eq!((device.stage, note.stalls), (Stage::Idle, 0));
    // The host has seen enough of the data.
    device.setup(&mut note, setup(0x80, 6, 0x0200, 0, 255));
    device.received(&mut note, &[]);
    let before = note.packets.len();
    device.sent(&mut note);
    assert_eq!((note.packets.len(), note.stalls), (before, 0));
}

#[test]
fn data_that_nobody_asked_for_are_refused() {
    let mut device = device();
    for packet in [&[][..], &[1, 2, 3]] {
        let mut note = Note::default();
        device.received(&mut note, packet);
        assert_eq!((note.stalls, note.packets.len()), (1, 0));
    }
}

#[derive(Clone, Debug)]
enum Event {
    Setup([u8; 8]),
    Received(Vec<u8>),
    Sent,
    Reset,
}

fn events() -> impl Strategy<Value = Event> {
    let kind = prop_oneof![
        Just(0x00u8),
        Just(0x01),
        Just(0x02),
        Just(0x80),
        Just(0x81),
        Just(0x82),
        Just(0x21),
        Just(0xA1),
        any::<u8>()
    ];
    let number = prop_oneof![0u8..12, 0x20u8..0x24, any::<u8>()];
    let value = prop_oneof![0u16..4, (0u16..8).prop_map(|kind| kind << 8), any::<u16>()];
    let index = prop_oneof![0u16..4, 0x80u16..0x84, any::<u16>()];
    let length = prop_oneof![0u16..10, 60u16..70, any::<u16>()];
    let request = (kind, number, value, index, length);
    prop_oneof![
        4 => request.prop_map(|(kind, number, value, index, length)| {
            Event::Setup(setup(kind, number, value, index, length))
        }),
        3 => proptest::collection::vec(any::<u8>(), 0..=64).prop_map(Event::Received),
        4 => Just(Event::Sent),
        1 => Just(Event::Reset),
    ]
}

proptest! {
    /// Whatever the host does: no panic, no packet that is too long, one answer to each SETUP, no
    /// address but one that was asked for, and afterwards the device enumerates as before.
    #[test]
    fn any_host_is_borne(events in proptest::collection::vec(events(), 1..60)) {
        let mut device = device();
        let mut note = Note::default();
        let mut asked = vec![];
        for event in events {
            let (packets, stalls) = (note.packets.len(), note.stalls);
            match event {
                Event::Setup(bytes) => {
                    if bytes[0] == 0 && bytes[1] == 5 {
                        asked.push(bytes[2]);
                    }
                    device.setup(&mut note, bytes);
                    let answers = note.packets.len() - packets + note.stalls - stalls;
                    let receives = matches!(device.stage, Stage::Receiving { .. });
                    prop_assert_eq!(answers, usize::from(!receives));
                }
                Event::Received(packet) => device.received(&mut note, &packet),
                Event::Sent => device.sent(&mut note),
                Event::Reset => device.reset(),
            }
            prop_assert!(note.packets.len() - packets <= 1 && note.stalls - stalls <= 1);
            if let Some(address) = note.address.take() {
                prop_assert!(asked.contains(&address));
            }
        }
        device.reset();
        let (bytes, _) = read(&mut device, setup(0x80, 6, 0x0200, 0, 75)).unwrap();
        prop_assert_eq!(bytes, WHOLE_CONFIGURATION);
        prop_assert!(write(&mut device, setup(0x00, 9, 1, 0, 0), &[]).0);
        prop_assert!(device.is_configured());
    }
}
