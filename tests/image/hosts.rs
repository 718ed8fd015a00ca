//! The image in flight while the host misbehaves.

use crate::faults::ms;
use crate::ready;
use client::{StateKind, Wire, request};
use rig::measure::LoopTiming;
use rig::usbip::Server;
use rig::{Ready, Ticks};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};

/// How long each host misbehaves.
const LENGTH: Ticks = Ticks::from_ms(1500);
/// Largest deviation of a control period, us.
const JITTER_US: f64 = 100.0;

/// Released and upright.
fn in_flight() -> Ready {
    let mut flight = ready();
    let Ready { rig, station, .. } = &mut flight;
    station.run(rig, ms(1000)).unwrap();
    station.arm(rig).unwrap();
    station.release(rig, 0.1).unwrap();
    station.run(rig, ms(300)).unwrap();
    flight
}

/// Lets `host` act once a millisecond; then the loop has kept its time, the flight its state and
/// its parameters.
fn assert_undisturbed(mut host: impl FnMut(u64, &mut rig::Rig)) {
    let mut flight = in_flight();
    let Ready { rig, station, .. } = &mut flight;
    station.list_parameters(rig).unwrap();
    let before = station.received().parameters.clone();
    let begin = rig.now();
    for millisecond in 0..LENGTH.as_us() / 1000 {
        host(millisecond, rig);
        rig.run_for(ms(1)).unwrap();
    }
    let timing = LoopTiming::over(rig.truth(), begin..rig.now());
    assert!(timing.jitter_us_max < JITTER_US, "{timing:?}");
    assert!(timing.bursts as u64 >= LENGTH.as_us() / 10_000 - 2, "{timing:?}");
    assert_eq!(rig.resets(), []);
    assert!(rig.environment.vehicle().pitch_rad().abs() < 0.2);
    // A host that behaves is served as before.
    rig.chip.usb_host.pause_reading(false);
    rig.chip.usb_host.attach();
    station.run(rig, ms(1500)).unwrap();
    assert_eq!(station.state(), Some(StateKind::Active));
    station.list_parameters(rig).unwrap();
    assert_eq!(station.received().parameters, before);
}

/// Bytes that are different each time and the same in every run.
fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        // xorshift64, Marsaglia 2003.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 24) as u8
    };
    (0..length).map(|_| next()).collect()
}

#[test]
fn one_that_stops_reading() {
    assert_undisturbed(|millisecond, rig| {
        if millisecond == 0 {
            rig.chip.usb_host.pause_reading(true);
        }
    });
}

#[test]
fn one_that_reads_now_and_then() {
    assert_undisturbed(|millisecond, rig| {
        rig.chip.usb_host.pause_reading(millisecond % 500 != 0);
    });
}

#[test]
fn one_that_sends_noise_as_fast_as_it_can() {
    assert_undisturbed(|millisecond, rig| {
        if rig.chip.usb_host.unsent() < 4096 {
            rig.usb_write(&noise(millisecond, 512));
        }
    });
}

#[test]
fn one_that_sends_half_frames_wrong_sums_oversized_lengths_and_unknown_messages() {
    let mut station = Wire::default();
    let disarm = station.frame(&request::DISARM.message());
    let mut wrong_sum = disarm.clone();
    wrong_sum[20] ^= 1;
    let half = disarm[..25].to_vec();
    let oversized = [&[0xFD, 255, 0, 0, 0, 255, 190, 76, 0, 0][..], &[0xFD; 300]].concat();
    let mut unknown = disarm.clone();
    unknown[9] = 0x7F;
    let elsewhere = [0xFD, 3, 0, 0, 1, 255, 190, 0xF0, 0xFF, 0xFF, 1, 2, 3, 4, 5].to_vec();
    let hostile = [half, wrong_sum, oversized, unknown, elsewhere];
    assert_undisturbed(|millisecond, rig| {
        if rig.chip.usb_host.unsent() < 4096 {
            rig.usb_write(&hostile[millisecond as usize % hostile.len()]);
        }
    });
}

