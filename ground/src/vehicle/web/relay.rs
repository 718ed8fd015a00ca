//! A vehicle for a procedure that waits for its answers, while the thread that has the port goes
//! on: what the vehicle sends is passed on to it, and its requests stand in the queue with all
//! others.

use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use client::Request;

use super::handle::{Condition, Handle};
use crate::vehicle::link::Link;
use crate::vehicle::way::{Waited, Way};

/// The way to the vehicle through the thread that has its port.
struct Relay {
    vehicle: Handle,
    frames: Receiver<Vec<u8>>,
    begun: Instant,
}

/// A link through the thread that has the port.
pub fn link(vehicle: Handle) -> Link {
    let frames = vehicle.listen();
    Link::at(Relay { vehicle, frames, begun: Instant::now() }).without_heartbeat()
}

impl Way for Relay {
    fn name(&self) -> &str {
        "the page's port"
    }

    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    fn read(&mut self, patience: Duration) -> Result<Vec<u8>> {
        match self.frames.recv_timeout(patience) {
            Ok(mut bytes) => {
                bytes.extend(self.frames.try_iter().flatten());
                Ok(bytes)
            }
            Err(RecvTimeoutError::Timeout) => Ok(Vec::new()),
            Err(RecvTimeoutError::Disconnected) => bail!("the port went away"),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.vehicle.send(bytes);
        Ok(())
    }

    fn request(&self, request: &Request, stop: Option<&'static AtomicBool>) -> Option<Waited> {
        let condition = Condition { until: None, unless: stop };
        let mut answer = self.vehicle.request(request.clone(), condition);
        Some(Box::new(move || answer.look()))
    }
}
