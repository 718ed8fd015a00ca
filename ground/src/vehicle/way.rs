//! How bytes get to the vehicle and back: by a port, by the rig in this process, or by the thread
//! that has either.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::Result;
use client::Request;

/// What a [`Link`](super::link::Link) reaches the vehicle by.
pub trait Way: Send {
    /// The port's name.
    fn name(&self) -> &str;

    /// The time by the clock that the vehicle keeps: real time at a port.
    fn now(&self) -> Duration;

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

    /// The board resets: waits until it is back, if it comes back.
    ///
    /// # Errors
    /// The rig stopped.
    fn reopen(&mut self) -> Result<()> {
        Ok(())
    }

    /// Resets a board that hangs. Whether it could.
    fn press_reset(&mut self) -> bool {
        false
    }

    /// Gives a request to the thread that has the port, which sends nothing once `stop` is set;
    /// `None` where the link's own client asks.
    fn request(&self, _: &Request, _stop: Option<&'static AtomicBool>) -> Option<Waited> {
        None
    }
}

/// Looks for the answer to a request.
pub type Waited = Box<dyn FnMut() -> Option<Result<()>>>;
