//! Logs of a vehicle: reported, replayed, inspected, converted.

pub mod convert;
pub mod inspect;
pub mod replay;
pub mod report;
