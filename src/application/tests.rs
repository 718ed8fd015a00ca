//! The application on a board that notes what it is asked.

use std::string::String;
use std::vec;
use std::vec::Vec;

mod states;

use super::*;
use crate::bringup::{Order, What};
use crate::failsafe::{BootReport, SelfCheck, StateKind};
use crate::params::Params;
use crate::sensor::{Kind, Sensor};
use crate::store::tests::Mock;

/// What a board was asked, in turn.
#[derive(Clone, Debug, PartialEq)]
enum Asked {
    Arm(bool),
    Begin(Transfer),
    StepBegins,
    StepEnds(PulseUs),
    PollPort,
    Stop(SelfCheck),
    Read,
    Write(usize),
}

struct Notes {
    asked: Vec<Asked>,
    bus: Bus,
    time: bool,
    open: bool,
    /// What the port is while it is not open.
    closed: Port,
    packets: Vec<Vec<u8>>,
    /// The one that was read last.
    packet: Vec<u8>,
    room: usize,
    flash: Mock,
    end: Option<StepEnd>,
    reset: Option<Reset>,
    /// Of the flight's memory.
    sum: u32,
    /// By how much it changes while flash is written.
    flips: u32,
}

impl Notes {
    /// The only word that this board shows: its address and what is there.
    const WORD: (u32, u32) = (0x2000_0010, 0x1234_5678);

    fn new() -> Self {
        Self {
            asked: vec![],
            bus: Bus::Free,
            time: true,
            open: false,
            closed: Port::Absent,
            packets: vec![],
            packet: vec![],
            room: 0,
            flash: Mock::new(),
            end: None,
            reset: None,
            sum: 0,
            flips: 0,
        }
    }

    fn take(&mut self) -> Vec<Asked> {
        core::mem::take(&mut self.asked)
    }
}

impl Sum for Notes {
    fn sum<T>(&self, _value: &T) -> u32 {
        self.sum
    }
}

impl Board for Notes {
    type Flash = Mock;

    fn answer(&self) -> &[u8] {
        &[]
    }
    fn arm(&mut self, bursts: &Bursts) {
        self.asked.push(Asked::Arm(bursts.whole.is_some()));
    }
    fn bus(&self) -> Bus {
        self.bus
    }
    fn has_time_for(&self, _transfer: &Transfer, _sensor: Kind) -> bool {
        self.time
    }
    fn begin(&mut self, _address: u8, transfer: Transfer) {
        self.asked.push(Asked::Begin(transfer));
    }
    fn step_begins(&mut self) {
        self.asked.push(Asked::StepBegins);
    }
    fn carried_tick(&self) -> Micros {
        Micros(0)
    }
    fn step_ends(&mut self, end: &StepEnd) {
        self.asked.push(Asked::StepEnds(end.pulses[0]));
        self.end = Some(*end);
    }
    fn status(&self) -> BoardStatus {
        BoardStatus::default()
    }
    fn poll_port(&mut self, _now: Micros, _armed: bool) -> Port {
        self.asked.push(Asked::PollPort);
        if self.open { Port::Open } else { self.closed }
    }
    fn read(&mut self) -> &[u8] {
        self.asked.push(Asked::Read);
        self.packet = self.packets.pop().unwrap_or_default();
        &self.packet
    }
    fn write(&mut self, bytes: &[u8]) -> usize {
        let count = bytes.len().min(self.room);
        self.asked.push(Asked::Write(count));
        count
    }
    fn flash(&mut self) -> &mut Mock {
        self.sum += self.flips;
        &mut self.flash
    }
    fn reset_soon(&mut self, _now: Micros, reset: Reset) {
        self.reset = Some(reset);
    }
    fn stop(&mut self, check: SelfCheck) {
        self.asked.push(Asked::Stop(check));
    }
    fn bringup(&mut self, order: Order) -> Option<u32> {
        let known = order.what == What::Peek as u8 && order.number == Self::WORD.0;
        known.then_some(Self::WORD.1)
    }
}

struct Bench {
    driver: Sensor,
    flight: Flight,
    telemetry: Telemetry,
    recorder: Recorder,
    board: Notes,
    now: Micros,
    port_open: bool,
    guard: Guard,
}

