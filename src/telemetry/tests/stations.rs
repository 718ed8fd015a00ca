//! What stations such as QGroundControl, MAVProxy and MAVSDK ask of a vehicle by themselves.

use super::*;

const REQUEST: MavCmd = MavCmd::MAV_CMD_REQUEST_MESSAGE;
const CALIBRATION: MavCmd = MavCmd::MAV_CMD_PREFLIGHT_CALIBRATION;
const ARM: MavCmd = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;

fn request(id: u32) -> Vec<u8> {
    order(REQUEST, id as f32, 0.0)
}

impl Link {
    /// What the host hears within `steps` steps of sending `bytes`.
    fn converse(&mut self, bytes: &[u8], steps: usize) -> Vec<MavMessage> {
        let mut heard = self.tell(bytes);
        for _ in 0..steps {
            self.record_step();
            heard.extend(take(&mut self.telemetry));
        }
        heard
    }

    /// SYS_STATUS, as the next step sends it to whoever asks.
    fn status(&mut self) -> SYS_STATUS_DATA {
        let heard = self.converse(&request(SYS_STATUS_DATA::ID), 1);
        let status = heard.into_iter().find_map(|message| match message {
            MavMessage::SYS_STATUS(status) => Some(status),
            _ => None,
        });
        status.unwrap()
    }
}

/// The order of QGroundControl's first connection, with what its older releases ask besides. Each
/// request is answered by what it asks for, or refused by an acknowledgement: none is left to its
/// repeats and its time-out.
#[test]
fn everything_that_qgroundcontrol_asks_at_its_start_is_answered() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.tell(&from_host(&HEARTBEAT_DATA::DEFAULT));
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    let unsupported = MavResult::MAV_RESULT_UNSUPPORTED;
    // What is asked for by its number, the answer, and how many messages of that number come.
    for (id, result, expected) in [
        (AUTOPILOT_VERSION_DATA::ID, accepted, 1),
        (version::ProtocolVersion::ID, accepted, 1),
        (AVAILABLE_MODES_DATA::ID, accepted, StateCode::COUNT),
        (COMPONENT_METADATA_DATA::ID, unsupported, 0),
        (COMPONENT_INFORMATION_BASIC_DATA::ID, unsupported, 0),
        (HOME_POSITION_DATA::ID, unsupported, 0),
        (CURRENT_MODE_DATA::ID, accepted, 1),
    ] {
        let heard = link.converse(&request(id), StateCode::COUNT);
        assert_eq!(acks(&heard), [(REQUEST, result)], "{id}");
        assert_eq!(count(&heard, id), expected, "{id}");
    }
    let list = from_host(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 });
    let heard = link.converse(&list, Params::count());
    assert_eq!(count(&heard, PARAM_VALUE_DATA::ID), Params::count());
    for list in ["mission_request_list", "fence_request_list", "rally_request_list"] {
        let heard = link.tell(&golden(list));
        assert!(
            matches!(heard[..], [MavMessage::MISSION_COUNT(MISSION_COUNT_DATA { count: 0, .. })]),
            "{list}: {heard:?}"
        );
    }
    // The rates of what it draws.
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    for id in [ATTITUDE_QUATERNION_DATA::ID, ATTITUDE_DATA::ID] {
        let heard = link.tell(&order(interval, id as f32, 100_000.0));
        assert_eq!(acks(&heard), [(interval, accepted)], "{id}");
    }
    assert_eq!(link.telemetry.dropped(), 0);
}

#[test]
fn the_state_has_a_name_among_the_modes() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let heard = link.converse(&request(AVAILABLE_MODES_DATA::ID), StateCode::COUNT);
    let modes: Vec<_> = heard
        .iter()
        .filter_map(|message| match message {
            MavMessage::AVAILABLE_MODES(mode) => {
                Some((mode.mode_index, mode.custom_mode, mode.mode_name.to_str()))
            }
            _ => None,
        })
        .collect();
    assert!(modes.contains(&(3, State::Standby.code(), Ok("standby"))));
    let indices: Vec<_> = modes.iter().map(|(index, ..)| *index).collect();
    assert_eq!(indices, (1..=StateCode::COUNT as u8).collect::<Vec<_>>(), "in order");
    // One of them alone; there is none behind the last.
    let heard = link.converse(&order(REQUEST, 435.0, 4.0), 3);
    assert_eq!(count(&heard, AVAILABLE_MODES_DATA::ID), 1);
    let beyond = link.converse(&order(REQUEST, 435.0, StateCode::COUNT as f32 + 1.0), 3);
    assert_eq!(acks(&beyond), [(REQUEST, MavResult::MAV_RESULT_UNSUPPORTED)]);
    assert_eq!(count(&beyond, AVAILABLE_MODES_DATA::ID), 0);
}

