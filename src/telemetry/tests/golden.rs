//! Frames against pymavlink 2.4.50, byte by byte.

use super::*;
use crate::ticks::BurstTimes;

/// The snapshot that the golden frames show.
fn golden_snapshot() -> Snapshot {
    Snapshot {
        now: Micros(1_240_001),
        sample: Some(RawSample {
            time: Micros(1_234_567),
            acc: [1, -2, -981],
            gyr: [16, -32, 48],
            mag: [800, -16, 0x1234],
        }),
        orientation: Orientation { wxyz_q30: [1 << 29, -1 << 29, 1 << 29, -1 << 29] },
        rates: [0.25, -1.5, 0.125].map(Q16::from),
        settled: true,
        cranks: [Q16::from(-0.375), Q16::default()],
        pulses: [PulseUs(1524), PulseUs::NONE],
        state: State::Active { over_tilt_since: None },
        fault: None,
        sensor_healthy: true,
        field_healthy: true,
        missed: 5,
    }
}

#[test]
fn a_step_is_byte_for_byte_what_pymavlink_sends() {
    let flight = Flight::new(Params::default(), BootReport::default()).unwrap();
    let mut telemetry = Telemetry::default();
    let board = BoardStatus {
        load_permille: 123,
        bus_errors: 6,
        bus_recoveries: 7,
        bursts: BurstTimes { mean_us: 4423, max_us: 4580 },
        stop_us: 180,
        clock_fine: None,
    };
    telemetry.record(
        &golden_snapshot(),
        &flight,
        &SensorStatus { fresh: 100, standby: None },
        &board,
    );
    let expected = [
        "statustext_clock",
        "heartbeat_active",
        "current_mode_active",
        "statustext",
        "attitude_quaternion",
        "servo_output_raw",
        "raw_imu",
        "named_value_float",
        "heartbeat_again",
        "sys_status",
        "debug_vect",
        "tilt_sd",
        "head_sd",
        "gain",
    ];
    assert_eq!(telemetry.pending(), expected.map(golden).concat());
}

/// Its next frame has the number 5, as many of the kept ones do.
fn before_frame_five() -> Telemetry {
    Telemetry { sequence: 5, ..Telemetry::default() }
}

#[test]
fn arms_by_either_version_of_the_protocol_signed_or_not_and_by_either_command() {
    for frame in ["arm_v2", "arm_v1", "arm_signed", "arm_int"] {
        let mut link = Link::new(Desk::in_standby(0.1));
        let answer = link.tell(&golden(frame));
        let accepted = (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(acks(&answer), [accepted], "{frame}");
        assert_eq!(texts(&answer), ["armed"]);
        assert_eq!(link.desk.flight.state(), State::Armed);
    }
}

/// What a station asks, and the one frame that answers it.
#[test]
fn questions_are_answered_byte_for_byte() {
    for (question, answer) in [
        ("timesync_request", "timesync_answer"),
        ("ping", "ping_answer"),
        ("mission_request_list", "mission_count"),
        ("mission_clear", "mission_cleared"),
        ("mission_upload", "mission_refused"),
        ("fence_request_list", "fence_count"),
        ("fence_clear", "fence_cleared"),
        ("fence_upload", "fence_refused"),
        ("rally_request_list", "rally_count"),
        ("rally_clear", "rally_cleared"),
        ("rally_upload", "rally_refused"),
        ("param_set", "param_value"),
        ("unknown_command", "unknown_command_ack"),
    ] {
        let mut link = Link::new(Desk::in_standby(0.1));
        link.telemetry.sequence = 5;
        let now = Micros(1_500_000);
        link.telemetry.receive(now, &golden(question), &mut link.desk.flight);
        assert_eq!(link.telemetry.pending(), golden(answer), "{question}");
    }
}

/// Messages that come first of several answers.
#[test]
fn answers_begin_byte_for_byte() {
    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    for (question, answer) in
        [(golden("param_unknown"), "param_error"), (order(request, 244.0, 1.0), "message_interval")]
    {
        let mut link = Link::new(Desk::in_standby(0.1));
        link.telemetry.sequence = 5;
        link.telemetry.receive(Micros(0), &question, &mut link.desk.flight);
        let answer = golden(answer);
        assert_eq!(link.telemetry.pending()[..answer.len()], answer);
    }
}

#[test]
fn modes_are_byte_for_byte_what_pymavlink_sends() {
    let mut telemetry = before_frame_five();
    telemetry.current_mode(0x105);
    assert_eq!(telemetry.pending(), golden("current_mode"));
    let mut telemetry = before_frame_five();
    assert!(telemetry.order_modes(3.0));
    telemetry.continue_modes();
    assert_eq!(telemetry.pending(), golden("available_mode"));
}
