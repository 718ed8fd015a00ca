//! Parameters in the chip's flash: saved, read back after a power cut, and never half of one set
//! and half of another.

use crate::faults::{assert_pulses_went_on, default_neutral_us, is_refused, ms};
use crate::ready;
use client::{Frame, StateKind, Wire, request};
use rig::ground_station::GroundStation;
use rig::measure::LoopTiming;
use rig::{Ready, Rig};
use tvc_nano::Axis;
use tvc_nano::store::SLOT_BYTES;

/// Where the image keeps them.
const STORE: std::ops::Range<usize> = 0x3F800..0x40000;

/// Cuts the power, waits for the image and asks what it has.
fn gain_after_power_cut(rig: &mut Rig, station: &mut GroundStation) -> f32 {
    rig.power_cycle();
    station.connect(rig).unwrap();
    station.list_parameters(rig).unwrap();
    station.received().parameters["PID_KP"]
}

fn saved(kp: f32) -> Ready {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "PID_KP", kp).unwrap();
    station.order(rig, request::SAVE).unwrap();
    bench
}

#[test]
fn saved_parameters_outlive_the_power_and_the_pulses_go_on_meanwhile() {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "PID_KP", 1.75).unwrap();
    let at = rig.now();
    station.order(rig, request::SAVE).unwrap();
    station.run(rig, ms(300)).unwrap();
    let pulses = rig.truth().pulses_since(Axis::Pitch, at);
    assert_pulses_went_on(pulses, rig.now() - at);
    let neutral = default_neutral_us();
    assert!(pulses.iter().all(|p| neutral.contains(&p.width_us())));
    assert_eq!(station.state(), Some(StateKind::Standby));
    assert_eq!(gain_after_power_cut(rig, station), 1.75);
    station.wait_for_state(rig, ms(8000), StateKind::Standby).unwrap();
}

/// What was measured at one speed of the bus says nothing of another: ticks planned by it would
/// come too late for their bursts.
#[test]
fn a_reload_that_changes_the_speed_of_the_bus_is_no_failsafe() {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "I2C_KHZ", 100.0).unwrap();
    station.set_parameter(rig, "SRV_RATE_HZ", 200.0).unwrap();
    station.run(rig, ms(2000)).unwrap();
    station.order(rig, request::SAVE).unwrap();
    station.order(rig, request::RESET).unwrap();
    station.run(rig, ms(2000)).unwrap();
    let stretch_us = station.received().parameters.get("I2C_STRETCH_US").copied();
    station.order(rig, request::RELOAD).unwrap();
    station.run(rig, ms(1000)).unwrap();
    assert_eq!(station.state(), Some(StateKind::Standby));
    assert_eq!(station.received().parameters.get("I2C_STRETCH_US").copied(), stretch_us);
    let texts = &station.received().texts;
    assert!(!texts.iter().any(|text| text.starts_with("failsafe")), "{texts:?}");
}

/// Clients find the vehicle by the number that its frames have, and it obeys orders to that number.
#[test]
fn a_vehicle_has_its_new_number_from_the_next_start_on() {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "MAV_SYSID", 7.0).unwrap();
    station.order(rig, request::SAVE).unwrap();
    let systems = |rig: &mut Rig| {
        rig.run_for(ms(100)).unwrap();
        let frames = Wire::default().receive_frames(&rig.usb_read());
        let mut systems: Vec<u8> = frames.iter().map(Frame::system).collect();
        systems.dedup();
        systems
    };
    assert_eq!(systems(rig), [1]);
    rig.power_cycle();
    station.connect(rig).unwrap();
    assert_eq!(systems(rig), [7]);
    station.wait_for_state(rig, ms(8000), StateKind::Standby).unwrap();
    station.disarm(rig).unwrap();
}

#[test]
fn what_was_not_saved_is_gone_and_a_reload_or_a_reset_brings_back_what_was() {
    let mut bench = saved(1.75);
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "PID_KP", 2.5).unwrap();
    station.order(rig, request::RELOAD).unwrap();
    station.list_parameters(rig).unwrap();
    assert_eq!(station.received().parameters["PID_KP"], 1.75);
    station.order(rig, request::RESET).unwrap();
    station.list_parameters(rig).unwrap();
    let default = tvc_nano::Params::default().pid_kp();
    assert_eq!(station.received().parameters["PID_KP"], default);
    assert_eq!(gain_after_power_cut(rig, station), 1.75);
}

