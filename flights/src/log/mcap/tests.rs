//! Files read back with the crate that wrote them.

use std::collections::BTreeSet;

use super::*;
use crate::log::tests::TOOL;
use mavlink::dialects::common::{
    HEARTBEAT_DATA, NAMED_VALUE_FLOAT_DATA, PARAM_VALUE_DATA, RAW_IMU_DATA, SERVO_OUTPUT_RAW_DATA,
    STATUSTEXT_DATA, SYS_STATUS_DATA,
};
use mcap::MessageStream;
use nalgebra::Vector3;

/// A frame of the vehicle.
fn frame(sequence: u8, message: &MavMessage) -> Vec<u8> {
    let header = mavlink::MavHeader {
        system_id: tvc_nano::config::SYSTEM_ID.into(),
        component_id: tvc_nano::config::COMPONENT_ID,
        sequence,
    };
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    raw.raw_bytes().to_vec()
}

/// Nose up by 30 degrees, heading north.
fn nose_up() -> ATTITUDE_QUATERNION_DATA {
    let (sin, cos) = 15_f32.to_radians().sin_cos();
    ATTITUDE_QUATERNION_DATA {
        time_boot_ms: 2_000,
        q1: cos,
        q3: sin,
        ..ATTITUDE_QUATERNION_DATA::default()
    }
}

fn every_kind() -> Vec<MavMessage> {
    vec![
        MavMessage::ATTITUDE_QUATERNION(nose_up()),
        MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
            time_usec: 2_004_500,
            servo1_raw: 1600,
            ..SERVO_OUTPUT_RAW_DATA::default()
        }),
        MavMessage::RAW_IMU(RAW_IMU_DATA {
            time_usec: 2_000_250,
            zacc: -981,
            ..RAW_IMU_DATA::default()
        }),
        MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: 2_000,
            value: 0.5,
            name: CRANKS[0].into(),
        }),
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { custom_mode: 2, ..HEARTBEAT_DATA::default() }),
        MavMessage::SYS_STATUS(SYS_STATUS_DATA::default()),
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: "PID_KP".into(),
            param_value: 1.25,
            ..PARAM_VALUE_DATA::default()
        }),
        MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            text: "standby".into(),
            ..STATUSTEXT_DATA::default()
        }),
    ]
}

/// Every kind of message with a frame missing before the last, came at 1 s since 1970 and 10 ms
/// later each.
fn written() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut writer = Writer::new(File::create(&path).unwrap(), TOOL).unwrap();
    let messages = every_kind();
    let last = messages.len() - 1;
    for (index, message) in messages.iter().enumerate() {
        let sequence = index + usize::from(index == last);
        let time_us = 1_000_000 + 10_000 * index as u64;
        writer.write(time_us, &frame(sequence as u8, message)).unwrap();
    }
    writer.end().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn messages_are_as_their_schemas_say_at_the_vehicles_times() {
    let bytes = written();
    let mut times = BTreeMap::new();
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let Some(schema) = &message.channel.schema else {
            continue;
        };
        assert_eq!(message.channel.message_encoding, "json");
        assert_eq!(schema.encoding, "jsonschema");
        let schema: Value = serde_json::from_slice(&schema.data).unwrap();
        let value: Value = serde_json::from_slice(&message.data).unwrap();
        let fields =
            |value: &Value| -> Vec<String> { value.as_object().unwrap().keys().cloned().collect() };
        assert_eq!(fields(&value), fields(&schema["properties"]));
        for (name, value) in value.as_object().unwrap() {
            let said = match value {
                Value::Number(number) if number.is_f64() => "number",
                Value::Number(_) => "integer",
                Value::String(_) => "string",
                _ => "object",
            };
            let expected = &schema["properties"][name]["type"];
            assert_eq!(said, expected, "{name} of {}", message.channel.topic);
        }
        let topic = message.channel.topic.clone();
        times.insert(topic, (message.log_time / 1000, value));
    }
    assert_eq!(times.len(), 9);
    // The vehicle's 2 s are the host's 1 s.
    assert_eq!(times["/attitude"].0, 1_000_000);
    assert_eq!(times["/servo"].0, 1_004_500);
    assert_eq!(times["/counts"].0, 1_000_250);
    assert_eq!(times["/state"].0, 1_040_000);
    assert_eq!(times["/state"].1["state"], "standby");
    let pitch = times["/attitude"].1["pitch_deg"].as_f64().unwrap();
    assert!((pitch - 30.0).abs() < 1e-4, "{pitch}");
}

