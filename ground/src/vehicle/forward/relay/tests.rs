//! QGroundControl's requests, played from its source (`FTPManager.cc`,
//! `RequestMetaDataTypeStateMachine.cc`, `CompInfoParam.cc`).

use super::*;
use crate::vehicle::forward::ftp::PAYLOAD;
use crate::vehicle::param::meaning;
use client::request;
use serde_json::Value;
use tvc_nano::params::{DESCRIPTIONS, Range, TABLE};

const ACCEPTED: u8 = 128;
const REFUSED: u8 = 129;

/// A station, the relay, and a vehicle that says little.
struct Bench {
    station: Wire,
    relay: Relay,
    vehicle_sequence: u8,
    /// What the station has got.
    heard: Wire,
    to_vehicle: Vec<u8>,
}

/// An answer of the file transfer.
#[derive(Debug, PartialEq)]
struct Answer {
    number: u16,
    session: u8,
    kind: u8,
    of: u8,
    last: bool,
    offset: u32,
    data: Vec<u8>,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self {
            station: Wire::default(),
            relay: Relay::new(),
            vehicle_sequence: 250,
            heard: Wire::default(),
            to_vehicle: Vec::new(),
        };
        bench.vehicle_speaks();
        bench
    }

    fn vehicle_speaks(&mut self) {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = MavHeader {
            system_id: 7,
            component_id: 1,
            sequence: self.vehicle_sequence,
        };
        self.vehicle_sequence = self.vehicle_sequence.wrapping_add(1);
        raw.serialize_message(header, &request::heartbeat());
        let frame = Wire::default().receive_frames(raw.raw_bytes()).remove(0);
        let passed = self.relay.pass(&frame);
        assert_eq!(self.heard.receive(&passed), [frame.message]);
    }

    fn tell(&mut self, message: &MavMessage) -> Vec<MavMessage> {
        let datagram = self.station.frame(message);
        let relayed = self.relay.take(&datagram);
        self.to_vehicle.extend(relayed.to_vehicle);
        let heard = relayed.to_station.iter();
        let heard = heard.flat_map(|frame| self.heard.receive_frames(frame));
        let messages = heard.map(|frame| {
            assert_eq!((frame.system(), frame.bytes[6]), (7, 1));
            frame.message
        });
        messages.collect()
    }

    fn ask(
        &mut self,
        number: u16,
        session: u8,
        operation: u8,
        offset: u32,
        data: &[u8],
    ) -> Vec<Answer> {
        let size = if data.is_empty() {
            239
        } else {
            data.len() as u8
        };
        let mut payload = [0; PAYLOAD];
        payload[..2].copy_from_slice(&number.to_le_bytes());
        payload[2..5].copy_from_slice(&[session, operation, size]);
        payload[8..12].copy_from_slice(&offset.to_le_bytes());
        payload[12..12 + data.len()].copy_from_slice(data);
        let heard = self.tell(&MavMessage::FILE_TRANSFER_PROTOCOL(
            FILE_TRANSFER_PROTOCOL_DATA {
                target_network: 0,
                target_system: 7,
                target_component: 1,
                payload,
            },
        ));
        let answer = |message: &MavMessage| match message {
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
                assert_eq!((m.target_system, m.target_component), (255, 190));
                let p = &m.payload;
                Answer {
                    number: u16::from_le_bytes([p[0], p[1]]),
                    session: p[2],
                    kind: p[3],
                    of: p[5],
                    last: p[6] == 1,
                    offset: u32::from_le_bytes([p[8], p[9], p[10], p[11]]),
                    data: p[12..12 + usize::from(p[4])].to_vec(),
                }
            }
            other => panic!("{other:?}"),
        };
        heard.iter().map(answer).collect()
    }

    /// As QGroundControl downloads a file: open, bursts until there is no more, the parts that were
    /// lost one by one, and all sessions closed. Every `loss`th part is lost.
    fn download(&mut self, path: &str, loss: usize) -> Vec<u8> {
        let mut number = 65_530;
        let opened = self.ask(number, 0, 4, 0, path.as_bytes()).remove(0);
        assert_eq!(
            (opened.kind, opened.of, opened.number),
            (ACCEPTED, 4, number + 1)
        );
        let size = u32::from_le_bytes(opened.data.try_into().unwrap()) as usize;
        let mut file = vec![None; size];
        let mut expected = 0;
        let mut parts = 0;
        loop {
            number = number.wrapping_add(2);
            let burst = self.ask(number, opened.session, 15, expected, &[]);
            self.vehicle_speaks();
            if burst[0].kind == REFUSED {
                assert_eq!((burst.len(), &burst[0].data[..]), (1, &[6][..]));
                break;
            }
            for (index, part) in burst.iter().enumerate() {
                assert_eq!(part.number, number.wrapping_add(1 + index as u16));
                assert_eq!(
                    (part.kind, part.of, part.session),
                    (ACCEPTED, 15, opened.session)
                );
                assert_eq!(part.last, index + 1 == burst.len());
                parts += 1;
                if parts % loss != 0 {
                    let from = part.offset as usize;
                    let bytes = part.data.iter().map(|byte| Some(*byte));
                    file.splice(from..from + part.data.len(), bytes);
                }
            }
            let end = burst.last().unwrap();
            expected = end.offset + end.data.len() as u32;
            number = end.number.wrapping_sub(1);
        }
        while let Some(missing) = file.iter().position(Option::is_none) {
            number = number.wrapping_add(2);
            let part = self
                .ask(number, opened.session, 5, missing as u32, &[])
                .remove(0);
            assert_eq!(
                (part.kind, part.of, part.offset),
                (ACCEPTED, 5, missing as u32)
            );
            let bytes = part.data.iter().map(|byte| Some(*byte));
            file.splice(missing..missing + part.data.len(), bytes);
        }
        assert_eq!(self.ask(number, 0, 2, 0, &[]).remove(0).kind, ACCEPTED);
        file.into_iter().flatten().collect()
    }
}

