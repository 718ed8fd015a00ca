//! The driver's state while the chip samples, and its trust in the samples.

use tvc_imu::{Micros, SensorFault};

use crate::request::Request;
use crate::sample::{Evidence, Inspector};
use crate::verify::Check;

/// After this many bad samples in a row, the chip is set up anew. If they are zeros it has reset
/// itself, whatever its mode says.
const BAD_SAMPLES_MAX: u8 = 3;
/// What a bad sample, or a register that read wrong, adds to a leaky bucket, from which a good
/// burst of all sensors takes 1. No sound burst is bad.
const WRONG_WEIGHT: u8 = 4;
/// What a suspect burst adds.
const SUSPECT_WEIGHT: u8 = 3;
/// What ones in a part of a burst add: a glitch of the cable makes three such bursts.
const ONES_WEIGHT: u8 = 2;
/// At this level of the bucket the chip is set up anew: the good samples are not to be believed
/// either, because flipped bits that are too small to be noticed come with those that are. Three
/// bad samples reach it if at most three good ones lie between them, and so do four suspect bursts,
/// or three in a row.
const UNRELIABLE_MAX: u8 = 9;

/// What the driver keeps while the chip samples.
#[derive(Clone, Debug, Default)]
pub(super) struct Sampling {
    /// The next check of the round.
    check: Check,
    /// The identity is read instead, because the bus is in doubt.
    in_doubt: bool,
    /// A burst has been judged since the last verification, so the next verification may follow.
    pub(super) due: bool,
    /// The transfer from [`next`](tvc_imu::Imu::next) without an outcome yet.
    pub(super) outstanding: Option<Errand>,
    /// A register read wrong once: samples are withheld until it has been read again.
    pub(super) mismatched: bool,
    /// Time of the first failed transfer since the last good burst.
    pub(super) silent_since: Option<Micros>,
    bad_samples: u8,
    unreliable: u8,
    pub(super) inspector: Inspector,
}

/// Purpose of a transfer between two bursts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Errand {
    Verify,
    Ask(Request),
}

impl Sampling {
    pub(super) fn new(inspector: Inspector) -> Self {
        Self { inspector, ..Self::default() }
    }

    /// The check that the next verification makes.
    pub(super) fn check(&self) -> Check {
        if self.in_doubt { Check::Identity } else { self.check }
    }

    /// A register read right. As long as the bus is in doubt, every other verification reads the
    /// identity.
    pub(super) fn right_register(&mut self) {
        if !self.in_doubt {
            self.check = self.check.next();
        }
        self.in_doubt = !self.in_doubt && self.unreliable > 0;
        self.mismatched = false;
        self.due = false;
    }

    /// A burst has ended. A verification without an outcome was not made: the owner had no time for
    /// so long a transfer, so that a shorter one follows.
    pub(super) fn burst_ended(&mut self) {
        self.due = true;
        if self.outstanding == Some(Errand::Verify) {
            self.in_doubt = false;
        }
    }

    /// The next verification reads the mode: the chip may have reset itself.
    pub(super) fn suspect_reset(&mut self) {
        if !self.mismatched {
            self.check = Check::Mode;
            self.in_doubt = false;
        }
    }

    /// Counts a wrong answer; true if there were too many to trust the right answers.
    fn distrust(&mut self, weight: u8) -> bool {
        self.unreliable = self.unreliable.saturating_add(weight);
        self.unreliable >= UNRELIABLE_MAX
    }

    /// Takes back the weight of a suspect burst that motion explains.
    pub(super) fn clear(&mut self) {
        self.unreliable = self.unreliable.saturating_sub(SUSPECT_WEIGHT);
    }

    /// Counts the evidence of an accepted burst on the wire; whether the burst is still trusted.
    pub(super) fn weigh(&mut self, evidence: Evidence) -> bool {
        match evidence {
            Evidence::Sound if !self.mismatched => {
                self.unreliable = self.unreliable.saturating_sub(1);
            }
            Evidence::Sound | Evidence::Little => {}
            Evidence::Suspect => {
                self.doubt();
                return !self.distrust(SUSPECT_WEIGHT);
            }
        }
        true
    }

    /// Counts ones in a part of a burst; whether the other bursts are still trusted.
    pub(super) fn weigh_ones(&mut self) -> bool {
        !self.distrust(ONES_WEIGHT)
    }

    /// The next verification reads the identity, unless a register is to be read again.
    fn doubt(&mut self) {
        self.in_doubt |= !self.mismatched;
    }

    /// Notes an accepted sample; whether it may be given out.
    pub(super) fn good_sample(&mut self) -> bool {
        self.silent_since = None;
        self.bad_samples = 0;
        !self.mismatched
    }

    /// Counts a bad sample; after too many, the reason to set the chip up anew.
    pub(super) fn bad_sample(&mut self, fault: SensorFault) -> Option<SensorFault> {
        self.bad_samples = self.bad_samples.saturating_add(1);
        let unreliable = self.distrust(WRONG_WEIGHT);
        if fault == SensorFault::AllZero {
            self.suspect_reset();
        } else {
            self.doubt();
        }
        let most = match fault {
            SensorFault::Frozen => 1,
            _ => BAD_SAMPLES_MAX,
        };
        let is_lasting = self.bad_samples >= most;
        (is_lasting || unreliable).then_some(match fault {
            // A register that reads wrong beside the zeros has lost its setting, too.
            SensorFault::AllZero if is_lasting || self.mismatched => SensorFault::Reset,
            fault if is_lasting => fault,
            _ => SensorFault::Unreliable,
        })
    }

    /// Notes a register that read wrong; the reason to set the chip up anew, if any. A wrong bit on
    /// the wire looks the same, so the register is read again, and the second answer counts.
    pub(super) fn wrong_register(&mut self, fault: SensorFault) -> Option<SensorFault> {
        if core::mem::replace(&mut self.mismatched, true) {
            Some(fault)
        } else {
            let unreliable = self.distrust(WRONG_WEIGHT);
            unreliable.then_some(SensorFault::Unreliable)
        }
    }
}
