//! Frames against pymavlink 2.4.50 byte by byte, and conversations against the `mavlink` crate's
//! own parser.

mod download;
mod golden;
mod noise;
mod parameters;
mod stations;

use std::string::{String, ToString};
use std::vec::Vec;

use mavlink::dialects::common::*;
use mavlink::{MavlinkReader, MavlinkVersion, MessageData};
use proptest::prelude::*;

use super::*;
use crate::failsafe::{BootReport, Command, Crash, Latch, Reason, RefusalKind, StateCode};
use crate::flight::Snapshot;
use crate::flight::tests::{Desk, reading};
use crate::params::Params;
use crate::servo::PulseUs;
use bno055_driver::{Health, RawSample, SensorFault};
use tvc_fusion::{Attitude, Flags, Quaternion, Vector3};

/// A frame as pymavlink makes it; `tools/golden_frames.py` made them.
fn golden(name: &str) -> Vec<u8> {
    let frames = include_str!("../../tests/data/golden_frames.txt");
    let mut lines = frames.lines().filter_map(|line| line.split_once(' '));
    hex(lines.find(|(known, _)| *known == name).unwrap().1)
}

fn hex(text: &str) -> Vec<u8> {
    (0..text.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap())
        .collect()
}

/// Take everything that waits, as the `mavlink` crate reads it; sequence numbers must have no
/// holes.
fn take(telemetry: &mut Telemetry) -> Vec<MavMessage> {
    let bytes = telemetry.pending().to_vec();
    telemetry.sent(bytes.len());
    let mut reader = MavlinkReader::new(&bytes[..]);
    let mut messages = Vec::new();
    let mut last = None;
    while let Ok((header, message)) = reader.read_message::<MavMessage>(MavlinkVersion::V2) {
        assert_eq!((header.system_id, header.component_id), (1, 1));
        if let Some(last) = last.replace(header.sequence) {
            assert_eq!(header.sequence, u8::wrapping_add(last, 1));
        }
        messages.push(message);
    }
    messages
}

fn texts(messages: &[MavMessage]) -> Vec<String> {
    messages
        .iter()
        .filter_map(|message| match message {
            MavMessage::STATUSTEXT(text) => Some(text.text.to_str().unwrap().to_string()),
            _ => None,
        })
        .collect()
}

fn acks(messages: &[MavMessage]) -> Vec<(MavCmd, MavResult)> {
    messages
        .iter()
        .filter_map(|message| match message {
            MavMessage::COMMAND_ACK(ack) => Some((ack.command, ack.result)),
            _ => None,
        })
        .collect()
}

fn count(messages: &[MavMessage], id: u32) -> usize {
    messages
        .iter()
        .filter(|message| mavlink::Message::message_id(*message) == id)
        .count()
}

/// A frame from a ground station.
fn from_host<D: MessageData>(data: &D) -> Vec<u8> {
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    let header = mavlink::MavHeader {
        system_id: 255,
        component_id: 190,
        sequence: 0,
    };
    raw.serialize_message_data(header, data);
    raw.raw_bytes().to_vec()
}

