//! What the flight remembers, as the host is told.

use super::*;

fn parts(messages: &[MavMessage]) -> Vec<(u16, Vec<i32>)> {
    let part = |message: &MavMessage| match message {
        MavMessage::V2_EXTENSION(told) => {
            let words = told.payload.chunks_exact(4).take(PART_WORDS);
            let words = words.map(|word| i32::from_le_bytes(word.try_into().unwrap()));
            Some((told.message_type, words.collect()))
        }
        _ => None,
    };
    messages.iter().filter_map(part).collect()
}

/// What is to be told after a step.
fn step(link: &mut Link) -> Vec<i32> {
    let snapshot = link.desk.step();
    link.record(&snapshot);
    let flight = &mut link.desk.flight;
    link.telemetry.tell_memory(&snapshot, flight, &link.desk.refresh);
    let mut words = std::vec![snapshot.now.0 as i32];
    flight.tell(&mut |word| words.push(word));
    let refresh = link.desk.refresh.words().iter();
    words.extend(refresh.map(|word| word.cast_signed()));
    words
}

#[test]
fn it_comes_once_a_second_from_standby_on_as_it_was_after_one_step() {
    let mut link = Link::new(Desk::new(0.1));
    let mut times = 0;
    for _ in 0..1_000 {
        let remembered = step(&mut link);
        let parts = parts(&take(&mut link.telemetry));
        if parts.is_empty() {
            continue;
        }
        assert_eq!(link.desk.flight.state(), State::Standby);
        let (types, told): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        let expected: Vec<_> = (MEMORY_TYPE..).take(types.len()).collect();
        assert_eq!(types, expected);
        let told = told.concat();
        assert_eq!(told[..MEMORY_WORDS], remembered);
        assert!(told[MEMORY_WORDS..].iter().all(|word| *word == 0));
        times += 1;
    }
    assert!((8..=10).contains(&times), "{times}");
}

/// What waits for room in the queue comes whole when there is.
#[test]
fn it_waits_for_room_in_the_queue() {
    let mut link = Link::new(Desk::in_standby(0.1));
    for _ in 0..250 {
        step(&mut link);
    }
    assert!(link.telemetry.dropped() > 0);
    link.telemetry.sent(link.telemetry.pending().len());
    let mut types = Vec::new();
    for _ in 0..10 {
        step(&mut link);
        types.extend(parts(&take(&mut link.telemetry)).into_iter().map(|part| part.0));
    }
    let parts = MEMORY_WORDS.div_ceil(PART_WORDS);
    // The next ones may be due by then.
    let expected: Vec<_> = (0x8000..).take(parts).collect();
    assert!(types.starts_with(&expected), "{types:?}");
}
