//! A STOP that cannot be lost: old orders, many pages, no page, no program.

use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::page::{Page, Server, vehicle, vehicle_with};
use crate::running::tvc;

/// What another program hears of the vehicle.
fn status(port: &Path) -> Value {
    let options = ["monitor", "--json", "--every", "0.2", "--seconds", "1.5", "--port"];
    let output = tvc(&[&options[..], &[port.to_str().unwrap()]].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(text.lines().last().expect("a status")).unwrap()
}

/// A vehicle in control.
fn release(page: &Page) {
    page.arm();
    page.press("release");
    page.wait_for("active");
}

#[test]
fn an_order_that_was_held_back_is_refused_and_a_stop_is_not() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.arm();
    for (order, fields) in
        [("release", Value::Null), ("set", json!({ "name": "PID_KP", "value": 2 }))]
    {
        let answer = page.give(order, fields, 1_500);
        let error = answer["error"].as_str().unwrap();
        assert!(error.contains("s old"), "{error}");
    }
    let answer = page.give("release", Value::Null, -i64::MAX);
    let error = answer["error"].as_str().unwrap();
    assert!(error.contains("another start"), "{error}");
    page.wait_for("armed");
    let answer = page.give("stop", Value::Null, 60_000);
    assert!(answer["error"].is_null(), "{answer}");
    page.wait_for("standby");
}

/// A sensor that is gone keeps the vehicle in its failsafe, where the rudder is at neutral.
#[test]
fn a_stop_of_a_vehicle_with_a_fault_is_answered() {
    let faults = tempfile::NamedTempFile::new().unwrap();
    let unplugged = "[[fault]]\nkind = \"unplugged\"\nat_s = 0.5\nfor_s = 600.0\n";
    std::fs::write(&faults, unplugged).unwrap();
    let (folder, port, _rig) = vehicle_with(&["--faults", faults.path().to_str().unwrap()]);
    let server = Server::of(&port, folder.path());
    let page = server.page();
    release(&page);
    page.wait_for("failsafe");
    let answer = page.give("stop", Value::Null, 0);
    let note = answer["note"].as_str().unwrap_or_else(|| panic!("{answer}"));
    assert!(note.contains("neutral; the fault stays: IMU"), "{note}");
    let said = server.end("TERM");
    assert!(said.contains("the fault stays: IMU"), "{said}");
}

#[test]
fn seven_pages_stop_each_and_a_stop_needs_neither_token_nor_socket() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let pages: Vec<Page> = (0..7).map(|_| server.page()).collect();
    for page in &pages {
        pages[0].arm();
        page.wait_for("armed");
        page.press("stop");
        pages[0].wait_for("standby");
    }
    pages[0].arm();
    let (status, text) = server.ask("POST /stop", "X-Stop: 1\r\nContent-Length: 0\r\n");
    assert_eq!(status, 200, "{text}");
    pages[0].wait_for("standby");
}

#[test]
fn a_program_that_is_told_to_end_disarms_first() {
    let (folder, port, _rig) = vehicle();
    for name in ["TERM", "INT", "HUP"] {
        let server = Server::of(&port, folder.path());
        let page = server.page();
        release(&page);
        let begun = Instant::now();
        let said = server.end(name);
        assert!(said.contains("the vehicle has been disarmed"), "{name}: {said}");
        assert!(begun.elapsed() < Duration::from_secs(2), "{name}");
        assert_eq!(status(&port)["state"], "standby", "{name}");
    }
}

/// Nobody is left to disarm it but the vehicle itself.
#[test]
fn a_program_that_was_killed_is_missed_by_the_vehicle() {
    let (folder, port, _rig) = vehicle();
    let mut server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for_parameter("FS_HOST", 1.0);
    release(&page);
    server.web.0.kill().unwrap();
    server.web.0.wait().unwrap();
    std::thread::sleep(Duration::from_secs(4));
    assert_eq!(status(&port)["state"], "failsafe");
}

#[test]
fn when_the_last_page_has_gone_the_vehicle_is_disarmed() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let (first, second) = (server.page(), server.page());
    release(&first);
    drop(first);
    std::thread::sleep(Duration::from_secs(2));
    second.wait_for("active");
    drop(second);
    std::thread::sleep(Duration::from_secs(2));
    let third = server.page();
    third.wait_for("standby");
    third.wait_for_text("the last page was closed");
}
