//! `tvc web` against the virtual rig: its HTTP interface as the page uses it, and as a foreign page
//! would.
#![cfg(unix)]

mod running;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use running::{Running, refused};

/// A machine that is busy with other tests runs the rig slower than real time.
const PATIENCE: Duration = Duration::from_secs(120);

impl Running {
    fn end(mut self) {
        let id = self.0.id().to_string();
        assert!(Command::new("kill").arg(id).status().unwrap().success());
        assert_eq!(self.0.wait().unwrap().code(), Some(0));
    }
}

fn rig(port: &Path) -> Running {
    let port = port.to_str().unwrap();
    let options = ["--seconds", "600", "--tilt", "0.3", "--link", port];
    Running::start(&[&["rig", "--pty"], &options[..]].concat()).0
}

/// A served page.
struct Page {
    web: Running,
    address: String,
    token: String,
}

impl Page {
    fn of(port: &Path, folder: &Path) -> Self {
        let (web, url) = Running::start(&[
            "web",
            "--listen",
            "127.0.0.1:0",
            "--port",
            port.to_str().unwrap(),
            "--logs",
            folder.to_str().unwrap(),
        ]);
        let address = url.trim_start_matches("http://").trim_end_matches('/');
        let mut page = Self {
            web,
            address: address.to_owned(),
            token: String::new(),
        };
        let (status, text) = page.ask("GET /", "", "");
        assert_eq!(status, 200, "{text}");
        let rest = text.split("name=\"token\" content=\"").nth(1).unwrap();
        page.token = rest.split('"').next().unwrap().to_owned();
        page
    }

    /// One request, with further lines for its head; status and whole answer.
    fn ask(&self, what: &str, head: &str, body: &str) -> (u16, String) {
        let host = match head.contains("Host:") {
            true => String::new(),
            false => format!("Host: {}\r\n", self.address),
        };
        let mut stream = TcpStream::connect(&self.address).unwrap();
        write!(
            stream,
            "{what} HTTP/1.1\r\n{host}Connection: close\r\nContent-Length: {}\r\n{head}\r\n{body}",
            body.len()
        )
        .unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let status = text.split(' ').nth(1).unwrap().parse().unwrap();
        (status, text)
    }

    /// A press of a button: status and answer.
    fn post(&self, path: &str, body: &Value) -> (u16, Value) {
        let head = format!("X-Token: {}\r\n", self.token);
        let (status, text) = self.ask(&format!("POST {path}"), &head, &body.to_string());
        let (_, body) = text.split_once("\r\n\r\n").unwrap();
        (status, serde_json::from_str(body).unwrap())
    }

    fn press(&self, path: &str) {
        let (status, answer) = self.post(path, &Value::Null);
        assert_eq!((status, &answer["ok"]), (200, &json!(true)), "{answer}");
    }

    /// Arms as soon as the vehicle lets itself be armed: its gyro has an offset to learn, its
    /// attitude to settle.
    fn arm(&self) {
        let begun = Instant::now();
        loop {
            let (status, answer) = self.post("/arm", &Value::Null);
            if status == 200 {
                return self.wait_for("armed");
            }
            let said = answer["error"].as_str().unwrap();
            assert!(said.contains("arm refused"), "{said}");
            assert!(begun.elapsed() < PATIENCE, "{said}");
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    fn events(&self) -> Events {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "GET /events?token={} HTTP/1.1\r\nHost: {}\r\n\r\n",
            self.token, self.address
        )
        .unwrap();
        Events(BufReader::new(stream))
    }

    /// The first event of that name for which `is` holds.
    fn wait(&self, name: &str, is: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        let mut last = Value::Null;
        for (event, data) in self.events() {
            assert!(begun.elapsed() < PATIENCE, "no such {name}; last: {last}");
            if event == name {
                if is(&data) {
                    return data;
                }
                last = data;
            }
        }
        panic!("the stream of events ended; last {name}: {last}");
    }

    fn wait_for(&self, state: &str) {
        self.wait("condition", |condition| condition["state"] == state);
    }

    fn parameter(&self, name: &str) -> Value {
        let (status, text) = self.ask(&format!("GET /parameters?token={}", self.token), "", "");
        assert_eq!(status, 200, "{text}");
        let (_, body) = text.split_once("\r\n\r\n").unwrap();
        let rows: Value = serde_json::from_str(body).unwrap();
        let rows = rows.as_array().unwrap();
        assert_eq!(rows.len(), tvc_nano::Params::count());
        rows.iter().find(|row| row["name"] == name).unwrap().clone()
    }
}

/// Server-Sent Events: name and data of each.
struct Events(BufReader<TcpStream>);

impl Iterator for Events {
    type Item = (String, Value);

    fn next(&mut self) -> Option<Self::Item> {
        let mut name = String::new();
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).ok()? == 0 {
                return None;
            }
            if let Some(event) = line.strip_prefix("event: ") {
                name = event.trim().to_owned();
            } else if let Some(data) = line.strip_prefix("data: ") {
                return Some((name, serde_json::from_str(data).unwrap()));
            }
        }
    }
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("nano");
    (folder, port)
}

