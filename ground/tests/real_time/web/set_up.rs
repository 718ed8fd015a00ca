//! The set-up from the page: from a Nano out of its box to a release, and what ends a step.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use super::page::{Page, Server, vehicle_with};
use super::parameter;

/// Begins a step as soon as the vehicle is heard.
fn begin(page: &Page, step: &str) {
    page.wait("condition", |now| now["connected"] == true && now["in_operation"] == false);
    let answer = page.give("set-up", json!({ "step": step }), 0);
    assert!(answer["error"].is_null(), "{step}: {answer}");
    page.wait("set_up", |now| now["step"] == step && now["running"] == true);
}

/// The number of the question with these words, which was not asked before.
fn question(page: &Page, words: &str, before: u64) -> u64 {
    let is_asked = |now: &Value| {
        assert_eq!(now["running"], true, "{words}: {now}");
        let asked = &now["question"];
        asked["id"].as_u64() > Some(before) && asked["words"].as_str().unwrap().contains(words)
    };
    let now = page.wait("set_up", is_asked);
    now["question"]["id"].as_u64().unwrap()
}

/// Answers questions in turn.
fn answer(page: &Page, answers: &[(&str, &str)]) {
    let mut last = 0;
    for (words, reply) in answers {
        last = question(page, words, last);
        let told = page.give("answer", json!({ "question": last, "reply": reply }), 0);
        assert!(told["error"].is_null(), "{words}: {told}");
    }
}

/// How the step has ended.
fn end(page: &Page) -> Value {
    page.wait("set_up", |now| now["running"] == false)
}

fn assert_met(page: &Page) -> Value {
    let now = end(page);
    assert_eq!(now["met"], true, "{now}");
    now
}

#[test]
fn a_nano_out_of_its_box_is_set_up_and_released_from_the_page_alone() {
    let (folder, port, _rig) =
        vehicle_with(&["--blank", "--sensor-errors", "worst", "--speed", "4"]);
    let server = Server::of(&port, folder.path());
    let page = server.page();

    begin(&page, "sensors");
    let declination = "Magnetic declination";
    answer(&page, &[(declination, "north"), (declination, "55.79, 12.52")]);
    // Each has its own patience: a busy machine runs the rig slower than real time.
    for line in [
        "a place such as 55.79,12.52",
        "at rest for 10 s",
        "left side up seen",
        "of all directions seen",
    ] {
        let is_seen = |now: &Value| now["lines"].to_string().contains(line);
        page.wait("set_up", is_seen);
        if line == "left side up seen" {
            page.wait("set_up", |now| now["seen"].is_array());
        }
    }
    answer(&page, &[("stand level", ""), ("Write this", "y")]);
    let now = assert_met(&page);
    let figures = now["figures"].as_array().unwrap();
    assert!(figures.iter().any(|row| row[0] == "hard iron, uT"), "{now}");
    for kind in ["tlog", "parm", "html"] {
        let file = folder.path().join(format!("calibration-001.{kind}"));
        assert!(file.exists(), "{}", file.display());
    }
    let has = |name: &str, value: f64| page.wait_for_parameter(name, value);

    begin(&page, "servo");
    let (centre, ends) = ("hangs straight down", "at which nothing touches");
    answer(
        &page,
        &[
            (centre, "1500"),
            (centre, "++"),
            (centre, "9000"),
            (centre, "1500"),
            (centre, ""),
            ("how many deg", "29"),
            ("how many deg", "31"),
            ("to the nose", ""),
            (ends, "930"),
            (ends, ""),
            (ends, ""),
            ("Write this", "y"),
        ],
    );
    let now = assert_met(&page);
    let lines = now["lines"].to_string();
    assert!(lines.contains("9000 leads to no pulse"), "{now}");
    has("SRV_CENTRE_US", 1500.0);
    has("SRV_US_PER_DEG", 10.0);
    has("SRV_MIN_US", 930.0);

    let said = page.refused("arm", Value::Null);
    assert!(said.contains("arm refused"), "{said}");
    begin(&page, "polarity");
    answer(&page, &[("point forward", "y"), ("point backward", "y")]);
    assert_met(&page);
    has("SRV_POLARITY", 1.0);

    page.wait_for("standby");
    page.press("step");
    let trial = page.wait("trial", |trial| trial["result"].is_object());
    assert_eq!(trial["result"]["run"]["stayed_active"], true, "{trial}");
    // In the flash, too.
    page.press("reload");
    has("SRV_POLARITY", 1.0);
    has("SRV_MIN_US", 930.0);
    drop(server);
    assert!(parameter(&port, "DECLINATION_DEG") > 4.0);
}

/// A polarity check up to its first question, with the rudder off its neutral.
fn see_the_rudder_answer(page: &Page) -> (u64, f64) {
    let pulse = |page: &Page| page.wait("frame", |_| true)["pulse_us"].as_f64().unwrap();
    page.wait_for("standby");
    let neutral = pulse(page);
    begin(page, "polarity");
    let asked = question(page, "point forward", 0);
    assert!(pulse(page) > neutral + 40.0);
    (asked, neutral)
}

