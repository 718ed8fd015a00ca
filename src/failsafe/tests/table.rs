//! The edges as a table, `tests/data/states/supervisor.txt`, and as the diagram of
//! `docs/reference/states.md`.

use std::collections::BTreeMap;

use super::*;
use crate::tests::{assert_kept, assert_part_kept};

/// What comes of an event in a state, over everything else that a state depends on.
type Table = BTreeMap<(u32, usize), BTreeSet<String>>;

fn words(code: u32) -> String {
    StateCode::try_from(code).unwrap().to_string()
}

/// The answer to an order, and the state that follows where it is another one.
fn outcome(before: &Seat, reply: &Reply, after: &Seat) -> String {
    let [from, to] = [before, after].map(|seat| seat.state().code());
    let next = if from == to { "stays".to_string() } else { format!("-> {}", words(to)) };
    match reply {
        None => next,
        Some(Ok(())) => format!("obeyed, {next}"),
        Some(Err(refusal)) => format!("refused: {refusal}"),
    }
}

fn render(table: &Table, names: &[String]) -> String {
    let mut text = String::from(
        "What the supervisor (src/failsafe.rs) does with every event in every state that can be \
         reached. Where there\nare several outcomes, the sensor, the attitude, the host or the \
         time decide.\n",
    );
    let mut last = None;
    for ((code, event), outcomes) in table {
        if last.replace(*code) != Some(*code) {
            text += &format!("\n{}\n", words(*code));
        }
        let outcomes: Vec<_> = outcomes.iter().map(String::as_str).collect();
        text += &format!("    {}: {}\n", names[*event], outcomes.join(" | "));
    }
    text
}

/// What led to a state, for a reader: an order, or what all events have in common that lead there.
fn cause(event: &Event, reply: &Reply, to: &State, name: &str) -> String {
    match (reply, to) {
        (Some(_), _) => name.to_string(),
        (None, State::Failsafe(reason)) => reason.kind().to_string(),
        (None, State::SelfTest(_)) => "first sample".to_string(),
        (None, State::Standby) => "a still second".to_string(),
        (None, State::Boot) => "sensor lost".to_string(),
        _ => unreachable!("{event:?} leads to {to:?}"),
    }
}

/// The states alone and what leads from one to another.
fn diagram(edges: &BTreeSet<(u8, u8, String)>) -> String {
    let name = |code: u8| {
        let words = StateKind::try_from(code).unwrap().to_string();
        words.replace([' ', '-'], "_")
    };
    let mut text = String::from("```mermaid\nstateDiagram-v2\n");
    for report in reports() {
        let start = format!("    [*] --> {}\n", name(report.state().kind().code()));
        if !text.contains(&start) {
            text += &start;
        }
    }
    let mut pairs: BTreeMap<(u8, u8), Vec<&str>> = BTreeMap::new();
    for (from, to, cause) in edges {
        pairs.entry((*from, *to)).or_default().push(cause);
    }
    for ((from, to), causes) in pairs {
        let causes = causes.join(", ");
        text += &format!("    {} --> {}: {causes}\n", name(from), name(to));
    }
    text + "```\n"
}

#[test]
fn the_table_of_edges_is_the_kept_one() {
    let events = Event::all();
    let names: Vec<_> = events.iter().map(Event::name).collect();
    // Attitudes with the same flaw have one row, whatever the tilt.
    let row = |event: &Event| {
        let place = events.iter().position(|other| other == event).unwrap();
        names.iter().position(|name| *name == names[place]).unwrap()
    };
    let mut table = Table::new();
    let mut edges = BTreeSet::new();
    let mut count = 0;
    let states = explore(
        |_| {},
        |before, event, reply, after| {
            count += 1;
            let [from, to] = [before, after].map(Seat::state);
            let outcomes = table.entry((from.code(), row(event))).or_default();
            outcomes.insert(outcome(before, reply, after));
            // A second of samples leads from boot through the self-test.
            let passes = from == State::Boot && to == State::Standby;
            if from.kind() != to.kind() && !passes {
                let cause = cause(event, reply, &to, &names[row(event)]);
                edges.insert((from.kind().code(), to.kind().code(), cause));
            }
        },
    );
    assert_kept("tests/data/states/supervisor.txt", &render(&table, &names));
    assert_part_kept("docs/reference/states.md", "diagram", &diagram(&edges));
    let figures = format!("- the supervisor alone: {states} states, {count} edges\n");
    assert_part_kept("docs/reference/states.md", "supervisor", &figures);
}