/// CRC-32 with neither inversion, bit by bit.
fn checksum(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn qgroundcontrol_gets_units_ranges_and_meanings_of_every_parameter() {
    let mut bench = Bench::new();
    let order = request::Order {
        params: [COMPONENT_METADATA_DATA::ID as f32, 0.0],
        ..request::VERSION
    };
    let heard = bench.tell(&order.message());
    let [
        MavMessage::COMMAND_ACK(ack),
        MavMessage::COMPONENT_METADATA(told),
    ] = &heard[..]
    else {
        panic!("{heard:?}");
    };
    assert_eq!(ack.result, MavResult::MAV_RESULT_ACCEPTED);
    let path = |uri: &str| uri.strip_prefix("mftp://").unwrap().to_owned();
    let general = bench.download(&path(told.uri.to_str().unwrap()), 1_000);
    assert_eq!(checksum(&general), told.file_crc);
    let general: Value = serde_json::from_slice(&general).unwrap();
    assert_eq!(general["version"], 1);
    let told = &general["metadataTypes"][0];
    assert_eq!(told["type"], 1);
    let parameters = bench.download(&path(told["uri"].as_str().unwrap()), 5);
    assert_eq!(u64::from(checksum(&parameters)), told["fileCrc"]);
    let parameters: Value = serde_json::from_slice(&parameters).unwrap();
    assert_eq!(parameters["version"], 1);
    let rows = parameters["parameters"].as_array().unwrap();
    assert_eq!(rows.len(), TABLE.len());
    for ((row, info), about) in rows.iter().zip(TABLE).zip(DESCRIPTIONS) {
        assert_eq!(
            (&row["name"], &row["type"]),
            (&info.name.into(), &"Float".into())
        );
        assert_eq!(
            (&row["units"], &row["shortDesc"]),
            (&about.unit.into(), &meaning(info.name).into())
        );
        let number = |value: &Value| value.as_f64().unwrap() as f32;
        assert_eq!(number(&row["default"]), info.default);
        match info.range {
            Range::Between(low, high) => {
                assert_eq!((number(&row["min"]), number(&row["max"])), (low, high));
            }
            Range::OneOf(values) => {
                let told: Vec<_> = row["values"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|row| number(&row["value"]))
                    .collect();
                assert_eq!(told, values);
            }
        }
    }
    assert!(bench.to_vehicle.is_empty());
    assert_eq!(bench.heard.counts().lost, 0);
}

#[test]
fn nothing_else_can_be_read_and_nothing_written() {
    let mut bench = Bench::new();
    let path = b"/general.json";
    for operation in (0..=255).filter(|operation| ![1, 2, 4, 14].contains(operation)) {
        for (session, data) in [(9, &path[..]), (255, &[0; 239])] {
            let answers = bench.ask(1, session, operation, u32::MAX, data);
            assert_eq!(
                (answers.len(), answers[0].kind, answers[0].number),
                (1, REFUSED, 2)
            );
        }
    }
    for path in [
        "",
        "/",
        "/etc/passwd",
        "/../general.json",
        "@PARAM/param.pck",
    ] {
        let refused = bench.ask(1, 0, 4, 0, path.as_bytes()).remove(0);
        assert_eq!(
            (refused.kind, &refused.data[..]),
            (REFUSED, &[10][..]),
            "{path}"
        );
    }
    let end = bench.ask(1, 1, 5, u32::MAX, &[]).remove(0);
    assert_eq!((end.kind, &end.data[..]), (REFUSED, &[6][..]));
    assert!(bench.to_vehicle.is_empty());
}

/// A datagram of requests for files does not grow into a flood.
#[test]
fn one_request_of_a_datagram_is_answered_by_so_many_frames_at_most() {
    let mut bench = Bench::new();
    let mut payload = [0; PAYLOAD];
    // One byte at a time of the second file.
    payload[2..5].copy_from_slice(&[1, 15, 1]);
    let message = MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system: 7,
        target_component: 1,
        payload,
    });
    let datagram: Vec<_> = (0..50)
        .flat_map(|_| bench.station.frame(&message))
        .collect();
    let relayed = bench.relay.take(&datagram);
    assert_eq!(
        (relayed.to_station.len(), relayed.to_vehicle.len()),
        (16, 0)
    );
}

