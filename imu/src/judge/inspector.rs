//! The judgement of bursts.
//!
//! A burst that breaks one of these rules is refused. No sound burst breaks one:
//!
//! | rule | refused | reason |
//! |---|---|---|
//! | length | another number of bytes than asked for | |
//! | all zero | acceleration and rates of zero | a sensor that rests shows zeros; live ones have noise |
//! | vanished | accelerations become 0, or a field or accelerations -1, from afar | the earth has both |
//! | frozen | rates that stand still for several refreshes | noise moves their last bits |
//! | range | accelerations or rates beyond the sensor's range | sensors clip at their range |
//! | no field | a field of zero, if the configuration needs a field | the earth has a field |
//!
//! A jump of the rates is held for one burst: the sample has the rates before, as if the gyroscope
//! had not been refreshed. The next burst shows whether the jump was real: motion stays there or
//! goes on, and a wrong bit goes back.
//!
//! A rate of -1 from afar is held too, because a data line that nobody drives reads 0xFFFF. So are
//! three rates of 0 from afar, because a line that is pulled low reads 0. A board that was struck
//! comes to rest with such rates. After a transfer that failed on the bus, smaller jumps are held:
//! the disturbance of the bus may go on.
//!
//! A wrong bit in the midst of a word looks like a motion. Bursts with features that are rare in a
//! sound burst are [suspect](Evidence::Suspect). One is a single bit that changes while another
//! word of the sensor stands still: a motion and a refresh change them all. After several suspect
//! or refused bursts in a short time, the driver sets the chip up anew. A board that was struck
//! [rattles](Evidence::Rattle): its rates jump to and fro while its accelerations jump, which
//! counts less.
//!
//! A vibration crosses -1 often. The next burst tells such a crossing, which clears the suspicion,
//! from a word that comes back. A field has no range and no limit to its jumps: a magnet that
//! passes moves it as far and as fast as a wrong bit.

use super::still::Still;
use crate::{Micros, RawSample, SensorFault};

/// Greatest age of a good burst for comparisons: after a longer gap, any change is possible.
pub const STEP_AGE_US: u64 = 65_000;

/// For this time after a jump of the accelerations, rates that jump to and fro are those of a board
/// that was struck and rattles, us.
const STRUCK_US: u64 = 100_000;

/// Accelerometer, magnetometer and gyroscope words of a burst, zero for a sensor that does not run;
/// in whole machine words: small cores copy words faster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(align(4))]
pub struct Words(pub [[i16; 3]; 3]);

impl Words {
    const fn acc(&self) -> [i16; 3] {
        self.0[0]
    }

    const fn mag(&self) -> [i16; 3] {
        self.0[1]
    }

    const fn gyr(&self) -> [i16; 3] {
        self.0[2]
    }
}

/// What is sound in the bursts of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// The accelerometer's range, counts.
    pub acc_range: u16,
    /// The gyroscope's range, counts.
    pub gyr_range: u16,
    /// Words of 0 or -1 are plausible if the sensor's last good words were this near to them, for
    /// accelerometer, magnetometer and gyroscope, counts.
    pub near: [u16; 3],
    /// Largest jump of a rate that is not held, counts. Fast hands change a rate by 300 deg/s
    /// within a refresh of 10 ms, and by 450 within a refresh of 15 ms.
    pub jump: u16,
    /// Largest jump that is not held after a failed transfer, counts.
    pub disturbed_jump: u16,
    /// Accelerations that jump by more show a blow, counts.
    pub blow: u16,
    /// A board that rattles turns slower than this, counts.
    pub rattle: u16,
    /// Shortest standstill of a dead sensor's words, us.
    pub still_us: u32,
    /// Accelerometer and gyroscope run.
    pub has_acc_and_gyr: bool,
    /// Every rate has noise.
    pub has_noisy_gyr: bool,
    /// Words of zero may stand: a fusion has removed offset and noise.
    pub may_rest: bool,
    /// A field of zero is a fault.
    pub needs_mag: bool,
}

