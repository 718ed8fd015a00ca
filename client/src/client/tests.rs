//! The client against a vehicle that can be slow, silent or forgetful.

use super::sending::BATCH;
use super::*;
use crate::request::{ARM, CALIBRATE, DISARM, SAVE};
use mavlink::MessageData;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, LOG_DATA_DATA, LOG_ENTRY_DATA,
    MavAutopilot, MavResult, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA, STATUSTEXT_DATA,
};
use tvc_nano::failsafe::{ReasonKind, RefusalKind, StateCode};

const TICK: Duration = Duration::from_millis(10);

/// Both ends of a link and the time that they share.
#[derive(Default)]
struct Bench {
    client: Client,
    vehicle: Wire,
    now: Duration,
}

impl Bench {
    /// The client sends no heartbeats, which would only stand among what is looked for.
    fn new() -> Self {
        Self { client: Client::without_heartbeat(), ..Self::default() }
    }

    /// What the client sends until so much time has gone by.
    fn run(&mut self, time: Duration) -> Vec<MavMessage> {
        let end = self.now + time;
        let mut sent = Vec::new();
        loop {
            self.client.poll(self.now);
            while let Some(frame) = self.client.outgoing() {
                sent.extend(self.vehicle.receive(&frame));
            }
            if self.now >= end {
                return sent;
            }
            self.now += TICK;
        }
    }

    /// What it sends at once.
    fn sent(&mut self) -> Vec<MavMessage> {
        self.run(Duration::ZERO)
    }

    fn order(&mut self, order: Order) -> Ticket {
        self.client.request(self.now, Request::Order(order))
    }

    fn request(&mut self, request: Request) -> Ticket {
        self.client.request(self.now, request)
    }

    /// The vehicle says something.
    fn say(&mut self, message: MavMessage) {
        let frame = self.vehicle.frame(&message);
        self.client.receive(self.now, &frame);
    }

    fn ack(&mut self, order: Order, result: MavResult) {
        self.say(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command: order.command, result }));
    }

    /// COMMAND_ACK with the extension that the dialect's type does not have.
    fn refuse(&mut self, order: Order, why: RefusalKind) {
        let [low, high] = (order.command as u16).to_le_bytes();
        let result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED as u8;
        let mut frame = vec![0xFD, 4, 0, 0, 0, 1, 1, 77, 0, 0];
        frame.extend([low, high, result, why.code()]);
        let crc = mavlink::calculate_crc(&frame[1..], COMMAND_ACK_DATA::EXTRA_CRC);
        frame.extend(crc.to_le_bytes());
        self.client.receive(self.now, &frame);
    }

    fn accept(&mut self, order: Order) {
        self.ack(order, MavResult::MAV_RESULT_ACCEPTED);
    }

    fn text(&mut self, words: &str) {
        self.say(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            text: words.into(),
            ..STATUSTEXT_DATA::default()
        }));
    }

    fn value(&mut self, index: u16, count: u16) {
        self.named_value(&format!("P{index}"), index.into(), index, count);
    }

    fn named_value(&mut self, name: &str, value: f32, index: u16, count: u16) {
        self.say(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_id: name.into(),
            param_value: value,
            param_index: index,
            param_count: count,
            ..PARAM_VALUE_DATA::default()
        }));
    }

    fn answer(&mut self, ticket: Ticket) -> Option<Answer> {
        self.client.answer(ticket)
    }
}

/// How often an order was sent.
fn copies(sent: &[MavMessage], order: Order) -> usize {
    let is = |message: &&MavMessage| match message {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA { command, param1, .. }) => {
            *command == order.command && *param1 == order.params[0]
        }
        _ => false,
    };
    sent.iter().filter(is).count()
}

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

#[test]
fn an_order_is_answered_by_its_acknowledgement_and_repeated_until_then() {
    let mut bench = Bench::new();
    let arm = bench.order(ARM);
    assert_eq!(copies(&bench.run(ms(2_500)), ARM), 3);
    bench.accept(CALIBRATE);
    assert_eq!(bench.answer(arm), None);
    bench.accept(ARM);
    assert_eq!(bench.answer(arm), Some(Ok(())));
    assert_eq!(bench.answer(arm), None, "told once");
    assert!(bench.run(ms(10_000)).is_empty());
}

#[test]
fn silence_ends_a_request() {
    let mut bench = Bench::new();
    let save = bench.order(SAVE);
    bench.run(ANSWER - TICK);
    assert_eq!(bench.answer(save), None);
    bench.run(TICK);
    let silence = Failure::Silence(SAVE.name.into());
    assert_eq!(bench.answer(save), Some(Err(silence.clone())));
    let words = "no answer about save the parameters from the vehicle within 5 s";
    assert_eq!(silence.to_string(), words);
}

