//! Frames against pymavlink 2.4.50 byte by byte, and conversations against the `mavlink` crate's
//! own parser.

mod download;
mod golden;
mod memory;
mod noise;
mod orders;
mod parameters;
mod stations;

use std::string::{String, ToString};
use std::vec::Vec;

use mavlink::dialects::common::*;
use mavlink::{MavlinkReader, MavlinkVersion, MessageData};
use proptest::prelude::*;

use super::*;
use crate::failsafe::{BootReport, Command, Crash, RefusalKind, StateCode};
use crate::flight::Snapshot;
use crate::flight::tests::{Desk, reading};
use crate::params::Params;
use crate::servo::PulseUs;
use tvc_fusion::fixed::Orientation;
use tvc_imu::{RawSample, SensorFault};
use tvc_pid::Q16;

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
    messages.iter().filter(|message| mavlink::Message::message_id(*message) == id).count()
}

/// A frame from a ground station.
fn from_host<D: MessageData>(data: &D) -> Vec<u8> {
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    let header = mavlink::MavHeader { system_id: 255, component_id: 190, sequence: 0 };
    raw.serialize_message_data(header, data);
    raw.raw_bytes().to_vec()
}

/// The host's order.
pub(crate) fn order(command: MavCmd, param1: f32, param2: f32) -> Vec<u8> {
    from_host(&COMMAND_LONG_DATA {
        command,
        param1,
        param2,
        target_system: 1,
        target_component: 1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

/// The host sets a parameter.
pub(crate) fn set(name: &str, value: f32) -> Vec<u8> {
    from_host(&PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}

/// The host's heartbeat.
pub(crate) fn heartbeat() -> Vec<u8> {
    from_host(&HEARTBEAT_DATA::DEFAULT)
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
    sensor: SensorStatus,
    board: BoardStatus,
}

impl Link {
    fn new(desk: Desk) -> Self {
        let (sensor, board) = (SensorStatus::default(), BoardStatus::default());
        let mut link = Self { desk, telemetry: Telemetry::default(), sensor, board };
        link.record_step();
        take(&mut link.telemetry);
        link
    }

    fn record(&mut self, snapshot: &Snapshot) {
        self.telemetry.record(snapshot, &self.desk.flight, &self.sensor, &self.board);
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
    link.desk.rate = 0.2;
    link.record_step();
    assert_eq!(count(&take(&mut link.telemetry), ATTITUDE_DATA::ID), 0);
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    let answer = link.tell(&order(interval, 30.0, 1.0));
    assert_eq!(acks(&answer), [(interval, MavResult::MAV_RESULT_ACCEPTED)]);
    let snapshot = link.desk.step();
    link.record(&snapshot);
    let angles = take(&mut link.telemetry).into_iter().find_map(|message| match message {
        MavMessage::ATTITUDE(m) => {
            let rates = [m.rollspeed, m.pitchspeed, m.yawspeed];
            assert_eq!(rates, snapshot.rates.map(f32::from));
            Some([m.roll, m.pitch, m.yaw])
        }
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

/// A start leaves it four seconds; then a sensor that should stand by is told once each time.
#[test]
fn a_missing_second_sensor_is_told_once_and_shows_in_the_status() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut seconds = |standby, seconds: u32| {
        link.sensor.standby = standby;
        let mut messages = Vec::new();
        for _ in 0..100 * seconds {
            link.record_step();
            messages.extend(take(&mut link.telemetry));
        }
        let status = messages.iter().rev().find_map(|message| match message {
            MavMessage::SYS_STATUS(status) => Some(status),
            _ => None,
        });
        let second = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO2;
        let shows = status.map(|status| {
            [status.onboard_control_sensors_present, status.onboard_control_sensors_health]
                .map(|sensors| sensors.contains(second))
        });
        (texts(&messages).len(), shows.unwrap())
    };
    assert_eq!(seconds(None, 20), (0, [false, false]));
    assert_eq!(seconds(Some(false), 4), (0, [true, false]));
    assert_eq!(seconds(Some(true), 10), (0, [true, true]));
    assert_eq!(seconds(Some(false), 30), (1, [true, false]));
}

#[test]
fn changes_of_state_are_told_at_once_with_their_reason() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.desk.flight.command(Micros(link.desk.now_us), Command::Arm).unwrap();
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
            &SensorStatus::default(),
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
fn eighty_milliseconds_of_silence_and_a_parameter_list_lose_nothing() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&from_host(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 }));
    for _ in 0..8 {
        link.record_step();
    }
    assert_eq!(link.telemetry.dropped(), 0);
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