#[test]
fn whatever_the_vehicle_sends_by_itself_is_sent_once_more_on_request() {
    let mut link = Link::new(Desk::in_standby(0.1));
    for id in [30, 31, 36, 27, 251, 0, 1] {
        // Nothing of a step comes by itself here.
        for stream in [30, 31, 36, 27, 251] {
            let off = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
            link.tell(&order(off, stream as f32, -1.0));
        }
        link.telemetry.heartbeat_at = Some(Micros(link.desk.now_us));
        let heard = link.converse(&request(id), 5);
        assert_eq!(acks(&heard), [(REQUEST, MavResult::MAV_RESULT_ACCEPTED)]);
        assert_eq!(count(&heard, id), 1, "{id}");
        assert_eq!(heard.len(), 2, "{heard:?}");
    }
}

#[test]
fn an_interval_is_told_by_either_command() {
    let mut link = Link::new(Desk::in_standby(0.1));
    #[allow(deprecated)]
    let get = MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL;
    for question in [order(get, 1.0, 0.0), order(REQUEST, 244.0, 1.0)] {
        let heard = link.tell(&question);
        assert!(
            matches!(
                heard[0],
                MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    interval_us: 1_000_000,
                    message_id: 1,
                })
            ),
            "{heard:?}"
        );
        assert_eq!(acks(&heard)[0].1, MavResult::MAV_RESULT_ACCEPTED);
    }
}

/// The check before arming is healthy exactly where an order to arm would be obeyed, and while the
/// drone is armed. Who asks for it is answered as the order would be, and nothing is said.
#[test]
fn stations_are_told_whether_the_drone_can_be_armed() {
    let readiness = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
    let mut said = Vec::new();
    let mut look = |link: &mut Link| {
        let status = link.status();
        assert!(
            status
                .onboard_control_sensors_present
                .intersection(status.onboard_control_sensors_enabled)
                .contains(readiness)
        );
        let healthy = status.onboard_control_sensors_health.contains(readiness);
        let armed = link.desk.flight.state().is_armed();
        let mut copy = link.desk.flight.clone();
        let obeyed = copy.command(Micros(link.desk.now_us), Command::Arm).is_ok();
        assert_eq!(healthy, armed || obeyed, "{:?}", copy.state());
        let answer = link.tell(&order(MavCmd::MAV_CMD_RUN_PREARM_CHECKS, 0.0, 0.0));
        let accepted = acks(&answer)[0].1 == MavResult::MAV_RESULT_ACCEPTED;
        assert_eq!(accepted, obeyed, "{:?}", copy.state());
        assert!(texts(&answer).is_empty(), "{answer:?}");
        said.push(healthy);
    };
    let mut link = Link::new(Desk::new(0.1));
    look(&mut link);
    // Standby comes before the gyro's offset is known.
    link.converse(&[], 150);
    assert_eq!(link.desk.flight.state(), State::Standby);
    look(&mut link);
    let mut link = Link::new(Desk::in_standby(0.1));
    look(&mut link);
    for (name, value) in [
        ("SRV_POLARITY", 0.0),
        ("SRV_POLARITY", 1.0),
        ("SRV_POLARITY", 2.0),
        ("SRV_POLARITY", 1.0),
        ("FS_HOST", 1.0),
    ] {
        link.tell(&set(name, value));
        look(&mut link);
    }
    link.tell(&set("FS_HOST", 0.0));
    link.tell(&order(ARM, 1.0, 0.0));
    look(&mut link);
    link.tell(&order(MavCmd::MAV_CMD_DO_GRIPPER, 1.0, 0.0));
    look(&mut link);
    for _ in 0..8 {
        let snapshot = link.desk.step_with(Err(SensorFault::Nak));
        link.record(&snapshot);
    }
    take(&mut link.telemetry);
    look(&mut link);
    let (ready, not) = (true, false);
    assert_eq!(
        said,
        [not, not, ready, not, not, not, ready, not, ready, ready, not],
        "boot, offset unknown, standby, polarity unchecked, refused, watched, checked, no host, \
         armed, active, failsafe"
    );
}

