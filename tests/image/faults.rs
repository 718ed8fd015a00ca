//! The image on the rig with a sensor or a cable that fails in mid-flight.

use crate::{firmware, ready};
use rig::bno055::Fault;
use rig::faults::NEUTRAL_US;
use rig::ground_truth::Pulse;
use rig::operator::{FlightState, OperatorError};
use rig::{Ready, ResetCause, Ticks};

pub(crate) fn ms(ms: u64) -> Ticks {
    Ticks::from_ms(ms)
}

/// Released from a tilt, and flying for long enough that the rudder is off neutral.
fn in_flight() -> Ready {
    let mut flight = ready();
    let Ready { rig, operator, .. } = &mut flight;
    rig.environment_mut().tilt_clamp(0.4);
    operator.run(rig, ms(2000)).unwrap();
    operator.arm(rig).unwrap();
    operator.release(rig, 0.2).unwrap();
    operator.run(rig, ms(150)).unwrap();
    let last = rig.truth().pulses.last().unwrap();
    assert!(
        !NEUTRAL_US.contains(&last.width_us()),
        "{}",
        last.width_us()
    );
    flight
}

/// Pulses never stopped: one every 20 ms, none outside the travel.
pub(crate) fn assert_pulses_went_on(pulses: &[Pulse], length: Ticks) {
    let expected = length.as_us_f64() / 20_000.0;
    assert!(
        pulses.len() as f64 > expected - 2.0,
        "{} pulses",
        pulses.len()
    );
    for pair in pulses.windows(2) {
        assert_eq!((pair[1].rise - pair[0].rise).as_us(), 20_000);
    }
    for pulse in pulses {
        assert!(
            (853.0..=2193.0).contains(&pulse.width_us()),
            "{}",
            pulse.width_us()
        );
    }
}

fn neutral_in_time_and_back_by_the_operator(fault: Fault, word: &str) {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    let texts = operator.received().texts.len();
    let at = rig.now();
    rig.inject(fault);
    operator.run(rig, ms(1000)).unwrap();

    // From 150 ms on, every pulse is neutral.
    let pulses = rig.truth().pulses_since(at);
    assert_pulses_went_on(pulses, ms(1000));
    for pulse in pulses.iter().filter(|p| p.rise >= at + ms(150)) {
        assert!(
            NEUTRAL_US.contains(&pulse.width_us()),
            "{fault:?}: {}",
            pulse.width_us()
        );
    }
    // State and reason have arrived.
    assert_eq!(operator.state(), Some(FlightState::Failsafe), "{fault:?}");
    let told = &operator.received().texts[texts..];
    let reason = told.iter().find(|t| t.text.starts_with("failsafe"));
    let reason = reason.unwrap_or_else(|| panic!("{fault:?}: {told:?}"));
    assert!(reason.text.contains(word), "{fault:?}: {}", reason.text);
    assert!(
        reason.at < at + ms(250),
        "{fault:?}: told after {}",
        reason.at - at
    );
    // While the fault lasts there is no way out, and never one straight to active.
    assert!(matches!(
        operator.arm(rig),
        Err(OperatorError::Refused { .. })
    ));
    if fault != Fault::ConfigReset {
        assert!(matches!(
            operator.disarm(rig),
            Err(OperatorError::Refused { .. })
        ));
    }

    rig.clear(fault);
    rig.environment_mut().catch();
    rig.environment_mut().tilt_clamp(0.0);
    // The attitude and the gyro offset are found anew.
    operator.run(rig, ms(8000)).unwrap();
    assert_eq!(
        operator.state(),
        Some(FlightState::Failsafe),
        "{fault:?}: only the operator ends it"
    );
    assert!(matches!(
        operator.release(rig, 0.0),
        Err(OperatorError::Refused { .. })
    ));
    assert!(matches!(
        operator.arm(rig),
        Err(OperatorError::Refused { .. })
    ));
    operator.disarm(rig).unwrap();
    operator
        .wait_for_state(rig, ms(500), FlightState::Standby)
        .unwrap();
    operator.arm(rig).unwrap();
    assert!(rig.resets().is_empty());
}

