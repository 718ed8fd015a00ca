//! Stored parameters at the host's word: MAV_CMD_PREFLIGHT_STORAGE.

use embedded_storage::nor_flash::NorFlash;
use mavlink::dialects::common::{MavCmd, MavResult, MavSeverity};

use super::Telemetry;
use crate::flight::Flight;
use crate::params::{ParamError, Params};
use crate::store::{self, BoardId, Loaded, Saving};

const STORAGE: u16 = MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16;

/// What the command's first parameter asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StorageOrder {
    /// Back to what is stored, to the defaults where nothing is.
    Reload,
    /// Store the parameters as they are.
    Save,
    /// Back to the defaults; what is stored stays until the next save.
    Reset,
}

impl StorageOrder {
    fn decode(param1: f32) -> Option<Self> {
        match param1 {
            0.0 => Some(Self::Reload),
            1.0 => Some(Self::Save),
            2.0 => Some(Self::Reset),
            _ => None,
        }
    }
}

impl Telemetry {
    /// Whether [`Telemetry::serve_storage`] has something to do.
    pub fn has_storage_order(&self) -> bool {
        self.storage.is_some()
    }

    /// Whether it is to save, which leaves the flight as it is.
    pub fn is_saving(&self) -> bool {
        matches!(self.storage, Some((StorageOrder::Save, _)))
    }

    /// Notes the order; [`Telemetry::serve_storage`] obeys it.
    pub(super) fn order_storage(&mut self, param1: f32, flight: &Flight) {
        match StorageOrder::decode(param1) {
            None => self.acknowledge(STORAGE, MavResult::MAV_RESULT_DENIED),
            Some(_) if flight.state().is_armed() => self.refuse_storage(),
            // A host that asks again has not been heard twice: one order, one answer.
            Some(order) if self.storage.is_none_or(|(waits, _)| waits == order) => {
                self.storage = Some((order, self.asker));
            }
            Some(_) => {
                self.warn(format_args!("storage order refused: busy with another"));
                self.acknowledge(STORAGE, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
            }
        }
    }

    /// Obeys an order about stored parameters, if there is one, a row or page of flash at a time.
    /// The processor may stand still for some 6 ms: call it once behind a step, and again until
    /// there is none. While the drone is armed it is refused.
    pub fn serve_storage<F: NorFlash>(&mut self, flash: &mut F, flight: &mut Flight) {
        let Some((order, asker)) = self.storage.take() else {
            return;
        };
        self.asker = asker;
        let saving = self.saving.take();
        let board = BoardId::of(&self.identity.serial);
        if flight.state().is_armed() {
            return self.refuse_storage();
        }
        let result = match order {
            StorageOrder::Save => {
                let params = flight.params();
                let Some(mut saving) = saving else {
                    self.storage = Some((order, asker));
                    self.saving = Some(Saving::begin(flash, params, board));
                    return;
                };
                match saving.go_on(flash, params) {
                    Ok(None) => {
                        self.storage = Some((order, asker));
                        self.saving = Some(saving);
                        return;
                    }
                    Ok(Some(_)) => MavResult::MAV_RESULT_ACCEPTED,
                    Err(error) => {
                        self.status_text(
                            MavSeverity::MAV_SEVERITY_ERROR,
                            format_args!("save failed: {error}"),
                        );
                        MavResult::MAV_RESULT_FAILED
                    }
                }
            }
            StorageOrder::Reload => {
                let (params, loaded) = store::load(flash, board);
                self.report_stored(loaded);
                replace(flight, params)
            }
            StorageOrder::Reset => replace(flight, Params::default()),
        };
        self.acknowledge(STORAGE, result);
    }

    fn refuse_storage(&mut self) {
        self.refuse_param(&ParamError::ArmedAll);
        self.acknowledge(STORAGE, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    }

    /// Says what the operator should know of the stored parameters.
    pub(super) fn report_stored(&mut self, loaded: Loaded) {
        if !loaded.is_as_saved() {
            self.warn(format_args!("{loaded}"));
        }
    }
}

#[inline(never)]
fn replace(flight: &mut Flight, params: Params) -> MavResult {
    match flight.replace_params(params) {
        Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
        Err(_) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
    }
}