#[test]
fn a_calibration_is_accepted_only_when_the_rest_is_over() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let calibrate = order(CALIBRATION, 1.0, 0.0);
    let heard = link.converse(&calibrate, 600);
    let answers: Vec<_> = acks(&heard).into_iter().map(|(_, result)| result).collect();
    let (last, before) = answers.split_last().unwrap();
    assert_eq!(*last, MavResult::MAV_RESULT_ACCEPTED);
    assert!(before.len() > 3, "once a second: {answers:?}");
    assert!(before.iter().all(|result| *result == MavResult::MAV_RESULT_IN_PROGRESS));
    assert!(link.desk.flight.is_calibrated());
    // It is told once.
    assert_eq!(acks(&link.converse(&request(0), 200)).len(), 1);
}

#[test]
fn a_calibration_that_ends_in_a_failsafe_has_failed() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.converse(&order(CALIBRATION, 1.0, 0.0), 150);
    assert_eq!(link.desk.flight.state(), State::Standby);
    for _ in 0..8 {
        let snapshot = link.desk.step_with(Err(SensorFault::Nak));
        link.record(&snapshot);
    }
    let heard = take(&mut link.telemetry);
    assert_eq!(acks(&heard), [(CALIBRATION, MavResult::MAV_RESULT_FAILED)]);
}

/// The last two bytes of the payload of a COMMAND_ACK name the asker; this crate's decoder leaves
/// them out.
fn ack_target(bytes: &[u8]) -> [u8; 2] {
    let ack = bytes
        .windows(22)
        .rfind(|frame| frame[..2] == [0xFD, 10] && frame[7] == COMMAND_ACK_DATA::ID as u8)
        .unwrap();
    [ack[18], ack[19]]
}

#[test]
fn an_acknowledgement_is_for_the_one_that_asked_however_late_it_comes() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut flash = crate::store::tests::Mock::new();
    let hear = |link: &mut Link, system: u8, bytes: &[u8]| {
        let mut frame = bytes.to_vec();
        frame[5] = system;
        let end = frame.len() - 2;
        let extra = <MavMessage as mavlink::Message>::extra_crc(COMMAND_LONG_DATA::ID);
        let crc = mavlink::calculate_crc(&frame[1..end], extra);
        frame[end..].copy_from_slice(&crc.to_le_bytes());
        let now = Micros(link.desk.now_us);
        link.telemetry.receive(now, &frame, &mut link.desk.flight);
        let bytes = link.telemetry.pending().to_vec();
        link.telemetry.sent(bytes.len());
        bytes
    };
    // One stores, one calibrates, a third asks for something else.
    assert!(hear(&mut link, 250, &save()).is_empty());
    let begun = hear(&mut link, 251, &order(CALIBRATION, 1.0, 0.0));
    assert_eq!(ack_target(&begun), [251, 190]);
    assert_eq!(ack_target(&hear(&mut link, 252, &request(148))), [252, 190]);
    while link.telemetry.has_storage_order() {
        link.telemetry.serve_storage(&mut flash, &mut link.desk.flight);
    }
    let saved = link.telemetry.pending().to_vec();
    link.telemetry.sent(saved.len());
    assert_eq!(ack_target(&saved), [250, 190]);
    while !link.desk.flight.is_calibrated() {
        take(&mut link.telemetry);
        link.record_step();
    }
    assert_eq!(ack_target(link.telemetry.pending()), [251, 190]);
}