#[test]
fn one_that_sets_parameters_out_of_range() {
    let mut station = Wire::default();
    let mut messages = Vec::new();
    for value in [f32::NAN, f32::INFINITY, -1e9, 1e9] {
        for name in ["PID_KP", "PID_KD", "SRV_CENTRE_US", "SRV_DIR", "NO_SUCH"] {
            messages.extend(station.frame(&request::set_parameter(name, value)));
        }
    }
    assert_undisturbed(|millisecond, rig| {
        if millisecond % 50 == 0 {
            rig.usb_write(&messages);
        }
    });
}

#[test]
fn one_that_resets_the_bus_aborts_requests_and_misses_acknowledgements() {
    assert_undisturbed(|millisecond, rig| {
        let host = &mut rig.chip.usb_host;
        host.lose_acknowledgement();
        match millisecond % 500 {
            0 => host.reset_bus(),
            // While it is enumerated anew.
            1..60 if millisecond % 3 == 0 => {
                host.abort_request();
            }
            _ => {}
        }
    });
}

/// Every frame arrives once.
#[test]
fn one_that_misses_acknowledgements_loses_no_frame() {
    let flight = in_flight();
    let attitudes = |loses: bool| {
        let mut fork = flight.clone();
        let Ready { rig, station, .. } = &mut fork;
        station.begin_measurement();
        for _ in 0..2000 {
            if loses {
                rig.chip.usb_host.lose_acknowledgement();
            }
            station.run(rig, ms(1)).unwrap();
        }
        station.received().attitudes.len()
    };
    assert_eq!(attitudes(true), attitudes(false));
}

#[test]
fn one_that_is_unplugged_in_mid_frame() {
    let mut station = Wire::default();
    let frame = station.frame(&request::DISARM.message());
    assert_undisturbed(|millisecond, rig| match millisecond % 500 {
        0 => rig.usb_write(&frame[..17]),
        3 => rig.chip.usb_host.detach(),
        100 => rig.chip.usb_host.attach(),
        _ => {}
    });
}

/// Enumeration is nine requests, each of which the image must hear, whatever it is doing when it
/// comes.
#[test]
fn one_that_comes_back_is_served_at_once_whenever_it_went() {
    let flight = in_flight();
    for instant in 0..60 {
        let mut fork = flight.clone();
        let Ready { rig, station, .. } = &mut fork;
        station.run(rig, Ticks::from_us(instant * 333)).unwrap();
        rig.chip.usb_host.detach();
        station.run(rig, ms(97)).unwrap();
        rig.chip.usb_host.attach();
        station.begin_measurement();
        station.run(rig, ms(400)).unwrap();
        let attitudes = station.received().attitudes.len();
        assert!(attitudes > 10, "{attitudes} when unplugged at {instant}");
    }
}

/// A client of USB/IP, as a kernel has it, at a rig that goes on meanwhile.
struct Importer {
    rig: rig::Rig,
    server: Server,
    stream: TcpStream,
}

impl Importer {
    fn new(rig: rig::Rig) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let server = Server::new(listener).unwrap();
        stream.set_nonblocking(true).unwrap();
        Self { rig, server, stream }
    }

    /// Sends bytes, and waits for the answer of this length.
    fn exchange(&mut self, sent: &[u8], length: usize) -> Vec<u8> {
        self.stream.write_all(sent).unwrap();
        let mut answer = vec![0; length];
        let mut at = 0;
        for _ in 0..1000 {
            self.server.poll(&mut self.rig.chip.usb_host);
            self.rig.run_for(ms(1)).unwrap();
            match self.stream.read(&mut answer[at..]) {
                Ok(0) if at < length => panic!("the server has gone after {at} bytes"),
                Ok(count) => at += count,
                Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock),
            }
            if at == length {
                return answer;
            }
        }
        panic!("{at} bytes of {length}");
    }

    fn operation(&mut self, code: u8, bus_id: &[u8], length: usize) -> Vec<u8> {
        let mut sent = vec![1, 0x11, 0x80, code, 0, 0, 0, 0];
        sent.extend(bus_id);
        if !bus_id.is_empty() {
            sent.resize(40, 0);
        }
        self.exchange(&sent, length)
    }

    /// A transfer that succeeds, and what came from the device.
    fn transfer(&mut self, number: u32, endpoint: u32, setup: [u8; 8], length: usize) -> Vec<u8> {
        let is_in = u32::from(endpoint > 0 || setup[0] & 0x80 != 0);
        let words = [1, number, 0, is_in, endpoint, 0, length as u32, 0, 0, 0];
        let mut sent: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
        sent.extend(setup);
        let head = self.exchange(&sent, 48);
        let word = |at: usize| u32::from_be_bytes(*head[at..].first_chunk().unwrap());
        assert_eq!((word(0), word(4), word(20)), (3, number, 0));
        self.exchange(&[], word(24) as usize)
    }
}