#[test]
fn the_page_shows_arms_stops_and_tunes_and_a_foreign_page_cannot() {
    let (folder, port) = folder();
    let _rig = rig(&port);
    let page = Page::of(&port, folder.path());
    page.wait_for("standby");

    let (_, text) = page.ask("GET /", "", "");
    assert!(text.contains("STOP") && text.contains("frame-ancestors 'none'"));
    for file in ["/page.js", "/page.css", "/chart.js", "/parameters.js"] {
        assert_eq!(page.ask(&format!("GET {file}"), "", "").0, 200, "{file}");
    }
    assert_eq!(page.ask("GET /no-such", "", "").0, 403);
    let token = format!("X-Token: {}\r\n", page.token);
    for (what, head) in [
        ("POST /arm", ""),
        ("POST /arm", "X-Token: 00\r\n"),
        ("POST /arm", &format!("{token}Host: evil.example\r\n")),
        ("GET /", "Host: evil.example\r\n"),
        ("GET /events", ""),
        ("GET /parameters?token=00", ""),
        (&format!("POST /arm?token={}", page.token), ""),
    ] {
        assert_eq!(page.ask(what, head, "").0, 403, "{what} {head}");
    }
    assert_eq!(page.ask("PUT /arm", &token, "").0, 403);
    assert_eq!(page.post("/no-such", &Value::Null).0, 404);
    page.wait_for("standby");

    // Fifty frames a second, with what the rig shows.
    let begun = Instant::now();
    let frames = page.events().filter(|(name, _)| name == "frame");
    let (_, frame) = frames.take(101).last().unwrap();
    let seconds = begun.elapsed().as_secs_f64();
    assert!((1.9..4.0).contains(&seconds), "100 frames in {seconds} s");
    let pitch = frame["attitude_deg"][1].as_f64().unwrap().to_radians();
    assert!((pitch - 0.3).abs() < 0.03, "{frame}");
    assert!(frame["latency_ms"].as_f64().unwrap() < 20.0, "{frame}");

    page.arm();
    let (status, answer) = page.post("/set", &json!({ "name": "SRV_DIR", "value": -1 }));
    assert_eq!(status, 409);
    assert!(answer["error"].as_str().unwrap().contains("disarm first"));
    let (status, answer) = page.post("/step", &Value::Null);
    assert_eq!(status, 409, "{answer}");
    page.press("/stop");
    page.wait_for("standby");
    let (status, answer) = page.post("/release", &Value::Null);
    assert_eq!(status, 409);
    assert!(
        answer["error"].as_str().unwrap().contains("refused"),
        "{answer}"
    );

    let (status, _) = page.post("/set", &json!({ "name": "PID_KP", "value": 1.25 }));
    assert_eq!(status, 200);
    assert_eq!(page.parameter("PID_KP")["value"], 1.25);
    let (status, answer) = page.post("/set", &json!({ "name": "PID_KP", "value": 11 }));
    assert_eq!(status, 409);
    let said = answer["error"].as_str().unwrap();
    assert!(said.contains("PID_KP must be 0 to 10"), "{said}");
    let (status, answer) = page.post("/set", &json!({ "name": "PID_KP" }));
    assert_eq!((status, answer["ok"].is_null()), (400, true));
    // The image has it, as another client finds once the port is free.
    page.web.end();
    let port = port.to_str().unwrap();
    let output = running::tvc(&["param", "get", "PID_KP", "--json", "--port", port]);
    let got: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(got["parameters"][0]["value"], 1.25);
}

#[test]
fn a_step_test_gives_its_figures_and_a_recording_its_log() {
    let (folder, port) = folder();
    let _rig = rig(&port);
    let page = Page::of(&port, folder.path());
    page.wait_for("standby");
    page.press("/step");
    let (status, _) = page.post("/record", &Value::Null);
    assert_eq!(status, 409, "a test is under way");
    let trial = page.wait("trial", |trial| trial["running"] == false);
    let run = &trial["result"]["run"];
    assert_eq!(run["stayed_active"], true, "{trial}");
    assert!(run["settling_5pct_s"].as_f64().unwrap() < 1.5, "{run}");
    assert!(trial["result"]["trace"].as_array().unwrap().len() > 100);
    assert!(folder.path().join("step-001.tlog").exists());
    page.wait_for("standby");

    // A STOP ends a test, whatever it does.
    page.press("/step");
    page.press("/stop");
    let trial = page.wait("trial", |trial| trial["running"] == false);
    let stage = trial["stage"].as_str().unwrap();
    assert!(stage.contains("stopped by the operator"), "{trial}");
    page.wait_for("standby");

    page.press("/record");
    page.wait("condition", |now| {
        now["recording"]
            .as_str()
            .is_some_and(|path| path.ends_with("flight-001.tlog"))
    });
    std::thread::sleep(Duration::from_secs(1));
    page.press("/end-record");
    let log = folder.path().join("flight-001.tlog");
    assert!(std::fs::metadata(log).unwrap().len() > 2_000);
}

#[test]
fn a_port_that_went_away_is_said_and_found_again() {
    let (folder, port) = folder();
    let first = rig(&port);
    let page = Page::of(&port, folder.path());
    page.wait_for("standby");
    first.end();
    let condition = page.wait("condition", |now| now["connected"] == false);
    let problem = condition["problem"].as_str().unwrap();
    assert!(
        problem.contains("went away") || problem.contains("no port"),
        "{problem}"
    );
    assert_eq!(page.post("/arm", &Value::Null).0, 409);
    let _second = rig(&port);
    page.wait_for("standby");
    page.arm();
}

#[test]
fn what_cannot_be_served_is_said_in_a_line() {
    let said = refused(&[
        "web",
        "--listen",
        "127.0.0.1:0",
        "--port",
        "/dev/no-such-port",
    ]);
    assert!(said.contains("no port /dev/no-such-port"), "{said}");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let said = refused(&["web", "--listen", &address]);
    assert!(
        said.contains(&address) && said.contains("--listen"),
        "{said}"
    );
    let said = refused(&["web", "--logs", "/no/such/folder"]);
    assert!(said.contains("--logs"), "{said}");
    refused(&["web", "--listen", "8650"]);
}
