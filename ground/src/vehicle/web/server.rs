//! HTTP: the page, its stream of events, and the requests of its buttons.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` and the files that it names | the page |
//! | `GET /events?token=` | Server-Sent Events: a frame 50 times a second, `condition`, `trial` and `text` when there is one |
//! | `GET /parameters?token=` | every parameter |
//! | `POST /stop`, `/arm`, `/release`, `/calibrate`, `/save`, `/reload`, `/reset` | the order is given |
//! | `POST /set` `{"name", "value"}` | a parameter is set |
//! | `POST /record`, `/end-record`, `/step` | a log begins, ends; a step test begins |
//!
//! A POST needs the token in `X-Token`, which no foreign page can send. Answers are JSON: `{"ok":
//! true}`, or `{"error": reason}` with status 409 if the vehicle refuses.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use client::{Parameter, Request as VehicleRequest, request};
use serde::{Deserialize, Serialize};
use serde_json::json;
use tiny_http::{Header, Method, Request, Response, StatusCode};

use super::auth::{Token, is_own_host};
use super::model::{Model, Seen, State};
use super::step_test;
use super::vehicle_thread::Handle;

/// Time between two frames.
const PERIOD: Duration = Duration::from_millis(20);
/// Time between two looks at whether the program is to end.
const LOOK: Duration = Duration::from_millis(100);
/// Longest body of a request, bytes.
const BODY: u64 = 4096;
/// Most pages at the same time.
const PAGES: usize = 16;

/// What the page is made of: path, kind, content.
const FILES: [(&str, &str, &str); 4] = [
    ("/page.css", "text/css", include_str!("page.css")),
    ("/page.js", "text/javascript", include_str!("page.js")),
    ("/chart.js", "text/javascript", include_str!("chart.js")),
    (
        "/parameters.js",
        "text/javascript",
        include_str!("parameters.js"),
    ),
];
const PAGE: &str = include_str!("page.html");
/// Stands for the token in the page's text.
const TOKEN: &str = "{{token}}";

