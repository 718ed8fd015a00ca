//! What `tvc bringup` examines: a board at a port, or the virtual rig in this process.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use client::{Client, Frame};
use rig::{Rig, Ticks};

use crate::vehicle::link::Link;
use crate::vehicle::port::{Port, find};

/// How often the rig's port is looked at.
const SLICE: Ticks = Ticks::from_ms(1);

/// A client at a board, real or virtual.
pub trait Target {
    /// The client; what it is asked to send goes out with the next [`turn`](Target::turn).
    fn client(&mut self) -> &mut Client;

    /// The time by the client's clock.
    fn now(&self) -> Duration;

    /// The frames that have come in a short while. A port that has gone away has none.
    ///
    /// # Errors
    /// The rig stopped.
    fn turn(&mut self) -> Result<Vec<Frame>>;

    /// The board resets: waits until its port is back, if it comes back.
    ///
    /// # Errors
    /// The rig stopped.
    fn reopen(&mut self) -> Result<()>;

    /// Resets a board that hangs. Whether it could.
    fn press_reset(&mut self) -> bool;
}

/// A board at a serial port.
pub struct Board {
    link: Link,
    wanted: Option<String>,
}

impl Board {
    /// Opens the port.
    ///
    /// # Errors
    /// As [`Port::open`].
    pub fn open(wanted: Option<&str>) -> Result<Self> {
        // The same board again after its reset, whatever else is connected meanwhile.
        let wanted = Some(find(wanted)?);
        Ok(Self {
            link: Link::at(Port::open(wanted.as_deref())?),
            wanted,
        })
    }
}

impl Target for Board {
    fn client(&mut self) -> &mut Client {
        self.link.client()
    }

    fn now(&self) -> Duration {
        self.link.now()
    }

    fn turn(&mut self) -> Result<Vec<Frame>> {
        Ok(self.link.receive().unwrap_or_else(|_| {
            std::thread::sleep(Duration::from_millis(20));
            Vec::new()
        }))
    }

    fn reopen(&mut self) -> Result<()> {
        /// The port of a chip that was reset is gone within this time, and back later.
        const GONE: Duration = Duration::from_millis(400);
        const PATIENCE: Duration = Duration::from_secs(10);
        std::thread::sleep(GONE);
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Ok(port) = Port::open(self.wanted.as_deref()) {
                self.link = Link::at(port);
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        Ok(())
    }

    fn press_reset(&mut self) -> bool {
        false
    }
}

/// The rig, on its own clock.
pub struct OnRig {
    rig: Rig,
    client: Client,
}

impl OnRig {
    /// A client at a rig that has been switched on.
    pub fn new(rig: Rig) -> Self {
        Self {
            rig,
            client: Client::default(),
        }
    }
}

impl Target for OnRig {
    fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.rig.now().as_secs_f64())
    }

    fn turn(&mut self) -> Result<Vec<Frame>> {
        let now = self.now();
        if self.rig.usb_host().is_configured() {
            self.client.poll(now);
            while let Some(frame) = self.client.outgoing() {
                self.rig.usb_write(&frame);
            }
        }
        self.rig.run_for(SLICE).context("the rig")?;
        let bytes = self.rig.usb_read();
        Ok(self.client.receive(self.now(), &bytes))
    }

    fn reopen(&mut self) -> Result<()> {
        self.client = Client::default();
        let until = self.now() + Duration::from_secs(3);
        while self.now() < until && !self.rig.usb_host().is_configured() {
            self.rig.run_for(SLICE).context("the rig")?;
        }
        Ok(())
    }

    fn press_reset(&mut self) -> bool {
        self.rig.press_reset();
        true
    }
}