fn order(command: MavCmd, param1: f32, param2: f32) -> Vec<u8> {
    from_host(&COMMAND_LONG_DATA {
        command,
        param1,
        param2,
        target_system: 1,
        target_component: 1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

fn set(name: &str, value: f32) -> Vec<u8> {
    from_host(&PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}

/// The host's order to start anew.
pub(crate) fn reboot() -> Vec<u8> {
    order(MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0)
}

/// The host's order to store the parameters.
pub(crate) fn save() -> Vec<u8> {
    order(MavCmd::MAV_CMD_PREFLIGHT_STORAGE, 1.0, 0.0)
}

/// The host's order to show the word at `address`.
pub(crate) fn peek(address: u32) -> Vec<u8> {
    order(MavCmd::MAV_CMD_USER_1, 1.0, f32::from_bits(address))
}

/// A flight and its link.
struct Link {
    desk: Desk,
    telemetry: Telemetry,
}

impl Link {
    fn new(desk: Desk) -> Self {
        let mut link = Self {
            desk,
            telemetry: Telemetry::default(),
        };
        link.record_step();
        take(&mut link.telemetry);
        link
    }

    fn record(&mut self, snapshot: &Snapshot) {
        self.telemetry.record(
            snapshot,
            &self.desk.flight,
            &Health::default(),
            &BoardStatus::default(),
        );
    }

    fn record_step(&mut self) {
        let snapshot = self.desk.step();
        self.record(&snapshot);
    }

    /// The host says something, and gets this back at once.
    fn tell(&mut self, bytes: &[u8]) -> Vec<MavMessage> {
        let now = Micros(self.desk.now_us);
        self.telemetry.receive(now, bytes, &mut self.desk.flight);
        take(&mut self.telemetry)
    }
}

#[test]
fn every_step_gives_one_attitude_one_servo_and_with_a_sample_one_raw_message() {
    let mut link = Link::new(Desk::in_standby(0.1));
    for _ in 0..10 {
        let time = link.desk.now_us;
        link.record_step();
        let messages = take(&mut link.telemetry);
        for id in [
            ATTITUDE_QUATERNION_DATA::ID,
            SERVO_OUTPUT_RAW_DATA::ID,
            RAW_IMU_DATA::ID,
            NAMED_VALUE_FLOAT_DATA::ID,
        ] {
            assert_eq!(count(&messages, id), 1);
        }
        let expected = reading(time, 0.1, 0.0);
        let found = messages.iter().find_map(|message| match message {
            MavMessage::RAW_IMU(raw) => Some((
                raw.time_usec,
                [raw.xacc, raw.yacc, raw.zacc],
                [raw.xmag, raw.ymag, raw.zmag],
            )),
            _ => None,
        });
        assert_eq!(found, Some((time, expected.acc, expected.mag)));
    }
    let snapshot = link.desk.step_with(Err(SensorFault::Late));
    link.record(&snapshot);
    let messages = take(&mut link.telemetry);
    assert_eq!(count(&messages, ATTITUDE_QUATERNION_DATA::ID), 1);
    assert_eq!(count(&messages, SERVO_OUTPUT_RAW_DATA::ID), 1);
    assert_eq!(count(&messages, RAW_IMU_DATA::ID), 0);
}

#[test]
fn angles_come_on_request_and_are_those_of_the_quaternion() {
    let mut link = Link::new(Desk::in_standby(0.3));
    link.record_step();
    assert_eq!(count(&take(&mut link.telemetry), ATTITUDE_DATA::ID), 0);
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    let answer = link.tell(&order(interval, 30.0, 1.0));
    assert_eq!(acks(&answer), [(interval, MavResult::MAV_RESULT_ACCEPTED)]);
    link.record_step();
    let angles = take(&mut link.telemetry)
        .into_iter()
        .find_map(|message| match message {
            MavMessage::ATTITUDE(m) => Some([m.roll, m.pitch, m.yaw]),
            _ => None,
        });
    let expected = link.desk.flight.attitude().orientation.euler();
    let expected = [expected.roll_rad, expected.pitch_rad, expected.yaw_rad];
    for (angle, expected) in angles.unwrap().into_iter().zip(expected) {
        assert!((angle - expected).abs() < 2e-4, "{angles:?} {expected:?}");
    }
    assert!((angles.unwrap()[1] - 0.3).abs() < 0.02, "{angles:?}");
}

#[test]
fn heartbeat_and_status_come_once_a_second() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut messages = Vec::new();
    for _ in 0..1000 {
        link.record_step();
        messages.extend(take(&mut link.telemetry));
    }
    assert_eq!(count(&messages, HEARTBEAT_DATA::ID), 10);
    assert_eq!(count(&messages, SYS_STATUS_DATA::ID), 10);
    assert_eq!(link.telemetry.dropped(), 0);
}

#[test]
fn the_operator_flies_it_by_messages_alone() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let (arm, gripper) = (
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        MavCmd::MAV_CMD_DO_GRIPPER,
    );
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    assert_eq!(acks(&link.tell(&order(arm, 1.0, 0.0))), [(arm, accepted)]);
    assert_eq!(
        acks(&link.tell(&order(gripper, 1.0, 0.0))),
        [(gripper, accepted)]
    );
    assert!(link.desk.flight.state().is_active());
    assert_eq!(acks(&link.tell(&order(arm, 0.0, 0.0))), [(arm, accepted)]);
    assert_eq!(link.desk.flight.state(), State::Standby);
}

#[test]
fn a_refusal_says_why() {
    let mut link = Link::new(Desk::in_standby(55.0_f64.to_radians()));
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    let answer = link.tell(&order(arm, 1.0, 0.0));
    assert_eq!(
        acks(&answer),
        [(arm, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]
    );
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
    let (arm, gripper) = (
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        MavCmd::MAV_CMD_DO_GRIPPER,
    );
    for (command, param1, param2, result) in [
        (arm, 0.5, 0.0, MavResult::MAV_RESULT_DENIED),
        (arm, f32::NAN, 0.0, MavResult::MAV_RESULT_DENIED),
        (gripper, 1.0, 1.0, MavResult::MAV_RESULT_DENIED),
        (
            MavCmd::MAV_CMD_NAV_TAKEOFF,
            0.0,
            0.0,
            MavResult::MAV_RESULT_UNSUPPORTED,
        ),
        (
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            33.0,
            0.0,
            MavResult::MAV_RESULT_UNSUPPORTED,
        ),
        (
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            148.0,
            0.0,
            MavResult::MAV_RESULT_ACCEPTED,
        ),
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
fn changes_of_state_are_told_at_once_with_their_reason() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.desk
        .flight
        .command(Micros(link.desk.now_us), Command::Arm)
        .unwrap();
    link.record_step();
    let messages = take(&mut link.telemetry);
    assert_eq!(texts(&messages), ["armed"]);
    assert_eq!(count(&messages, HEARTBEAT_DATA::ID), 1);
    for _ in 0..8 {
        let snapshot = link.desk.step_with(Err(SensorFault::Nak));
        link.record(&snapshot);
    }
    let messages = take(&mut link.telemetry);
    assert_eq!(texts(&messages), ["failsafe: IMU does not answer"]);
    assert!(messages.iter().any(|message| matches!(
        message,
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0x105,
            system_status: MavState::MAV_STATE_CRITICAL,
            ..
        })
    )));
}

#[test]
fn a_sensor_that_does_not_start_is_told_once_a_second() {
    let mut desk = Desk::new(0.1);
    let mut telemetry = Telemetry::default();
    let mut said = Vec::new();
    for _ in 0..300 {
        let snapshot = desk.step_with(Err(SensorFault::Nak));
        telemetry.record(
            &snapshot,
            &desk.flight,
            &Health::default(),
            &BoardStatus::default(),
        );
        said.extend(texts(&take(&mut telemetry)));
    }
    let fault = "IMU does not answer";
    assert_eq!(
        said,
        [
            "clock: raw, up to 3 % off without USB",
            "boot: waiting for the sensor",
            fault,
            fault,
            fault
        ]
    );
}

#[test]
fn every_state_and_reason_has_its_own_number_and_fits_the_line() {
    let states = [
        State::Boot,
        State::Standby,
        State::Armed,
        State::Active {
            over_tilt_since: None,
        },
        State::Failsafe(Reason::Sensor(SensorFault::DeadSensor {
            register: 1,
            found: 0xFF,
        })),
        State::Failsafe(Reason::StaleData),
        State::Failsafe(Reason::InvalidAttitude),
        State::Failsafe(Reason::Tilt),
        State::Failsafe(Reason::HostSilent),
        State::Latched(Latch::Crash(Crash::Watchdog)),
        State::Latched(Latch::Crash(Crash::BrownOut)),
        State::Latched(Latch::Crash(Crash::Panic {
            callers: [0x3_FFFF; 3],
        })),
        State::Latched(Latch::Crash(Crash::HardFault { pc: u32::MAX })),
        State::Latched(Latch::ParametersLost),
    ];
    let mut codes: Vec<_> = states.iter().map(State::code).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!(codes.len(), states.len());
    for state in states {
        assert!(state.to_string().len() <= 50, "{state}");
    }
}

#[test]
fn a_silent_host_costs_whole_frames_and_the_host_can_count_them() {
    let mut link = Link::new(Desk::in_standby(0.1));
    for _ in 0..100 {
        link.record_step();
    }
    let dropped = link.telemetry.dropped();
    assert!(dropped > 0);
    // Events still find room.
    link.telemetry.receive(
        Micros(link.desk.now_us),
        &order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0),
        &mut link.desk.flight,
    );
    let bytes = link.telemetry.pending().to_vec();
    link.telemetry.sent(bytes.len());
    let mut reader = MavlinkReader::new(&bytes[..]);
    let (mut frames, mut lost, mut last) = (0, 0, None);
    let mut armed = false;
    while let Ok((header, message)) = reader.read_message::<MavMessage>(MavlinkVersion::V2) {
        if let Some(last) = last.replace(header.sequence) {
            lost += u32::from(header.sequence.wrapping_sub(last).wrapping_sub(1));
        }
        armed |= texts(&[message]) == ["armed"];
        frames += 1;
    }
    assert!(armed && frames > 30);
    // The host sees the losses modulo 256.
    assert_eq!(lost % 256, dropped % 256);
}

#[test]
fn ten_milliseconds_of_silence_and_a_parameter_list_lose_nothing() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&from_host(&PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    }));
    for _ in 0..8 {
        link.record_step();
    }
    assert_eq!(link.telemetry.dropped(), 0);
}