/// Sent with every answer: nothing is loaded from elsewhere, no foreign page may show this one in a
/// frame.
const HEADERS: [(&str, &str); 5] = [
    (
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Cache-Control", "no-store"),
];

/// What every request needs.
pub struct Server {
    /// The token that a command needs.
    pub token: Token,
    /// The page carries the token: only this computer can reach it.
    pub open: bool,
    /// The vehicle.
    pub vehicle: Handle,
    /// What is known of it.
    pub model: Arc<Model>,
    /// Ends the step test under way.
    pub test_stop: Arc<AtomicBool>,
    /// Pages that listen.
    pub pages: Arc<AtomicUsize>,
}

/// Why a request is refused: status, reason.
type Refusal = (u16, String);

/// Answers requests until `ended`, each in a thread of its own: one may wait seconds for the
/// vehicle.
///
/// # Errors
/// The socket fails.
pub fn serve(
    listener: TcpListener,
    server: &Arc<Server>,
    ended: &mut dyn FnMut() -> bool,
) -> Result<()> {
    let http = tiny_http::Server::from_listener(listener, None)
        .map_err(|error| anyhow!("serving the page: {error}"))?;
    while !ended() {
        if let Some(request) = http.recv_timeout(LOOK)? {
            let server = server.clone();
            std::thread::spawn(move || server.answer(request));
        }
    }
    Ok(())
}

#[derive(Deserialize)]
struct Setting {
    name: String,
    value: f32,
}

impl Server {
    fn answer(&self, mut request: Request) {
        if let Err((status, reason)) = self.admit(&request) {
            return respond(request, status, "text/plain", &reason);
        }
        let url = request.url().to_owned();
        let path = url.split('?').next().unwrap_or_default();
        match (request.method().clone(), path) {
            (Method::Get, "/") => {
                let page = PAGE.replace(TOKEN, self.token.text());
                respond(request, 200, "text/html", &page);
            }
            (Method::Get, "/events") => self.stream(request),
            (Method::Get, "/parameters") => {
                let text = serde_json::to_string(&self.model.lock().parameters);
                respond_json(request, text.map_err(|error| (500, error.to_string())));
            }
            (Method::Get, _) => match FILES.iter().find(|(name, ..)| *name == path) {
                Some((_, kind, content)) => respond(request, 200, kind, content),
                None => respond(request, 404, "text/plain", "there is no such page\n"),
            },
            (Method::Post, _) => {
                let mut body = String::new();
                let read = request.as_reader().take(BODY).read_to_string(&mut body);
                let result = read
                    .map_err(|error| (400, format!("a body that is no text: {error}")))
                    .and_then(|_| self.order(path, &body))
                    .map(|()| json!({ "ok": true }).to_string());
                respond_json(request, result);
            }
            _ => respond(request, 405, "text/plain", "GET and POST only\n"),
        }
    }

    /// Checks host and token.
    fn admit(&self, request: &Request) -> Result<(), Refusal> {
        if !header(request, "Host").is_some_and(is_own_host) {
            return Err((
                403,
                "open this page by its number, as tvc web printed it, or as localhost\n".into(),
            ));
        }
        let url = request.url();
        let (path, query) = url.split_once('?').unwrap_or((url, ""));
        let given = match request.method() {
            Method::Post => header(request, "X-Token"),
            _ => query
                .split('&')
                .find_map(|pair| pair.strip_prefix("token=")),
        };
        let free = *request.method() == Method::Get
            && (FILES.iter().any(|(name, ..)| *name == path) || (path == "/" && self.open));
        if free || given.is_some_and(|given| self.token.is(given)) {
            return Ok(());
        }
        Err((
            403,
            "no valid token: open the address that tvc web printed\n".into(),
        ))
    }

    /// Does what a button asks for.
    fn order(&self, path: &str, body: &str) -> Result<(), Refusal> {
        let order = |order| self.vehicle.order(order).map_err(refused);
        match path {
            "/stop" => {
                self.test_stop.store(true, Ordering::SeqCst);
                order(request::DISARM)
            }
            "/arm" => order(request::ARM),
            "/release" => order(request::RELEASE),
            "/calibrate" => order(request::CALIBRATE),
            "/save" => order(request::SAVE),
            "/reload" => order(request::RELOAD),
            "/reset" => order(request::RESET),
            "/set" => {
                let Setting { name, value } = serde_json::from_str(body)
                    .map_err(|error| (400, format!("a name and a value are needed: {error}")))?;
                let set = VehicleRequest::Set(Parameter { name, value });
                self.vehicle.request(set).map_err(refused)
            }
            "/record" => self.record(),
            "/end-record" => self.vehicle.end_recording().map_err(refused),
            "/step" => self.step(),
            _ => Err((404, "there is no such order".into())),
        }
    }

    fn record(&self) -> Result<(), Refusal> {
        idle(&self.model.lock())?;
        self.vehicle.record("flight").map_err(refused)?;
        if self.model.lock().status().in_operation {
            return Ok(());
        }
        // The estimate begins anew, so that a replay knows its past. The page shows a refusal as a
        // text.
        let _ = self.vehicle.order(request::CALIBRATE);
        Ok(())
    }

    /// Begins a step test.
    fn step(&self) -> Result<(), Refusal> {
        let mut state = self.model.lock();
        idle(&state)?;
        if state.status().in_operation || !state.status().connected {
            return Err((409, "the vehicle is not in standby: disarm first".into()));
        }
        // Cleared before the test is shown as running: a STOP after that counts.
        self.test_stop.store(false, Ordering::SeqCst);
        let mut test = state.step_test().clone();
        test.running = true;
        state.set_step_test(test);
        drop(state);
        let (vehicle, model) = (self.vehicle.clone(), self.model.clone());
        let stop = self.test_stop.clone();
        std::thread::spawn(move || step_test::run(&vehicle, &model, &stop));
        Ok(())
    }

    /// Sends a page everything, until it goes away.
    fn stream(&self, request: Request) {
        if self.pages.fetch_add(1, Ordering::SeqCst) < PAGES {
            let mut out = request.into_writer();
            // That the page has gone is no error.
            let _ = self.send_events(&mut out);
        } else {
            respond(request, 503, "text/plain", "too many pages are open\n");
        }
        self.pages.fetch_sub(1, Ordering::SeqCst);
    }

    fn send_events(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let mut head = String::from(
            "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nConnection: close\r\n",
        );
        for (name, value) in HEADERS {
            head += &format!("{name}: {value}\r\n");
        }
        out.write_all((head + "\r\n").as_bytes())?;
        let mut seen = Seen::default();
        let mut due = Instant::now();
        loop {
            let update = self.model.lock().update(&mut seen);
            let mut events = String::new();
            if let Some(status) = &update.status {
                event(&mut events, "condition", status)?;
            }
            if let Some(test) = &update.step_test {
                event(&mut events, "trial", test)?;
            }
            for text in &update.texts {
                event(&mut events, "text", text)?;
            }
            event(&mut events, "frame", &update.motion)?;
            out.write_all(events.as_bytes())?;
            out.flush()?;
            due += PERIOD;
            let now = Instant::now();
            match due.checked_duration_since(now) {
                Some(rest) => std::thread::sleep(rest),
                // Missed frames are not made up for.
                None => due = now,
            }
        }
    }
}

/// What the vehicle or its port says to an order that is not obeyed.
fn refused(why: anyhow::Error) -> Refusal {
    (409, format!("{why:#}"))
}

/// Nothing is being recorded or tested.
fn idle(state: &State) -> Result<(), Refusal> {
    if state.step_test().running {
        return Err((409, "a step test is under way".into()));
    }
    match &state.status().recording {
        Some(path) => Err((409, format!("{path} is being recorded: end it first"))),
        None => Ok(()),
    }
}

fn event(events: &mut String, name: &str, data: &impl Serialize) -> std::io::Result<()> {
    let data = serde_json::to_string(data)?;
    *events += &format!("event: {name}\ndata: {data}\n\n");
    Ok(())
}

fn header<'a>(request: &'a Request, name: &'static str) -> Option<&'a str> {
    let found = request.headers().iter().find(|h| h.field.equiv(name))?;
    Some(found.value.as_str())
}

fn respond_json(request: Request, result: Result<String, Refusal>) {
    match result {
        Ok(text) => respond(request, 200, "application/json", &text),
        Err((status, reason)) => {
            let text = json!({ "error": reason }).to_string();
            respond(request, status, "application/json", &text);
        }
    }
}

fn respond(request: Request, status: u16, kind: &str, content: &str) {
    let mut response = Response::from_string(content).with_status_code(StatusCode(status));
    let kind = format!("{kind}; charset=utf-8");
    let fixed = HEADERS.iter().copied();
    for (name, value) in fixed.chain([("Content-Type", kind.as_str())]) {
        if let Ok(header) = Header::from_bytes(name, value) {
            response.add_header(header);
        }
    }
    // Who asked may be gone.
    let _ = request.respond(response);
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiny_http::TestRequest;

    fn server(open: bool) -> Server {
        Server {
            token: Token::new().unwrap(),
            open,
            vehicle: Handle::new().0,
            model: Arc::default(),
            test_stop: Arc::default(),
            pages: Arc::default(),
        }
    }

    fn get(path: &str) -> Request {
        let host = Header::from_bytes("Host", "192.168.1.7:8650").unwrap();
        TestRequest::new().with_path(path).with_header(host).into()
    }

    #[test]
    fn the_page_gives_its_token_to_this_computer_alone() {
        assert!(server(true).admit(&get("/")).is_ok());
        let server = server(false);
        assert!(server.admit(&get("/")).is_err());
        assert!(server.admit(&get("/?token=00")).is_err());
        let path = format!("/?token={}", server.token.text());
        assert!(server.admit(&get(&path)).is_ok());
        // Files without a secret need no token.
        assert!(server.admit(&get("/page.js")).is_ok());
    }
}
