//! Writes parameters into the vehicle's flash and reads them back.

use anyhow::{Result, bail};
use client::{Parameter, request};

use crate::vehicle::link::Vehicle;

/// Sets `rows`, saves them, reads them back out of the flash and compares; how many were changed.
///
/// # Errors
/// The vehicle refuses one, does not answer, or its flash has another value.
pub fn write(vehicle: &mut Vehicle, rows: &[Parameter]) -> Result<usize> {
    let before = vehicle.parameters()?;
    let mut changed = 0;
    for row in rows {
        if !before.contains(row) {
            vehicle.set_parameter(&row.name, row.value)?;
            changed += 1;
        }
    }
    vehicle.command(request::SAVE)?;
    // Reloaded, so that the comparison is with the flash.
    vehicle.command(request::RELOAD)?;
    let after = vehicle.parameters()?;
    match rows.iter().find(|row| !after.contains(row)) {
        None => Ok(changed),
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