#[test]
fn a_refusal_has_the_reason_that_stands_directly_before_it() {
    let mut bench = Bench::new();
    let arm = bench.order(ARM);
    bench.text("arm refused: run tvc calibrate polarity first");
    bench.refuse(ARM, RefusalKind::Polarity);
    let failure = bench.answer(arm).unwrap().unwrap_err();
    assert_eq!(failure.refusal(), Some(RefusalKind::Polarity));
    assert_eq!(failure.to_string(), "arm refused: run tvc calibrate polarity first");

    let arm = bench.order(ARM);
    bench.text("self-test: hold still");
    bench.say(MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    bench.ack(ARM, MavResult::MAV_RESULT_DENIED);
    let failure = bench.answer(arm).unwrap().unwrap_err();
    assert_eq!(failure.refusal(), None);
    assert_eq!(failure.to_string(), "arm refused (MAV_RESULT_DENIED)");
}

impl Bench {
    /// How an order fails behind the text that the vehicle repeats once a second.
    fn refused_again(&mut self, order: request::Order, kind: RefusalKind) -> Failure {
        let ticket = self.order(order);
        self.text("failsafe: IMU does not answer");
        self.refuse(order, kind);
        self.answer(ticket).unwrap().unwrap_err()
    }
}

/// The vehicle tells a refusal once, and its state once a second.
#[test]
fn a_refusal_that_was_told_before_has_the_reason_of_its_kind_and_of_the_state() {
    let mut bench = Bench::new();
    let failure = bench.refused_again(ARM, RefusalKind::Tilt);
    assert_eq!(failure.to_string(), "arm refused: tilt beyond 50 deg");
    let failure = bench.refused_again(ARM, RefusalKind::WrongState);
    assert_eq!(failure.to_string(), "arm refused: in unknown (255)");
    let failsafe = HEARTBEAT_DATA {
        custom_mode: StateCode::Failsafe(ReasonKind::Sensor).number(),
        ..HEARTBEAT_DATA::default()
    };
    bench.say(MavMessage::HEARTBEAT(failsafe));
    let failure = bench.refused_again(DISARM, RefusalKind::FaultPersists);
    assert_eq!(failure.persisting_fault(), Some("IMU does not answer"));
    let failure = bench.refused_again(ARM, RefusalKind::WrongState);
    assert_eq!(failure.to_string(), "arm refused: failsafe: IMU does not answer");
}

#[test]
fn a_second_acknowledgement_of_an_insisted_disarm_does_not_answer_a_later_arm() {
    let mut bench = Bench::new();
    let disarm = bench.order(DISARM);
    // The first acknowledgement takes longer than the pause between two copies.
    assert_eq!(copies(&bench.run(ms(150)), DISARM), 2);
    bench.accept(DISARM);
    assert_eq!(bench.answer(disarm), Some(Ok(())));
    let arm = bench.order(ARM);
    bench.sent();
    bench.accept(DISARM);
    assert_eq!(bench.answer(arm), None, "that was the second copy's");
    bench.refuse(ARM, RefusalKind::Sensor);
    let failure = bench.answer(arm).unwrap().unwrap_err();
    assert_eq!(failure.refusal(), Some(RefusalKind::Sensor));
}

#[test]
fn a_lost_acknowledgement_delays_a_later_order_and_does_not_answer_it() {
    let mut bench = Bench::new();
    let disarm = bench.order(DISARM);
    bench.run(ms(150));
    // One of two acknowledgements is lost.
    bench.accept(DISARM);
    assert_eq!(bench.answer(disarm), Some(Ok(())));
    let arm = bench.order(ARM);
    bench.sent();
    bench.accept(ARM);
    assert_eq!(bench.answer(arm), None, "taken for the lost one");
    assert_eq!(copies(&bench.run(REPEAT), ARM), 1);
    bench.accept(ARM);
    assert_eq!(bench.answer(arm), Some(Ok(())));
    // After the time that an answer may take nothing is expected any more.
    bench.run(ANSWER);
    let arm = bench.order(ARM);
    bench.accept(ARM);
    assert_eq!(bench.answer(arm), Some(Ok(())));
}

/// The acknowledgement of an order to disarm is lost, perhaps with the order itself. That of an
/// order to arm behind it, the same command, does not say that the vehicle is disarmed.
#[test]
fn a_later_acknowledgement_does_not_answer_an_earlier_order() {
    for (first, second) in [(DISARM, ARM), (SAVE, request::RESET)] {
        let mut bench = Bench::new();
        let earlier = bench.order(first);
        bench.sent();
        let later = bench.order(second);
        for _ in 0..copies(&bench.sent(), second) {
            bench.accept(second);
        }
        assert_eq!(bench.answer(earlier), None, "{first:?}");
        let again = bench.run(REPEAT);
        assert!(copies(&again, first) > 0 && copies(&again, second) == 0);
        (0..copies(&again, first)).for_each(|_| bench.accept(first));
        assert_eq!(bench.answer(earlier), Some(Ok(())));
        // What was lost of the first only delays the second.
        for _ in 0..2 {
            assert_eq!(bench.answer(later), None);
            assert_eq!(copies(&bench.run(TICK), second), 1);
            bench.accept(second);
            bench.run(REPEAT - TICK - TICK);
        }
        assert_eq!(bench.answer(later), Some(Ok(())), "{second:?}");
    }
}

/// What waits for an earlier order has its own time from then on.
#[test]
fn an_order_behind_a_silent_one_is_sent_when_that_has_failed() {
    let mut bench = Bench::new();
    let earlier = bench.order(SAVE);
    let later = bench.order(request::RESET);
    assert_eq!(copies(&bench.run(ANSWER + TICK), request::RESET), 1);
    assert!(matches!(bench.answer(earlier), Some(Err(Failure::Silence(_)))));
    assert_eq!(bench.answer(later), None);
}

#[test]
fn nothing_that_was_ordered_before_a_disarm_is_sent_after_it() {
    let mut bench = Bench::new();
    let (arm, save) = (bench.order(ARM), bench.order(SAVE));
    bench.sent();
    let disarm = bench.order(DISARM);
    let overtaken = Failure::Overtaken("arm".into());
    assert_eq!(bench.answer(arm), Some(Err(overtaken)));
    let sent = bench.run(ms(3_000));
    assert_eq!(copies(&sent, DISARM), 31);
    assert_eq!((copies(&sent, ARM), copies(&sent, SAVE)), (0, 0));
    // The acknowledgement of the arming comes first and says nothing about the disarming.
    bench.accept(ARM);
    assert_eq!(bench.answer(disarm), None);
    bench.accept(DISARM);
    bench.accept(SAVE);
    assert_eq!(bench.answer(disarm), Some(Ok(())));
    assert_eq!(bench.answer(save), Some(Ok(())));
}

#[test]
fn a_port_that_goes_away_ends_what_waits_and_says_so() {
    let mut bench = Bench::new();
    let stop = bench.order(DISARM);
    bench.client.close();
    let failure = bench.answer(stop).unwrap().unwrap_err();
    assert_eq!(failure.to_string(), "disarm: the port went away");
}

#[test]
fn a_list_that_takes_longer_than_any_silence_is_not_asked_for_again() {
    let mut bench = Bench::new();
    let list = bench.request(Request::List);
    assert_eq!(bench.sent(), [request::list_parameters()]);
    for index in 0..40 {
        assert!(bench.run(ms(900)).is_empty(), "{index}");
        assert_eq!(bench.answer(list), None);
        bench.value(index, 40);
    }
    assert_eq!(bench.answer(list), Some(Ok(())));
    assert_eq!(bench.client.parameters().count(), 40);
    assert_eq!(bench.client.parameter("P7"), Some(7.0));
}

#[test]
fn only_what_is_missing_of_a_list_is_asked_for_again() {
    let mut bench = Bench::new();
    let list = bench.request(Request::List);
    bench.sent();
    for index in (0..60).filter(|index| ![3, 41].contains(index)) {
        bench.value(index, 60);
    }
    let missing = [3, 41].map(request::read_parameter_at);
    assert_eq!(bench.run(REPEAT), missing);
    bench.value(41, 60);
    assert_eq!(bench.run(REPEAT), missing[..1]);
    bench.value(3, 60);
    assert_eq!(bench.answer(list), Some(Ok(())));
    let names: Vec<_> = bench.client.parameters().map(|row| &row.name).collect();
    assert_eq!(names[..4], ["P0", "P1", "P2", "P3"]);

    // Of many that are missing, no more are asked for than the vehicle can answer at once.
    bench.request(Request::List);
    bench.sent();
    bench.value(59, 60);
    let asked = bench.run(REPEAT);
    assert_eq!(asked.len(), BATCH);
    assert!(asked.iter().all(|message| matches!(
        message,
        MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA { param_index: 0.., .. })
    )));
}

