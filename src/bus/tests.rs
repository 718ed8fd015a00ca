use std::vec::Vec;

use super::*;
use tvc_imu::Bytes;

const ADDRESS: u8 = 0x28;

/// A wire that notes what it is told, and that refuses to synchronise from some call on.
#[derive(Debug)]
struct Noted {
    told: Vec<Told>,
    signal: Signal,
    is_idle: bool,
    /// Calls that still go well.
    good: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Address(u8),
    Data(u8),
    Command(Command),
    Listen(bool),
}

impl Noted {
    fn note(&mut self, told: Told) -> Result<(), NotSynchronised> {
        self.good = self.good.checked_sub(1).ok_or(NotSynchronised)?;
        self.told.push(told);
        Ok(())
    }
}

impl Wire for Noted {
    fn wait_idle(&mut self) -> Result<(), NotSynchronised> {
        self.is_idle.then_some(()).ok_or(NotSynchronised)
    }

    fn write_address(&mut self, address: u8) -> Result<(), NotSynchronised> {
        self.note(Told::Address(address))
    }

    fn write_data(&mut self, byte: u8) -> Result<(), NotSynchronised> {
        self.note(Told::Data(byte))
    }

    fn command(&mut self, command: Command) -> Result<(), NotSynchronised> {
        self.note(Told::Command(command))
    }

    fn next_byte(&mut self) -> Option<u8> {
        let Signal::Byte(byte) = self.signal else {
            return None;
        };
        self.command(Command::Continue).ok()?;
        Some(byte)
    }

    fn signal(&mut self) -> Signal {
        self.signal
    }

    fn listen(&mut self, on: bool) {
        self.told.push(Told::Listen(on));
    }

    fn is_idle(&self) -> bool {
        self.is_idle
    }
}

fn master() -> Master<Noted> {
    let mut master = Master::new(Noted {
        told: Vec::new(),
        signal: Signal::Nothing,
        is_idle: true,
        good: usize::MAX,
    });
    master.arm(&Bursts { address: ADDRESS, whole: Some(read(3)), rates: Some(read(1)) });
    master.set_broken(false);
    master
}

fn read(len: u8) -> Transfer {
    Transfer::Read { register: 8, len }
}

fn write<const N: usize>(bytes: [u8; N]) -> Transfer {
    Transfer::Write { register: 0x3D, bytes: Bytes::new(bytes) }
}

/// Interrupts with each of these in turn, 100 us apart; whether the last one, and no other, ended
/// the transfer.
fn interrupt(master: &mut Master<Noted>, signals: &[Signal]) -> bool {
    let mut ended = false;
    for (index, signal) in signals.iter().enumerate() {
        assert!(!ended, "over before {signal:?}");
        master.wire.signal = *signal;
        ended = master.advance(|| Micros(1_000 + 100 * (index as u64 + 1)));
    }
    ended
}

const ACK: Signal = Signal::Acknowledged;

#[test]
fn a_read_takes_its_bytes_and_refuses_the_last_one() {
    let mut master = master();
    assert!(!master.begin(ADDRESS, &read(3), Micros(1_000)));
    assert_eq!(master.state(), Bus::Busy);
    let bytes = [5, 6, 7].map(Signal::Byte);
    let signals = [&[ACK, ACK], &bytes[..]].concat();
    assert!(interrupt(&mut master, &signals));
    assert_eq!(
        master.wire.told,
        [
            Told::Address(ADDRESS << 1),
            Told::Listen(true),
            Told::Data(8),
            Told::Address(ADDRESS << 1 | READ),
            Told::Command(Command::Continue),
            Told::Command(Command::Continue),
            Told::Command(Command::Stop),
            Told::Listen(false),
        ]
    );
    let mut answer = Answer::NONE;
    let over = master.collect(&mut answer).unwrap();
    assert_eq!((over.origin, over.took_us), (Origin::Loop, 500));
    assert_eq!(over.outcome.result, Ok(()));
    assert_eq!(answer.bytes(), [5, 6, 7]);
    assert_eq!(master.collect(&mut answer), None, "once");
    assert_eq!(master.state(), Bus::Free);
}

#[test]
fn a_write_sends_its_bytes_and_leaves_no_answer() {
    let mut master = master();
    assert!(!master.begin(ADDRESS, &write([0x0C, 1]), Micros(1_000)));
    assert!(interrupt(&mut master, &[ACK; 4]));
    let data = [0x3D, 0x0C, 1].map(Told::Data);
    assert_eq!(master.wire.told[2..5], data);
    assert_eq!(master.wire.told[5], Told::Command(Command::Stop));
    let mut answer = Answer::NONE;
    assert!(master.collect(&mut answer).is_some());
    assert!(answer.bytes().is_empty());
}

