//! A USB serial port (CDC ACM, full speed) without its hardware: what the device is like, and how
//! it answers the host's requests on endpoint 0.
//!
//! It is written for one device with one configuration, which leaves no buffer whose length a
//! request decides, and so nothing that could panic. What moves packets is a [`Controller`].
//!
//! ```text
//! Device::setup
//!   ├─ data to the host:   Sending ── last packet ─▶ Sent ── its empty packet ─▶ Idle
//!   ├─ data from the host: Receiving ── all there ─┐
//!   ├─ no data:            ────────────────────────┴▶ Acknowledging ── taken ──▶ Idle
//!   └─ refused:            endpoint 0 stalls until the next SETUP
//! ```
//!
//! Sources: USB 2.0, chapters 8.5.3 (control transfers) and 9 (requests, descriptors); CDC 1.2 and
//! its PSTN subclass 1.2 (serial port).

pub mod descriptors;
mod device;
mod request;

pub use device::Device;
pub use request::Request;

/// Longest packet of the control endpoint and of the two that carry data, bytes.
pub const PACKET_BYTES: usize = 64;
/// Longest packet of the endpoint of notifications, of which there are none, bytes.
pub const NOTIFICATION_BYTES: usize = 8;

/// An endpoint beside endpoint 0; the direction is the host's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Interrupt IN 1: a serial port has it, and this one never uses it.
    Notifications,
    /// Bulk OUT 1: data from the host.
    FromHost,
    /// Bulk IN 2: data to the host.
    ToHost,
}

impl Endpoint {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Notifications, Self::FromHost, Self::ToHost];

    /// Number, and bit 7 where it is IN (USB 2.0, 9.6.6).
    pub const fn address(self) -> u8 {
        match self {
            Self::Notifications => 0x81,
            Self::FromHost => 0x01,
            Self::ToHost => 0x82,
        }
    }

    #[inline(never)]
    fn at(address: u16) -> Option<Self> {
        let is_its = |endpoint: &Self| u16::from(endpoint.address()) == address;
        Self::ALL.into_iter().find(is_its)
    }
}

/// What moves the packets.
pub trait Controller {
    /// Send a packet of at most [`PACKET_BYTES`] on endpoint 0; [`Device::sent`] tells that the
    /// host has taken it.
    fn send(&mut self, packet: &[u8]);

    /// Answer STALL on endpoint 0, both ways, until the next SETUP.
    fn stall(&mut self);

    /// Answer to this address from now on, 0 to 127.
    fn set_address(&mut self, address: u8);

    /// Answer STALL on an endpoint, or no longer; then its next packet is DATA0 (USB 2.0, 9.4.5).
    fn halt(&mut self, endpoint: Endpoint, halted: bool);

    /// Whether an endpoint answers STALL.
    fn is_halted(&self, endpoint: Endpoint) -> bool;
}