#[test]
fn a_list_of_which_nothing_comes_is_asked_for_as_a_whole_and_given_up() {
    let mut bench = Bench::new();
    let list = bench.request(Request::List);
    let asked = vec![request::list_parameters(); 5];
    assert_eq!(bench.run(ANSWER), asked);
    assert!(matches!(bench.answer(list), Some(Err(Failure::Silence(_)))));
}

/// Whatever it repeats.
#[test]
fn a_list_that_never_becomes_whole_is_given_up_and_says_what_is_missing() {
    for count in [u16::MAX, 5] {
        let mut bench = Bench::new();
        let list = bench.request(Request::List);
        let given_up = (0..20).find_map(|_| {
            for index in [0, 1, 3] {
                bench.value(index, count);
            }
            bench.run(ms(1000));
            bench.answer(list)
        });
        let missing = usize::from(count) - 3;
        let why = Failure::Incomplete { count, missing, first: 3 };
        assert_eq!(given_up, Some(Err(why)));
    }
}

#[test]
fn a_recording_that_no_recorder_holds_is_refused_and_nothing_is_no_progress() {
    let mut bench = Bench::new();
    let entry = |size| MavMessage::LOG_ENTRY(LOG_ENTRY_DATA { size, ..LOG_ENTRY_DATA::default() });
    let ticket = bench.request(Request::Download);
    bench.say(entry(u32::MAX));
    let refused = bench.answer(ticket).unwrap().unwrap_err();
    assert_eq!(refused, Failure::Recording(u32::MAX as usize));
    let ticket = bench.request(Request::Download);
    bench.say(entry(500));
    let given_up = (0..20).find_map(|_| {
        bench.say(entry(500));
        bench.say(MavMessage::LOG_DATA(LOG_DATA_DATA::default()));
        bench.run(ms(1000));
        bench.answer(ticket)
    });
    assert!(matches!(given_up, Some(Err(Failure::Silence(_)))));
}

