//! HTTP: the page's files, its WebSocket, and a STOP that needs neither.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` and the files that it names | the page |
//! | `GET /page` | the [WebSocket](super::socket) of a page |
//! | `POST /stop` | the vehicle is disarmed |
//! | `GET /rig.json` | what can be done to a virtual rig |
//! | `GET /logs`, `/logs/NAME`, `/reports/NAME` | the recordings, one of them, its report |
//!
//! The page is no secret. The token is in the address that the tool prints, behind `#`, which
//! browsers keep to themselves. The page sends it over its WebSocket, and as `Authorization:
//! Bearer` where it asks for recordings; no foreign page can send that. `POST /stop` needs no
//! token, so that a page of an earlier start still stops the vehicle; it needs the header `X-Stop`,
//! which a foreign page cannot send.
//!
//! Every connection has a time limit, and they are few: where there are too many, the oldest one
//! that has not shown a token is closed, so that whoever holds connections keeps nobody out. No
//! body is ever read.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{self, HeaderName, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{HeaderMap, Method, Request, Response, StatusCode, http::response::Builder};
use hyper_util::rt::{TokioIo, TokioTimer};
use percent_encoding::percent_decode_str;
use serde_json::json;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::time::{sleep, timeout};
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

use super::auth::is_own_host;
use super::desk::Desk;
use super::visitor::Visitor;
use super::{logs, rig, socket};
use crate::vehicle::admission::Admission;
use report::input;

/// Time for a request's head.
const HEAD: Duration = Duration::from_secs(2);
/// Time for a request and its answer; the vehicle has five seconds for its own.
const EXCHANGE: Duration = Duration::from_secs(8);
/// Further time for a recording on its way to a page that has shown the token.
const DOWNLOAD: Duration = Duration::from_secs(600);
/// Longest head, bytes.
const HEAD_BYTES: usize = 16 * 1024;
/// Pause after a connection that could not be taken in.
const PAUSE: Duration = Duration::from_millis(20);

const HTML: &str = "text/html; charset=utf-8";
const JSON: &str = "application/json";
const SCRIPT: &str = "text/javascript; charset=utf-8";

const STYLE: &str = "text/css; charset=utf-8";

/// What the page is made of: path, kind, content.
const FILES: &[(&str, &str, &str)] = &[
    ("/", HTML, include_str!("page.html")),
    ("/page.css", STYLE, include_str!("page.css")),
    ("/page.js", SCRIPT, include_str!("page.js")),
    ("/guided.js", SCRIPT, include_str!("guided.js")),
    ("/dom.js", SCRIPT, include_str!("dom.js")),
    ("/link.js", SCRIPT, include_str!("link.js")),
    ("/stop.js", SCRIPT, include_str!("stop.js")),
    ("/charts.js", SCRIPT, include_str!("charts.js")),
    ("/releases.js", SCRIPT, include_str!("releases.js")),
    ("/attitude.js", SCRIPT, include_str!("attitude.js")),
    ("/sections.js", SCRIPT, include_str!("sections.js")),
    ("/parameters.js", SCRIPT, include_str!("parameters.js")),
    ("/parameter_file.js", SCRIPT, include_str!("parameter_file.js")),
    ("/uPlot.js", SCRIPT, include_str!("../../../vendor/uplot/uPlot.iife.min.js")),
    ("/uPlot.css", STYLE, include_str!("../../../vendor/uplot/uPlot.min.css")),
    ("/rig.js", SCRIPT, include_str!("rig.js")),
    ("/logs.js", SCRIPT, include_str!("logs.js")),
    ("/tests.js", SCRIPT, include_str!("tests.js")),
];

