//! The trust in a sensor that samples: what its bursts and its registers tell of it.

use super::inspector::{Evidence, Inspector, Judged, Rules, Words};
use crate::{Health, Micros, SensorFault, Transferred};

/// Longest time without a good burst before the sensor is set up anew, us. A shorter glitch of the
/// cable does not reset the sensor: the driver verifies that, and sampling goes on.
pub const GLITCH_US: u64 = 60_000;
/// After this many bad samples in a row, the sensor is set up anew. If they are zeros it has reset
/// itself, whatever its registers say.
const BAD_SAMPLES_MAX: u8 = 3;
/// What a bad sample adds to a leaky bucket, from which a good burst of all sensors takes 1. No
/// sound burst is bad.
const WRONG_WEIGHT: u8 = 5;
/// What a register that read wrong adds, and a burst of zeros, which a register shows to be those
/// of a reset.
const REGISTER_WEIGHT: u8 = 4;
/// What a suspect burst adds.
const SUSPECT_WEIGHT: u8 = 3;
/// What a burst of a board that rattles adds.
const RATTLE_WEIGHT: u8 = 2;
/// What ones in a part of a burst add: a glitch of the cable makes three such bursts.
const ONES_WEIGHT: u8 = 2;
/// At this level of the bucket the sensor is set up anew: the good samples are not to be believed
/// either, because flipped bits that are too small to be noticed come with those that are. Two
/// bad samples reach it if at most one good one lies between them, and so do four suspect bursts,
/// or three in a row.
const UNRELIABLE_MAX: u8 = 9;

/// The verdict on a burst or a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is good.
    Good,
    /// It is not to be used, for this reason.
    Bad(SensorFault),
    /// The sensor is to be set up anew, for this reason.
    Restart(SensorFault),
}

impl Verdict {
    /// Whether the burst or the register is good.
    ///
    /// # Errors
    /// The reason why it is not.
    pub fn result(self) -> Result<(), SensorFault> {
        match self {
            Self::Good => Ok(()),
            Self::Bad(fault) | Self::Restart(fault) => Err(fault),
        }
    }
}

/// What the driver knows of a sensor that samples.
#[derive(Clone, Debug, Default)]
pub struct Trust {
    /// The bus is in doubt: the next verification reads what never changes.
    in_doubt: bool,
    /// The sensor may have reset itself: the next verification reads what shows it.
    may_have_reset: bool,
    /// A register read wrong once: samples are withheld until it has been read again.
    mismatched: bool,
    /// Time of the first failed transfer since the last good burst.
    silent_since: Option<Micros>,
    bad_samples: u8,
    unreliable: u8,
    inspector: Inspector,
}

impl Trust {
    /// Trust in a sensor whose first bursts this inspector has seen.
    #[must_use]
    pub fn new(inspector: Inspector) -> Self {
        Self { inspector, ..Self::default() }
    }

    /// The judge of the bursts.
    #[must_use]
    pub fn inspector(&self) -> &Inspector {
        &self.inspector
    }

    /// The next verification should read what never changes, such as an identification.
    #[must_use]
    pub fn is_in_doubt(&self) -> bool {
        self.in_doubt
    }

    /// The next verification should read what a reset changes.
    #[must_use]
    pub fn may_have_reset(&self) -> bool {
        self.may_have_reset
    }

    /// A register read wrong once, and is to be read again.
    #[must_use]
    pub fn is_mismatched(&self) -> bool {
        self.mismatched
    }

