//! What of a ground station's datagrams may reach the vehicle: everything from who may command,
//! questions alone from the station that is only shown the vehicle, nothing from anybody else.
//!
//! | from | without a key | with a key |
//! |---|---|---|
//! | this computer, or `--accept-commands-from` | everything | questions, and what is signed |
//! | `--to` | questions | questions |
//! | anywhere else | nothing | nothing |

use std::net::IpAddr;

use client::{Frame, Wire};
use mavlink::Message;
use mavlink::dialects::common::{MavCmd, MavMessage};

use crate::vehicle::admission::{Admission, remedy};
use crate::vehicle::signing::Signing;

/// The gate.
pub struct Gate {
    admission: Admission,
    /// The station that the vehicle is shown to.
    shown: IpAddr,
    signing: Option<Signing>,
    refused: u64,
}

impl Gate {
    /// A gate that has refused nothing.
    pub fn new(admission: Admission, shown: IpAddr, signing: Option<Signing>) -> Self {
        Self { admission, shown, signing, refused: 0 }
    }

    /// A frame for the station, signed if there is a key.
    pub fn outgoing(&self, frame: Vec<u8>) -> Vec<u8> {
        match &self.signing {
            Some(signing) => signing.sign(&frame),
            None => frame,
        }
    }

    /// What of a datagram may go on; whatever was signed is not any more.
    pub fn incoming(&mut self, datagram: &[u8], from: IpAddr) -> Vec<u8> {
        let may_command = self.admission.admits(from);
        if may_command && self.signing.is_none() {
            return datagram.to_vec();
        }
        let is_shown = may_command || from.to_canonical() == self.shown.to_canonical();
        let (mut admitted, mut rest) = (Vec::new(), datagram);
        while !rest.is_empty() {
            let length = Wire::frame_length(rest).unwrap_or(1);
            let Some(frame) = Wire::default().receive_frames(&rest[..length]).pop() else {
                // Perhaps there is a frame behind this byte.
                rest = &rest[1..];
                continue;
            };
            rest = &rest[length..];
            let signing = self.signing.as_ref();
            let verified = signing.and_then(|signing| signing.verified(&frame.bytes));
            match verified {
                Some(plain) if may_command => admitted.extend(plain),
                _ if is_shown && is_question(&frame.message) => admitted.extend(&frame.bytes),
                // It says only that the station is there, and every one says it all the time.
                _ if matches!(frame.message, MavMessage::HEARTBEAT(_)) => {}
                _ => self.refuse(&frame, from, may_command),
            }
        }
        admitted
    }

    /// Counts what is refused, and says of the first one why.
    fn refuse(&mut self, frame: &Frame, from: IpAddr, may_command: bool) {
        self.refused += 1;
        if self.refused == 1 {
            let why = match may_command {
                true => "it is not signed with this key, or was sent before".to_owned(),
                false => remedy(from),
            };
            eprintln!("refused {} from {from}: {why}", frame.message.message_name());
        }
    }

    /// Says how many were refused.
    pub fn end(&self) {
        if self.refused > 0 {
            eprintln!("refused {} messages in all", self.refused);
        }
    }
}

/// Whether a message asks for something and changes nothing.
fn is_question(message: &MavMessage) -> bool {
    let asks = |command: MavCmd| {
        matches!(command, MavCmd::MAV_CMD_REQUEST_MESSAGE | MavCmd::MAV_CMD_RUN_PREARM_CHECKS)
    };
    match message {
        MavMessage::PARAM_REQUEST_READ(_)
        | MavMessage::PARAM_REQUEST_LIST(_)
        | MavMessage::TIMESYNC(_)
        | MavMessage::LOG_REQUEST_LIST(_)
        | MavMessage::LOG_REQUEST_DATA(_)
        | MavMessage::LOG_REQUEST_END(_)
        | MavMessage::MISSION_REQUEST_LIST(_)
        // The vehicle refuses every file, which a station waits for.
        | MavMessage::FILE_TRANSFER_PROTOCOL(_) => true,
        MavMessage::COMMAND_LONG(m) => asks(m.command),
        MavMessage::COMMAND_INT(m) => asks(m.command),
        _ => false,
    }
}

#[cfg(test)]
mod tests;