#[test]
fn a_value_is_compared_with_what_was_set() {
    let mut bench = Bench::new();
    let set = |value| Request::Set(Parameter { name: "PID_KP".into(), value });
    let ticket = bench.request(set(1.5));
    bench.named_value("PID_KP", 1.0, 0, 60);
    assert_eq!(bench.answer(ticket), None, "of an earlier question");
    bench.named_value("PID_KP", 1.5, 0, 60);
    assert_eq!(bench.answer(ticket), Some(Ok(())));

    let ticket = bench.request(set(99.0));
    bench.text("PID_KP must be 0 to 10");
    bench.named_value("PID_KP", 1.5, 0, 60);
    let failure = bench.answer(ticket).unwrap().unwrap_err();
    let words = "PID_KP stays at 1.5: PID_KP must be 0 to 10";
    assert_eq!(failure.to_string(), words);

    let ticket = bench.request(Request::Read("NO_SUCH".into()));
    bench.text("no such parameter");
    let unknown = Failure::UnknownParameter("NO_SUCH".into());
    assert_eq!(bench.answer(ticket), Some(Err(unknown)));
}

#[test]
fn a_download_goes_on_where_a_part_was_lost() {
    let mut bench = Bench::new();
    let content: Vec<u8> = (0..200).collect();
    let entry = |size| MavMessage::LOG_ENTRY(LOG_ENTRY_DATA { size, ..LOG_ENTRY_DATA::default() });
    let part = |from: usize| {
        let mut data = [0; 90];
        let bytes = &content[from..(from + 90).min(200)];
        data[..bytes.len()].copy_from_slice(bytes);
        MavMessage::LOG_DATA(LOG_DATA_DATA {
            ofs: from as u32,
            count: bytes.len() as u8,
            data,
            ..LOG_DATA_DATA::default()
        })
    };
    let ticket = bench.request(Request::Download);
    assert_eq!(bench.sent(), [request::list_logs()]);
    bench.say(entry(200));
    assert_eq!(bench.sent(), [request::log_data(0, 200)]);
    bench.say(part(0));
    bench.say(part(180));
    assert_eq!(bench.run(REPEAT), [request::log_data(90, 110)]);
    bench.say(part(90));
    bench.say(part(180));
    assert_eq!(bench.answer(ticket), Some(Ok(())));
    assert_eq!(bench.client.recording(), content);

    let ticket = bench.request(Request::Download);
    bench.say(entry(0));
    assert_eq!(bench.answer(ticket), Some(Ok(())));
    assert!(bench.client.recording().is_empty());
}

