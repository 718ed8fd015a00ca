//! The image in flight while the host misbehaves.

use crate::ready;
use client::{StateKind, Wire, request};
use rig::measure::LoopTiming;
use rig::{Ready, Ticks};

/// How long each host misbehaves.
const LENGTH: Ticks = Ticks::from_ms(1500);
/// Largest deviation of a control period, us.
const JITTER_US: f64 = 100.0;

fn ms(ms: u64) -> Ticks {
    Ticks::from_ms(ms)
}

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