#[test]
fn the_version_has_the_serial_number_and_capabilities() {
    let serial = std::array::from_fn(|at| at as u8 + 1);
    let mut link = Link::new(Desk::in_standby(0.1));
    link.telemetry = Telemetry::new(Identity { system: 1, serial });
    let now = Micros(link.desk.now_us);
    link.telemetry.receive(now, &request(148), &mut link.desk.flight);
    // `uid2` is an extension that this crate's decoder leaves out.
    let payload = &link.telemetry.pending()[10..86];
    assert_eq!(payload[60..], serial);
    let heard = take(&mut link.telemetry);
    let MavMessage::AUTOPILOT_VERSION(version) = &heard[0] else {
        panic!("{heard:?}");
    };
    let folded: [u8; 8] = std::array::from_fn(|at| serial[at] ^ serial[at + 8]);
    assert_eq!(version.uid, u64::from_le_bytes(folded));
    assert_eq!(version.flight_sw_version & 0xFF, 255);
    assert!(
        version.capabilities.contains(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT)
    );
    assert!(
        !version.capabilities.contains(MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MISSION_INT)
    );
}

#[test]
fn a_vehicle_with_another_number_speaks_by_it_and_obeys_no_order_to_the_first() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.telemetry = Telemetry::new(Identity { system: 7, ..Identity::default() });
    let arm = |target_system| {
        from_host(&COMMAND_LONG_DATA {
            command: ARM,
            param1: 1.0,
            target_system,
            target_component: 1,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    let now = Micros(link.desk.now_us);
    link.telemetry.receive(now, &arm(1), &mut link.desk.flight);
    assert!(link.telemetry.pending().is_empty());
    link.telemetry.receive(now, &arm(7), &mut link.desk.flight);
    assert_eq!(link.desk.flight.state(), State::Armed);
    assert_eq!(link.telemetry.pending()[5..7], [7, 1]);
}

/// As MAVProxy begins to fetch its parameters: it asks for a file first, and for the parameters
/// when that is refused.
#[test]
fn a_request_for_a_file_is_refused_at_once() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let path = b"@PARAM/param.pck?withdefaults=1";
    let mut payload = [0; 251];
    // Number, session, OpenFileRO, size; offset; path.
    payload[..5].copy_from_slice(&[0xFF, 0x12, 3, 4, path.len() as u8]);
    payload[12..12 + path.len()].copy_from_slice(path);
    let request = FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system: 1,
        target_component: 1,
        payload,
    };
    let heard = link.tell(&from_host(&request));
    let [MavMessage::FILE_TRANSFER_PROTOCOL(answer)] = &heard[..] else {
        panic!("{heard:?}");
    };
    assert_eq!((answer.target_system, answer.target_component), (255, 190));
    // The next number, the session, NAK, one byte, of OpenFileRO; unknown operation.
    assert_eq!(answer.payload[..8], [0x00, 0x13, 3, 129, 1, 4, 0, 0]);
    assert_eq!(answer.payload[8..14], [0, 0, 0, 0, 7, 0]);
    let other = FILE_TRANSFER_PROTOCOL_DATA { target_system: 2, ..request };
    assert_eq!(link.tell(&from_host(&other)), []);
}

/// Whoever begins to listen at any time hears within a second why control was given up.
#[test]
fn a_failsafe_is_told_with_its_reason_once_a_second() {
    let mut link = Link::new(Desk::in_standby(0.1));
    link.record_step();
    for _ in 0..20 {
        let snapshot = link.desk.step_with(Err(SensorFault::Nak));
        link.record(&snapshot);
    }
    take(&mut link.telemetry);
    // Ticks of 10 ms.
    for _ in 0..3 {
        let said = texts(&link.converse(&[], 100));
        assert_eq!(said, ["failsafe: IMU does not answer"]);
    }
}

#[test]
fn a_refusal_is_not_repeated_within_two_seconds_and_names_what_is_latched() {
    let crash = BootReport { crash: Some(Crash::Watchdog), ..BootReport::default() };
    let mut link = Link::new(Desk::with(0.1, crate::flight::tests::params(), crash));
    link.converse(&[], 5);
    let arm = order(ARM, 1.0, 0.0);
    let said = texts(&link.tell(&arm));
    let expected = ["arm refused: in latched fault", "latched fault: watchdog reset"];
    assert_eq!(said, expected);
    for _ in 0..3 {
        let again = link.tell(&arm);
        assert_eq!(acks(&again), [(ARM, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]);
        assert!(texts(&again).is_empty(), "{again:?}");
    }
    link.converse(&[], 200);
    assert_eq!(texts(&link.tell(&arm)), expected);
}