#[test]
fn everything_else_reaches_the_vehicle_byte_by_byte() {
    let mut bench = Bench::new();
    let file = bench.ask(1, 0, 4, 0, b"/general.json");
    assert_eq!(file.len(), 1);
    let mut sent = Vec::new();
    let mut datagram = vec![0xFD, 3, 0xFE];
    for message in [
        request::heartbeat(),
        request::set_parameter("PID_KP", 1.5),
        request::DISARM.message(),
        request::VERSION.message(),
    ] {
        datagram.extend(bench.station.frame(&message));
    }
    sent.extend_from_slice(&datagram);
    let ftp = MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA::default());
    datagram.extend(bench.station.frame(&ftp));
    datagram.extend_from_slice(&[0xFD, 200, 0]);
    sent.extend_from_slice(&[0xFD, 200, 0]);
    assert_eq!(bench.relay.take(&datagram).to_vehicle, sent);
}

/// The station counts the frames that the vehicle's link has lost, and no others.
#[test]
fn answers_are_numbered_between_the_vehicles_frames() {
    let mut bench = Bench::new();
    for _ in 0..300 {
        bench.vehicle_speaks();
        bench.ask(1, 0, 15, 0, &[]);
    }
    assert_eq!(bench.heard.counts().lost, 0);
    bench.vehicle_sequence = bench.vehicle_sequence.wrapping_add(3);
    bench.vehicle_speaks();
    assert_eq!(bench.heard.counts().lost, 3);
    assert_eq!(bench.heard.counts().crc_errors, 0);
}
