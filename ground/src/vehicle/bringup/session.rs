//! The conversation with the board: words of its memory, and what it streams meanwhile.

use std::time::Duration;

use anyhow::{Result, bail};
use client::request::{self, Order};
use client::{BoardValue, Failure, Request, StateCode, StateKind, text};
use mavlink::dialects::common::{MavMessage, MavResult, RAW_IMU_DATA, SYS_STATUS_DATA};
use tvc_nano::bringup::What;

use crate::vehicle::link::Link;

/// An order whose answer takes longer was repeated.
pub const REPEATED: Duration = Duration::from_millis(900);
/// How long the vehicle may take until its first heartbeat.
const CONNECT: Duration = Duration::from_secs(5);

/// What the vehicle has said since it was forgotten last.
#[derive(Default)]
pub struct Heard {
    /// Raw samples.
    pub samples: Vec<RAW_IMU_DATA>,
    /// Load and counters.
    pub status: Vec<SYS_STATUS_DATA>,
    /// Mean and longest burst, us, and fresh data a second.
    pub bursts: Vec<[f32; 3]>,
}

/// A conversation.
pub struct Session {
    /// The link to the board or the rig.
    pub link: Link,
    /// What has been heard.
    pub heard: Heard,
    /// Tells one order from another.
    serial: u32,
}

impl Session {
    /// Waits for the vehicle.
    ///
    /// # Errors
    /// No heartbeat.
    pub fn begin(link: Link) -> Result<Self> {
        let mut session = Self { link, heard: Heard::default(), serial: 1 };
        if !session.wait(CONNECT, |session| session.state().is_some())? {
            bail!(
                "no heartbeat within {} s: is tvc-nano on the board (tvc flash)?",
                CONNECT.as_secs()
            );
        }
        Ok(session)
    }

    /// The state of the flight.
    pub fn state(&mut self) -> Option<StateKind> {
        self.link.client().state()
    }

    /// The state and the kind of reason for it.
    pub fn state_code(&mut self) -> Option<StateCode> {
        self.link.client().state_code()
    }

    /// What the vehicle says of its state; what its heartbeat says, where the words were lost.
    pub fn reason(&mut self) -> String {
        match self.link.client().reason() {
            "" => self.state_code().map_or_else(String::new, |code| code.to_string()),
            words => words.to_owned(),
        }
    }

    /// The time by the client's clock.
    pub fn now(&self) -> Duration {
        self.link.now()
    }

    /// Takes in what comes in a short while.
    ///
    /// # Errors
    /// The port went away, or the rig stopped.
    pub fn turn(&mut self) -> Result<()> {
        for frame in self.link.receive()? {
            match frame.message {
                MavMessage::RAW_IMU(sample) => self.heard.samples.push(sample),
                MavMessage::SYS_STATUS(status) => self.heard.status.push(status),
                MavMessage::DEBUG_VECT(told) if text(&told.name) == "imu_bus" => {
                    self.heard.bursts.push([told.x, told.y, told.z]);
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Takes in what comes until `done`, for at most `patience`. Whether it is done.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn wait(
        &mut self,
        patience: Duration,
        mut done: impl FnMut(&mut Self) -> bool,
    ) -> Result<bool> {
        let until = self.now() + patience;
        loop {
            if done(self) {
                return Ok(true);
            }
            if self.now() >= until {
                return Ok(false);
            }
            self.turn()?;
        }
    }

    /// Listens for so long.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn listen(&mut self, time: Duration) -> Result<()> {
        self.wait(time, |_| false).map(|_| ())
    }

    /// Gives an order and waits for its answer.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn order(&mut self, order: Order) -> Result<Result<(), Failure>> {
        self.ask(Request::Order(order))
    }

    /// A parameter's value, `None` if the vehicle does not tell it.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn parameter(&mut self, name: &str) -> Result<Option<f32>> {
        let told = self.ask(Request::Read(name.to_owned()))?;
        let value = self.link.client().parameter(name);
        Ok(value.filter(|_| told.is_ok()))
    }

    fn ask(&mut self, request: Request) -> Result<Result<(), Failure>> {
        let ticket = self.link.request(request);
        loop {
            self.turn()?;
            if let Some(answer) = self.link.client().answer(ticket) {
                return Ok(answer);
            }
        }
    }

    /// The word at an address, with the time at which the vehicle read it.
    ///
    /// # Errors
    /// The rig stopped; the firmware refuses, is older than this command or does not answer.
    pub fn peek_at(&mut self, address: u32) -> Result<BoardValue> {
        match self.examine(What::Peek, address)? {
            Some(value) => Ok(value),
            None => bail!("the firmware does not show {address:#010x}"),
        }
    }

    /// The word at an address.
    ///
    /// # Errors
    /// As [`Session::peek_at`].
    pub fn peek(&mut self, address: u32) -> Result<u32> {
        Ok(self.peek_at(address)?.value)
    }

    /// What the board answers to an order that needs no address; `None` if it cannot.
    ///
    /// # Errors
    /// As [`Session::peek_at`].
    pub fn measure(&mut self, what: What) -> Result<Option<u32>> {
        self.serial += 1;
        let value = self.examine(what, self.serial)?;
        Ok(value.map(|value| value.value))
    }

    fn examine(&mut self, what: What, number: u32) -> Result<Option<BoardValue>> {
        match self.order(request::bringup(what, number))? {
            Ok(()) => Ok(self.link.client().board_value(number)),
            Err(Failure::Refused { result: MavResult::MAV_RESULT_DENIED, .. }) => Ok(None),
            Err(failure) => Err(failure.into()),
        }
    }

    /// Gives an order that ends in a reset, and waits for the vehicle's return. Whether it came
    /// back by itself.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn fall(&mut self, what: What) -> Result<bool> {
        /// Longest of a watchdog, a bootloader and the port's return.
        const RETURN: Duration = Duration::from_secs(4);
        self.serial += 1;
        let order = request::bringup(what, self.serial);
        // It speaks until it has read the order, which may be lost on its way.
        for _ in 0..5 {
            self.link.client().send(&order.message());
            let heard = self.listen(Duration::from_millis(150));
            let spoken = self.link.client().counts().messages;
            // The port may have gone away with the board.
            let more = heard.and_then(|()| self.listen(Duration::from_millis(150)));
            if more.is_err() || self.link.client().counts().messages == spoken {
                break;
            }
        }
        self.link.reopen()?;
        let returned = self.wait(RETURN, |session| session.state().is_some());
        if matches!(returned, Ok(true)) {
            // What it says of its state follows.
            self.listen(Duration::from_millis(200))?;
            return Ok(true);
        }
        if self.link.way().press_reset() {
            self.link.reopen()?;
            self.wait(RETURN, |session| session.state().is_some())?;
        }
        Ok(false)
    }
}