impl Bench {
    fn new() -> Self {
        let mut params = Params::default();
        params.set("SRV_HOLD_DEG", -10.0).unwrap();
        Self {
            driver: Sensor::new(&Params::default()),
            flight: Flight::new(params, BootReport::default()).unwrap(),
            telemetry: Telemetry::default(),
            recorder: Recorder::new(),
            board: Notes::new(),
            now: Micros(1_000_000),
            port_open: false,
            guard: Guard::default(),
        }
    }

    /// Turns of the loop, 10 ms from one to the next.
    fn turns(&mut self, events: Vec<Event>) {
        let mut application = Application::new(
            &mut self.driver,
            &mut self.flight,
            &mut self.telemetry,
            &mut self.recorder,
        );
        (application.port_open, application.guard) = (self.port_open, self.guard);
        for event in events {
            self.now = self.now.after(10_000);
            application.turn(self.now, event, &mut self.board);
        }
        (self.port_open, self.guard) = (application.port_open, application.guard);
    }
}

/// A transfer that nobody has acknowledged.
const REFUSED: Outcome = Outcome { started: Micros(1_000_000), result: Err(BusError::Nak) };

#[test]
fn the_sensor_is_served_before_and_in_the_step_and_at_the_end_and_the_host_behind_it() {
    let mut bench = Bench::new();
    bench.turns(vec![Event::Missed]);
    let asked = bench.board.take();
    // A bus that is free already, as this one always is, is asked for the same thing each time.
    let parts = asked.split(|asked| matches!(asked, Asked::Arm(false) | Asked::Begin(_)));
    let others: Vec<&[Asked]> = parts.filter(|part| !part.is_empty()).collect();
    let step_ends = Asked::StepEnds(PulseUs(1424));
    assert_eq!(others, [&[Asked::StepBegins][..], &[step_ends, Asked::PollPort]]);
    assert!(matches!(asked[..], [Asked::Arm(false), .., Asked::Begin(_)]));
}

#[test]
fn a_step_is_taken_for_a_burst_or_a_missed_one_and_for_nothing_else() {
    for (event, steps) in [
        (Event::Nothing, 0),
        (Event::Reply(REFUSED), 0),
        (Event::Late(REFUSED), 0),
        (Event::Burst(REFUSED), 1),
        (Event::Missed, 1),
    ] {
        let mut bench = Bench::new();
        bench.turns(vec![event]);
        let begun = bench.board.take();
        let begun = begun.iter().filter(|a| **a == Asked::StepBegins).count();
        assert_eq!(begun, steps);
        assert_eq!(bench.flight.state().kind(), StateKind::Boot);
    }
}

/// A save that waits for a host keeps nobody from the sensor.
#[test]
fn no_piece_of_a_save_is_due_while_the_port_is_closed() {
    let mut bench = Bench::new();
    bench.board.open = true;
    bench.board.packets = vec![crate::telemetry::tests::save()];
    bench.turns(vec![Event::Nothing]);
    bench.board.open = false;
    bench.board.packets.clear();
    let Bench { driver, flight, telemetry, recorder, board, now, .. } = &mut bench;
    let mut application = Application::new(driver, flight, telemetry, recorder);
    for _ in 0..20 {
        *now = now.after(10_000);
        application.turn(*now, Event::Missed, board);
        assert!(application.telemetry.has_storage_order() && !application.has_piece_to_save());
    }
}

#[test]
fn the_sensor_waits_for_a_free_bus() {
    let mut bench = Bench::new();
    bench.board.bus = Bus::Busy;
    bench.turns(vec![Event::Nothing]);
    assert_eq!(bench.board.take(), [Asked::PollPort]);
    // Before it samples there is no burst to get in the way of.
    (bench.board.bus, bench.board.time) = (Bus::Free, false);
    bench.turns(vec![Event::Nothing]);
    let asked = bench.board.take();
    assert!(matches!(asked[..], [Asked::PollPort, Asked::Begin(_)]), "{asked:?}");
}

