//! `tvc forward` between the virtual rig and stations.

use std::net::UdpSocket;
use std::process::Stdio;
use std::time::{Duration, Instant};

use mavlink::dialects::common::MavMessage;
use serde_json::Value;

use crate::running;
use crate::vehicle::{PATIENCE, Rig};

#[test]
fn everything_is_forwarded_and_the_station_is_heard() {
    use client::Wire;

    let rig = Rig::start(&[]);
    let socket = || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket
    };
    let (station, plot) = (socket(), socket());
    let mut bridge = running::command(&["forward", "--port", &rig.path("nano")])
        .args(["--to", &station.local_addr().unwrap().to_string()])
        .args(["--plot", &plot.local_addr().unwrap().to_string()])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut link = Wire::default();
    let mut datagram = [0; 2048];
    let mut heard = |link: &mut Wire| {
        let (count, from) = station.recv_from(&mut datagram).unwrap();
        (link.receive(&datagram[..count]), from)
    };
    let (_, vehicle) = heard(&mut link);
    let set = link.frame(&client::request::set_parameter("PID_KP", 1.75));
    station.send_to(&set, vehicle).unwrap();
    let begun = Instant::now();
    let echoed = |messages: Vec<MavMessage>| {
        let echo = |message: &MavMessage| match message {
            MavMessage::PARAM_VALUE(row) => row.param_value == 1.75,
            _ => false,
        };
        messages.iter().any(echo)
    };
    while !echoed(heard(&mut link).0) {
        assert!(begun.elapsed() < PATIENCE);
    }
    let mut object = [0; 4096];
    let count = plot.recv(&mut object).unwrap();
    let object: Value = serde_json::from_slice(&object[..count]).unwrap();
    assert!(object["timestamp"].is_number() && object["attitude_rad"][1].is_number());
    bridge.kill().unwrap();
    bridge.wait().unwrap();
}

/// With a key, whoever has not signed a command is not obeyed, not even on this computer; what the
/// vehicle tells is signed on its way.
#[test]
fn with_a_key_the_bridge_obeys_only_who_has_it() {
    use client::Wire;
    use mavlink::{MAVLinkV2MessageRaw, MavHeader, SigningConfig, SigningData};
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key");
    let key: [u8; 32] = std::array::from_fn(|index| 3 * index as u8);
    std::fs::write(&path, key).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
    let rig = Rig::start(&[]);
    let station = UdpSocket::bind("127.0.0.1:0").unwrap();
    station.set_read_timeout(Some(PATIENCE)).unwrap();
    let bridge = running::command(&["forward", "--port", &rig.path("nano"), "--seconds", "6"])
        .args(["--to", &station.local_addr().unwrap().to_string()])
        .args(["--plot", "127.0.0.1:9", "--signing-key", path.to_str().unwrap()])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let of_key = |key| SigningData::from_config(SigningConfig::new(key, 1, true, false));
    let (ours, seen) = (of_key(key), of_key(key));
    let mut datagram = [0; 2048];
    let mut link = Wire::default();
    // Every frame is signed; whether a value came back.
    let mut told = |value: f32| {
        let begun = Instant::now();
        loop {
            let (count, from) = station.recv_from(&mut datagram).unwrap();
            let mut bytes = [0; 283];
            bytes[..count].copy_from_slice(&datagram[..count]);
            let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(bytes);
            assert!(seen.verify_signature(&raw), "what comes is not signed");
            let is_it = |message: &MavMessage| matches!(message, MavMessage::PARAM_VALUE(row) if row.param_value == value);
            let found = link.receive(&datagram[..count]).iter().any(is_it);
            if found || begun.elapsed() > Duration::from_secs(1) {
                return (found, from);
            }
        }
    };
    let (_, vehicle) = told(f32::NAN);
    let set = |value, signing: Option<&SigningData>| {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
        let message = client::request::set_parameter("PID_KP", value);
        match signing {
            Some(signing) => {
                raw.serialize_message_for_signing(header, &message);
                signing.sign_message(&mut raw);
            }
            None => raw.serialize_message(header, &message),
        }
        station.send_to(raw.raw_bytes(), vehicle).unwrap();
    };
    set(1.75, None);
    assert!(!told(1.75).0, "an unsigned command was obeyed");
    set(1.75, Some(&of_key([7; 32])));
    assert!(!told(1.75).0, "a command with another key was obeyed");
    set(1.5, Some(&ours));
    assert!(told(1.5).0, "a signed command was not obeyed");
    let output = bridge.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("refused PARAM_SET from 127.0.0.1"), "{said}");
    assert!(said.contains("refused 2 messages in all"), "{said}");
}
