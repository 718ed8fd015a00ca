//! Logs of a vehicle: written, read, reported, replayed, converted.

pub mod convert;
pub mod inspect;
pub mod log;
pub mod replay;
pub mod report;