/// The judge of bursts, with its memory of earlier bursts.
#[derive(Clone, Debug, Default)]
pub struct Inspector {
    /// Last burst, good or bad.
    last: Option<Words>,
    /// Last good burst.
    good: Option<(Micros, Words)>,
    /// The last field without a wrong bit, or one that stayed.
    field: [i16; 3],
    still: Still,
    /// Rates of the last burst, if they were held back.
    held: Option<[i16; 3]>,
    /// The newest burst whose accelerations had jumped.
    struck_at: Option<Micros>,
    ones: Ones,
}

/// A burst that was accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Judged {
    /// Whether it differs from the burst before.
    pub fresh: bool,
    /// Evidence on the wire.
    pub evidence: Evidence,
    /// An earlier burst was suspect for words of -1, and motion explains them.
    pub cleared: bool,
}

/// Evidence of an accepted burst on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evidence {
    /// Nothing wrong.
    Sound,
    /// Rates alone, a third of a burst.
    Little,
    /// Rates that jump to and fro on a board that was struck.
    Rattle,
    /// It has a feature that is rare in a sound burst.
    Suspect,
}

impl Inspector {
    /// For the same chip after another set-up: its refresh rate is known.
    #[must_use]
    pub fn anew(&self) -> Self {
        Self { still: self.still.anew(), ..Self::default() }
    }

    /// Whether a burst of the rates alone can be judged: a good burst before has the other words.
    #[must_use]
    pub fn has_good(&self) -> bool {
        self.good.is_some()
    }

    /// Judges the words of a burst. [`sample`](Self::sample) has them if the burst is good.
    ///
    /// `is_whole` tells a whole burst from rates that [`complete`](Self::complete) completed.
    /// `behind_failure` says that the transfer before it failed on the bus.
    ///
    /// # Errors
    /// The fault of the first rule that the burst breaks.
    pub fn judge(
        &mut self,
        rules: &Rules,
        time: Micros,
        now: &Words,
        is_whole: bool,
        behind_failure: bool,
    ) -> Result<Judged, SensorFault> {
        let last = self.last.replace(*now);
        let fresh = last.as_ref() != Some(now);
        let (moves, jumps) = match last {
            Some(last) if rules.has_noisy_gyr => {
                let (last, now) = (last.gyr(), now.gyr());
                (last != now, moved(&last, &now, rules.disturbed_jump))
            }
            _ => (fresh, false),
        };
        self.still.look(time, moves, jumps);
        let good = self.recent(time).copied();
        // Behind a gap nothing tells whether a jump goes on.
        let held = self.held.take().zip(good);
        if let Some(fault) = self.broken_rule(rules, time, good.as_ref(), now) {
            return Err(fault);
        }
        let mut accepted = *now;
        let jump = if behind_failure { rules.disturbed_jump } else { rules.jump };
        let is_confirmed =
            held.is_some_and(|(held, before)| goes_on(&before.gyr(), &held, &now.gyr(), jump));
        if good.is_some_and(|good| moved(&good.acc(), &now.acc(), rules.blow)) {
            self.struck_at = Some(time);
        }
        let is_struck = self.struck_at.is_some_and(|at| time.since(at) <= STRUCK_US);
        let is_rattle = is_struck
            && held.is_some_and(|(held, _)| {
                held.iter().all(|rate| rate.unsigned_abs() < rules.rattle)
            });
        let jumps_back = held.is_some() && !is_confirmed && !behind_failure;
        let field_moves = last.is_some_and(|last| last.mag() != now.mag());
        let field_is_wrong =
            good.is_some() && field_moves && has_wrong_bit(&self.field, &now.mag());
        if !field_is_wrong {
            self.field = now.mag();
        }
        let mut is_suspect = jumps_back && !is_rattle;
        let mut cleared = false;
        if let Some(good) = good {
            let [acc, mag, gyr] = self.ones.look(rules, &good, now, &mut cleared);
            is_suspect |= acc || mag || gyr;
            is_suspect |= !rules.may_rest
                && (field_is_wrong
                    || has_wrong_bit(&good.acc(), &now.acc())
                    || has_wrong_bit(&good.gyr(), &now.gyr()));
            let [_, _, near] = rules.near;
            let is_zero = now.gyr() == [0; 3] && !rules.may_rest;
            let most = if is_zero { near.min(jump) } else { jump };
            if !is_confirmed && (gyr || moved(&good.gyr(), &now.gyr(), most)) {
                self.held = Some(now.gyr());
                accepted.0[2] = good.gyr();
            }
        }
        self.good = Some((time, accepted));
        let evidence = match (is_suspect, is_whole) {
            (true, _) => Evidence::Suspect,
            (false, _) if jumps_back => Evidence::Rattle,
            (false, true) => Evidence::Sound,
            (false, false) => Evidence::Little,
        };
        Ok(Judged { fresh, evidence, cleared })
    }