/// The device is listed and given to one client, whose requests and transfers reach the firmware.
/// Afterwards the laptop of the rig has it again.
#[test]
fn a_kernel_elsewhere_talks_with_the_firmware_over_usb_ip() {
    let mut importer = Importer::new(ready().rig);
    let list = importer.operation(5, &[], 12 + 312 + 8);
    assert_eq!(list[..12], [1, 0x11, 0, 5, 0, 0, 0, 0, 0, 0, 0, 1]);
    assert_eq!(list[12 + 300..12 + 304], [0x23, 0x41, 0x80, 0x57]);
    assert_eq!(importer.operation(3, b"9-9", 8)[4..], [0, 0, 0, 1], "no such device");
    let import = importer.operation(3, b"1-1", 8 + 312);
    assert_eq!(import[4..8], [0; 4]);
    assert_eq!(import[8..], list[12..12 + 312]);

    let descriptor = importer.transfer(1, 0, [0x80, 6, 0, 1, 0, 0, 18, 0], 18);
    assert_eq!(descriptor[..2], [18, 1]);
    assert_eq!(descriptor[8..12], [0x41, 0x23, 0x57, 0x80]);
    // Configuration 1; DTR and RTS.
    importer.transfer(2, 0, [0, 9, 1, 0, 0, 0, 0, 0], 0);
    importer.transfer(3, 0, [0x21, 0x22, 3, 0, 0, 0, 0, 0], 0);
    let stream: Vec<u8> =
        (4..40).flat_map(|number| importer.transfer(number, 2, [0; 8], 64)).collect();
    let mut wire = Wire::default();
    let heard = wire.receive(&stream);
    assert!(heard.len() > 10, "{} messages in {} bytes", heard.len(), stream.len());
    // A transfer that waits is taken back.
    let waits = [1, 50, 0, 1, 1, 0, 8, 0, 0, 0, 0, 0];
    let unlink = [2, 51, 0, 0, 0, 50, 0, 0, 0, 0, 0, 0];
    let sent: Vec<u8> = [waits, unlink].concat().into_iter().flat_map(u32::to_be_bytes).collect();
    let answer = importer.exchange(&sent, 48);
    assert_eq!(answer[..8], [0, 0, 0, 4, 0, 0, 0, 51]);
    assert_eq!(answer[20..24], (-104_i32).to_be_bytes());

    importer.stream.shutdown(Shutdown::Both).unwrap();
    importer.server.poll(&mut importer.rig.chip.usb_host);
    importer.rig.run_for(ms(500)).unwrap();
    assert!(!importer.rig.chip.usb_host.is_handed_over());
    assert!(importer.rig.chip.usb_host.is_configured());
}

/// What is no USB/IP, or a transfer that no driver would submit, ends the connection.
#[test]
fn a_client_that_does_not_speak_usb_ip_is_left() {
    let ready = ready().rig;
    let too_long = [1, 1, 0, 0, 2, 0, u32::MAX, 0, 0, 0, 0, 0];
    let no_endpoint = [1, 1, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0];
    for words in [too_long, no_endpoint, [9; 12]] {
        let mut importer = Importer::new(ready.clone());
        importer.operation(3, b"1-1", 8 + 312);
        let sent: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
        importer.stream.write_all(&sent).unwrap();
        importer.server.poll(&mut importer.rig.chip.usb_host);
        assert!(!importer.rig.chip.usb_host.is_handed_over(), "{words:?}");
    }
}
