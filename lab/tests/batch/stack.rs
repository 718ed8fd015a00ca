//! `lab stack` on the firmware's own image: the worst case holds on the rig and is as small as it
//! has to be, and the interrupts have the priorities that `src/samd21/mod.rs` says.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::running::{self, json, tvc};

/// The image of this tree, in flight from the largest tilt.
fn stack() -> Value {
    json(&tvc(&["stack", "--start", "0.8", "--json"]))
}

#[test]
fn the_worst_case_covers_what_the_rig_sees_and_fits() {
    let stack = stack();
    let bytes = |key: &str| stack[key].as_u64().unwrap();
    let (worst, seen) = (bytes("worst_bytes"), bytes("seen_bytes"));
    assert!(worst >= seen, "{worst} and {seen}");
    assert!(stack["share_pct"].as_f64().unwrap() <= 60.0);
    assert_eq!(stack["problems"], serde_json::json!([]));
    // A table of jumps whose entries are missed would leave their code without a path to it. What
    // traps behind main is all that no path leads to.
    assert!(bytes("not_followed_bytes") <= 8);

    // The levels are the total, and the way of each is its bytes.
    let rows = |key: &str| stack[key].as_array().unwrap().iter();
    let number = |row: &Value, key: &str| row[key].as_u64().unwrap();
    let levels = rows("levels");
    let both = levels.map(|row| number(row, "bytes") + number(row, "frame_bytes"));
    assert_eq!(both.sum::<u64>(), worst);
    for level in rows("levels") {
        let steps = rows("path").filter(|step| step["level"] == level["level"]);
        let way: u64 = steps.map(|step| number(step, "bytes")).sum();
        assert_eq!(way, number(level, "bytes"), "{level}");
    }
    // Everything on the way comes and goes: main's own part is not the sum of all frames.
    let owns = rows("largest").map(|row| number(row, "own_bytes"));
    assert!(owns.sum::<u64>() > worst);
}

/// Every call of the image is followed, those by pointers too: none of the functions that are
/// reached is one of the core library's for panics, or the handler.
#[test]
fn no_call_leads_to_a_panic() {
    let stack = json(&tvc(&["stack", "--after", "0.01", "--top", "100000", "--json"]));
    assert_eq!(stack["problems"], serde_json::json!([]));
    let rows = stack["largest"].as_array().unwrap().iter();
    let functions: Vec<_> = rows.map(|row| row["function"].as_str().unwrap()).collect();
    assert!(functions.len() > 200, "{} functions", functions.len());
    for part in ["panic", "unwrap_failed", "expect_failed", "rust_begin_unwind", "slice_index"] {
        let found = functions.iter().find(|name| name.contains(part));
        assert_eq!(found, None);
    }
}

#[test]
fn interrupts_have_the_priorities_that_the_board_documents() {
    let stack = stack();
    let handlers = stack["handlers"].as_array().unwrap().iter();
    let priorities: BTreeMap<_, _> = handlers
        .map(|row| (row["handler"].as_str().unwrap(), row["priority"].as_f64().unwrap()))
        .collect();
    for (handler, priority) in [
        ("SysTick", 0.0),
        ("WDT", 0.0),
        ("TCC0", 1.0),
        ("SERCOM4", 1.0),
        ("USB", 3.0),
        ("HardFault", -1.0),
    ] {
        assert_eq!(priorities.get(handler), Some(&priority), "{handler}");
    }
}

/// An image that is not the firmware's is run without a flight; the reset's way is in it.
#[test]
fn any_image_is_analysed_without_a_flight() {
    let stack = json(&tvc(&["stack", "--after", "0.01", "--json"]));
    assert_eq!(stack["path"][0]["function"], "Reset");
    assert!(stack["seen_bytes"].as_u64().unwrap() > 0);
    let said = running::said(&tvc(&["stack", "--after", "0.01"]));
    assert!(!said.contains("missed"), "{said}");
}
