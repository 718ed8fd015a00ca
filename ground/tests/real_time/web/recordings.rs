//! Recordings on the page: listed, downloaded, reported, and told to nobody without the token;
//! tests that are neither a step nor a flight.

use serde_json::{Value, json};

use super::page::{Server, vehicle};
use crate::running::tvc;

/// The body of an answer.
fn body(answer: &[u8]) -> &[u8] {
    let end = answer.windows(4).position(|at| at == b"\r\n\r\n").unwrap();
    &answer[end + 4..]
}

#[test]
fn recordings_are_listed_downloaded_and_reported_with_the_token_alone() {
    let (folder, port, _rig) = vehicle();
    let logs = folder.path().join("logs");
    std::fs::create_dir(&logs).unwrap();
    let server = Server::of(&port, &logs);
    let page = server.page();
    page.wait_for("standby");
    page.press("step");
    page.wait("trial", |trial| trial["result"].is_object());
    let log = logs.join("step-001.tlog");
    let bytes = std::fs::read(&log).unwrap();
    std::fs::write(folder.path().join("secret.tlog"), &bytes).unwrap();
    std::fs::write(logs.join("my notes & more.tlog"), "no log").unwrap();

    let key = format!("Authorization: Bearer {}\r\n", server.token);
    let wrong = format!("Authorization: Bearer {}\r\n", "0".repeat(32));
    for path in ["/logs", "/logs/step-001.tlog", "/reports/step-001.tlog"] {
        for head in ["", &wrong, "Authorization: Basic eA==\r\n"] {
            let (status, answer) = server.ask(&format!("GET {path}"), head);
            assert_eq!(status, 401, "{path} {head}");
            assert!(!answer.contains("step-001"), "{answer}");
        }
        let foreign = format!("{key}Host: evil.example\r\n");
        assert_eq!(server.ask(&format!("GET {path}"), &foreign).0, 403);
        let in_the_address = format!("GET {path}?token={}", server.token);
        assert_eq!(server.ask(&in_the_address, "").0, 401);
    }

    let listed = server.ask_for_bytes("GET /logs", &key).1;
    let listed: Value = serde_json::from_slice(body(&listed)).unwrap();
    let step = listed.as_array().unwrap().iter();
    let step = step.clone().find(|log| log["name"] == "step-001.tlog");
    let step = step.unwrap_or_else(|| panic!("{listed}"));
    assert_eq!(step["bytes"], bytes.len());
    assert!(step["seconds"].as_f64().unwrap() > 3.0, "{step}");
    assert!(step["begun_ms"].as_u64().unwrap() > 1_700_000_000_000);

    let (status, answer) = server.ask_for_bytes("GET /logs/step-001.tlog", &key);
    assert_eq!((status, body(&answer)), (200, &bytes[..]));
    let named = server.ask("GET /logs/my%20notes%20%26%20more.tlog", &key);
    assert!(named.1.ends_with("no log"), "{}", named.1);
    assert_eq!(server.ask("GET /reports/my%20notes%20%26%20more.tlog", &key).0, 404);

    let page_of = folder.path().join("report.html");
    let [log, page_of] = [&log, &page_of].map(|path| path.to_str().unwrap());
    assert!(tvc(&["report", log, "--out", page_of]).status.success());
    let (status, answer) = server.ask_for_bytes("GET /reports/step-001.tlog", &key);
    assert_eq!(status, 200);
    assert_eq!(body(&answer), std::fs::read(page_of).unwrap());

    // While the vehicle may need its STOP, this program makes no report.
    page.arm();
    let (status, refusal) = server.ask("GET /reports/step-001.tlog", &key);
    assert_eq!(status, 404);
    assert!(refusal.contains("in operation"), "{refusal}");
    page.press("stop");
    page.wait_for("standby");

    let secret = folder.path().join("secret.tlog");
    let encoded = secret.to_str().unwrap().replace('/', "%2F");
    for name in [
        "..%2Fsecret.tlog",
        "%2e%2e/secret.tlog",
        "../secret.tlog",
        "..%5Csecret.tlog",
        "%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "step-001.tlog%00",
        "step-001.tlog/",
        "%ff",
        "",
        ".",
        "..",
        &encoded,
        secret.to_str().unwrap(),
    ] {
        for kind in ["logs", "reports"] {
            let status = server.ask(&format!("GET /{kind}/{name}"), &key).0;
            assert_eq!(status, 404, "{kind}/{name}");
        }
    }
}

#[test]
fn hold_and_chirp_give_their_figures_and_the_set_point_comes_back() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for("standby");
    let said = page.refused("hold", json!({ "seconds": 0.5 }));
    assert!(said.contains("1 to 600 s"), "{said}");
    let result = |order: &str, seconds: u32| {
        let answer = page.give(order, json!({ "seconds": seconds }), 0);
        assert!(answer["error"].is_null(), "{answer}");
        let trial =
            page.wait("trial", |trial| trial["manoeuvre"] == order && trial["running"] == false);
        assert!(trial["result"].is_object(), "{trial}");
        assert!(folder.path().join(format!("{order}-001.tlog")).exists());
        page.wait_for("standby");
        trial["result"].clone()
    };
    let hold = result("hold", 4);
    assert!(hold["hold"]["rms_error_rad"].as_f64().unwrap() < 0.05, "{hold}");
    assert!(hold["sweep"].is_null(), "{hold}");

    let chirp = result("chirp", 12);
    let sweep = &chirp["sweep"];
    assert!(sweep["delay_s"].as_f64().unwrap() > 0.0, "{sweep}");
    assert!(sweep["points"].as_array().unwrap().len() > 10, "{sweep}");
    assert!(chirp["run"].is_null(), "no step: {chirp}");
    page.wait_for_parameter("PITCH_SET_DEG", 0.0);

    // A STOP ends it, and the set point still comes back.
    let answer = page.give("chirp", json!({ "seconds": 60 }), 0);
    assert!(answer["error"].is_null(), "{answer}");
    page.wait("frame", |frame| frame["set_deg"].as_f64().is_some_and(|deg| deg.abs() > 1.0));
    page.press("stop");
    let trial = page.wait("trial", |trial| trial["running"] == false);
    assert!(trial["stage"].as_str().unwrap().contains("stopped by the operator"), "{trial}");
    page.wait_for_parameter("PITCH_SET_DEG", 0.0);
    page.wait_for("standby");

    // So it does where the program is told to end.
    let answer = page.give("chirp", json!({ "seconds": 60 }), 0);
    assert!(answer["error"].is_null(), "{answer}");
    page.wait("frame", |frame| frame["set_deg"].as_f64().is_some_and(|deg| deg.abs() > 1.0));
    let said = server.end("TERM");
    assert!(said.contains("disarmed"), "{said}");
    assert_eq!(super::parameter(&port, "PITCH_SET_DEG"), 0.0);
}
