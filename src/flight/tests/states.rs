//! Who may move the rudder: faults, tilt, and the operator's commands out of order.

use super::*;
use crate::SelfCheck;
use crate::ticks::BurstTimes;
use std::string::ToString;

#[test]
fn every_sensor_fault_commands_neutral_in_time_and_leads_back_only_to_standby() {
    for fault in [
        SensorFault::Nak,
        SensorFault::Timeout,
        SensorFault::Stuck,
        SensorFault::Arbitration,
        SensorFault::Protocol,
        SensorFault::Reset,
        SensorFault::AllOnes,
        SensorFault::Frozen,
        SensorFault::Implausible,
        SensorFault::Torn,
        SensorFault::Late,
        SensorFault::Booting,
        SensorFault::RegisterMismatch,
    ] {
        let mut desk = Desk::active(0.4);
        desk.run(5);
        let since = desk.now_us;
        while desk.step_with(Err(fault)).pulses[0] != NEUTRAL {
            assert!(desk.now_us - since <= 60_000, "{fault:?}");
        }
        let reason = Reason::Sensor(fault);
        assert_eq!(desk.flight.state(), State::Failsafe(reason));
        assert_eq!(desk.command(Command::Release), Err(Refusal::WrongState(desk.flight.state())));
        assert_eq!(desk.command(Command::Arm), Err(Refusal::WrongState(desk.flight.state())));
        assert_eq!(desk.command(Command::Disarm), Err(Refusal::FaultPersists(reason)));

        desk.free = false;
        (desk.pitch, desk.rate) = (0.3, 0.0);
        assert_eq!(desk.run(4).pulses[0], NEUTRAL);
        assert_eq!(desk.command(Command::Disarm), Err(Refusal::FaultPersists(reason)));
        desk.run(1);
        assert_eq!(desk.flight.state(), State::Failsafe(reason), "never by itself");
        desk.command(Command::Disarm).unwrap();
        assert_eq!(desk.flight.state(), State::Standby);
    }
}

/// Of a sample that the driver found bad nothing gets into the estimate: not its counts, not even
/// its time.
#[test]
fn a_bad_sample_never_reaches_the_filter() {
    let mut desk = Desk::active(0.4);
    desk.run(20);
    let before = desk.flight.attitude();
    for fault in [
        SensorFault::Implausible,
        SensorFault::Torn,
        SensorFault::AllOnes,
        SensorFault::Reset,
        SensorFault::Frozen,
        SensorFault::Unreliable,
        SensorFault::RegisterMismatch,
        SensorFault::Nak,
    ] {
        let snapshot = desk.step_with(Err(fault));
        assert_eq!(snapshot.sample, None);
        assert_eq!(desk.flight.attitude(), before, "{fault:?}");
    }
}

/// A wrong bit in a register that is read to look after the sensor is no reason to give up.
#[test]
fn a_register_in_doubt_costs_samples_and_not_the_flight() {
    let mut desk = Desk::active(0.4);
    desk.run(5);
    for _ in 0..3 {
        desk.step_with(Err(SensorFault::RegisterMismatch));
    }
    desk.run(1);
    assert!(desk.flight.state().is_active());
}

#[test]
fn tilt_ends_control_after_a_tenth_of_a_second_but_not_while_held() {
    let mut desk = Desk::in_standby(0.8);
    desk.command(Command::Arm).unwrap();
    desk.pitch = 1.15;
    desk.run(300);
    assert_eq!(desk.flight.state(), State::Armed);
    assert_eq!(desk.command(Command::Release), Err(Refusal::Tilt));

    let mut desk = Desk::active(0.8);
    desk.free = false;
    // Thrown over at 5 rad/s, faster than any filter's accelerometer correction.
    desk.rate = 5.0;
    let mut over_since = None;
    while desk.flight.state().is_active() {
        desk.pitch = (desk.pitch + 0.05).min(1.2);
        // Rates that stay the same for 60 ms are not known to be new.
        let unsteady = if desk.now_us.is_multiple_of(20_000) { 5.0 } else { 5.01 };
        desk.rate = if desk.pitch < 1.2 { unsteady } else { 0.0 };
        let attitude = desk.step().orientation.quaternion();
        if attitude.pitch() > 60.0_f32.to_radians() {
            over_since.get_or_insert(desk.now_us);
        }
        assert!(desk.now_us < 7_000_000);
    }
    assert_eq!(desk.now_us - over_since.unwrap(), 100_000);
    assert_eq!(desk.flight.state(), State::Failsafe(Reason::Tilt));
    assert_eq!(desk.command(Command::Disarm), Err(Refusal::FaultPersists(Reason::Tilt)));
}

