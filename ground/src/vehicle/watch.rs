//! A vehicle whose rudder a command moves, and which is left neutral whatever ends the command.
//!
//! At its end (after its work, at an error, at Ctrl-C, SIGTERM or SIGHUP, at a panic) the command
//! disarms and puts back what it changed for its time. Where it cannot act any more, because it was
//! killed or the port is gone, the vehicle does: `FS_HOST` is 1 meanwhile, so three seconds without
//! a heartbeat of the host are a failsafe.

use std::ops::{Deref, DerefMut};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::Result;
use client::{Failure, Parameter, Request, StateKind, request};

use crate::vehicle::link::Vehicle;

/// What to do about a vehicle that is not known to be disarmed.
pub const CUT_POWER: &str = "no answer to the order to disarm: cut the vehicle's power";
/// Time after which an order to disarm counts as unanswered.
const UNANSWERED: Duration = Duration::from_millis(500);

/// With 1 the vehicle watches over its host: three seconds without a heartbeat are a failsafe.
pub const FS_HOST: &str = "FS_HOST";

/// A [`Vehicle`] that is left neutral.
pub struct Watched {
    vehicle: Vehicle,
    /// Parameters to put back at the end; `None` while there is nothing to end.
    put_back: Option<Vec<Parameter>>,
}

impl Watched {
    /// A vehicle that nothing has been done to.
    pub fn new(vehicle: Vehicle) -> Self {
        Self { vehicle, put_back: None }
    }

    /// From here on the command may move the rudder, until [`Self::leave`]; `stop` ends every wait
    /// for the vehicle meanwhile.
    pub fn begin(&mut self, stop: &'static AtomicBool) {
        self.put_back.get_or_insert_default();
        self.vehicle.heed(Some(stop));
    }

    /// Lets the vehicle watch over this host until [`Self::leave`].
    ///
    /// # Errors
    /// The vehicle does not answer.
    pub fn watch_host(&mut self) -> Result<()> {
        let before = self.vehicle.parameter(FS_HOST)?;
        if before == 1.0 {
            return Ok(());
        }
        self.put_back_later(FS_HOST, before);
        self.vehicle.set_parameter(FS_HOST, 1.0)
    }

    /// The parameter gets this value at the end.
    pub fn put_back_later(&mut self, name: &str, value: f32) {
        self.put_back.get_or_insert_default().push(Parameter::new(name, value));
    }

    /// Leaves the vehicle neutral, after `done`, and puts the parameters back, the newest first.
    ///
    /// # Errors
    /// That of `done`, or the vehicle does not answer: then it goes on watching over its host.
    pub fn leave<T>(&mut self, done: Result<T>) -> Result<T> {
        let left = self.undo();
        if let (Err(_), Err(problem)) = (&done, &left) {
            eprintln!("the vehicle was not disarmed: {problem:#}");
        }
        let done = done?;
        left.map(|()| done)
    }

    fn undo(&mut self) -> Result<()> {
        let Some(mut rows) = self.put_back.take() else {
            return Ok(());
        };
        self.vehicle.heed(None);
        // A latched fault is at neutral, and to disarm would acknowledge it, which is for a person.
        if self.vehicle.state() != Some(StateKind::Latched) {
            // A log that cannot be written ends the first try; the vehicle's silence is final.
            self.vehicle.disarm().or_else(|why| match why.is::<Failure>() {
                true => Err(why),
                false => self.vehicle.disarm(),
            })?;
        }
        while let Some(Parameter { name, value }) = rows.pop() {
            self.vehicle.set_parameter(&name, value)?;
        }
        Ok(())
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        // An error has been told already, and after a panic there is nobody to tell.
        let _ = self.undo();
    }
}

impl Deref for Watched {
    type Target = Vehicle;

    fn deref(&self) -> &Vehicle {
        &self.vehicle
    }
}

impl DerefMut for Watched {
    fn deref_mut(&mut self) -> &mut Vehicle {
        &mut self.vehicle
    }
}

impl Vehicle {
    /// Disarms: the rudder is at neutral afterwards. Gives the fault that still keeps the vehicle
    /// in its failsafe, if there is one. A person at the terminal is told soon what to do where no
    /// answer comes; the order is repeated meanwhile.
    ///
    /// # Errors
    /// The vehicle does not answer.
    pub fn disarm(&mut self) -> Result<Option<String>> {
        let (begun, mut told) = (self.now(), false);
        let answer = self.request(Request::Order(request::DISARM), &mut |now| {
            if !told && now.saturating_sub(begun) > UNANSWERED {
                told = true;
                eprintln!("{CUT_POWER}");
            }
        });
        let Err(refused) = answer else {
            return Ok(None);
        };
        match refused.downcast_ref() {
            Some(Failure::Silence(_)) => Err(refused.context(CUT_POWER)),
            failure => match failure.and_then(Failure::persisting_fault) {
                Some(fault) => Ok(Some(fault.to_owned())),
                None => Err(refused),
            },
        }
    }
}

#[cfg(all(test, unix))]
mod tests;
