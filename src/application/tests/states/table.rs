//! The edges as a table, `tests/data/states/vehicle.txt`, and the orders as
//! `docs/reference/states.md` has them.

use std::collections::{BTreeMap, BTreeSet};
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use super::events::{Event, Ordered};
use super::vehicle::{Said, Vehicle};
use super::{Edge, Found};
use crate::failsafe::{RefusalKind, StateCode, StateKind};
use crate::tests::{assert_kept, assert_part_kept};

fn words(code: u32) -> String {
    StateCode::try_from(code).unwrap().to_string()
}

/// The first answer to an order.
fn answer(ordered: Ordered, said: &[Said]) -> String {
    let acks = Vehicle::acks(said, ordered.number());
    match acks.first() {
        None => "no answer yet".to_string(),
        Some((0, _)) => "accepted".to_string(),
        Some((1, 0)) => "refused".to_string(),
        Some((1, detail)) => {
            let kind = RefusalKind::try_from(*detail).unwrap();
            format!("refused: {kind}")
        }
        Some((2, _)) => "denied".to_string(),
        Some((3, _)) => "unsupported".to_string(),
        Some((5, _)) => "in progress".to_string(),
        Some(other) => unreachable!("{ordered:?}: {other:?}"),
    }
}

/// What comes of an event: the answer, and the state where it is another one.
fn outcome(edge: &Edge) -> String {
    let answer = match edge.event {
        Event::Order(ordered) => Some(answer(ordered, &edge.said)),
        Event::Set(..) if edge.said.contains(&Said::Error) => Some("refused".to_string()),
        Event::Set(..) if edge.said.is_empty() => Some("no answer yet".to_string()),
        Event::Set(..) => Some("told".to_string()),
        _ => None,
    };
    let next = (edge.from != edge.to).then(|| format!("-> {}", words(edge.to)));
    let parts: Vec<_> = answer.into_iter().chain(next).collect();
    if parts.is_empty() {
        return "stays".to_string();
    }
    parts.join(", ")
}

fn render(edges: &[&Edge]) -> String {
    let events = Event::all();
    let mut table: BTreeMap<(u32, usize), BTreeSet<String>> = BTreeMap::new();
    for edge in edges {
        let place = events.iter().position(|event| *event == edge.event);
        let outcomes = table.entry((edge.from, place.unwrap())).or_default();
        outcomes.insert(outcome(edge));
    }
    let mut text = String::from(
        "What the whole application (src/application.rs) does with every event in every state that \
         was found:\nwhat the host is answered, and the state that follows. Where there are several \
         outcomes, the sensor, the\nattitude, the host, the port, the parameters or the time decide.\n",
    );
    let mut last = None;
    for ((code, event), outcomes) in table {
        if last.replace(code) != Some(code) {
            text += &format!("\n{}\n", words(code));
        }
        let outcomes: Vec<_> = outcomes.into_iter().collect();
        text += &format!("    {}: {}\n", events[event].name(), outcomes.join(" | "));
    }
    text
}

/// Orders by rows, states by columns: whether they are ever accepted, else why they are refused.
fn orders(edges: &[&Edge]) -> String {
    let mut kinds: Vec<StateKind> = StateKind::ALL.to_vec();
    kinds.sort_unstable_by_key(|kind| kind.code());
    let heads: Vec<_> = kinds.iter().map(StateKind::to_string).collect();
    let mut text = format!("| order | {} |\n", heads.join(" | "));
    text += &format!("|---|{}\n", "---|".repeat(kinds.len()));
    for ordered in Ordered::ALL {
        let cell = |kind: &StateKind| {
            let told = edges.iter().filter(|edge| {
                let state = StateCode::try_from(edge.from).unwrap();
                edge.event == Event::Order(ordered) && state.kind() == *kind
            });
            let answers: BTreeSet<_> = told.map(|edge| answer(ordered, &edge.said)).collect();
            let is_told = |answer: &&String| *answer != "no answer yet";
            let answers: Vec<_> = answers.iter().filter(is_told).cloned().collect();
            match answers[..] {
                // Noted, and accepted when it is done.
                [] => "accepted".to_string(),
                _ => answers.join("; ").replace("refused: ", ""),
            }
        };
        let cells: Vec<_> = kinds.iter().map(cell).collect();
        let name = ordered.name();
        text += &format!("| {name} | {} |\n", cells.join(" | "));
    }
    text
}

pub(super) fn assert_is_kept(found: &[Found]) {
    let edges: Vec<&Edge> = found.iter().flat_map(|found| &found.edges).collect();
    assert_kept("tests/data/states/vehicle.txt", &render(&edges));
    assert_part_kept("docs/reference/states.md", "orders", &orders(&edges));
    let figures = found.iter().map(|Found { name, states, edges }| {
        let (states, edges) = (states.len(), edges.len());
        format!("- {name}: {states} states, {edges} edges\n")
    });
    assert_part_kept("docs/reference/states.md", "vehicle", &figures.collect::<String>());
}