#[test]
fn arming_asks_for_less_than_fifty_degrees() {
    let mut desk = Desk::in_standby(51.0_f64.to_radians());
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Tilt));
    let mut desk = Desk::in_standby(-49.0_f64.to_radians());
    assert_eq!(desk.command(Command::Arm), Ok(()));
}

#[test]
fn commands_out_of_order_are_refused_and_repeated_ones_are_not() {
    let mut desk = Desk::new(0.1);
    assert_eq!(desk.command(Command::Arm), Err(Refusal::WrongState(State::Boot)));
    desk.run(REST);
    assert_eq!(desk.command(Command::Release), Err(Refusal::WrongState(State::Standby)));
    for command in [Command::Arm, Command::Arm, Command::Release, Command::Release] {
        desk.command(command).unwrap();
    }
    assert!(desk.flight.state().is_active());
    desk.command(Command::Disarm).unwrap();
    assert_eq!(desk.step().pulses[0], NEUTRAL);
    desk.command(Command::Disarm).unwrap();
    assert_eq!(desk.flight.state(), State::Standby);
}

#[test]
fn a_bad_end_of_the_last_run_must_be_acknowledged() {
    for crash in [
        Crash::Watchdog,
        Crash::BrownOut,
        Crash::SelfCheck(SelfCheck::Stack),
        Crash::HardFault { pc: 0x2100 },
    ] {
        let report = BootReport { crash: Some(crash), ..BootReport::default() };
        let mut desk = Desk::with(0.1, params(), report);
        desk.run(300);
        assert_eq!(desk.flight.state(), State::Latched(Latch::Crash(crash)));
        assert_eq!(
            desk.command(Command::Arm),
            Err(Refusal::WrongState(State::Latched(Latch::Crash(crash))))
        );
        desk.command(Command::Disarm).unwrap();
        desk.run(110);
        assert_eq!(desk.flight.state(), State::Standby);
    }
}

#[test]
fn lost_parameters_are_acknowledged_after_the_crash_that_came_with_them() {
    let report = BootReport { crash: Some(Crash::BrownOut), stored: Loaded::Corrupt };
    let mut desk = Desk::with(0.1, Params::default(), report);
    for latch in [Latch::Crash(Crash::BrownOut), Latch::ParametersLost] {
        assert_eq!(desk.flight.state(), State::Latched(latch));
        assert!(desk.command(Command::Arm).is_err());
        desk.command(Command::Disarm).unwrap();
    }
    assert_eq!(desk.flight.state(), State::Boot);
}

#[test]
fn losing_the_sensor_during_the_self_test_starts_it_again() {
    let mut desk = Desk::new(0.1);
    desk.run(90);
    for _ in 0..8 {
        desk.step_with(Err(SensorFault::Nak));
    }
    assert_eq!(desk.flight.state(), State::Boot);
    desk.run(90);
    assert!(matches!(desk.flight.state(), State::SelfTest(_)));
    desk.run(15);
    assert_eq!(desk.flight.state(), State::Standby);
}