#[test]
fn unplugged() {
    neutral_in_time_and_back_by_the_operator(Fault::Unplugged, "does not answer");
}

#[test]
fn data_line_stuck() {
    neutral_in_time_and_back_by_the_operator(Fault::SdaStuck, "IMU");
}

#[test]
fn clock_line_stuck() {
    neutral_in_time_and_back_by_the_operator(Fault::SclStuck, "IMU");
}

#[test]
fn reset_to_config() {
    neutral_in_time_and_back_by_the_operator(Fault::ConfigReset, "IMU");
}

#[test]
fn all_ones() {
    neutral_in_time_and_back_by_the_operator(Fault::AllOnes, "all ones");
}

#[test]
fn frozen() {
    neutral_in_time_and_back_by_the_operator(Fault::Frozen, "frozen");
}

/// A slave that hangs inside a byte lets go after a few clocks: the image gives them.
#[test]
fn a_slave_inside_a_byte_is_clocked_free() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    rig.inject(Fault::SdaHeld { clocks: 7 });
    operator.run(rig, ms(500)).unwrap();
    assert!(!rig.environment().sensor().held_low(rig.now()).sda);
    let last = rig.truth().bursts.last().unwrap();
    assert!(rig.now() - last.end < ms(20), "bursts go on");
}

#[test]
fn spikes_are_ridden_out() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    rig.inject(Fault::Spikes { probability: 0.003 });
    rig.inject(Fault::CorruptWords { probability: 0.003 });
    operator.run(rig, ms(3000)).unwrap();
    assert_eq!(
        operator.state(),
        Some(FlightState::Active),
        "{:?}",
        operator.last_text()
    );
    let pitch = rig.environment().drone().pitch_rad();
    assert!(pitch.abs() < 0.05, "{pitch}");
}

/// Puts one instruction into RAM that the image leaves alone, and the core onto it.
fn divert(rig: &mut rig::Rig, instruction: u16) -> u32 {
    let at = 0x7A00;
    rig.chip_mut().ram_mut()[at..at + 2].copy_from_slice(&instruction.to_le_bytes());
    let mut registers = rig.chip().registers();
    registers.r[15] = 0x2000_0000 + at as u32;
    registers.primask = false;
    rig.chip_mut().set_registers(&registers);
    registers.r[15]
}

#[test]
fn a_hung_loop_is_reset_and_told() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    let at = rig.now();
    // The main loop never comes back: a branch to itself.
    divert(rig, 0xE7FE);
    operator.run(rig, ms(450)).unwrap();
    assert_eq!(rig.resets().len(), 1, "the watchdog fires");
    let (fired, cause) = rig.resets()[0];
    assert_eq!(cause, ResetCause::Watchdog);
    // Its early warning had put the rudder to neutral before.
    let last = rig.truth().pulses.last().unwrap();
    assert!(last.fall < fired && fired - at < ms(400));
    assert!(NEUTRAL_US.contains(&last.width_us()), "{}", last.width_us());
    // The bootloader costs half a second, then pulses are back and the reason is told.
    operator.run(rig, ms(600)).unwrap();
    let back = rig.truth().pulses_since(fired)[0];
    assert!(back.rise - fired < ms(600), "{}", back.rise - fired);
    assert!(NEUTRAL_US.contains(&back.width_us()));
    operator.connect(rig).unwrap();
    operator
        .wait_for_state(rig, ms(2000), FlightState::Latched)
        .unwrap();
    let told = operator.received().texts.iter();
    assert!(
        told.clone()
            .any(|t| t.at > fired && t.text.contains("latched fault")),
        "{told:?}"
    );
    assert!(matches!(
        operator.arm(rig),
        Err(OperatorError::Refused { .. })
    ));
    rig.environment_mut().catch();
    rig.environment_mut().tilt_clamp(0.0);
    operator.disarm(rig).unwrap();
    operator
        .wait_for_state(rig, ms(6000), FlightState::Standby)
        .unwrap();
}