#[test]
fn a_step_tells_the_board_the_neutral_pulse_the_rates_and_the_state() {
    let mut bench = Bench::new();
    bench.turns(vec![Event::Missed]);
    let end = bench.board.end.unwrap();
    assert_eq!((end.pulses[0], end.neutral[0]), (PulseUs(1424), PulseUs(1424)));
    assert_eq!((end.timing.frame_hz, end.timing.i2c_khz), (50, 400));
    assert_eq!(end.state.kind(), StateKind::Boot);
}

#[test]
fn nothing_is_kept_for_a_host_that_does_not_listen_and_a_new_one_hears_the_state() {
    let mut bench = Bench::new();
    bench.turns(vec![Event::Missed, Event::Missed]);
    assert!(bench.telemetry.pending().is_empty());
    bench.board.open = true;
    bench.turns(vec![Event::Nothing]);
    bench.turns(vec![Event::Missed]);
    let text = String::from_utf8_lossy(bench.telemetry.pending()).into_owned();
    assert!(text.contains("boot: waiting for the sensor"), "{text:?}");
}

#[test]
fn the_host_gets_what_it_has_room_for_and_its_orders_reach_the_board() {
    let mut bench = Bench::new();
    (bench.board.open, bench.board.room) = (true, 20);
    bench.turns(vec![Event::Nothing, Event::Missed]);
    let waiting = bench.telemetry.pending().len();
    bench.board.take();
    bench.turns(vec![Event::Nothing]);
    assert!(bench.board.asked.contains(&Asked::Write(20)));
    assert_eq!(bench.telemetry.pending().len(), waiting - 20);
    let reboot = crate::telemetry::tests::reboot();
    bench.board.packets = vec![reboot];
    bench.turns(vec![Event::Nothing]);
    assert_eq!(bench.board.reset, Some(Reset::Restart));
}

#[test]
fn flash_is_not_written_while_a_transfer_is_under_way() {
    let mut bench = Bench::new();
    bench.board.open = true;
    bench.board.bus = Bus::Busy;
    bench.board.packets = vec![crate::telemetry::tests::save()];
    bench.turns(vec![Event::Nothing]);
    assert_eq!(
        crate::store::load(&mut bench.board.flash, crate::store::BoardId::default()).1,
        crate::store::Loaded::Nothing
    );
    bench.board.bus = Bus::Free;
    bench.board.packets.clear();
    // A piece behind every fourth step: a row or a page, in front of them the choice of the slot.
    let pieces = |bench: &mut Bench, events: Vec<Event>| {
        let before = bench.board.flash.operations();
        bench.turns(events);
        bench.board.flash.operations() - before
    };
    assert_eq!(pieces(&mut bench, vec![Event::Nothing; 5]), 0, "no step");
    assert_eq!(pieces(&mut bench, vec![Event::Missed]), 0, "the choice");
    let step_and_more = [Event::Missed, Event::Nothing, Event::Nothing];
    assert_eq!(pieces(&mut bench, step_and_more.repeat(4)), 1);
    assert_eq!(pieces(&mut bench, step_and_more.repeat(5)), 2);
    assert!(bench.telemetry.has_storage_order());
    bench.turns(vec![Event::Missed; 80]);
    assert!(!bench.telemetry.has_storage_order());
    assert!(matches!(
        crate::store::load(&mut bench.board.flash, crate::store::BoardId::default()).1,
        crate::store::Loaded::Set { generation: 1, .. }
    ));
}

#[test]
fn memory_that_changes_by_itself_is_noticed_whatever_the_host_sends() {
    let stops = |bench: &mut Bench| {
        let asked = bench.board.take();
        asked.contains(&Asked::Stop(SelfCheck::Memory))
    };
    for bytes in [vec![], vec![0xFD]] {
        // Before a packet and behind it.
        for before in [false, true] {
            let mut bench = Bench::new();
            bench.board.open = true;
            bench.turns(vec![Event::Missed, Event::Missed]);
            assert!(!stops(&mut bench));
            bench.board.packets = vec![bytes.clone()];
            bench.board.sum += u32::from(before);
            bench.turns(vec![Event::Nothing]);
            bench.board.sum += u32::from(!before);
            bench.turns(vec![Event::Missed]);
            assert!(stops(&mut bench), "{bytes:?} {before}");
        }
    }
}

