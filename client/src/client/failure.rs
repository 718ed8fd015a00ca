//! Why a request is not fulfilled.

use mavlink::dialects::common::MavResult;
use thiserror::Error;
use tvc_nano::failsafe::RefusalKind;

use super::{ANSWER, Parameter};

/// Between an order and the reason why the vehicle refuses it, in the vehicle's words.
pub(super) const REFUSED: &str = " refused: ";

/// Why a request was not fulfilled.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Failure {
    /// The vehicle does not obey.
    #[error("{}", refused(order, *result, reason))]
    Refused {
        /// What was ordered.
        order: String,
        /// Its answer.
        result: MavResult,
        /// Why, where it is one of the firmware's refusals.
        refusal: Option<RefusalKind>,
        /// Its words, if it said any.
        reason: String,
    },
    /// The vehicle has no parameter of this name.
    #[error("the vehicle has no parameter {0}")]
    UnknownParameter(String),
    /// The vehicle keeps another value.
    #[error("{} stays at {}: {reason}", kept.name, kept.value)]
    Kept {
        /// The parameter as it is.
        kept: Parameter,
        /// The vehicle's words.
        reason: String,
    },
    /// Nothing came.
    #[error("no answer about {0} from the vehicle within {s} s", s = ANSWER.as_secs())]
    Silence(String),
    /// The vehicle names more parameters than it sends.
    #[error(
        "of {count} parameters that the vehicle names, {missing} have not come, number {first} \
         first; nothing new within {s} s", s = ANSWER.as_secs()
    )]
    Incomplete {
        /// How many it names.
        count: u16,
        /// How many have not come.
        missing: usize,
        /// The first of them, counted from 1.
        first: u32,
    },
    /// The vehicle names a recording that none can have.
    #[error("the vehicle names a recording of {0} bytes, which no recorder holds")]
    Recording(usize),
    /// An order to disarm was given meanwhile.
    #[error("{0}: overtaken by an order to disarm")]
    Overtaken(String),
    /// The port went away before the answer came.
    #[error("{0}: the port went away")]
    Gone(String),
}

impl Failure {
    /// The firmware's refusal, if it is one.
    pub fn refusal(&self) -> Option<RefusalKind> {
        match self {
            Self::Refused { refusal, .. } => *refusal,
            _ => None,
        }
    }

    /// The fault that keeps the vehicle from standby, where an order to disarm was refused for that
    /// alone: its rudder is at neutral.
    pub fn persisting_fault(&self) -> Option<&str> {
        match self {
            Self::Refused { refusal: Some(RefusalKind::FaultPersists), reason, .. } => {
                Some(reason.split_once(REFUSED).map_or(reason, |(_, fault)| fault))
            }
            _ => None,
        }
    }
}

fn refused(order: &str, result: MavResult, reason: &str) -> String {
    match result {
        MavResult::MAV_RESULT_UNSUPPORTED => {
            format!("this firmware does not know the command to {order}")
        }
        _ if reason.is_empty() => format!("{order} refused ({result:?})"),
        _ => reason.to_owned(),
    }
}