/// Sent with every answer: nothing is loaded from elsewhere, no foreign page may show this one in a
/// frame.
const HEADERS: [(HeaderName, &str); 6] = [
    // One request a connection, so that each has its time.
    (header::CONNECTION, "close"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (header::CACHE_CONTROL, "no-store"),
];

/// An answer: whole, since the longest is a recording on this computer's disk.
type Answer = Response<Full<Bytes>>;

/// Answers requests for ever.
pub async fn serve(listener: TcpListener, desk: Arc<Desk>, admission: &Admission) -> Infallible {
    loop {
        match listener.accept().await {
            Ok((stream, from)) => {
                // Without it the system delays small messages.
                let _ = stream.set_nodelay(true);
                let visitor = Visitor::of(from.ip(), admission);
                let exchange = exchange(stream, visitor, desk.clone());
                desk.strangers.add(tokio::spawn(exchange).abort_handle());
            }
            // No descriptor is left, or the other side has gone already.
            Err(_) => {
                desk.strangers.end_one();
                sleep(PAUSE).await;
            }
        }
    }
}

/// One connection: a request and its answer.
pub async fn exchange(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    visitor: Visitor,
    desk: Arc<Desk>,
) {
    let service = service_fn(|request| answer(request, visitor, desk.clone()));
    let mut connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    // That the other side has gone is no error.
    let is_slow = timeout(EXCHANGE, &mut connection).await.is_err();
    if is_slow && !desk.strangers.has(tokio::task::id()) {
        let _ = timeout(DOWNLOAD, connection).await;
    }
}

async fn answer(
    request: Request<Incoming>,
    visitor: Visitor,
    desk: Arc<Desk>,
) -> hyper::http::Result<Answer> {
    let head = request.headers();
    if !is_of_own_page(head) {
        return plain(
            StatusCode::FORBIDDEN,
            "open this page by its number, as tvc web printed it, or as localhost\n",
        );
    }
    match (request.method(), request.uri().path()) {
        (&Method::POST, "/stop") if head.contains_key("X-Stop") => match desk.stop().await {
            Ok(note) => respond(StatusCode::OK, JSON, json!({ "note": note }).to_string()),
            Err(error) => {
                let error = json!({ "error": format!("{error:#}") });
                respond(StatusCode::CONFLICT, JSON, error.to_string())
            }
        },
        (&Method::GET, "/page") => open(request, visitor, desk),
        (&Method::GET, "/rig.json") => respond(StatusCode::OK, JSON, rig::vocabulary().to_string()),
        (&Method::GET, path) if path == "/logs" || folder_and_name(path).is_some() => {
            if !is_authorised(head, &desk) {
                return plain(StatusCode::UNAUTHORIZED, "recordings need the page's token\n");
            }
            desk.strangers.forget(tokio::task::id());
            let path = path.to_owned();
            // Reading must not keep a STOP waiting.
            let read = tokio::task::spawn_blocking(move || recordings(&desk, &path));
            match read.await {
                Ok(Ok((kind, content))) => respond(StatusCode::OK, kind, content),
                Ok(Err(error)) => plain(StatusCode::NOT_FOUND, &format!("{error:#}\n")),
                Err(_) => plain(StatusCode::INTERNAL_SERVER_ERROR, "it cannot be read\n"),
            }
        }
        (&Method::GET, path) => match FILES.iter().find(|(name, ..)| *name == path) {
            Some((_, kind, content)) => respond(StatusCode::OK, kind, *content),
            None => plain(StatusCode::NOT_FOUND, "there is no such page\n"),
        },
        _ => plain(StatusCode::FORBIDDEN, "orders come from the page\n"),
    }
}

/// Opens a page's WebSocket.
fn open(
    mut request: Request<Incoming>,
    visitor: Visitor,
    desk: Arc<Desk>,
) -> hyper::http::Result<Answer> {
    let head = request.headers();
    let upgrade = head.get(header::UPGRADE).map(HeaderValue::as_bytes);
    let key = head.get(header::SEC_WEBSOCKET_KEY);
    let (true, Some(key)) = (upgrade.is_some_and(|to| to.eq_ignore_ascii_case(b"websocket")), key)
    else {
        return plain(StatusCode::UPGRADE_REQUIRED, "this is a page's WebSocket\n");
    };
    let accept = derive_accept_key(key.as_bytes());
    let upgrade = hyper::upgrade::on(&mut request);
    let of_task = desk.clone();
    let task = tokio::spawn(async move {
        if let Ok(Ok(stream)) = timeout(HEAD, upgrade).await {
            socket::run(TokioIo::new(stream), visitor, &of_task).await;
        }
    });
    desk.strangers.add(task.abort_handle());
    Response::builder()
        .status(StatusCode::SWITCHING_PROTOCOLS)
        .header(header::CONNECTION, "upgrade")
        .header(header::UPGRADE, "websocket")
        .header(header::SEC_WEBSOCKET_ACCEPT, accept)
        .body(Full::default())
}

/// Whether the request has the token of this start.
fn is_authorised(head: &HeaderMap, desk: &Desk) -> bool {
    let given = head.get(header::AUTHORIZATION);
    let given = given.and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
    given.is_some_and(|token| desk.token.is(token))
}

/// The folder and the name, as it is written in an address, of a recording's path.
fn folder_and_name(path: &str) -> Option<(&str, &str)> {
    let (folder, name) = path.strip_prefix('/')?.split_once('/')?;
    ["logs", "reports"].contains(&folder).then_some((folder, name))
}

/// What is asked for about recordings, and its kind.
fn recordings(desk: &Desk, path: &str) -> Result<(&'static str, Vec<u8>)> {
    let Some((folder, name)) = folder_and_name(path) else {
        return Ok((JSON, serde_json::to_vec(&logs::list(&desk.logs)?)?));
    };
    let name = percent_decode_str(name).decode_utf8()?;
    let path = logs::find(&desk.logs, &name)?;
    if folder == "reports" {
        return Ok((HTML, desk.report(&path)?));
    }
    Ok(("application/octet-stream", input::bytes(&path, input::LOG)?))
}

/// Whether a request names this computer, and comes from a page of this program if from any.
fn is_of_own_page(head: &HeaderMap) -> bool {
    let text = |name| head.get(name).and_then(|value| value.to_str().ok());
    let Some(host) = text(header::HOST).filter(|host| is_own_host(host)) else {
        return false;
    };
    let from = text(header::ORIGIN).and_then(|from| from.strip_prefix("http://"));
    !head.contains_key(header::ORIGIN) || from == Some(host)
}

fn plain(status: StatusCode, text: &str) -> hyper::http::Result<Answer> {
    respond(status, "text/plain; charset=utf-8", text.to_owned())
}

fn respond(
    status: StatusCode,
    kind: &str,
    content: impl Into<Bytes>,
) -> hyper::http::Result<Answer> {
    HEADERS
        .into_iter()
        .fold(Response::builder().status(status), |response, (name, value)| {
            Builder::header(response, name, value)
        })
        .header(header::CONTENT_TYPE, kind)
        .body(Full::new(content.into()))
}
