//! A driver elsewhere.

use super::*;

/// A device that a driver elsewhere has configured.
fn handed_over() -> Device {
    let mut device = Device::configured();
    assert!(device.host().hand_over());
    device.run(Ticks::from_ms(40));
    let set_configuration = [0, 9, 1, 0, 0, 0, 0, 0];
    assert_eq!(request(&mut device, 1, set_configuration, 0), Ok(Vec::new()));
    device
}

/// What becomes of a request from the device.
fn request(
    device: &mut Device,
    id: u32,
    setup: [u8; 8],
    length: usize,
) -> Result<Vec<u8>, UrbError> {
    let is_in = setup[0] & 0x80 != 0;
    device.host().submit(Urb { id, is_in, setup, length, ..Urb::default() });
    device.run(Ticks::from_ms(20));
    let [answer]: [Answer; 1] = device.host().answers().try_into().unwrap();
    assert_eq!(answer.id, id);
    answer.data
}

fn output(id: u32, data: Vec<u8>) -> Urb {
    Urb { id, endpoint: 2, data, ..Urb::default() }
}

fn input(id: u32, length: usize) -> Urb {
    Urb { id, endpoint: 2, is_in: true, length, ..Urb::default() }
}

#[test]
fn requests_reach_the_device_behind_a_reset_and_an_address() {
    let mut device = handed_over();
    assert_eq!(device.resets, 2);
    let whole = request(&mut device, 2, [0x80, 6, 0, 2, 0, 0, 67, 0], 67);
    assert_eq!(whole, Ok(CONFIGURATION.to_vec()));
    assert_eq!(device.host().configuration(), CONFIGURATION);
    let qualifier = request(&mut device, 3, [0x80, 6, 0, 6, 0, 0, 10, 0], 10);
    assert_eq!(qualifier, Err(UrbError::Stalled));
    let asked: Vec<_> = device.requests.iter().rev().take(4).rev().map(|asked| asked.1).collect();
    assert_eq!(asked, [5, 9, 6, 6], "address, configuration, descriptors");
    assert_eq!(device.host().errors(), []);
}

#[test]
fn a_request_carries_data_to_the_device() {
    let mut device = handed_over();
    let coding = vec![0x80, 0x25, 0, 0, 0, 0, 8];
    let setup = [0x21, 0x20, 0, 0, 0, 0, 7, 0];
    device.host().submit(Urb { id: 9, setup, data: coding.clone(), ..Urb::default() });
    device.run(Ticks::from_ms(20));
    assert_eq!(device.host().answers(), [Answer { id: 9, data: Ok(Vec::new()), sent: 7 }]);
    assert_eq!(device.line_coding, coding);
}

#[test]
fn bulk_transfers_end_with_their_data_and_share_no_packet() {
    let mut device = handed_over();
    device.host().submit(input(10, 256));
    device.host().submit(input(11, 5));
    for (id, byte) in [(12, 1), (13, 2)] {
        device.host().submit(output(id, vec![byte; 70]));
    }
    device.host().submit(output(14, vec![3; 5]));
    device.run(Ticks::from_ms(30));
    let mut answers = device.host().answers();
    answers.sort_by_key(|answer| answer.id);
    let sent: Vec<_> = answers.iter().map(|answer| (answer.id, answer.sent)).collect();
    assert_eq!(sent, [(10, 0), (11, 0), (12, 70), (13, 70), (14, 5)]);
    // The echo of 64 and 6 bytes: the second is a short packet, which ends the transfer.
    assert_eq!(answers[0].data, Ok(vec![1; 70]));
    // 64 bytes do not fit into 5.
    assert_eq!(answers[1].data, Err(UrbError::Wrong));
}

#[test]
fn a_transfer_that_is_taken_back_leaves_the_others() {
    let mut device = handed_over();
    device.echo = false;
    for id in [20, 21, 22] {
        device.host().submit(output(id, vec![id as u8; 100]));
    }
    device.host().submit(input(23, 64));
    assert!(device.host().unlink(21) && device.host().unlink(23));
    assert!(!device.host().unlink(21), "it is gone");
    device.run(Ticks::from_ms(20));
    let ids: Vec<_> = device.host().answers().into_iter().map(|answer| answer.id).collect();
    assert_eq!(ids, [20, 22]);
    assert_eq!(device.got, [vec![20; 100], vec![22; 100]].concat());
}

/// The device waits with its answer: the next SETUP ends the request for it.
#[test]
fn a_request_that_is_taken_back_is_ended_by_the_next_one() {
    let mut device = handed_over();
    let whole = Urb {
        id: 30,
        is_in: true,
        setup: [0x80, 6, 0, 2, 0, 0, 67, 0],
        length: 67,
        ..Urb::default()
    };
    device.host().submit(whole);
    device.bench.pass(Ticks::from_ms(3));
    assert!(device.host().unlink(30));
    let device_descriptor = request(&mut device, 31, [0x80, 6, 0, 1, 0, 0, 18, 0], 18);
    assert_eq!(device_descriptor, Ok(DEVICE.to_vec()));
}

#[test]
fn an_endpoint_that_is_not_there_is_told() {
    let mut device = handed_over();
    device.host().submit(Urb { id: 40, endpoint: 7, ..Urb::default() });
    let answers = device.host().answers();
    assert_eq!(answers, [Answer { id: 40, data: Err(UrbError::NoEndpoint), sent: 0 }]);
}

#[test]
fn taken_back_it_is_enumerated_anew_and_a_device_that_leaves_ends_it() {
    let mut device = handed_over();
    device.host().take_back();
    device.run(Ticks::from_ms(200));
    assert!(device.host().is_configured());
    assert_eq!(device.host().statistics().enumerations, 2);
    assert!(device.host().hand_over());
    device.bench.w16(USB + 8, 1);
    device.run(Ticks::from_ms(1));
    assert!(!device.host().is_handed_over(), "DETACH");
    assert!(!Device::new(Ticks::ZERO).host().hand_over(), "not enumerated");
}

#[test]
fn a_transfer_whose_packet_is_on_the_bus_is_taken_back_at_any_instant() {
    for us in (0..1500).step_by(7) {
        let mut device = handed_over();
        device.echo = false;
        device.host().submit(output(50, vec![1; 64]));
        device.bench.pass(Ticks::from_us(us));
        device.host().unlink(50);
        device.host().submit(output(51, vec![2; 64]));
        device.run(Ticks::from_ms(20));
        let answers = device.host().answers();
        let sent = answers.iter().find(|answer| answer.id == 51).map(|answer| answer.sent);
        assert_eq!(sent, Some(64), "taken back after {us} us");
        assert!(device.got.ends_with(&[2; 64]), "after {us} us");
    }
}