/// A save is four erasures and a page for every eight parameters, with turns of the loop in
/// between: steps of two milliseconds end after every one of them.
#[test]
fn a_power_cut_at_any_instant_of_a_save_leaves_the_old_set_or_the_new_one() {
    let mut bench = saved(1.75);
    let Ready { rig, station, .. } = &mut bench;
    station.set_parameter(rig, "PID_KP", 2.5).unwrap();
    let before = rig.chip.memory.flash()[STORE].to_vec();
    station.request_save(rig);
    let mut found = [0, 0];
    // The image begins when the sensor's bus is free, some ticks later.
    for instant in (0..800).step_by(2) {
        if found[1] > 5 {
            break;
        }
        station.run(rig, ms(2)).unwrap();
        let mut fork = rig.clone();
        let kp = gain_after_power_cut(&mut fork, &mut station.clone());
        assert!(kp == 1.75 || kp == 2.5, "{instant} ms: {kp}");
        found[usize::from(kp == 2.5)] += 1;
    }
    assert!(found[0] >= 5 && found[1] > 5, "{found:?}");
    assert_ne!(rig.chip.memory.flash()[STORE], before, "something was written");
}

#[test]
fn corrupt_rows_are_told_and_nothing_is_armed_until_the_operator_has_seen_it() {
    let mut bench = saved(1.75);
    let Ready { rig, station, .. } = &mut bench;
    for slot in [0, SLOT_BYTES] {
        let address = STORE.start + slot + 20;
        let worn = rig.chip.memory.flash()[address] ^ 4;
        rig.chip.load_flash(address as u32, &[worn]);
    }
    let default = tvc_nano::Params::default().pid_kp();
    assert_eq!(gain_after_power_cut(rig, station), default);
    station.wait_for_state(rig, ms(2000), StateKind::Latched).unwrap();
    let texts = station.received().texts.iter();
    assert!(texts.clone().any(|t| t.contains("stored parameters lost")), "{texts:?}");
    assert!(is_refused(&station.arm(rig)));
    station.disarm(rig).unwrap();
    station.wait_for_state(rig, ms(8000), StateKind::Standby).unwrap();
}

#[test]
fn nothing_is_saved_while_armed() {
    let mut bench = ready();
    let Ready { rig, station, .. } = &mut bench;
    station.arm(rig).unwrap();
    let before = rig.chip.memory.flash()[STORE].to_vec();
    let refused = station.order(rig, request::SAVE);
    assert!(is_refused(&refused), "{refused:?}");
    assert_eq!(rig.chip.memory.flash()[STORE], before);
    assert_eq!(station.state(), Some(StateKind::Armed));
}

/// What a law makes of its parameters must be computed in the time that a tick leaves.
#[test]
fn a_parameter_that_changes_in_flight_costs_no_tick() {
    changes_cost_no_tick(ready());
}

/// Parameters change every few milliseconds of a flight.
pub(crate) fn changes_cost_no_tick(mut bench: Ready) {
    let Ready { rig, station, .. } = &mut bench;
    station.arm(rig).unwrap();
    station.release(rig, 0.0).unwrap();
    station.run(rig, ms(1000)).unwrap();
    let from = rig.now();
    for round in 0..12 {
        for (name, value) in [("PID_KP", 1.9), ("SFC_CURVE", 0.85), ("PITCH_GAIN", 31.0)] {
            let value = value + 0.01 * round as f32;
            station.set_parameter(rig, name, value).unwrap();
            // The next one arrives at another instant between two ticks.
            station.run(rig, ms(5)).unwrap();
        }
    }
    let timing = LoopTiming::over(rig.truth(), from..rig.now());
    assert!(timing.bursts > 30 && timing.jitter_us_max < 100.0, "{timing:?}");
    assert!(timing.steps.abs_diff(timing.bursts) <= 1, "{timing:?}");
    assert_eq!(station.state(), Some(StateKind::Active));
}