/// At rest a rate of 6 deg/s is no turn; so much is no offset either.
#[test]
fn nothing_is_armed_with_an_offset_that_is_too_large() {
    let mut desk = Desk::new(0.3);
    desk.run(250);
    desk.flight.set_param("CAL_GYR_OX", 6.0).unwrap();
    desk.run(REST);
    assert_eq!(desk.command(Command::Arm), Err(Refusal::BiasRefused));
    desk.flight.set_param("CAL_GYR_OX", 0.0).unwrap();
    desk.run(REST);
    desk.command(Command::Arm).unwrap();
}

/// After a gap that is too short to start over the attitude is as it was, but nobody knows.
#[test]
fn arming_waits_for_the_tilt_to_be_certain() {
    let mut desk = Desk::new(0.3);
    desk.run(REST);
    for _ in 0..20 {
        desk.step_with(Err(SensorFault::Nak));
    }
    desk.run(usize::from(crate::config::RECOVERY_SAMPLES) + 1);
    desk.command(Command::Disarm).unwrap();
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Uncertain));
    let mut steps = 0;
    while desk.command(Command::Arm).is_err() {
        desk.run(1);
        steps += 1;
    }
    assert!((20..600).contains(&steps), "{steps}");
}

/// The timing follows what the bursts take, but not while armed; a sensor that is too slow for 100
/// bursts a second is not flown, and the refusal says how long a burst takes.
#[test]
fn the_timing_follows_the_bursts_and_a_slow_bus_is_refused() {
    let bursts = |mean_us| BoardStatus {
        bursts: BurstTimes { mean_us, max_us: mean_us + 200 },
        ..BoardStatus::default()
    };
    let changed = Some(Params::STRETCH);
    let mut desk = Desk::in_standby(0.0);
    desk.flight.set_param("I2C_KHZ", 400.0).unwrap();
    for (mean_us, changes, stretch_us) in [
        (0, None, 180),
        (4_423, None, 180),
        (4_600, None, 180),
        (4_650, changed, 196),
        (7_993, changed, 355),
        (8_204, None, 355),
    ] {
        assert_eq!(desk.flight.learn(&bursts(mean_us)), changes, "{mean_us}");
        assert_eq!(desk.flight.params().timing().stretch_us, stretch_us);
    }
    assert_eq!(desk.flight.learn(&bursts(8_400)), changed);
    let refused = desk.command(Command::Arm);
    assert_eq!(refused, Err(Refusal::SlowBus(8_395)));
    assert_eq!(refused.unwrap_err().to_string(), "IMU bursts of 8395 us too slow");
    assert_eq!(desk.flight.learn(&bursts(4_300)), changed);
    desk.run(REST);
    desk.command(Command::Arm).unwrap();
    assert_eq!(desk.flight.learn(&bursts(8_400)), None, "armed");
}

/// What USB disciplines the clock to is kept, but for the last bits, and not while armed.
#[test]
fn the_clock_that_usb_has_locked_is_kept() {
    let mut desk = Desk::in_standby(0.0);
    let locked = |fine| BoardStatus { clock_fine: Some(fine), ..BoardStatus::default() };
    assert_eq!(desk.flight.params().clock_fine(), None);
    let changed = Some(Params::CLOCK);
    for (fine, changes, kept) in [(645, changed, 645), (649, None, 645), (640, changed, 640)] {
        assert_eq!(desk.flight.learn(&locked(fine)), changes);
        assert_eq!(desk.flight.params().clock_fine(), Some(kept));
    }
    desk.command(Command::Arm).unwrap();
    assert_eq!(desk.flight.learn(&locked(500)), None);
}

