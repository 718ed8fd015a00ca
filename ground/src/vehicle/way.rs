//! How bytes get to the vehicle and back: by a port of one's own, or by the thread that has the
//! port.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::Result;
use client::Request;

/// What a [`Link`](super::link::Link) reaches the vehicle by.
pub trait Way: Send {
    /// The port's name.
    fn name(&self) -> &str;

    /// The bytes that have come, waiting at most `patience` for the first one.
    ///
    /// # Errors
    /// The port went away.
    fn read(&mut self, patience: Duration) -> Result<Vec<u8>>;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// The port went away, or takes nothing any more.
    fn write(&mut self, bytes: &[u8]) -> Result<()>;

    /// Gives a request to the thread that has the port, which sends nothing once `stop` is set;
    /// `None` where the link's own client asks.
    fn request(&self, _: &Request, _stop: Option<&'static AtomicBool>) -> Option<Waited> {
        None
    }
}

/// Looks for the answer to a request.
pub type Waited = Box<dyn FnMut() -> Option<Result<()>>>;
