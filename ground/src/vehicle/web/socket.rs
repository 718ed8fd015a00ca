//! A page's WebSocket: everything that the page shows goes to it, every order of its buttons comes
//! from it. One connection a page, and none that counts among the six that a browser allows.
//!
//! The page begins with `{"token": TOKEN}`; where it has the word that is good once, it is told the
//! token in the same form. Then it gets a message fifty times a second, with `now_ms`, `frame` and
//! whatever has changed ([`State::update`](super::model::State::update)). It sends orders
//! ([`Message`]), each of which is answered by `{"id": ID}` with `note` where there is something to
//! know, or with `error`.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use futures_util::stream::FuturesUnordered;
use futures_util::{SinkExt, StreamExt};
use hyper::upgrade::Upgraded;
use hyper_util::rt::TokioIo;
use serde::Deserialize;
use serde_json::json;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::protocol::{
    CloseFrame, Message as Frame, Role, WebSocketConfig,
};

use super::desk::{Desk, Message};
use super::model::Seen;
use super::visitor::Visitor;

/// Time between two messages to the page.
const PERIOD: Duration = Duration::from_millis(20);
/// Time for the token.
const LOGIN: Duration = Duration::from_secs(2);
/// Time between two questions whether the page is still there; browsers answer them by themselves.
const PING: Duration = Duration::from_millis(500);
/// Silence after which a page has gone, and time in which it must take a message.
const GONE: Duration = Duration::from_secs(2);
/// Longest message from a page, bytes: a parameter file.
const LONGEST: usize = 16 * 1024;
/// Most orders of a page that wait for their answers.
const ORDERS: usize = 32;
/// Close code, as the page knows it: the token is not of this start.
const NO_TOKEN: u16 = 4403;
/// Close code: too many pages are open.
const FULL: u16 = 4503;

#[derive(Deserialize)]
struct Login {
    token: String,
}

type Socket = WebSocketStream<TokioIo<Upgraded>>;

/// Serves a page until it goes away.
pub async fn run(stream: TokioIo<Upgraded>, visitor: Visitor, desk: &Arc<Desk>) {
    let limits = WebSocketConfig::default()
        .read_buffer_size(LONGEST)
        .max_message_size(Some(LONGEST))
        .max_frame_size(Some(LONGEST));
    let mut socket = Socket::from_raw_socket(stream, Role::Server, Some(limits)).await;
    if !is_admitted(&mut socket, desk).await {
        return close(socket, NO_TOKEN, "no valid token").await;
    }
    let Some(_presence) = desk.enter() else {
        return close(socket, FULL, "too many pages are open").await;
    };
    desk.strangers.forget(tokio::task::id());
    // That the page has gone is no error.
    let _ = serve(&mut socket, visitor, desk).await;
}

/// Whether the page begins with the token.
async fn is_admitted(socket: &mut Socket, desk: &Desk) -> bool {
    let Ok(Some(Ok(Frame::Text(text)))) = timeout(LOGIN, socket.next()).await else {
        return false;
    };
    let Ok(Login { token }) = serde_json::from_str(&text) else {
        return false;
    };
    let token_of_now = json!({ "token": desk.token.0 });
    desk.token.is(&token)
        || (desk.once.take(&token)
            && send(socket, Frame::text(token_of_now.to_string())).await.is_ok())
}

async fn close(mut socket: Socket, code: u16, reason: &'static str) {
    let reason = CloseFrame { code: CloseCode::from(code), reason: reason.into() };
    let _ = timeout(GONE, socket.close(Some(reason))).await;
}

async fn serve(socket: &mut Socket, visitor: Visitor, desk: &Arc<Desk>) -> Result<()> {
    let mut seen = Seen::default();
    let mut answers = FuturesUnordered::new();
    let mut heard = Instant::now();
    let [mut news, mut ping] = [PERIOD, PING].map(interval);
    // Missed messages are not made up for.
    news.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        tokio::select! {
            biased;
            frame = socket.next() => {
                heard = Instant::now();
                let text = match frame.context("closed")?? {
                    Frame::Text(text) => text,
                    Frame::Ping(_) | Frame::Pong(_) => continue,
                    _ => bail!("closed, or no text"),
                };
                let message: Message = serde_json::from_str(&text)?;
                // Beyond that other STOPs wait for the same answer.
                let most = if message.is_stop() { 2 * ORDERS } else { ORDERS };
                let id = message.id;
                if let Err(refusal) = visitor.admit(&message) {
                    answer(socket, id, Err(refusal)).await?;
                } else if answers.len() < most {
                    let outcome = desk.give(message);
                    answers.push(async move { (id, outcome.await) });
                } else {
                    let why = anyhow!("too many orders wait for their answers: press again");
                    answer(socket, id, Err(why)).await?;
                }
            }
            Some((id, outcome)) = answers.next(), if !answers.is_empty() => {
                answer(socket, id, outcome).await?;
            }
            _ = ping.tick() => {
                if heard.elapsed() > GONE {
                    bail!("silent");
                }
                send(socket, Frame::Ping(Vec::new().into())).await?;
            }
            _ = news.tick() => {
                let update = desk.model.lock().update(desk.now_ms(), &mut seen);
                send(socket, Frame::text(serde_json::to_string(&update)?)).await?;
            }
        }
    }
}

/// Tells what has become of an order.
async fn answer(socket: &mut Socket, id: u64, outcome: Result<Option<String>>) -> Result<()> {
    let answer = match outcome {
        Ok(note) => json!({ "id": id, "note": note }),
        Err(error) => json!({ "id": id, "error": format!("{error:#}") }),
    };
    send(socket, Frame::text(answer.to_string())).await
}

/// Sends a message, which a page that is still there takes soon.
async fn send(socket: &mut Socket, frame: Frame) -> Result<()> {
    timeout(GONE, socket.send(frame)).await??;
    Ok(())
}