    /// The fault of the first rule that a burst breaks, after the last `good` burst if that is
    /// recent.
    fn broken_rule(
        &self,
        rules: &Rules,
        time: Micros,
        good: Option<&Words>,
        now: &Words,
    ) -> Option<SensorFault> {
        if all_zero(rules, now) {
            return Some(SensorFault::AllZero);
        }
        if let Some(fault) = good.and_then(|good| vanished(rules, good, now)) {
            return Some(fault);
        }
        if self.still.is_dead(time, rules.still_us) {
            return Some(SensorFault::Frozen);
        }
        out_of_range(rules, now).then_some(SensorFault::Implausible)
    }

    /// The last good burst, with the rates before if its rates are held; `None` before the first.
    #[must_use]
    pub fn sample(&self) -> Option<RawSample> {
        self.good.map(|(time, Words([acc, mag, gyr]))| RawSample { time, acc, mag, gyr })
    }

    /// Completes the words of a burst of the rates alone by the last good burst; `false` without a
    /// good burst.
    #[must_use]
    pub fn complete(&self, words: &mut Words) -> bool {
        let Some((_, Words([acc, mag, _]))) = self.good else {
            return false;
        };
        let Words([to_acc, to_mag, _]) = words;
        (*to_acc, *to_mag) = (acc, mag);
        true
    }

    /// The last good burst, if it is recent enough for a comparison at `time`.
    fn recent(&self, time: Micros) -> Option<&Words> {
        let (then, good) = self.good.as_ref()?;
        (time.since(*then) <= STEP_AGE_US).then_some(good)
    }
}

/// Whether the burst may show a sensor that measures nothing: all outputs are zero.
///
/// A magnetometer that has not measured yet also has a field of zero. Acceleration and rate suffice
/// if both are live.
fn all_zero(rules: &Rules, Words([acc, mag, gyr]): &Words) -> bool {
    *acc == [0; 3] && *gyr == [0; 3] && (rules.has_acc_and_gyr || *mag == [0; 3])
}

/// Whether the accelerations have all become 0 or -1, or the field -1, from farther than
/// [`Rules::near`]. Then the line was pulled low, or nobody drove it, or the sensor has died. A
/// magnetometer may measure nothing for a while.
fn vanished(rules: &Rules, good: &Words, now: &Words) -> Option<SensorFault> {
    let (Words([good_acc, good_mag, _]), Words([acc, mag, _])) = (good, now);
    let [acc_near, mag_near, _] = rules.near;
    let has_left =
        |good: &[i16; 3], now: &[i16; 3], near| *now == [-1; 3] && moved(good, now, near);
    if has_left(good_acc, acc, acc_near) || has_left(good_mag, mag, mag_near) {
        return Some(SensorFault::AllOnes);
    }
    let is_torn = !rules.may_rest && *acc == [0; 3] && moved(good_acc, acc, acc_near);
    is_torn.then_some(SensorFault::Torn)
}