#[test]
fn frames_come_back_as_they_went_in_and_a_gap_is_told() {
    let bytes = written();
    let (log, error) = frames(&bytes).unwrap();
    assert!(error.is_none());
    let log = crate::log::Log::parse(&log);
    let messages: Vec<_> = log.entries.iter().map(|entry| &entry.message).collect();
    assert_eq!(messages, every_kind().iter().collect::<Vec<_>>());
    assert_eq!(log.entries[7].lost_before, 1);
    assert_eq!(log.entries[7].time_us, 1_070_000);
    let said = MessageStream::new(&bytes).unwrap().any(|message| {
        String::from_utf8_lossy(&message.unwrap().data).contains("1 frames are missing")
    });
    assert!(said);
}

#[test]
fn a_cut_file_is_read_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut writer = Writer::new(File::create(&path).unwrap(), TOOL).unwrap();
    for round in 0..400 {
        for message in every_kind() {
            writer.write(round, &frame(0, &message)).unwrap();
        }
    }
    drop(writer);
    let bytes = std::fs::read(path).unwrap();
    let whole = frames(&bytes).unwrap().0.len();
    let (part, error) = frames(&bytes[..bytes.len() / 2]).unwrap();
    assert!(error.is_some());
    assert!(part.len() > whole / 3 && part.len() < whole);
    assert!(frames(&bytes[..20]).is_err());
}

#[test]
fn the_body_in_a_viewer_points_where_the_drone_points() {
    let shown = transform(0, &nose_up());
    let part = |name: &str| shown["rotation"][name].as_f64().unwrap();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(
        part("w"),
        part("x"),
        part("y"),
        part("z"),
    ));
    let forward = rotation * Vector3::x();
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    assert!((forward - Vector3::new(0.0, cos, sin)).norm() < 1e-6, "{forward}");
    let left = rotation * Vector3::y();
    assert!((left + Vector3::x()).norm() < 1e-6, "west: {left}");
}

#[test]
fn a_vehicle_that_starts_anew_sets_its_clock_again() {
    let mut clock = Clock::default();
    let attitude = |time_boot_ms| {
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            ..ATTITUDE_QUATERNION_DATA::default()
        })
    };
    assert_eq!(clock.time_us(50_000_000, &attitude(9_000)), 50_000_000);
    assert_eq!(clock.time_us(50_019_000, &attitude(9_010)), 50_010_000);
    assert_eq!(clock.time_us(60_000_000, &attitude(500)), 60_000_000);
    assert_eq!(clock.time_us(60_013_000, &attitude(510)), 60_010_000);
}

#[test]
fn the_vehicles_build_and_parameters_are_metadata() {
    use mavlink::dialects::common::AUTOPILOT_VERSION_DATA;

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = Writer::new(File::create(&path).unwrap(), TOOL).unwrap();
    let version = MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        flight_sw_version: 0x0001_02FF,
        flight_custom_version: *b"0a1b2c3d",
        ..AUTOPILOT_VERSION_DATA::default()
    });
    for (sequence, message) in every_kind().iter().chain([&version]).enumerate() {
        writer.write(1, &frame(sequence as u8, message)).unwrap();
    }
    writer.end().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut found = BTreeMap::new();
    for record in mcap::read::LinearReader::new(&bytes).unwrap() {
        if let mcap::records::Record::Metadata(metadata) = record.unwrap() {
            found.insert(metadata.name, metadata.metadata);
        }
    }
    assert_eq!(found["origin"]["vehicle"], "0.1.2 0a1b2c3d");
    assert_eq!(found["parameters"]["PID_KP"], "1.25");
}

/// The layouts for Foxglove and PlotJuggler name what a log has.
#[test]
fn every_topic_and_field_of_the_layouts_is_in_a_log() {
    let mut fields = BTreeSet::new();
    for message in MessageStream::new(&written()).unwrap().map(Result::unwrap) {
        let topic = &message.channel.topic;
        fields.insert(topic.clone());
        if let Ok(Value::Object(said)) = serde_json::from_slice(&message.data) {
            fields.extend(said.keys().map(|field| format!("{topic}.{field}")));
        }
    }
    let foxglove = include_str!("../../../../docs/layouts/foxglove.json");
    let plotjuggler = include_str!("../../../../docs/layouts/plotjuggler.xml");
    serde_json::from_str::<Value>(foxglove).unwrap();
    for (layout, separator) in [(foxglove, "."), (plotjuggler, "/")] {
        let mut named = 0;
        // Every second part of the text stands in quotes.
        let quoted = layout.split('"').skip(1).step_by(2);
        for name in quoted.filter(|text| text.starts_with('/')) {
            named += 1;
            assert!(fields.iter().any(|field| field.replace('.', separator) == name), "{name}");
        }
        assert!(named > 4, "{named}");
    }
}
