//! The page of `tvc web` without a browser: its address, its HTTP requests, its WebSocket.

use std::collections::HashMap;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, Sender, TryRecvError};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::{Error, Message};

use crate::running::{self, Running};

/// A machine that is busy with other tests runs the rig slower than real time.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// A virtual rig, its port, and the folder of both.
pub(crate) fn vehicle() -> (tempfile::TempDir, PathBuf, Running) {
    vehicle_with(&[])
}

/// The same, with further options of `tvc rig`.
pub(crate) fn vehicle_with(more: &[&str]) -> (tempfile::TempDir, PathBuf, Running) {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("nano");
    let rig = rig_with(&port, more);
    (folder, port, rig)
}

/// A rig that stands at `port`.
pub(crate) fn rig(port: &Path) -> Running {
    rig_with(port, &[])
}

fn rig_with(port: &Path, more: &[&str]) -> Running {
    let port = port.to_str().unwrap();
    let options = ["rig", "--pty", "--seconds", "3600", "--tilt", "0.3", "--link", port];
    Running::start(&[&options, more].concat()).0
}

/// Sends a signal to a process of ours.
pub(crate) fn signal(running: &Running, name: &str) {
    let id = running.0.id().to_string();
    let status = Command::new("kill").args(["-s", name, &id]).status();
    assert!(status.unwrap().success());
}

/// A program that serves the page.
pub(crate) struct Server {
    pub(crate) web: Running,
    pub(crate) address: String,
    pub(crate) token: String,
}

impl Server {
    /// Serves the vehicle at `port`; recordings go to `folder`.
    pub(crate) fn of(port: &Path, folder: &Path) -> Self {
        Self::limited(port, folder, "true")
    }

    /// The same, after a line for the shell.
    pub(crate) fn limited(port: &Path, folder: &Path, limit: &str) -> Self {
        Self::run(&format!("--port={}", port.display()), folder, limit)
    }

    /// At a rig in the process of `tvc web`.
    pub(crate) fn with_rig(folder: &Path) -> Self {
        Self::run("--rig", folder, "true")
    }

    fn run(vehicle: &str, folder: &Path, limit: &str) -> Self {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("{limit}; exec \"$0\" \"$@\"")]);
        let web = running::command(&["web", "--listen", "127.0.0.1:0", vehicle]);
        command.arg(web.get_program()).args(web.get_args());
        command.arg("--logs").arg(folder).stderr(Stdio::piped());
        let (web, url) = Running::of(&mut command);
        let (address, token) = url.split_once("/#token=").unwrap();
        Self {
            web,
            address: address.trim_start_matches("http://").to_owned(),
            token: token.to_owned(),
        }
    }

    /// One request, with further lines for its head; status and whole answer.
    pub(crate) fn ask(&self, what: &str, head: &str) -> (u16, String) {
        let (status, bytes) = self.ask_for_bytes(what, head);
        (status, String::from_utf8(bytes).unwrap())
    }

    /// The same; head and body as bytes.
    pub(crate) fn ask_for_bytes(&self, what: &str, head: &str) -> (u16, Vec<u8>) {
        let host = match head.contains("Host:") {
            true => String::new(),
            false => format!("Host: {}\r\n", self.address),
        };
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(stream, "{what} HTTP/1.1\r\n{host}{head}\r\n").unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let status = String::from_utf8_lossy(&bytes[9..12]).parse().unwrap();
        (status, bytes)
    }

    /// A page in a browser.
    pub(crate) fn page(&self) -> Page {
        self.page_with(&self.token)
    }

    /// A page with this token.
    pub(crate) fn page_with(&self, token: &str) -> Page {
        Page::open(&self.address, token)
    }

    /// Ends by this signal; what it has said.
    pub(crate) fn end(mut self, name: &str) -> String {
        signal(&self.web, name);
        let mut said = String::new();
        let mut out = self.web.0.stderr.take().unwrap();
        out.read_to_string(&mut said).unwrap();
        assert_eq!(self.web.0.wait().unwrap().code(), Some(0), "{said}");
        said
    }
}

/// What has come to a page.
#[derive(Default)]
struct Seen {
    now_ms: u64,
    messages: u64,
    /// The newest of each kind.
    news: HashMap<String, Value>,
    texts: Vec<Value>,
    answers: HashMap<u64, Value>,
    /// Why the connection was closed.
    closed: Option<u16>,
}

/// A page that is open, read by a thread of its own.
pub(crate) struct Page {
    out: Sender<String>,
    seen: Arc<Mutex<Seen>>,
    next: std::cell::Cell<u64>,
}