#[test]
fn nobody_arms_before_the_rudder_was_seen_to_answer_and_a_turned_servo_or_mount_asks_for_it_again()
{
    for (name, value) in
        [("SRV_DIR", -1.0), ("MNT_ROLL_DEG", 180.0), ("MNT_PITCH_DEG", 1.0), ("MNT_YAW_DEG", 90.0)]
    {
        let mut desk = Desk::in_standby(0.0);
        let same = desk.flight.params().value(name).unwrap();
        desk.flight.set_param(name, same).unwrap();
        assert_eq!(desk.flight.params().polarity(Axis::Pitch), Polarity::Checked);
        desk.flight.set_param(name, value).unwrap();
        assert_eq!(desk.flight.params().polarity(Axis::Pitch), Polarity::Unchecked);
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity), "{name}");
        desk.flight.set_param(name, same).unwrap();
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity), "{name}");
        // A file of parameters says so of another vehicle.
        let unseen = ParamError::Unseen { name: "SRV_POLARITY" };
        assert_eq!(desk.flight.set_param("SRV_POLARITY", 1.0), Err(unseen));
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity), "{name}");
        desk.see("SRV_POLARITY");
        // A turned mount has started the estimate over.
        desk.run(REST);
        assert_eq!(desk.command(Command::Arm), Ok(()));
    }
}

/// Turns the held drone to `to` at 0.5 rad/s and rests there for half a second.
fn tilt(desk: &mut Desk, to: f64) -> Snapshot {
    desk.rate = 0.5_f64.copysign(to - desk.pitch);
    while (to - desk.pitch) * desk.rate > 0.0 {
        desk.pitch += desk.rate * 0.01;
        desk.step();
    }
    desk.rate = 0.0;
    desk.run(50)
}

#[test]
fn the_rudder_answers_the_tilt_in_standby_while_somebody_looks_and_nothing_is_armed_then() {
    let mut desk = Desk::in_standby(0.0);
    desk.flight.set_param("SRV_POLARITY", 2.0).unwrap();
    assert_eq!(tilt(&mut desk, 0.3).pulses[0], NEUTRAL, "no host");
    tilt(&mut desk, 0.0);
    desk.flight.host_heard(Micros(desk.now_us));
    let up = tilt(&mut desk, 0.3).pulses[0];
    // Nose up asks for positive crank angles, which are longer pulses.
    assert!(up > PulseUs(1600), "{up:?}");
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Polarity));
    let down = tilt(&mut desk, -0.3).pulses[0];
    assert!(down < PulseUs(1450), "{down:?}");
    desk.flight.host_heard(Micros(desk.now_us));
    let upright = tilt(&mut desk, 0.0).pulses[0];
    assert!(upright.0.abs_diff(NEUTRAL.0) < 30, "{upright:?}");
    let tilted = tilt(&mut desk, 0.3).pulses[0];
    assert!(tilted > NEUTRAL, "{tilted:?}");
    assert_eq!(desk.run(300).pulses[0], NEUTRAL, "silent for three seconds");
    desk.flight.host_heard(Micros(desk.now_us));
    desk.flight.set_param("SRV_DIR", -1.0).unwrap();
    assert_eq!(desk.run(1).pulses[0], NEUTRAL);
    desk.see("SRV_POLARITY");
    assert_eq!(desk.run(50).pulses[0], NEUTRAL);
}

#[test]
fn a_pulse_is_tried_for_two_seconds_where_nobody_needs_the_rudder() {
    let mut desk = Desk::in_standby(0.0);
    let low = PulseUs(900);
    let test_pulse = |desk: &mut Desk| desk.command(Command::TestPulse(Axis::Pitch, low));
    test_pulse(&mut desk).unwrap();
    assert_eq!(desk.run(199).pulses[0], low);
    assert_eq!(desk.run(2).pulses[0], NEUTRAL);
    test_pulse(&mut desk).unwrap();
    assert_eq!(desk.run(1).pulses[0], low);
    desk.command(Command::Arm).unwrap();
    assert_eq!(desk.run(1).pulses[0], NEUTRAL);
    assert_eq!(test_pulse(&mut desk), Err(Refusal::WrongState(State::Armed)));
    desk.command(Command::Disarm).unwrap();
    assert_eq!(desk.run(1).pulses[0], NEUTRAL);
}