/// Whether a word is beyond the range and a sixty-fourth of it, or the magnetic field is zero.
/// Sensors clip at their range; offsets come on top.
fn out_of_range(rules: &Rules, Words([acc, mag, gyr]): &Words) -> bool {
    let beyond = |words: &[i16; 3], range: u16| {
        let limit = range.saturating_add(range / 64);
        words.iter().any(|word| word.unsigned_abs() > limit)
    };
    beyond(acc, rules.acc_range)
        || beyond(gyr, rules.gyr_range)
        || rules.needs_mag && *mag == [0; 3]
}

/// Whether single bits of a sensor's words have changed since a good burst, one of them far above
/// their noise, while another word stands still.
fn has_wrong_bit(good: &[i16; 3], now: &[i16; 3]) -> bool {
    /// Bits 4 to 15.
    const LARGE: u32 = 0xFFF0;
    let mut pairs = good.iter().zip(now);
    let [x, y, z] = [(); 3].map(|()| pairs.next().map_or(0, |(l, n)| (l ^ n) as u16 as u32));
    let stands = x == 0 || y == 0 || z == 0;
    let is_bit = |change: u32| change & change.wrapping_sub(1) == 0;
    (x | y | z) & LARGE != 0 && stands && is_bit(x) && is_bit(y) && is_bit(z)
}

/// Words of -1: what a data line shows that nobody drives, and what motion passes.
#[derive(Clone, Debug)]
struct Ones {
    /// What each word was before it came to -1 from afar; -1 if it did not.
    from: Words,
}

impl Default for Ones {
    fn default() -> Self {
        Self { from: Words([[-1; 3]; 3]) }
    }
}

impl Ones {
    /// The sensors of which a word has come to -1 from farther than [`Rules::near`]. `crossed` says
    /// that a word went on from -1 as in motion, and that no word jumped back.
    fn look(
        &mut self,
        rules: &Rules,
        Words(good): &Words,
        Words(now): &Words,
        crossed: &mut bool,
    ) -> [bool; 3] {
        let mut returned = false;
        let mut sensors = now.iter().zip(good).zip(&mut self.from.0).zip(rules.near);
        let came = [(); 3].map(|()| {
            let Some((((now, good), from), near)) = sensors.next() else {
                return false;
            };
            let mut came = false;
            for ((&now, &good), from) in now.iter().zip(good).zip(from) {
                if now == -1 {
                    if *from == -1 && good.abs_diff(-1) > near {
                        *from = good;
                        came = true;
                    }
                } else if *from != -1 {
                    let back = (*from < -1) == (now < -1) && now.abs_diff(-1) > near;
                    returned |= back;
                    *crossed |= !back;
                    *from = -1;
                }
            }
            came
        });
        *crossed &= !returned;
        came
    }
}

/// Whether `now` is what motion makes of `held`, which came behind `before`: it is near to `held`,
/// or goes on from there. In a fast hand each refresh is a jump; from one refresh to the next the
/// jump itself changes by less than twice the limit. A wrong bit goes back: the change is twice its
/// size.
fn goes_on(before: &[i16; 3], held: &[i16; 3], now: &[i16; 3], jump: u16) -> bool {
    before.iter().zip(held).zip(now).all(|((before, held), now)| {
        let change = i32::from(*now) - 2 * i32::from(*held) + i32::from(*before);
        now.abs_diff(*held) <= jump || change.unsigned_abs() <= 2 * u32::from(jump)
    })
}

/// Whether any word has moved by more than `limit`.
fn moved(from: &[i16; 3], to: &[i16; 3], limit: u16) -> bool {
    let mut pairs = from.iter().zip(to);
    pairs.any(|(from, to)| from.abs_diff(*to) > limit)
}
