//! Damaged frames, foreign bytes and any payload: nothing panics, nothing acts.

use super::*;

#[test]
fn a_corrupt_frame_is_counted_and_does_nothing() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut frame = golden("arm_v2");
    frame[12] ^= 0x40;
    assert!(link.tell(&frame).is_empty());
    assert_eq!(link.telemetry.parser.crc_errors(), 1);
    assert_eq!(texts(&link.tell(&golden("arm_v2"))), ["armed"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// No noise can hide a command for longer than the longest frame that noise may pretend to
    /// begin, and nothing panics.
    #[test]
    fn a_command_gets_through_any_noise(
        noise in prop::collection::vec(prop_oneof![any::<u8>(), Just(0xFD), Just(0xFE)], 0..300),
        pieces in prop::collection::vec(1_usize..40, 1..40),
    ) {
        let mut link = Link::new(Desk::in_standby(0.1));
        let mut bytes = noise;
        bytes.extend(golden("arm_v2"));
        bytes.extend([0; 80]);
        let mut rest = &bytes[..];
        for piece in pieces.into_iter().cycle() {
            let (now, later) = rest.split_at(piece.min(rest.len()));
            link.tell(now);
            rest = later;
            if rest.is_empty() {
                break;
            }
        }
        prop_assert_eq!(link.desk.flight.state(), State::Armed);
    }

    /// Any message of interest with any payload is harmless.
    #[test]
    fn any_payload_is_harmless(
        id in prop::sample::select(&[
            0_u32, 4, 20, 21, 23, 43, 44, 45, 75, 76, 110, 111, 117, 119, 122,
        ]),
        payload in prop::collection::vec(any::<u8>(), 0..=64),
    ) {
        let mut link = Link::new(Desk::in_standby(0.1));
        let extra = <MavMessage as mavlink::Message>::extra_crc(id);
        let mut frame = std::vec![0xFD, payload.len() as u8, 0, 0, 0, 255, 190, id as u8, 0, 0];
        frame.extend(&payload);
        let crc = mavlink::calculate_crc(&frame[1..], extra);
        frame.extend(crc.to_le_bytes());
        link.tell(&frame);
        prop_assert!(link.telemetry.parser.crc_errors() == 0);
    }
}

/// Half frames, damaged frames and noise.
#[test]
fn ten_million_bytes_of_noise_neither_panic_nor_act() {
    let frames = ["arm_v2", "arm_v1", "arm_signed", "unknown_command", "raw_imu"].map(golden);
    let mut random = 0x9E37_79B9_7F4A_7C15_u64;
    let mut next = || {
        // xorshift64, Marsaglia 2003.
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let mut link = Link::new(Desk::new(0.1));
    let before = link.desk.flight.state();
    let mut fed = 0;
    while fed < 10_000_000 {
        let mut bytes = frames[(next() % 5) as usize].clone();
        match next() % 4 {
            0 => bytes.truncate((next() % bytes.len() as u64) as usize),
            1 => {
                let at = (next() % bytes.len() as u64) as usize;
                bytes[at] ^= (next() % 255 + 1) as u8;
            }
            2 => bytes = (0..next() % 300).map(|_| next() as u8).collect(),
            _ => bytes.insert(1, next() as u8),
        }
        fed += bytes.len();
        link.telemetry.receive(Micros(0), &bytes, &mut link.desk.flight);
        let waiting = link.telemetry.pending().len();
        link.telemetry.sent(waiting);
    }
    // What came through whole was refused; the next good frame is understood.
    assert_eq!(link.desk.flight.state(), before);
    link.telemetry.receive(Micros(0), &[0; 300], &mut link.desk.flight);
    let waiting = link.telemetry.pending().len();
    link.telemetry.sent(waiting);
    let answer = link.tell(&golden("arm_v2"));
    assert_eq!(acks(&answer).len(), 1);
}