#[test]
fn time_is_synchronised_on_request() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let now = link.desk.now_us as i64;
    let answer = link.tell(&from_host(&TIMESYNC_DATA { tc1: 0, ts1: 77 }));
    assert_eq!(
        answer,
        [MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: now * 1000,
            ts1: 77
        })]
    );
    assert!(
        link.tell(&from_host(&TIMESYNC_DATA { tc1: 5, ts1: 77 }))
            .is_empty()
    );
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

proptest::proptest! {
    /// By hand or by the compiler, over the clock's whole range.
    #[test]
    fn milliseconds_are_microseconds_by_a_thousand(us: u64) {
        for us in [us, us >> 24, us % 3_000, u64::MAX] {
            proptest::prop_assert_eq!(milliseconds(Micros(us)), (us / 1000) as u32);
        }
    }
}

#[test]
fn calibration_begins_anew_and_arms_nothing_until_the_offset_is_learned() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let calibrate = order(MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 1.0, 0.0);
    let answer = link.tell(&calibrate);
    assert_eq!(
        acks(&answer),
        [(
            MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION,
            MavResult::MAV_RESULT_IN_PROGRESS
        )]
    );
    assert!(texts(&answer).contains(&"boot: waiting for the sensor".to_string()));
    let arm = order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0);
    let refused = link.tell(&arm);
    assert_eq!(
        acks(&refused)[0].1,
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    );
    let unknown = link.tell(&order(MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 0.0, 0.0));
    assert_eq!(acks(&unknown)[0].1, MavResult::MAV_RESULT_DENIED);
}

