//! The driver's state while the chip samples.

use tvc_imu::judge::{Inspector, Trust};

use crate::request::Request;
use crate::verify::Check;

/// What the driver keeps while the chip samples.
#[derive(Clone, Debug, Default)]
pub(super) struct Sampling {
    /// The next check of the round.
    check: Check,
    /// A burst has been judged since the last verification, so the next verification may follow.
    pub(super) due: bool,
    /// The transfer from [`next`](tvc_imu::Imu::next) without an outcome yet.
    pub(super) outstanding: Option<Errand>,
    pub(super) trust: Trust,
}

/// Purpose of a transfer between two bursts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Errand {
    Verify,
    Ask(Request),
}

impl Sampling {
    pub(super) fn new(inspector: Inspector) -> Self {
        Self { trust: Trust::new(inspector), ..Self::default() }
    }

    /// The check that the next verification makes.
    pub(super) fn check(&self) -> Check {
        if self.trust.is_in_doubt() {
            Check::Identity
        } else if self.trust.may_have_reset() {
            Check::Mode
        } else {
            self.check
        }
    }

    /// This check found what it should.
    pub(super) fn passed(&mut self, check: Check) {
        if check != Check::Identity {
            self.check = check.next();
        }
    }

    /// A burst has ended. A verification without an outcome was not made: the owner had no time for
    /// so long a transfer, so that a shorter one follows.
    pub(super) fn burst_ended(&mut self) {
        self.due = true;
        if self.outstanding == Some(Errand::Verify) {
            self.trust.not_verified();
        }
    }
}
