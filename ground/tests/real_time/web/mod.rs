//! `tvc web` against the virtual rig: as the page uses it, and as a foreign page would.

mod cockpit;
mod hostile;
mod page;
mod recordings;
mod rig;
mod set_up;
mod stopping;

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::running::{self, json as object, tvc};
use page::{Server, rig as rig_at, signal, vehicle};

/// What the vehicle at `port` has of a parameter.
fn parameter(port: &Path, name: &str) -> f64 {
    let port = port.to_str().unwrap();
    let got = object(&tvc(&["param", "get", name, "--json", "--port", port]));
    got["parameters"][0]["value"].as_f64().unwrap()
}

#[test]
fn the_page_shows_arms_stops_and_tunes_and_a_foreign_page_cannot() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for("standby");

    // The page itself is no secret: the token is in the address alone.
    let (_, text) = server.ask("GET /", "");
    assert!(text.contains("STOP") && text.contains("frame-ancestors 'none'"));
    assert!(!text.contains(&server.token));
    for name in [
        "page.js",
        "guided.js",
        "page.css",
        "link.js",
        "stop.js",
        "charts.js",
        "releases.js",
        "attitude.js",
        "sections.js",
        "parameters.js",
        "rig.js",
        "logs.js",
        "tests.js",
        "rig.json",
        "parameter_file.js",
        "uPlot.js",
        "uPlot.css",
    ] {
        assert_eq!(server.ask(&format!("GET /{name}"), "").0, 200, "{name}");
    }
    for (what, head, status) in [
        ("GET /no-such", "", 404),
        ("GET /", "Host: evil.example\r\n", 403),
        ("GET /page", "", 426),
        ("POST /arm", "", 403),
        ("PUT /stop", "X-Stop: 1\r\n", 403),
        ("POST /stop", "", 403),
        ("POST /stop", "X-Stop: 1\r\nHost: evil.example\r\n", 403),
        ("POST /stop", "X-Stop: 1\r\nOrigin: http://evil.example\r\n", 403),
        ("POST /stop", "X-Stop: 1\r\nOrigin: null\r\n", 403),
        ("GET /page", "Upgrade: websocket\r\nOrigin: http://127.0.0.1:1\r\n", 403),
    ] {
        assert_eq!(server.ask(what, head).0, status, "{what} {head}");
    }
    for token in ["", "00", &"0".repeat(32)] {
        assert_eq!(server.page_with(token).closed(), 4403, "{token}");
    }

    // Fifty messages a second, with what the rig shows.
    let (first, begun) = (page.messages(), Instant::now());
    std::thread::sleep(Duration::from_secs(2));
    let hz = (page.messages() - first) as f64 / begun.elapsed().as_secs_f64();
    assert!((25.0..55.0).contains(&hz), "{hz} messages a second");
    let frame = page.wait("frame", |_| true);
    let pitch = frame["attitude_deg"][1].as_f64().unwrap().to_radians();
    assert!((pitch - 0.3).abs() < 0.03, "{frame}");
    assert!(frame["latency_ms"].as_f64().unwrap() < 20.0, "{frame}");

    page.arm();
    let said = page.refused("set", json!({ "name": "SRV_DIR", "value": -1 }));
    assert!(said.contains("disarm first"), "{said}");
    page.refused("step", Value::Null);
    page.press("stop");
    page.wait_for("standby");
    let said = page.refused("release", Value::Null);
    assert!(said.contains("refused"), "{said}");

    page.set("PID_KP", 1.25);
    page.wait_for_parameter("PID_KP", 1.25);
    for (name, value, part) in [
        ("PID_KP", json!(11), "PID_KP must be 0 to 10"),
        ("PID_KP", json!(1e39), "PID_KP must be 0 to 10"),
        ("SRV_DIR", json!(0.5), "SRV_DIR must be"),
        ("PID_KP\0x", json!(2), "no parameter"),
        ("NO_SUCH", json!(2), "no parameter"),
    ] {
        let said = page.refused("set", json!({ "name": name, "value": value }));
        assert!(said.contains(part), "{said}");
    }

    // The vehicle watches over the program, which is not stored and ends with it.
    page.wait_for_parameter("FS_HOST", 1.0);
    page.press("save");
    page.press("reload");
    page.wait_for_parameter("FS_HOST", 1.0);
    assert!(!server.end("TERM").contains("disarmed"));
    assert_eq!(parameter(&port, "PID_KP"), 1.25);
    assert_eq!(parameter(&port, "FS_HOST"), 0.0);
    let port = port.to_str().unwrap();
    let reset = tvc(&["param", "reset", "--stored", "--port", port]);
    assert!(reset.status.success(), "{}", running::said(&reset));
    assert_eq!(parameter(Path::new(port), "FS_HOST"), 0.0);
}