/// Nobody wants it back after the next start.
#[test]
fn a_parameter_that_memory_has_changed_is_not_stored() {
    let mut bench = Bench::new();
    bench.board.open = true;
    bench.turns(vec![Event::Missed]);
    bench.board.packets = vec![crate::telemetry::tests::save()];
    bench.board.sum += 1;
    bench.turns(vec![Event::Missed, Event::Nothing]);
    assert!(bench.board.take().contains(&Asked::Stop(SelfCheck::Memory)));
}

#[test]
fn settings_that_change_while_flash_is_written_for_a_save_are_noticed() {
    let mut bench = Bench::new();
    bench.board.open = true;
    bench.board.packets = vec![crate::telemetry::tests::save()];
    bench.board.bus = Bus::Busy;
    bench.turns(vec![Event::Missed]);
    assert!(bench.telemetry.is_saving());
    (bench.board.bus, bench.board.flips) = (Bus::Free, 1);
    bench.board.packets.clear();
    bench.board.take();
    bench.turns(vec![Event::Missed]);
    assert_eq!(bench.board.sum, 1, "a piece is done");
    bench.board.flips = 0;
    bench.turns(vec![Event::Missed]);
    assert!(bench.board.take().contains(&Asked::Stop(SelfCheck::Memory)));
}

/// An order to the board itself is answered with the board's value, or refused.
#[test]
fn an_order_to_the_board_is_answered_after_it_is_done() {
    use crate::telemetry::tests::peek;
    let mut bench = Bench::new();
    bench.board.open = true;
    bench.turns(vec![Event::Nothing]);
    for (address, message) in [(Notes::WORD.0, 252), (Notes::WORD.0 + 4, 77)] {
        bench.telemetry.sent(bench.telemetry.pending().len());
        bench.board.packets = vec![peek(address)];
        bench.turns(vec![Event::Nothing]);
        // NAMED_VALUE_INT (252) before its COMMAND_ACK, or COMMAND_ACK (77) alone.
        let answer = bench.telemetry.pending();
        assert_eq!(answer.get(7), Some(&message), "{address:#x}");
        let value = answer.get(14..18);
        let shown = value == Some(&Notes::WORD.1.to_le_bytes());
        assert_eq!(shown, address == Notes::WORD.0);
    }
}

/// Some programs never say that they have opened the port. The first whole message shows it, and
/// five seconds without one that they are gone.
#[test]
fn a_port_that_is_not_open_speaks_as_long_as_messages_come() {
    use mavlink::dialects::common::{HEARTBEAT_DATA, MavMessage};
    let mut message = mavlink::MAVLinkV2MessageRaw::new();
    message.serialize_message(
        mavlink::MavHeader::default(),
        &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
    );
    let mut bench = Bench::new();
    (bench.board.closed, bench.board.room) = (Port::Silent, 2048);
    let written = |bench: &mut Bench, turns| {
        bench.turns(vec![Event::Missed; turns]);
        let asked = bench.board.take();
        asked.iter().any(|asked| matches!(asked, Asked::Write(1..)))
    };
    assert!(!written(&mut bench, 10), "nobody has been heard");
    bench.board.packets = vec![message.raw_bytes().to_vec()];
    assert!(written(&mut bench, 3));
    // A turn is 10 ms.
    assert!(written(&mut bench, 490));
    bench.turns(vec![Event::Missed; 20]);
    bench.board.take();
    assert!(!written(&mut bench, 10), "silent for five seconds");
}

/// Nobody would hear the answer to what shows that somebody is there: it is neither obeyed nor
/// answered, and the next one is both.
#[test]
fn the_first_message_at_a_port_that_is_not_open_is_no_order() {
    let mut bench = Bench::new();
    (bench.board.closed, bench.board.room) = (Port::Silent, 2048);
    for reset in [None, Some(Reset::Restart)] {
        bench.board.packets = vec![crate::telemetry::tests::reboot()];
        bench.turns(vec![Event::Nothing]);
        assert_eq!(bench.board.reset, reset);
        let written = bench.board.take();
        let is_answered = written.iter().any(|a| matches!(a, Asked::Write(1..)));
        assert_eq!(is_answered, reset.is_some());
    }
}