#[test]
fn a_brown_out_is_latched() {
    let mut flight = ready();
    let Ready { rig, operator, .. } = &mut flight;
    rig.brown_out();
    operator.run(rig, ms(700)).unwrap();
    operator.connect(rig).unwrap();
    operator
        .wait_for_state(rig, ms(2000), FlightState::Latched)
        .unwrap();
    assert!(operator.last_text().unwrap().contains("brown-out"));
}

/// The record of a crash outlives the bootloader, which uses RAM of its own, and not the power.
#[test]
fn a_hard_fault_is_told_after_the_reset() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    let at = rig.now();
    let pc = divert(rig, 0xDE00);
    operator.run(rig, ms(1200)).unwrap();
    assert_eq!(rig.resets().len(), 1);
    let (reset, _) = rig.resets()[0];
    let before = rig.truth().pulses.iter().rfind(|p| p.fall < reset).unwrap();
    assert!(
        reset - at < ms(20) || NEUTRAL_US.contains(&before.width_us()),
        "{} us for {}",
        before.width_us(),
        reset - at
    );
    operator
        .wait_for_state(rig, ms(3000), FlightState::Latched)
        .unwrap();
    let reason = format!("hard fault at {pc:#010x}");
    let told = &operator.received().texts;
    assert!(told.iter().any(|t| t.text.contains(&reason)), "{told:?}");

    rig.environment_mut().catch();
    rig.environment_mut().tilt_clamp(0.0);
    rig.power_cycle();
    operator.connect(rig).unwrap();
    operator
        .wait_for_state(rig, ms(8000), FlightState::Standby)
        .unwrap();
}

/// A panic tells where it came from: here, out of bounds, from where the loop was.
#[test]
fn a_panic_is_told_after_the_reset() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    let panic = firmware()
        .symbols()
        .find(|(name, _)| name.contains("panic_bounds_check"));
    let (_, panic) = panic.expect("something in the image is indexed");
    let mut registers = rig.chip().registers();
    let from = registers.r[15];
    (registers.r[14], registers.r[15]) = (from | 1, panic & !1);
    registers.primask = false;
    rig.chip_mut().set_registers(&registers);
    let at = rig.now();
    operator.run(rig, ms(1200)).unwrap();
    let (reset, _) = rig.resets()[0];
    let last = rig.truth().pulses.iter().rfind(|p| p.fall < reset).unwrap();
    assert!(NEUTRAL_US.contains(&last.width_us()) && reset - at < ms(400));
    operator
        .wait_for_state(rig, ms(3000), FlightState::Latched)
        .unwrap();
    let told = &operator.received().texts;
    let place = format!(" {from:#x}");
    assert!(
        told.iter()
            .any(|t| t.text.contains("latched fault: panic") && t.text.contains(&place)),
        "{place}: {told:?}"
    );
}

#[test]
fn a_laptop_that_stops_reading_or_goes_away_disturbs_nothing() {
    let mut flight = in_flight();
    let Ready { rig, operator, .. } = &mut flight;
    let at = rig.now();
    rig.usb_host_mut().pause_reading(true);
    operator.run(rig, ms(1000)).unwrap();
    rig.usb_host_mut().pause_reading(false);
    rig.usb_host_mut().detach();
    operator.run(rig, ms(1000)).unwrap();
    rig.usb_host_mut().attach();
    operator.run(rig, ms(1000)).unwrap();
    assert_pulses_went_on(rig.truth().pulses_since(at), ms(3000));
    let pitch = rig.environment().drone().pitch_rad();
    assert!(pitch.abs() < 0.03, "{pitch}");
    let steps = rig.truth().steps.iter().filter(|s| s.start >= at).count();
    assert!((449..=451).contains(&steps), "{steps} steps in 3 s");
    let before = operator.received().heartbeats.len();
    operator.run(rig, ms(2000)).unwrap();
    assert!(operator.received().heartbeats.len() > before);
    assert_eq!(operator.state(), Some(FlightState::Active));
}