fn assert_at_neutral(page: &Page, neutral: f64) {
    page.wait("frame", |frame| (frame["pulse_us"].as_f64().unwrap() - neutral).abs() < 2.0);
}

#[test]
fn a_polarity_check_is_ended_by_stop_by_a_closed_page_and_with_the_program() {
    let (folder, port, _rig) = vehicle_with(&["--blank"]);
    let server = Server::of(&port, folder.path());
    let page = server.page();
    let (asked, neutral) = see_the_rudder_answer(&page);
    for order in ["arm", "step", "record", "reset", "calibrate"] {
        let said = page.refused(order, Value::Null);
        assert!(said.contains("set-up is under way"), "{order}: {said}");
    }
    let yes = |question: u64| json!({ "question": question, "reply": "y" });
    for other in [0, asked - 1, asked + 1] {
        let said = page.refused("answer", yes(other));
        assert!(said.contains("not asked any more"), "{said}");
    }
    let late = page.give("answer", yes(asked), 1_500);
    assert!(late["error"].as_str().unwrap().contains("s old"), "{late}");
    page.press("stop");
    let now = end(&page);
    assert!(now["ending"].as_str().unwrap().contains("stopped"), "{now}");
    page.wait_for_parameter("SRV_POLARITY", 0.0);
    assert_at_neutral(&page, neutral);
    let said = page.refused("answer", yes(asked));
    assert!(said.contains("not asked any more"), "{said}");
    page.refused("cancel", Value::Null);

    // Cancelled, it ends without a STOP.
    see_the_rudder_answer(&page);
    page.press("cancel");
    assert_eq!(end(&page)["met"], false);
    page.wait_for_parameter("SRV_POLARITY", 0.0);
    assert_at_neutral(&page, neutral);

    // Nobody is left who could answer.
    see_the_rudder_answer(&page);
    drop(page);
    std::thread::sleep(Duration::from_secs(2));
    let page = server.page();
    end(&page);
    page.wait_for_text("the last page was closed");
    page.wait_for_parameter("SRV_POLARITY", 0.0);
    assert_at_neutral(&page, neutral);

    see_the_rudder_answer(&page);
    server.end("TERM");
    assert_eq!(parameter(&port, "SRV_POLARITY"), 0.0);
    assert_eq!(parameter(&port, "FS_HOST"), 0.0);
}

/// What was set before the flash took it is put back.
#[test]
fn a_servo_that_nobody_agrees_to_stays_as_it_was() {
    let (folder, port, _rig) = vehicle_with(&[]);
    let before = 1523.6;
    let server = Server::of(&port, folder.path());
    let page = server.page();
    begin(&page, "servo");
    answer(&page, &[("hangs straight down", "1450"), ("hangs straight down", "")]);
    // The servo holds the pulse that the next question is about.
    question(&page, "Horn at 1750 us", 0);
    page.wait("frame", |frame| frame["pulse_us"] == 1750);
    answer(
        &page,
        &[
            ("how many deg", ""),
            ("to the nose", ""),
            ("Shortest", ""),
            ("Longest", ""),
            ("Write this", "n"),
        ],
    );
    let now = end(&page);
    assert_eq!(now["met"], false, "{now}");
    assert_eq!(now["ending"], "the vehicle is as it was");
    page.wait("frame", |frame| (frame["pulse_us"].as_f64().unwrap() - before).abs() < 2.0);
    page.wait_for_parameter("SRV_CENTRE_US", before);
    page.wait_for_parameter("SRV_POLARITY", 1.0);
}

/// 5 mm forward lower the nose: 0.040 rad of servo hold it.
#[test]
fn a_lateral_offset_is_measured_from_the_page_and_stop_ends_the_flight() {
    let (folder, port, _rig) = vehicle_with(&["--cm-offset", "5", "--speed", "2"]);
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for_parameter("FS_HOST", 1.0);
    begin(&page, "hold");
    page.wait_for("active");
    page.press("stop");
    page.wait_for("standby");
    let now = end(&page);
    assert!(now["ending"].as_str().unwrap().contains("stopped"), "{now}");

    begin(&page, "hold");
    answer(&page, &[("Write this", "y")]);
    page.wait_for("standby");
    assert_met(&page);
    assert_hold(&page);
    // The watch over this program ends with it, and not with the step.
    page.wait_for_parameter("FS_HOST", 1.0);
    server.end("TERM");
    assert_eq!(parameter(&port, "FS_HOST"), 0.0);
    assert_near(&port);
}

fn assert_hold(page: &Page) {
    page.wait("parameters", |rows| {
        let mut rows = rows.as_array().unwrap().iter();
        rows.any(|row| row["name"] == "SRV_HOLD_DEG" && row["value"] != 0.0)
    });
}

fn assert_near(port: &Path) {
    let deg = parameter(port, "SRV_HOLD_DEG");
    assert!((deg.abs() - 2.3).abs() < 0.4, "{deg}");
}
