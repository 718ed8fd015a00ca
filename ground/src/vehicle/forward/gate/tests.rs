use super::*;
use client::request;
use mavlink::dialects::common::{PARAM_REQUEST_LIST_DATA, PARAM_SET_DATA};

const OWN: &str = "127.0.0.1";
const STATION: &str = "192.168.1.20";
const STRANGER: &str = "192.168.1.66";

fn gate(accepted: &[&str], key: Option<u8>) -> Gate {
    use clap::{Args, Command, FromArgMatches};
    let command = Admission::augment_args(Command::new("gate"));
    let words = accepted.iter().flat_map(|from| ["--accept-commands-from", from]);
    let found = command.get_matches_from(std::iter::once("gate").chain(words));
    let admission = Admission::from_arg_matches(&found).unwrap();
    Gate::new(admission, STATION.parse().unwrap(), key.map(signing))
}

fn signing(seed: u8) -> Signing {
    let key: Vec<u8> = (0..32).map(|byte| byte ^ seed).collect();
    Signing::parse(&key).unwrap()
}

fn frame(message: &MavMessage) -> Vec<u8> {
    Wire::default().frame(message)
}

fn question() -> Vec<u8> {
    frame(&MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA::default()))
}

/// What changes something: an order of each kind, and a parameter.
fn commands() -> Vec<Vec<u8>> {
    let orders = [
        request::ARM,
        request::DISARM,
        request::RELEASE,
        request::CALIBRATE,
        request::SAVE,
        request::RELOAD,
        request::RESET,
        request::REBOOT,
    ];
    let mut frames: Vec<_> = orders.iter().map(|order| frame(&order.message())).collect();
    frames.push(frame(&MavMessage::PARAM_SET(PARAM_SET_DATA::default())));
    frames
}

fn incoming(gate: &mut Gate, bytes: &[u8], from: &str) -> Vec<u8> {
    gate.incoming(bytes, from.parse().unwrap())
}

#[test]
fn commands_come_from_this_computer_unless_the_user_opens_them() {
    for command in commands() {
        let mut closed = gate(&[], None);
        assert_eq!(incoming(&mut closed, &command, OWN), command);
        assert_eq!(closed.refused, 0);
        for other in [STATION, STRANGER] {
            assert!(incoming(&mut closed, &command, other).is_empty(), "{other}");
        }
        assert_eq!(closed.refused, 2);
        let mut open = gate(&[STATION], None);
        assert_eq!(incoming(&mut open, &command, STATION), command);
        assert!(incoming(&mut open, &command, STRANGER).is_empty());
        let mut all = gate(&["any"], None);
        assert_eq!(incoming(&mut all, &command, STRANGER), command);
    }
}

#[test]
fn the_station_that_is_shown_the_vehicle_may_ask() {
    let mut gate = gate(&[], None);
    let list = question();
    assert_eq!(incoming(&mut gate, &list, STATION), list);
    assert!(incoming(&mut gate, &list, STRANGER).is_empty());
    // Between a command, noise, MAVLink 1 and a broken frame, of which nothing passes.
    let mut broken = list.clone();
    broken[10] ^= 1;
    let arm = &commands()[0];
    let mixed = [arm, &b"\xFE\x00noise\xFD"[..], &broken, &list, arm].concat();
    assert_eq!(incoming(&mut gate, &mixed, STATION), list);
    let beat = frame(&request::heartbeat());
    let refused = gate.refused;
    assert!(incoming(&mut gate, &beat, STATION).is_empty(), "it would be watched over");
    assert_eq!(gate.refused, refused, "every station sends it");
}

#[test]
fn with_a_key_commands_are_signed_whoever_sends_them() {
    for from in [OWN, STATION] {
        let mut gate = gate(&[STATION], Some(0));
        // Two signatures of one signer never have the same time.
        let (key, other) = (signing(0), signing(1));
        for command in commands() {
            let (right, wrong) = (key.sign(&command), other.sign(&command));
            assert_eq!(incoming(&mut gate, &right, from), command, "unsigned to the vehicle");
            for refused in [&command, &wrong, &right] {
                assert!(incoming(&mut gate, refused, from).is_empty());
            }
        }
        assert_eq!(gate.refused, 3 * commands().len() as u64);
        assert_eq!(incoming(&mut gate, &question(), from), question());
    }
    // A key opens nothing by itself.
    let mut closed = gate(&[], Some(0));
    let signed = signing(0).sign(&commands()[0]);
    assert!(incoming(&mut closed, &signed, STATION).is_empty());
}

#[test]
fn what_goes_out_is_signed_with_the_key() {
    let list = question();
    assert_eq!(gate(&[], None).outgoing(list.clone()), list);
    let signed = gate(&[], Some(0)).outgoing(list.clone());
    assert_eq!(signing(0).verified(&signed), Some(list));
}
