//! What a vehicle sends, and what a ground station sends to it.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::{Result, bail};
use client::{ServoMap, StatusTracker, Wire};
use mavlink::dialects::common::{MavCmd, MavMessage};
use tvc_nano::{Axis, Params};

use super::{Outcome, expect};
use ground::vehicle::admission::Admission;
use ground::vehicle::forward::gate::Gate;
use ground::vehicle::link::{Link, Vehicle};
use ground::vehicle::signing::Signing;
use ground::vehicle::way::Way;
use ground::vehicle::{bringup, info, monitor, recorder};
use report::measure::Figures;

/// Bytes that come at a time.
const AT_A_TIME: usize = 300;

/// A key.
const KEY: &[u8; 32] = b"a key that is stored in no input";

/// A way on which these bytes come, and then the port goes away.
struct Fed {
    bytes: Vec<u8>,
    at: usize,
    now: Duration,
}

impl Fed {
    fn link(bytes: &[u8]) -> Link {
        let bytes = bytes.to_vec();
        Link::at(Self { bytes, at: 0, now: Duration::ZERO })
    }
}

impl Way for Fed {
    fn name(&self) -> &str {
        "input"
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn read(&mut self, patience: Duration) -> Result<Vec<u8>> {
        self.now += patience;
        let rest = &self.bytes[self.at..];
        let Some(next) = rest.chunks(AT_A_TIME).next() else {
            bail!("it went away");
        };
        self.at += next.len();
        Ok(next.to_vec())
    }

    fn write(&mut self, _: &[u8]) -> Result<()> {
        Ok(())
    }
}

/// A vehicle that is asked for one thing or another. What it refuses, and that it goes away, is its
/// own affair.
pub fn asked(bytes: &[u8], number: u64) -> Outcome {
    if number % 6 == 5 {
        // That it stops is no fault of this program.
        let _ = bringup::examine(Fed::link(bytes), false);
        return Ok(());
    }
    let Ok(mut vehicle) = Vehicle::at(Fed::link(bytes)) else {
        return Ok(());
    };
    match number % 6 {
        0 => drop(vehicle.parameters()),
        1 => drop(vehicle.recording()),
        2 => {
            let _ = info::vehicle::ask(&mut vehicle, Some("0123abcd")).map(|told| {
                let figures = Figures::from(told.figures());
                (figures.text(), serde_json::to_string(&figures))
            });
        }
        3 => drop(vehicle.set_parameter("PID_KP", 1.0)),
        _ => return watched(&mut vehicle),
    }
    Ok(())
}

/// As `tvc monitor` shows it.
fn watched(vehicle: &mut Vehicle) -> Outcome {
    let servos = Axis::ALL.map(|axis| ServoMap::of(&Params::default(), axis));
    let mut tracker = StatusTracker::new(servos);
    while let Ok(frames) = vehicle.receive() {
        for frame in frames {
            tracker.take(&frame.message);
        }
        let status = tracker.next(vehicle.link().client());
        serde_json::to_string(&status).map_err(|error| error.to_string())?;
        let _ = monitor::lines(&status);
    }
    Ok(())
}

/// A vehicle behind the page of `tvc web`.
pub fn page(bytes: &[u8], _: u64) -> Outcome {
    super::page::heard(Fed::link(bytes));
    Ok(())
}

/// The content of a recorder.
pub fn recorder(bytes: &[u8], _: u64) -> Outcome {
    let Ok(flight) = recorder::flight(bytes, Vec::new()) else {
        return Ok(());
    };
    let _ = ground::logs::report::figures(&flight).text();
    Ok(())
}

/// What comes to `tvc forward` by UDP: no more goes on to the vehicle than came, nothing of a
/// stranger, and of what is not signed nothing where there is a key.
pub fn station(bytes: &[u8], number: u64) -> Outcome {
    let shown = Ipv4Addr::new(192, 0, 2, 20);
    let from = [Ipv4Addr::LOCALHOST, shown, Ipv4Addr::new(192, 0, 2, 66)][number as usize % 3];
    let key = number.is_multiple_of(5).then(|| Signing::parse(KEY).unwrap());
    let has_key = key.is_some();
    let mut gate = Gate::new(Admission::default(), shown.into(), key);
    let admitted = gate.incoming(bytes, from.into());
    let frames = Wire::default().receive_frames(&admitted);
    let commands = frames.iter().any(|frame| match &frame.message {
        MavMessage::PARAM_SET(_) | MavMessage::HEARTBEAT(_) => true,
        MavMessage::COMMAND_LONG(long) => long.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        _ => false,
    });
    let may_command = from.is_loopback() && !has_key;
    expect(may_command || !commands, "who may not command does")?;
    expect(admitted.len() <= bytes.len(), "it says more than it hears")
}
