//! The parameters in the vehicle's flash. MAVLink has no question about them; the board shows its
//! flash word by word, as to `tvc bringup`, while nobody needs the rudder.

use client::request::bringup;
use client::{Request, StateKind, Ticket};
use tvc_nano::Params;
use tvc_nano::bringup::What;
use tvc_nano::store::{Loaded, STORE_ADDRESS, STORE_BYTES, load_bytes};

use super::Session;
use super::guard::HostWatch;
use crate::vehicle::param::is_measured;
use crate::vehicle::watch::FS_HOST;

/// What has been read.
#[derive(Default)]
pub(super) struct Stored {
    /// The store's bytes as far as they have been read.
    bytes: Vec<u8>,
    asked: Option<Ticket>,
    /// The board does not show them.
    refused: bool,
    /// Those that were read last: the defaults where nothing is stored.
    pub(super) params: Option<Params>,
}

impl Stored {
    /// Reads them again, since they may have changed.
    pub(super) fn read_anew(&mut self) {
        self.bytes.clear();
        self.asked = None;
    }

    /// The value of a parameter that an operator stores. The operator has not set the watch over
    /// this program.
    pub(super) fn value(&self, name: &str, host: &HostWatch) -> Option<f32> {
        let is_own = is_measured(name) || (name == FS_HOST && host.is_on());
        self.params.as_ref().filter(|_| !is_own)?.value(name)
    }
}

impl Session<'_> {
    /// Reads the next word.
    pub(super) fn ask_stored(&mut self) {
        if self.stored.refused || self.stored.bytes.len() == STORE_BYTES {
            return;
        }
        let address = STORE_ADDRESS + self.stored.bytes.len() as u32;
        let client = self.link.client();
        if let Some(ticket) = self.stored.asked {
            let Some(answer) = client.answer(ticket) else {
                return;
            };
            self.stored.asked = None;
            let state = client.state();
            match (answer, client.board_value(address)) {
                (Ok(()), Some(word)) => {
                    self.stored.bytes.extend(word.value.to_le_bytes());
                    if let Ok(bytes) = <[u8; STORE_BYTES]>::try_from(&*self.stored.bytes) {
                        self.take_stored(&bytes);
                        return;
                    }
                }
                // A refusal outside of standby says nothing about standby.
                _ => self.stored.refused = state.is_some_and(is_idle),
            }
            return self.ask_stored();
        }
        let is_free = client.has_all_parameters()
            && client.state().is_some_and(is_idle)
            && self.waiting.is_empty()
            && self.list.is_none();
        if is_free {
            let order = bringup(What::Peek, address);
            self.stored.asked = Some(self.link.request(Request::Order(order)));
        }
    }

    fn take_stored(&mut self, bytes: &[u8; STORE_BYTES]) {
        let (params, loaded) = load_bytes(bytes);
        if loaded != Loaded::Corrupt && params.value(FS_HOST) == Some(1.0) {
            self.host.leave_to_operator();
        }
        self.stored.params = (loaded != Loaded::Corrupt).then_some(params);
        self.publish_parameters();
    }
}

/// Where the board shows its memory.
fn is_idle(state: StateKind) -> bool {
    matches!(state, StateKind::Boot | StateKind::SelfTest | StateKind::Standby)
}
