//! Logs of a vehicle: reported, replayed, inspected, converted.

pub mod inspect;
pub mod replay;
pub mod report;
