//! The page of `tvc web` in front of no vehicle: connections, orders, and what it shows.

use std::net::Ipv4Addr;
use std::sync::Arc;

use super::Outcome;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::runtime::Builder;

use ground::vehicle::admission::Admission;
use ground::vehicle::link::Link;
use ground::vehicle::web::auth::{Once, Token};
use ground::vehicle::web::desk::{Desk, Message};
use ground::vehicle::web::handle::Handle;
use ground::vehicle::web::model::Model;
use ground::vehicle::web::rig::RigControl;
use ground::vehicle::web::visitor::Visitor;
use ground::vehicle::web::{server, vehicle_thread};

/// The token that is stored in inputs.
const TOKEN: &str = "00112233445566778899aabbccddeeff";
/// What a connection takes at a time.
const PIPE: usize = 64 * 1024;

/// A desk in front of a vehicle that hears nothing.
fn desk() -> Arc<Desk> {
    let (handle, _) = Handle::new();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz_corpus/log").into();
    let secrets = (Token(TOKEN.to_owned()), Once::new().unwrap());
    Arc::new(Desk::new(
        secrets,
        handle,
        RigControl::beside(None),
        folder,
        "none".into(),
        Arc::default(),
    ))
}

/// Sends bytes to the page's port; all that comes back before the connection ends.
async fn send(bytes: &[u8], mut ours: DuplexStream) -> Vec<u8> {
    let mut answer = Vec::new();
    let _ = ours.write_all(bytes).await;
    let _ = ours.shutdown().await;
    let _ = ours.read_to_end(&mut answer).await;
    answer
}

/// One connection that sends these bytes and ends: whatever is answered is HTTP.
pub fn request(bytes: &[u8], _: u64) -> Outcome {
    let runtime = Builder::new_current_thread().enable_time().build();
    let answer = runtime.unwrap().block_on(async {
        let (ours, theirs) = tokio::io::duplex(PIPE);
        let exchange = server::exchange(
            theirs,
            Visitor::of(Ipv4Addr::LOCALHOST.into(), &Admission::default()),
            desk(),
        );
        let task = tokio::spawn(exchange);
        let answer = send(bytes, ours).await;
        task.await.map(|()| answer)
    });
    let answer = answer.map_err(|error| error.to_string())?;
    match answer.is_empty() || answer.starts_with(b"HTTP/1.") {
        true => Ok(()),
        false => Err("it answers something else than HTTP".into()),
    }
}

/// A page's messages, whose page is known.
pub fn order(bytes: &[u8], _: u64) -> Outcome {
    if let Ok(text) = str::from_utf8(bytes) {
        text.lines().for_each(give);
    }
    Ok(())
}

/// Gives an order of a page.
fn give(text: &str) {
    let Ok(message) = serde_json::from_str::<Message>(text) else {
        return;
    };
    let runtime = Builder::new_current_thread().enable_time().build();
    // What becomes of it is the desk's affair.
    let _ = runtime.unwrap().block_on(desk().give(message));
}

/// What the page shows of a vehicle that is heard by this link.
pub fn heard(link: Link) {
    let model = Model::default();
    vehicle_thread::hear(link, &model);
    let update = model.lock().update(0, &mut ground::vehicle::web::model::Seen::default());
    serde_json::to_string(&update).unwrap();
}
