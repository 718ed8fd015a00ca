//! The vehicle as a ground station sees it: a MAVLink client without I/O.
//!
//! [`Client`] takes received bytes and gives messages; it takes [requests](Request) and gives bytes
//! to send and, later, the answer to each. It opens no port, never waits and has no clock of its
//! own: whoever drives it passes the time since the start as a [`Duration`](core::time::Duration).
//! The virtual rig drives it by the emulated USB and clock, `tvc` by a serial port and real time,
//! and the page of `tvc web` from the one thread that owns the port.
//!
//! | module | what |
//! |---|---|
//! | [`wire`] | frames in a stream of bytes, and what was lost |
//! | [`request`] | the messages that a ground station sends |
//! | [`client`] | requests with their answers, repeats and time limits; parameters; the recorder's download |
//! | [`state`] | the firmware's states and reasons as they come over the link |
//! | [`status`] | the newest of everything that the vehicle tells, as one object |

#![forbid(unsafe_code)]

pub mod client;
pub mod request;
pub mod state;
pub mod status;
pub mod wire;

pub use client::{BoardValue, Client, Failure, Parameter, Request, Ticket};
pub use request::Order;
pub use status::{LinkHealth, ServoMap, Status, StatusTracker};
pub use tvc_nano::failsafe::{LatchKind, ReasonKind, RefusalKind, StateCode, StateKind};
pub use wire::{Frame, LinkCounts, Wire};

use mavlink::types::CharArray;

/// A text field of a message.
pub fn text<const N: usize>(field: &CharArray<N>) -> &str {
    field.to_str().unwrap_or("(not UTF-8)")
}
