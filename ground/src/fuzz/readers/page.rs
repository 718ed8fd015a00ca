//! What a page, or whoever else reaches the port of `tvc web`, sends.

use super::Outcome;
use crate::vehicle::web;

/// A connection's bytes: a request, or a page's WebSocket.
pub fn request(bytes: &[u8], _: u64) -> Outcome {
    web::fuzzed::exchange(bytes)
}

/// A page's message, whose page is known.
pub fn order(bytes: &[u8], _: u64) -> Outcome {
    if let Ok(text) = str::from_utf8(bytes) {
        for line in text.lines() {
            web::fuzzed::order(line);
        }
    }
    Ok(())
}