    /// The bytes of a burst. All ones, in more than the `chance` bytes of a sensor at rest, are no
    /// answer: nobody drove the data line. Behind a lost burst, no bytes are ones by chance.
    ///
    /// # Errors
    /// The fault.
    pub fn received<'b>(
        &self,
        outcome: Transferred<'b>,
        chance: usize,
    ) -> Result<&'b [u8], SensorFault> {
        received(outcome, if self.silent_since.is_some() { 0 } else { chance })
    }

    /// Judges the words of a burst. [`Inspector::sample`] has them if the burst is good. `is_whole`
    /// tells a whole burst from rates that [`Inspector::complete`] completed.
    #[inline]
    pub fn judge(
        &mut self,
        health: &mut Health,
        rules: &Rules,
        time: Micros,
        words: &Words,
        is_whole: bool,
    ) -> Verdict {
        let behind_failure = self.silent_since.is_some();
        let judged = self.inspector.judge(rules, time, words, is_whole, behind_failure);
        let Judged { fresh, evidence, cleared } = match judged {
            Ok(judged) => judged,
            // Nobody drove the line for a part of the burst, which is a gap in the data.
            Err(fault) if fault.is_bus() => {
                return if self.distrust(ONES_WEIGHT) {
                    unreliable(health)
                } else {
                    self.silent(health, time, fault)
                };
            }
            Err(fault) => return self.conclude(health, time, Err(fault)),
        };
        health.fresh = health.fresh.wrapping_add(u32::from(fresh));
        if cleared {
            self.unreliable = self.unreliable.saturating_sub(SUSPECT_WEIGHT);
        }
        if self.weigh(evidence) { self.conclude(health, time, Ok(())) } else { unreliable(health) }
    }

    /// Takes data that the sensor fused itself, which show nothing of the wire but their faults.
    pub fn fused(
        &mut self,
        health: &mut Health,
        time: Micros,
        judged: Result<(), SensorFault>,
    ) -> Verdict {
        if judged.is_ok() {
            self.weigh(Evidence::Sound);
        }
        self.conclude(health, time, judged)
    }

    /// Draws the conclusions from judged data; withholds good data while a register is mismatched.
    #[inline]
    pub fn conclude(
        &mut self,
        health: &mut Health,
        time: Micros,
        judged: Result<(), SensorFault>,
    ) -> Verdict {
        match judged {
            Ok(()) => {
                self.silent_since = None;
                self.bad_samples = 0;
                if self.mismatched {
                    health.withheld = health.withheld.wrapping_add(1);
                    return Verdict::Bad(SensorFault::RegisterMismatch);
                }
                health.good = health.good.wrapping_add(1);
                health.last_good = Some(time);
                Verdict::Good
            }
            Err(fault) => {
                health.count(fault);
                self.bad_sample(fault)
            }
        }
    }

    /// Notes a lost transfer. The sensor may have reset. Only a sensor that stays silent is set up
    /// anew.
    pub fn silent(&mut self, health: &mut Health, now: Micros, fault: SensorFault) -> Verdict {
        health.count(fault);
        self.suspect_reset();
        let since = *self.silent_since.get_or_insert(now);
        if now.since(since) >= GLITCH_US { Verdict::Restart(fault) } else { Verdict::Bad(fault) }
    }

    /// Draws the conclusions from a verification. A wrong bit on the wire looks like a wrong
    /// register, so the register is read again, and the second answer counts.
    pub fn verified(
        &mut self,
        health: &mut Health,
        now: Micros,
        judged: Result<(), SensorFault>,
    ) -> Verdict {
        match judged {
            Ok(()) => {
                health.verified = health.verified.wrapping_add(1);
                // As long as the bus is in doubt, every other verification reads the identity.
                let was_in_doubt = self.in_doubt;
                self.may_have_reset &= was_in_doubt;
                self.in_doubt = !was_in_doubt && self.unreliable > 0;
                self.mismatched = false;
                Verdict::Good
            }
            Err(fault) if fault.is_bus() => self.silent(health, now, fault),
            Err(fault) => {
                health.mismatched = health.mismatched.wrapping_add(1);
                if core::mem::replace(&mut self.mismatched, true) {
                    Verdict::Restart(fault)
                } else if self.distrust(REGISTER_WEIGHT) {
                    Verdict::Restart(SensorFault::Unreliable)
                } else {
                    Verdict::Bad(fault)
                }
            }
        }
    }

    /// A verification was not made, because the owner had no time for it.
    pub fn not_verified(&mut self) {
        self.in_doubt = false;
    }

    fn suspect_reset(&mut self) {
        if !self.mismatched {
            self.may_have_reset = true;
            self.in_doubt = false;
        }
    }

    /// The next verification reads the identity, unless a register is to be read again.
    fn doubt(&mut self) {
        self.in_doubt |= !self.mismatched;
    }

    /// Counts a wrong answer; true if there were too many to trust the right answers.
    fn distrust(&mut self, weight: u8) -> bool {
        self.unreliable = self.unreliable.saturating_add(weight);
        self.unreliable >= UNRELIABLE_MAX
    }

    /// Counts the evidence of an accepted burst on the wire; whether the burst is still trusted.
    fn weigh(&mut self, evidence: Evidence) -> bool {
        match evidence {
            Evidence::Sound if !self.mismatched => {
                self.unreliable = self.unreliable.saturating_sub(1);
            }
            Evidence::Sound | Evidence::Little => {}
            Evidence::Rattle => return !self.distrust(RATTLE_WEIGHT),
            Evidence::Suspect => {
                self.doubt();
                return !self.distrust(SUSPECT_WEIGHT);
            }
        }
        true
    }

    /// Counts a bad sample; after too many, the sensor is set up anew.
    fn bad_sample(&mut self, fault: SensorFault) -> Verdict {
        self.bad_samples = self.bad_samples.saturating_add(1);
        let unreliable = if fault == SensorFault::AllZero {
            self.suspect_reset();
            self.distrust(REGISTER_WEIGHT)
        } else {
            self.doubt();
            self.distrust(WRONG_WEIGHT)
        };
        let most = match fault {
            SensorFault::Frozen => 1,
            _ => BAD_SAMPLES_MAX,
        };
        let is_lasting = self.bad_samples >= most;
        if !is_lasting && !unreliable {
            return Verdict::Bad(fault);
        }
        Verdict::Restart(match fault {
            // A register that reads wrong beside the zeros has lost its setting, too.
            SensorFault::AllZero if is_lasting || self.mismatched => SensorFault::Reset,
            fault if is_lasting => fault,
            _ => SensorFault::Unreliable,
        })
    }
}

/// Too many bursts were wrong.
fn unreliable(health: &mut Health) -> Verdict {
    health.count(SensorFault::Unreliable);
    Verdict::Restart(SensorFault::Unreliable)
}

/// The bytes of an answer. All ones, in more than the `chance` bytes of a sensor at rest, are no
/// answer: nobody drove the data line.
///
/// # Errors
/// The fault.
pub fn received(outcome: Transferred<'_>, chance: usize) -> Result<&[u8], SensorFault> {
    match outcome {
        Ok(bytes) if bytes.len() > chance && bytes.iter().all(|byte| *byte == 0xFF) => {
            Err(SensorFault::AllOnes)
        }
        Ok(bytes) => Ok(bytes),
        Err(error) => Err(error.into()),
    }
}