impl Page {
    fn open(address: &str, token: &str) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        let (mut socket, _) = tungstenite::client(format!("ws://{address}/page"), stream).unwrap();
        let login = json!({ "token": token }).to_string();
        socket.send(Message::text(login)).unwrap();
        socket.get_ref().set_read_timeout(Some(LOOK)).unwrap();
        let (out, orders) = mpsc::channel::<String>();
        let seen = Arc::new(Mutex::new(Seen::default()));
        let shared = seen.clone();
        std::thread::spawn(move || {
            loop {
                match orders.try_recv() {
                    Ok(order) => drop(socket.send(Message::text(order))),
                    Err(TryRecvError::Empty) => {}
                    Err(TryRecvError::Disconnected) => return,
                }
                match socket.read() {
                    Ok(Message::Text(text)) => shared.lock().unwrap().take(&text),
                    Ok(Message::Close(frame)) => {
                        let code = frame.map_or(0, |frame| frame.code.into());
                        shared.lock().unwrap().closed = Some(code);
                    }
                    Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {}
                    Err(_) => {
                        shared.lock().unwrap().closed.get_or_insert(0);
                        return;
                    }
                    Ok(_) => {}
                }
            }
        });
        Self { out, seen, next: std::cell::Cell::new(1) }
    }

    /// Waits until `find` finds something in what has come.
    fn find<T>(&self, what: &str, find: impl Fn(&mut Seen) -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            if let Some(found) = find(&mut self.seen.lock().unwrap()) {
                return found;
            }
            assert!(
                begun.elapsed() < PATIENCE,
                "{what}; newest: {:?}",
                self.seen.lock().unwrap().news
            );
            std::thread::sleep(LOOK);
        }
    }

    /// The code with which the program closed it.
    pub(crate) fn closed(&self) -> u16 {
        self.find("closed", |seen| seen.closed)
    }

    /// The newest of a kind for which `is` holds.
    pub(crate) fn wait(&self, kind: &str, is: impl Fn(&Value) -> bool) -> Value {
        self.find(kind, |seen| {
            let value = seen.news.get(kind);
            value.filter(|value| is(value)).cloned()
        })
    }

    /// Waits for a state of the flight.
    pub(crate) fn wait_for(&self, state: &str) {
        self.wait("condition", |condition| condition["state"] == state);
    }

    /// Waits for a text of the vehicle or the program.
    pub(crate) fn wait_for_text(&self, words: &str) {
        self.find(words, |seen| {
            let mut texts = seen.texts.iter();
            texts.find(|text| text["text"].as_str().unwrap().contains(words))?;
            Some(())
        });
    }

    /// How many messages have come.
    pub(crate) fn messages(&self) -> u64 {
        self.seen.lock().unwrap().messages
    }

    /// Sends an order as of some time before now, negative after it; its answer.
    pub(crate) fn give(&self, order: &str, fields: Value, age_ms: i64) -> Value {
        let id = self.next.replace(self.next.get() + 1);
        let now_ms = self.find("a first message", |seen| (seen.now_ms > 0).then_some(seen.now_ms));
        let heard_ms = now_ms.saturating_add_signed(-age_ms);
        let mut message = json!({ "id": id, "heard_ms": heard_ms, "order": order });
        if let Value::Object(fields) = fields {
            message.as_object_mut().unwrap().extend(fields);
        }
        self.out.send(message.to_string()).unwrap();
        self.find(order, |seen| seen.answers.remove(&id))
    }

    /// Something done by hand to the rig.
    pub(crate) fn act(&self, action: &str) {
        let answer = self.give("rig", json!({ "action": action }), 0);
        assert!(answer["error"].is_null(), "{action}: {answer}");
    }

    /// A button that is obeyed.
    pub(crate) fn press(&self, order: &str) {
        let answer = self.give(order, Value::Null, 0);
        assert!(answer["error"].is_null(), "{order}: {answer}");
    }

    /// A button that is refused, with the reason.
    pub(crate) fn refused(&self, order: &str, fields: Value) -> String {
        let answer = self.give(order, fields, 0);
        let error = answer["error"].as_str();
        error.unwrap_or_else(|| panic!("{order}: {answer}")).to_owned()
    }

    /// Changes a parameter.
    pub(crate) fn set(&self, name: &str, value: f64) {
        let answer = self.give("set", json!({ "name": name, "value": value }), 0);
        assert!(answer["error"].is_null(), "{answer}");
    }

    /// Waits until the vehicle has this value.
    pub(crate) fn wait_for_parameter(&self, name: &str, value: f64) {
        self.wait("parameters", |rows| {
            let rows = rows.as_array().unwrap();
            assert!([0, tvc_nano::Params::count()].contains(&rows.len()));
            rows.iter().any(|row| row["name"] == name && row["value"] == value)
        });
    }

    /// Arms as soon as the vehicle lets itself be armed: its gyro has an offset to learn, its
    /// attitude to settle.
    pub(crate) fn arm(&self) {
        self.wait_for("standby");
        let begun = Instant::now();
        loop {
            let answer = self.give("arm", Value::Null, 0);
            let Some(said) = answer["error"].as_str() else {
                return self.wait_for("armed");
            };
            // On a busy machine the vehicle is slow to answer.
            let is_passing = said.contains("arm refused") || said.contains("waited too long");
            assert!(is_passing, "{said}");
            assert!(begun.elapsed() < PATIENCE, "{said}");
            std::thread::sleep(Duration::from_millis(200));
        }
    }
}

impl Seen {
    fn take(&mut self, text: &str) {
        let Value::Object(message) = serde_json::from_str(text).unwrap() else {
            panic!("{text}");
        };
        if let Some(id) = message.get("id") {
            let id = id.as_u64().unwrap();
            self.answers.insert(id, Value::Object(message));
            return;
        }
        if message.contains_key("token") {
            return self.news.extend(message);
        }
        self.messages += 1;
        self.now_ms = message["now_ms"].as_u64().unwrap();
        if let Some(Value::Array(texts)) = message.get("texts") {
            self.texts.extend(texts.iter().cloned());
        }
        self.news.extend(message);
    }
}
