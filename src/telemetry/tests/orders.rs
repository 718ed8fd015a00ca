//! What the host orders, and what comes of it.

use super::*;

#[test]
fn the_operator_flies_it_by_messages_alone() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let (arm, gripper) = (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavCmd::MAV_CMD_DO_GRIPPER);
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    assert_eq!(acks(&link.tell(&order(arm, 1.0, 0.0))), [(arm, accepted)]);
    assert_eq!(acks(&link.tell(&order(gripper, 1.0, 0.0))), [(gripper, accepted)]);
    assert!(link.desk.flight.state().is_active());
    assert_eq!(acks(&link.tell(&order(arm, 0.0, 0.0))), [(arm, accepted)]);
    assert_eq!(link.desk.flight.state(), State::Standby);
}

#[test]
fn a_refusal_says_why() {
    let mut link = Link::new(Desk::in_standby(55.0_f64.to_radians()));
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    let answer = link.tell(&order(arm, 1.0, 0.0));
    assert_eq!(acks(&answer), [(arm, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]);
    assert_eq!(texts(&answer), ["arm refused: tilt beyond 50 deg"]);
    // COMMAND_ACK's fourth byte, which this crate's decoder leaves out, has it as a number.
    let now = Micros(link.desk.now_us);
    let bytes = order(arm, 1.0, 0.0);
    link.telemetry.receive(now, &bytes, &mut link.desk.flight);
    let sent = link.telemetry.pending().to_vec();
    link.telemetry.sent(sent.len());
    let ack = &sent[sent.len() - 22..];
    assert_eq!((ack[1], ack[7]), (10, COMMAND_ACK_DATA::ID as u8));
    let refusal = RefusalKind::try_from(ack[13]);
    assert_eq!(refusal, Ok(RefusalKind::Tilt));
    let answer = link.tell(&order(MavCmd::MAV_CMD_DO_GRIPPER, 1.0, 0.0));
    assert_eq!(texts(&answer), ["release refused: in standby"]);
}

#[test]
fn bad_arguments_are_denied_and_other_commands_unsupported() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let (arm, gripper) = (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavCmd::MAV_CMD_DO_GRIPPER);
    for (command, param1, param2, result) in [
        (arm, 0.5, 0.0, MavResult::MAV_RESULT_DENIED),
        (arm, f32::NAN, 0.0, MavResult::MAV_RESULT_DENIED),
        (gripper, 1.0, 1.0, MavResult::MAV_RESULT_DENIED),
        (MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 0.0, 0.0, MavResult::MAV_RESULT_DENIED),
        (MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, MavResult::MAV_RESULT_UNSUPPORTED),
        (MavCmd::MAV_CMD_REQUEST_MESSAGE, 33.0, 0.0, MavResult::MAV_RESULT_UNSUPPORTED),
        (MavCmd::MAV_CMD_REQUEST_MESSAGE, 148.0, 0.0, MavResult::MAV_RESULT_ACCEPTED),
    ] {
        let answer = link.tell(&order(command, param1, param2));
        assert_eq!(acks(&answer), [(command, result)]);
    }
    assert_eq!(link.desk.flight.state(), State::Standby);
}

#[test]
fn a_message_for_another_vehicle_is_not_ours() {
    let mut link = Link::new(Desk::in_standby(0.1));
    for (target_system, target_component, ours) in [(2, 1, false), (1, 7, false), (0, 0, true)] {
        let frame = from_host(&COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            param1: 1.0,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        assert_eq!(link.tell(&frame).is_empty(), !ours);
    }
    assert_eq!(link.desk.flight.state(), State::Armed);
}

#[test]
fn calibration_is_refused_while_armed_and_says_why() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let answer = link.tell(&order(MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 1.0, 0.0));
    assert_eq!(texts(&answer), ["calibration refused: in armed"]);
    assert_eq!(acks(&answer)[0].1, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
}

#[test]
fn a_reset_is_for_the_board_and_refused_while_armed() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let reboot = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN;
    for (param1, reset) in
        [(1.0, Some(Reset::Restart)), (3.0, Some(Reset::Bootloader)), (2.0, None)]
    {
        let answer = link.tell(&order(reboot, param1, 0.0));
        let accepted = acks(&answer)[0].1 == MavResult::MAV_RESULT_ACCEPTED;
        assert_eq!(accepted, reset.is_some());
        assert_eq!(link.telemetry.take_reset(), reset);
        assert_eq!(link.telemetry.take_reset(), None);
    }
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let answer = link.tell(&order(reboot, 1.0, 0.0));
    assert_eq!(texts(&answer), ["reboot refused: in armed"]);
    assert_eq!(link.telemetry.take_reset(), None);
}

#[test]
fn an_order_to_the_board_is_refused_while_the_rudder_may_be_needed() {
    let peek = peek(0x2000_0010);
    let mut link = Link::new(Desk::in_standby(0.1));
    assert_eq!(acks(&link.tell(&peek)), [], "answered when it is done");
    let wanted = crate::bringup::Order { what: 1, number: 0x2000_0010 };
    assert_eq!(link.telemetry.take_bringup(), Some(wanted));
    assert_eq!(link.telemetry.take_bringup(), None);
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let refused = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert_eq!(acks(&link.tell(&peek)), [(MavCmd::MAV_CMD_USER_1, refused)]);
    assert_eq!(link.telemetry.take_bringup(), None);
}

#[test]
fn a_heartbeat_of_the_host_counts() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&set("FS_HOST", 1.0));
    let arm = order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0);
    assert_eq!(texts(&link.tell(&arm)), ["arm refused: no host heartbeat"]);
    link.tell(&from_host(&HEARTBEAT_DATA::DEFAULT));
    assert_eq!(texts(&link.tell(&arm)), ["armed"]);
}

#[test]
fn time_is_synchronised_on_request() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let now = link.desk.now_us as i64;
    let answer = link.tell(&from_host(&TIMESYNC_DATA { tc1: 0, ts1: 77 }));
    assert_eq!(answer, [MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: now * 1000, ts1: 77 })]);
    assert!(link.tell(&from_host(&TIMESYNC_DATA { tc1: 5, ts1: 77 })).is_empty());
}

#[test]
fn a_stream_comes_as_often_as_the_host_asks() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    let mut asked = |id: u32, interval_us: f32| {
        let answer = link.tell(&order(interval, id as f32, interval_us));
        acks(&answer)[0].1
    };
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    assert_eq!(asked(ATTITUDE_QUATERNION_DATA::ID, 50_000.0), accepted);
    assert_eq!(asked(RAW_IMU_DATA::ID, -1.0), accepted);
    assert_eq!(asked(GPS_RAW_INT_DATA::ID, 50_000.0), MavResult::MAV_RESULT_DENIED);
    let mut messages = Vec::new();
    for _ in 0..100 {
        link.record_step();
        messages.extend(take(&mut link.telemetry));
    }
    assert_eq!(count(&messages, ATTITUDE_QUATERNION_DATA::ID), 20);
    assert_eq!(count(&messages, RAW_IMU_DATA::ID), 0);
    assert_eq!(count(&messages, SERVO_OUTPUT_RAW_DATA::ID), 100);
}