/// Whatever comes instead of what is waited for, at any byte, ends the transfer; a slave that
/// refuses is no reason to set the bus up anew.
#[test]
fn what_fails_at_any_byte_ends_the_transfer() {
    let good = [ACK, ACK, Signal::Byte(1), Signal::Byte(2), Signal::Byte(3)];
    for at in 0..good.len() {
        for (signal, error, is_broken) in [
            (Signal::Refused, BusError::Nak, false),
            (Signal::Error, BusError::Protocol, true),
            (Signal::Lost, BusError::Arbitration, true),
        ] {
            let mut master = master();
            assert!(!master.begin(ADDRESS, &read(3), Micros(1_000)));
            let signals = [&good[..at], &[signal]].concat();
            assert!(interrupt(&mut master, &signals), "{signal:?} at {at}");
            let over = master.collect(&mut Answer::NONE.clone()).unwrap();
            assert_eq!(over.outcome.result, Err(error));
            assert_eq!(master.is_broken(), is_broken);
        }
    }
}

#[test]
fn a_wire_that_does_not_synchronise_breaks_the_bus() {
    // The address, the register's number, the repeated start, and three answers to bytes.
    for good in 0..6 {
        let mut master = master();
        master.wire.good = good;
        let mut is_over = master.begin(ADDRESS, &read(3), Micros(1_000));
        assert_eq!(is_over, good == 0);
        for signal in [ACK, ACK, Signal::Byte(1), Signal::Byte(2), Signal::Byte(3)] {
            if !is_over {
                is_over = interrupt(&mut master, &[signal]);
            }
        }
        assert!(is_over && master.is_broken(), "{good}");
        let over = master.collect(&mut Answer::NONE.clone()).unwrap();
        assert!(over.outcome.result.is_err());
        assert_eq!(master.state(), Bus::Broken);
    }
}

#[test]
fn a_transfer_has_a_deadline() {
    let mut master = master();
    assert!(!master.begin(ADDRESS, &read(3), Micros(1_000)));
    let end = Micros(1_000 + TRANSFER_DEADLINE_US);
    assert!(!master.is_late(Micros(end.0 - 1)) && master.is_well(Micros(end.0 - 1)));
    assert!(master.is_late(end) && !master.is_well(end));
    master.abort(BusError::Stuck);
    assert!(!master.is_late(end));
    // An interrupt that was pending then changes nothing.
    assert!(!interrupt(&mut master, &[ACK]));
    let over = master.collect(&mut Answer::NONE.clone()).unwrap();
    assert_eq!(over.outcome.result, Err(BusError::Stuck));
}

#[test]
fn a_tick_starts_the_burst_that_is_armed_once() {
    let origin = |rates_only| Origin::Tick { rates_only };
    for rates_only in [false, true] {
        let mut master = master();
        assert!(!master.start_burst(Micros(1_000), rates_only));
        let bytes = [Signal::Byte(1); 3];
        let bytes = &bytes[..if rates_only { 1 } else { 3 }];
        assert!(interrupt(&mut master, &[&[ACK, ACK], bytes].concat()));
        let over = master.collect(&mut Answer::NONE.clone()).unwrap();
        assert_eq!(over.origin, origin(rates_only));
        let told = master.wire.told.len();
        assert!(!master.start_burst(Micros(9_000), rates_only), "not armed again");
        assert_eq!(master.wire.told.len(), told);
    }
}

#[test]
fn a_burst_overtakes_what_went_well_and_waits_for_what_did_not() {
    let mut answer = Answer::NONE;
    // Over and not collected.
    let mut over = master();
    assert!(!over.begin(ADDRESS, &write([]), Micros(1_000)));
    assert!(interrupt(&mut over, &[ACK; 2]));
    assert!(!over.start_burst(Micros(2_000), false));
    assert_eq!(over.collect(&mut answer), None, "the burst is under way");
    // Failed, or under way: the burst is not begun.
    for signal in [Signal::Refused, ACK] {
        let mut busy = master();
        assert!(!busy.begin(ADDRESS, &read(3), Micros(1_000)));
        let is_over = interrupt(&mut busy, &[signal]);
        let told = busy.wire.told.len();
        assert!(!busy.start_burst(Micros(2_000), false));
        assert_eq!(busy.wire.told.len(), told);
        assert_eq!(busy.collect(&mut answer).is_some(), is_over);
    }
    // A STOP that is still on its way costs the burst; a broken bus tells at once.
    let mut held = master();
    held.wire.is_idle = false;
    assert!(held.awaits_stop());
    assert!(!held.start_burst(Micros(2_000), false));
    assert!(held.wire.told.is_empty());
    held.set_broken(true);
    assert!(held.start_burst(Micros(2_000), false));
    let told = held.collect(&mut answer).unwrap().outcome.result;
    assert_eq!(told, Err(BusError::Stuck));
}