#[test]
fn heartbeats_are_sent_ten_times_a_second_and_the_vehicles_are_heard() {
    let mut bench = Bench::default();
    assert_eq!(bench.run(ms(250)), vec![request::heartbeat(); 3]);
    bench.say(request::heartbeat());
    assert_eq!(bench.client.heard(), None, "another ground station's");
    bench.say(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
        custom_mode: 3,
        ..HEARTBEAT_DATA::default()
    }));
    assert_eq!(bench.client.heard(), Some(bench.now));
    assert_eq!(bench.client.state(), Some(StateKind::Armed));
}

/// Acknowledgements that get lost must not shift the ones behind them: a value has its number.
#[test]
fn an_order_to_the_board_is_answered_by_its_value() {
    let value = |number: u32, value| {
        MavMessage::NAMED_VALUE_INT(mavlink::dialects::common::NAMED_VALUE_INT_DATA {
            time_boot_ms: 7,
            value,
            name: format!("{number:08x}").as_str().into(),
        })
    };
    let peek = |number| request::bringup(tvc_nano::bringup::What::Peek, number);
    let ack =
        |result| MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command: request::BRINGUP, result });
    let mut bench = Bench::new();
    let first = bench.order(peek(0x2000_0000));
    let second = bench.order(peek(0x2000_0004));
    bench.say(ack(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(bench.client.answer(first), None);
    bench.say(value(0x2000_0004, -2));
    assert_eq!(bench.client.answer(first), None);
    assert_eq!(bench.client.answer(second), Some(Ok(())));
    let told = BoardValue { time_ms: 7, value: 0xFFFF_FFFE };
    assert_eq!(bench.client.board_value(0x2000_0004), Some(told));
    assert_eq!(bench.client.board_value(0x2000_0004), None);
    bench.say(ack(MavResult::MAV_RESULT_DENIED));
    assert!(matches!(bench.client.answer(first), Some(Err(Failure::Refused { .. }))));
}

/// Before the vehicle is heard, orders are for all; then for the one that was heard.
#[test]
fn orders_go_to_the_vehicle_that_is_heard() {
    let mut bench = Bench::new();
    let target = |bench: &mut Bench| bench.sent()[0].target_system_id();
    bench.order(DISARM);
    assert_eq!(target(&mut bench), Some(0));
    let mut raw = mavlink::MAVLinkV2MessageRaw::new();
    let header = mavlink::MavHeader { system_id: 7, component_id: 1, sequence: 0 };
    let beat = HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
        ..HEARTBEAT_DATA::default()
    };
    raw.serialize_message_data(header, &beat);
    bench.client.receive(bench.now, raw.raw_bytes());
    bench.order(DISARM);
    assert_eq!(target(&mut bench), Some(7));
}

/// A gyro calibration takes seconds: that it has begun is the answer.
#[test]
fn an_order_that_goes_on_has_been_obeyed() {
    let mut bench = Bench::new();
    let ticket = bench.order(CALIBRATE);
    bench.ack(CALIBRATE, MavResult::MAV_RESULT_IN_PROGRESS);
    assert_eq!(bench.client.answer(ticket), Some(Ok(())));
    bench.ack(CALIBRATE, MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(bench.client.answer(ticket), None);
}

fn beat(state: StateCode) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: state.number(),
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
        ..HEARTBEAT_DATA::default()
    })
}

fn said(words: &str) -> MavMessage {
    MavMessage::STATUSTEXT(STATUSTEXT_DATA { text: words.into(), ..STATUSTEXT_DATA::default() })
}

#[test]
fn the_text_behind_a_new_state_is_its_reason() {
    let mut bench = Bench::new();
    assert_eq!(bench.client.state(), None);
    assert_eq!(bench.client.state_name(), "unknown (255)");
    let failsafe = beat(StateCode::Failsafe(ReasonKind::Tilt));
    for message in [
        failsafe.clone(),
        said("failsafe: tilt beyond 60 deg"),
        said("arm refused: in failsafe"),
        failsafe,
        said("something else"),
    ] {
        bench.say(message);
    }
    assert_eq!(bench.client.state(), Some(StateKind::Failsafe));
    assert_eq!(bench.client.reason(), "failsafe: tilt beyond 60 deg");
}

#[test]
fn a_stations_heartbeat_changes_nothing_of_the_vehicles_state() {
    let mut bench = Bench::new();
    bench.say(beat(StateCode::Armed));
    bench.say(said("armed"));
    bench.say(request::heartbeat());
    bench.say(said("something else"));
    assert_eq!(bench.client.state_code(), Some(StateCode::Armed));
    assert_eq!(bench.client.reason(), "armed");
}
