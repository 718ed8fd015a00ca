//! Writes parameters into the vehicle's flash and reads them back.

use anyhow::{Result, bail};
use client::{Parameter, request};

use super::polarity;
use crate::vehicle::link::Vehicle;

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
            vehicle.set_parameter(&row.name, row.value)?;
        }
        vehicle.command(request::SAVE)
    };
    if let Err(why) = set(vehicle) {
        // The check of the polarity stands behind what may undo it.
        let is_old = |old: &&Parameter| {
            old.name == polarity::NAME || changed.iter().any(|row| row.name == old.name)
        };
        for old in before.iter().filter(is_old) {
            vehicle.set_parameter(&old.name, old.value)?;
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