/// Other users of the computer can read the command line of the browser.
#[test]
fn the_browser_that_is_opened_gets_a_word_that_is_good_once() {
    let (folder, port, _rig) = vehicle();
    let opener = folder.path().join("xdg-open");
    std::fs::write(&opener, "#!/bin/sh\necho \"$1\" > \"$0.tmp\"; mv \"$0.tmp\" \"$0.said\"\n")
        .unwrap();
    std::fs::set_permissions(&opener, PermissionsExt::from_mode(0o700)).unwrap();
    let path = format!("PATH={}:$PATH; set -- \"$@\" --open", folder.path().display());
    let server = Server::limited(&port, folder.path(), &path);
    let said = folder.path().join("xdg-open.said");
    let begun = Instant::now();
    while !said.exists() {
        assert!(begun.elapsed() < page::PATIENCE, "no browser was opened");
        std::thread::sleep(Duration::from_millis(10));
    }
    let url = std::fs::read_to_string(said).unwrap();
    let word = url.trim().split_once("#token=").unwrap().1;
    assert_ne!(word, server.token);
    let page = server.page_with(word);
    page.wait("token", |token| *token == server.token.as_str());
    page.wait_for("standby");
    assert_eq!(server.page_with(word).closed(), 4403);
    server.page().wait_for("standby");
}

#[test]
fn a_step_test_gives_its_figures_and_a_recording_its_log() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for("standby");
    page.press("step");
    let said = page.refused("record", Value::Null);
    assert!(said.contains("under way"), "{said}");
    let trial = page.wait("trial", |trial| trial["result"].is_object());
    let run = &trial["result"]["run"];
    assert_eq!(run["stayed_active"], true, "{trial}");
    assert!(run["settling_5pct_s"].as_f64().unwrap() < 1.5, "{run}");
    let releases = page.wait("releases", |rows| rows[0]["test"] == "step");
    assert!(releases[0]["trace"].as_array().unwrap().len() > 100);
    assert_eq!(releases[0]["run"]["rise_s"], run["rise_s"], "{releases}");
    assert!(folder.path().join("step-001.tlog").exists());
    page.wait_for("standby");

    // A STOP ends a test, whatever it does.
    page.press("step");
    page.press("stop");
    let trial = page.wait("trial", |trial| trial["running"] == false && trial["result"].is_null());
    let stage = trial["stage"].as_str().unwrap();
    assert!(stage.contains("stopped by the operator"), "{trial}");
    page.wait_for("standby");

    page.press("record");
    page.wait("condition", |now| {
        now["recording"].as_str().is_some_and(|path| path.ends_with("flight-001.tlog"))
    });
    std::thread::sleep(Duration::from_secs(1));
    page.press("end-record");
    let log = folder.path().join("flight-001.tlog");
    assert!(std::fs::metadata(log).unwrap().len() > 2_000);
}

/// The file may have 8 blocks, as if the disk were full.
#[test]
fn a_recording_that_cannot_be_written_is_said_and_stops_nothing() {
    let (folder, port, _rig) = vehicle();
    let server = Server::limited(&port, folder.path(), "trap '' XFSZ; ulimit -f 8");
    let page = server.page();
    page.wait_for("standby");
    page.press("record");
    let condition = page.wait("condition", |now| now["recording_failure"].is_string());
    assert!(condition["recording"].is_null(), "{condition}");
    assert_eq!(condition["connected"], true, "the port stays open");
    let said = condition["recording_failure"].as_str().unwrap();
    assert!(said.contains("flight-001.tlog"), "{said}");

    page.press("step");
    let is_over = |trial: &Value| trial["running"] == false && trial["log"] != "";
    let trial = page.wait("trial", is_over);
    let stage = trial["stage"].as_str().unwrap();
    assert!(stage.contains("step-001.tlog"), "no verdict: {trial}");
    assert!(trial["result"].is_null(), "{trial}");
    page.wait_for("standby");
}

#[test]
fn a_port_that_went_away_is_said_and_found_again() {
    let (folder, port, mut first) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for("standby");
    signal(&first, "TERM");
    first.0.wait().unwrap();
    let condition = page.wait("condition", |now| now["connected"] == false);
    let problem = condition["problem"].as_str().unwrap();
    assert!(problem.contains("went away") || problem.contains("no port"), "{problem}");
    page.refused("arm", Value::Null);
    page.refused("stop", Value::Null);
    let _second = rig_at(&port);
    page.wait_for("standby");
    page.arm();
}