#[test]
fn calibration_is_refused_while_armed_and_says_why() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let answer = link.tell(&order(MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION, 1.0, 0.0));
    assert_eq!(texts(&answer), ["calibration refused: in armed"]);
    assert_eq!(
        acks(&answer)[0].1,
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    );
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
    assert_eq!(
        asked(GPS_RAW_INT_DATA::ID, 50_000.0),
        MavResult::MAV_RESULT_DENIED
    );
    let mut messages = Vec::new();
    for _ in 0..100 {
        link.record_step();
        messages.extend(take(&mut link.telemetry));
    }
    assert_eq!(count(&messages, ATTITUDE_QUATERNION_DATA::ID), 20);
    assert_eq!(count(&messages, RAW_IMU_DATA::ID), 0);
    assert_eq!(count(&messages, SERVO_OUTPUT_RAW_DATA::ID), 100);
}

#[test]
fn a_reset_is_for_the_board_and_refused_while_armed() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let reboot = MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN;
    for (param1, reset) in [
        (1.0, Some(Reset::Restart)),
        (3.0, Some(Reset::Bootloader)),
        (2.0, None),
    ] {
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
    let wanted = crate::bringup::Order {
        what: 1,
        number: 0x2000_0010,
    };
    assert_eq!(link.telemetry.take_bringup(), Some(wanted));
    assert_eq!(link.telemetry.take_bringup(), None);
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let refused = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert_eq!(acks(&link.tell(&peek)), [(MavCmd::MAV_CMD_USER_1, refused)]);
    assert_eq!(link.telemetry.take_bringup(), None);
}
