//! The pipes to the device's endpoints (USB 2.0, 5.3.2).

use crate::board::Ticks;

/// What goes to, or comes from, one endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pipe {
    Control,
    BulkIn,
    BulkOut,
    Interrupt,
}

/// State of one pipe: toggle of its next packet, and when it is tried again. That of the control
/// pipe has its toggle in the transfer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PipeState {
    pub(super) toggle: bool,
    pub(super) ready: Ticks,
}
