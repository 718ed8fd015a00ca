//! Writes parameters into the vehicle's flash and reads them back.

use anyhow::{Result, bail};
use client::{Parameter, request};
use flights::param_file::is_polarity;

use crate::vehicle::link::Vehicle;

/// Value of a polarity while nobody has seen the rudder answer a tilt.
pub const UNCHECKED: f32 = 0.0;
/// Its value once somebody has.
pub const CHECKED: f32 = 1.0;
/// Its value while somebody is about to: the rudder answers a tilt in standby.
pub const WATCHED: f32 = 2.0;

/// Sets `rows`, saves them, reads them back out of the flash and compares; how many were changed.
/// Where they cannot be saved, those that were changed are put back.
///
/// # Errors
/// The vehicle refuses one, does not answer, or its flash has another value.
pub fn write(vehicle: &mut Vehicle, rows: &[Parameter]) -> Result<usize> {
    let before = vehicle.parameters()?;
    let changed: Vec<_> = rows.iter().filter(|row| !before.contains(row)).collect();
    let set = |vehicle: &mut Vehicle| {
        for row in &changed {
            set_row(vehicle, row)?;
        }
        vehicle.command(request::SAVE)
    };
    if let Err(why) = set(vehicle) {
        // The check of the polarity stands behind what may undo it.
        let is_old = |old: &&Parameter| {
            is_polarity(&old.name) || changed.iter().any(|row| row.name == old.name)
        };
        for old in before.iter().filter(is_old) {
            set_row(vehicle, old)?;
        }
        return Err(why);
    }
    // Reloaded, so that the comparison is with the flash.
    vehicle.command(request::RELOAD)?;
    let after = vehicle.parameters()?;
    match rows.iter().find(|row| !after.contains(row)) {
        None => Ok(changed.len()),
        Some(row) => {
            let found = after.iter().find(|other| other.name == row.name);
            bail!(
                "{} is {} in the vehicle's flash, not {}",
                row.name,
                found.map_or("missing".into(), |found| found.value.to_string()),
                row.value
            )
        }
    }
}

/// Sets a parameter. A polarity becomes checked only from watched: a vehicle refuses it of one that
/// nobody has looked at.
fn set_row(vehicle: &mut Vehicle, row: &Parameter) -> Result<()> {
    if is_polarity(&row.name) && row.value == CHECKED {
        vehicle.set_parameter(&row.name, WATCHED)?;
    }
    vehicle.set_parameter(&row.name, row.value)
}

#[cfg(all(test, unix))]
pub mod tests {
    use std::io::{ErrorKind, Read, Write};
    use std::thread::{JoinHandle, spawn};
    use std::time::Duration;

    use client::{Wire, text};
    use mavlink::dialects::common::{
        COMMAND_ACK_DATA, HEARTBEAT_DATA, MavMessage, MavResult, PARAM_VALUE_DATA,
    };
    use serialport::{SerialPort, TTYPort};

    use flights::param_file::POLARITY;

    use super::*;
    use crate::vehicle::link::Link;
    use crate::vehicle::port::Port;

    /// Parameters with these values.
    pub fn rows(values: [(&str, f32); 3]) -> Vec<Parameter> {
        values.map(|(name, value)| Parameter::new(name, value)).into()
    }

    /// A vehicle that obeys no order, and that forgets a parameter when its direction is set; at
    /// the end it gives its parameters.
    pub fn vehicle(
        mut has: Vec<Parameter>,
        forgets: &'static str,
    ) -> (Vehicle, JoinHandle<Vec<Parameter>>) {
        let (mut end, port) = TTYPort::pair().unwrap();
        end.set_timeout(Duration::from_millis(20)).unwrap();
        let thread = spawn(move || {
            let (mut wire, mut bytes) = (Wire::default(), [0; 1024]);
            loop {
                let told = match end.read(&mut bytes) {
                    Err(error) if error.kind() == ErrorKind::TimedOut => Vec::new(),
                    Ok(count @ 1..) => wire.receive(&bytes[..count]),
                    _ => return has,
                };
                let mut answers = vec![MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())];
                for message in told {
                    match message {
                        MavMessage::PARAM_SET(set) => {
                            let name = text(&set.param_id);
                            for row in &mut has {
                                if row.name == name {
                                    row.value = set.param_value;
                                } else if row.name == forgets && name == "SRV_DIR" {
                                    row.value = 0.0;
                                }
                            }
                        }
                        MavMessage::PARAM_REQUEST_LIST(_) => {}
                        MavMessage::COMMAND_LONG(order) => {
                            answers.push(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                                command: order.command,
                                result: MavResult::MAV_RESULT_DENIED,
                            }));
                            continue;
                        }
                        _ => continue,
                    }
                    let value = |(index, row): (usize, &Parameter)| {
                        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                            param_id: row.name.as_str().into(),
                            param_value: row.value,
                            param_index: index as u16,
                            param_count: has.len() as u16,
                            ..PARAM_VALUE_DATA::default()
                        })
                    };
                    answers.extend(has.iter().enumerate().map(value));
                }
                for answer in answers {
                    // The other end may have been closed by now.
                    let _ = end.write_all(&wire.frame(&answer));
                }
            }
        });
        let link = Link::at(Port::at(Box::new(port), "cable".into()));
        (Vehicle::at(link).unwrap(), thread)
    }

    #[test]
    fn what_cannot_be_saved_is_put_back_and_the_polarity_is_checked_as_before() {
        let before = rows([("SRV_CENTRE_US", 1520.0), ("SRV_DIR", 1.0), (POLARITY, 1.0)]);
        let (mut vehicle, thread) = vehicle(before.clone(), POLARITY);
        let wanted = &before[..2];
        let wanted: Vec<_> =
            wanted.iter().map(|row| Parameter { value: -row.value, ..row.clone() }).collect();
        let refused = write(&mut vehicle, &wanted).unwrap_err().to_string();
        assert!(refused.contains("save the parameters"), "{refused}");
        drop(vehicle);
        assert_eq!(thread.join().unwrap(), before);
    }
}