/// The estimate belongs to the samples as calibration and mount had made them, and to their rate.
#[test]
fn a_changed_calibration_or_mount_starts_the_estimate_over_and_arming_waits() {
    for (name, value) in [
        ("CAL_GYR_OY", 3.0),
        ("CAL_ACC_OX", 0.2),
        ("CAL_MAG_XX", 1.1),
        ("MNT_PITCH_DEG", 30.0),
        ("DECLINATION_DEG", 4.0),
        ("I2C_KHZ", 400.0),
    ] {
        let mut desk = Desk::in_standby(0.0);
        desk.flight.set_param(name, value).unwrap();
        desk.see("SRV_POLARITY");
        // At once, and after the first sample of the new kind.
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Settling), "{name}");
        desk.run(1);
        assert_eq!(desk.command(Command::Arm), Err(Refusal::Settling), "{name}");
    }
}

#[test]
fn the_old_offset_of_the_gyro_does_not_outlive_its_calibration() {
    let turning = |desk: &mut Desk| {
        let mut sample = reading(desk.now_us, 0.0, 0.0);
        sample.gyr[1] += 3 * 16;
        desk.step_with(Ok(sample))
    };
    let mut desk = Desk::new(0.0);
    for _ in 0..REST {
        turning(&mut desk);
    }
    assert_eq!(desk.flight.state(), State::Standby);
    desk.flight.set_param("CAL_GYR_OY", 3.0).unwrap();
    while desk.command(Command::Arm).is_err() {
        turning(&mut desk);
        assert!(desk.now_us < 20_000_000);
    }
    turning(&mut desk);
    let attitude = desk.flight.attitude();
    assert!(attitude.rate[1].abs() < 1e-3, "{attitude:?}");
    assert!(attitude.orientation.pitch().abs() < 2e-3, "{attitude:?}");
}

#[test]
fn reloaded_parameters_start_the_estimate_over_only_if_the_samples_mean_something_else() {
    let mut desk = Desk::in_standby(0.0);
    let mut params = params();
    params.set("PID_KP", 1.0).unwrap();
    desk.flight.replace_params(params.clone()).unwrap();
    assert_eq!(desk.command(Command::Arm), Ok(()));
    desk.command(Command::Disarm).unwrap();
    params.set("CAL_GYR_OY", 3.0).unwrap();
    desk.flight.replace_params(params).unwrap();
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Settling));
    desk.run(1);
    assert_eq!(desk.command(Command::Arm), Err(Refusal::Settling));
}

#[test]
fn a_test_pulse_is_refused_while_the_rudder_answers_the_tilt_and_ends_when_it_begins_to() {
    let pulse = Command::TestPulse(Axis::Pitch, PulseUs(1900));
    let mut desk = Desk::in_standby(0.0);
    desk.flight.set_param("SRV_POLARITY", 2.0).unwrap();
    assert_eq!(desk.command(pulse), Err(Refusal::RudderAnswers));
    assert_eq!(desk.run(1).pulses[0], NEUTRAL);
    desk.flight.set_param("SRV_POLARITY", 1.0).unwrap();
    desk.command(pulse).unwrap();
    assert_eq!(desk.run(1).pulses[0], PulseUs(1900));
    desk.flight.set_param("SRV_POLARITY", 2.0).unwrap();
    assert!(desk.run(50).pulses[0].0.abs_diff(NEUTRAL.0) < 30);
    desk.flight.set_param("SRV_POLARITY", 1.0).unwrap();
    assert_eq!(desk.run(1).pulses[0], NEUTRAL, "what was ended does not come back");
}

/// 80 mg on z leave 0.92 g: no healthy sensor, until the offset is known.
#[test]
fn a_sensor_with_a_large_offset_passes_its_self_test_once_it_is_calibrated() {
    let mut params = params();
    params.set("CAL_ACC_OZ", 0.785).unwrap();
    for (params, expected) in [(super::params(), false), (params, true)] {
        let mut desk = Desk::with(0.0, params, BootReport::default());
        for _ in 0..REST {
            let mut sample = reading(desk.now_us, 0.0, 0.0);
            sample.acc[2] += 79;
            desk.step_with(Ok(sample));
        }
        assert_eq!(desk.flight.state() == State::Standby, expected);
    }
}
