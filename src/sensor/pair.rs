//! Both sensors: one flies, the other stands by.
//!
//! They sit on one body, so that they turn alike. What the LSM6DS3 reads is turned into the BNO055's
//! axes, and the mean difference of the two is added: that is what the BNO055 would have read, its
//! offsets included. So the calibration is the BNO055's alone, and the attitude goes on when the
//! sensor that flies fails: its next sample comes from the other.
//!
//! The difference is followed while the vehicle is disarmed, and slowly in the air. A sensor whose
//! offset wanders in the air is seen by the angle that gathers between the two.

use tvc_imu::{Bursts, Imu, Micros, Next, RawSample, Refresh, Sample, SensorFault, Transferred};

use super::{GYR_COUNTS, Kind, bno055, lsm6ds3};
use crate::mount::Relative;

/// Greatest age of a sample of the sensor that stands by, us: two turns of four ticks.
const STANDBY_AGE_US: u64 = 60_000;
/// Comparisons before the difference is known: 3 s.
const KNOWN: u16 = 110;
/// The difference follows by this share, as a negative power of two: a second on the ground, two
/// minutes in the air.
const GROUND_LOG2: u32 = 5;
/// See [`GROUND_LOG2`].
const AIR_LOG2: u32 = 12;
/// Bits of the difference behind the point.
const FINER: u32 = 12;
/// The angle between the two forgets by this share: 1.7 s.
const FORGET_LOG2: u32 = 6;
/// Largest angle between the two: 2.5 deg, in counts times comparisons, of which there are 37 a
/// second.
const ANGLE_LIMIT: i32 = (2.5 * GYR_COUNTS * 37.0) as i32;

/// The transfer that was asked for last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Asked {
    /// By the driver of the sensor that flies.
    #[default]
    Flying,
    /// By the driver of the other.
    Standby,
    /// A burst of the other, and when it began.
    Burst(Micros),
}

/// Differences of the BNO055's words from the LSM6DS3's, times `2^FINER`.
type Differences = [[i32; 3]; 2];

/// Both drivers.
#[derive(Clone, Debug)]
pub struct Pair {
    bno055: bno055::Driver,
    lsm6ds3: lsm6ds3::Driver,
    /// The LSM6DS3 flies.
    onboard_flies: bool,
    relative: Relative,
    /// How both sit, deg.
    mounts_deg: [[f32; 3]; 2],
    asked: Asked,
    /// Ticks so far, for the turns of the drivers.
    tick: u8,
    /// The other's burst of this tick has been made.
    burst_made: bool,
    /// The newest sample of the other, in the BNO055's axes and units, without the difference.
    standby: Option<RawSample>,
    /// The same, until it has been compared.
    fresh: Option<RawSample>,
    differences: Differences,
    compared: u16,
    /// Angles between the two, counts times samples.
    angles: [i32; 3],
    holds: bool,
    refresh: Refresh,
}

impl Pair {
    /// Of sensors that sit on the body by these angles: roll, pitch and yaw of each, deg.
    pub(super) fn new([bno055_deg, lsm6ds3_deg]: [[f32; 3]; 2]) -> Self {
        Self {
            bno055: bno055::new(),
            lsm6ds3: lsm6ds3::new(),
            onboard_flies: false,
            relative: Relative::new(lsm6ds3_deg, bno055_deg),
            mounts_deg: [bno055_deg, lsm6ds3_deg],
            asked: Asked::Flying,
            tick: 0,
            burst_made: false,
            standby: None,
            fresh: None,
            differences: [[0; 3]; 2],
            compared: 0,
            angles: [0; 3],
            holds: false,
            refresh: Refresh::default(),
        }
    }

    pub(super) fn mounts_deg(&self) -> [[f32; 3]; 2] {
        self.mounts_deg
    }

    /// The vehicle is armed: the difference is followed slowly.
    pub(super) fn hold_offsets(&mut self, holds: bool) {
        self.holds = holds;
    }

    /// The transfer that was asked for last is with the LSM6DS3.
    pub(super) fn asks_onboard(&self) -> bool {
        self.onboard_flies == (self.asked == Asked::Flying)
    }

    /// The address of that transfer.
    pub(super) fn address(&self) -> u8 {
        if self.asks_onboard() {
            self.lsm6ds3.bursts().address
        } else {
            self.bno055.bursts().address
        }
    }

    fn drivers(&mut self) -> (&mut dyn Imu, &mut dyn Imu) {
        if self.onboard_flies {
            (&mut self.lsm6ds3, &mut self.bno055)
        } else {
            (&mut self.bno055, &mut self.lsm6ds3)
        }
    }

    /// The next transfer. There is time for one behind each burst of the sensor that flies: its
    /// driver has every second tick, and the other one's burst and driver the rest.
    fn ask(&mut self, now: Micros) -> (Next, Asked) {
        let (tick, burst_made) = (self.tick & 3, self.burst_made);
        let (flying, other) = self.drivers();
        if flying.is_sampling() {
            let burst = other.bursts().whole.filter(|_| tick == 1 && !burst_made);
            let next = match (burst, tick) {
                (Some(burst), _) => return (Next::Transfer(burst), Asked::Burst(now)),
                (None, 1) => return (Next::Sample, Asked::Flying),
                (None, 3) => other.next(now),
                _ => return (flying.next(now), Asked::Flying),
            };
            return match next {
                Next::Transfer(_) => (next, Asked::Standby),
                Next::Wait(_) | Next::Sample => (Next::Sample, Asked::Flying),
            };
        }
        let next = flying.next(now);
        if !matches!(next, Next::Transfer(_))
            && let Next::Transfer(transfer) = other.next(now)
        {
            return (Next::Transfer(transfer), Asked::Standby);
        }
        (next, Asked::Flying)
    }

    fn flying(&self) -> &dyn Imu {
        if self.onboard_flies { &self.lsm6ds3 } else { &self.bno055 }
    }

    /// A sample of the LSM6DS3 along the BNO055's axes.
    fn turned(&self, raw: RawSample) -> RawSample {
        let [acc, gyr] = [&raw.acc, &raw.gyr].map(|words| self.relative.turn(words));
        RawSample { acc, gyr, ..raw }
    }

    /// What the BNO055 would have read where the LSM6DS3 has read this, along its axes.
    fn with_differences(&self, mut raw: RawSample) -> RawSample {
        let [acc, gyr] = &self.differences;
        for (words, differences) in [(&mut raw.acc, acc), (&mut raw.gyr, gyr)] {
            for (word, difference) in words.iter_mut().zip(differences) {
                let sum = i32::from(*word) + ((difference + (1 << (FINER - 1))) >> FINER);
                *word = sum.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
            }
        }
        raw
    }

    /// Follows the differences of two samples, and the angle that gathers between them.
    ///
    /// # Errors
    /// The two turn differently.
    fn compare(&mut self, bno055: &RawSample, lsm6ds3: &RawSample) -> Result<(), SensorFault> {
        let log2 = if self.holds { AIR_LOG2 } else { GROUND_LOG2 };
        self.compared = (self.compared + 1).min(KNOWN);
        let [acc, gyr] = &mut self.differences;
        let pairs = [(&bno055.acc, &lsm6ds3.acc, acc), (&bno055.gyr, &lsm6ds3.gyr, gyr)];
        let mut errors = [0; 3];
        for (of_bno055, of_lsm6ds3, differences) in pairs {
            let both = of_bno055.iter().zip(of_lsm6ds3).zip(differences).zip(&mut errors);
            for (((bno055, lsm6ds3), difference), error) in both {
                let now = (i32::from(*bno055) - i32::from(*lsm6ds3)) << FINER;
                *error = (now - *difference) >> FINER;
                *difference += (now - *difference) >> log2;
            }
        }
        let mut differ = false;
        // The errors left are those of the rates.
        for (angle, error) in self.angles.iter_mut().zip(errors) {
            *angle += error - (*angle >> FORGET_LOG2);
            differ |= self.holds && angle.abs() > ANGLE_LIMIT;
            if !self.holds {
                *angle = 0;
            }
        }
        if differ { Err(SensorFault::Disagreement) } else { Ok(()) }
    }

    /// Takes a sample of the sensor that stands by.
    fn stand_by(&mut self, started: Micros, outcome: Transferred<'_>) {
        let (_, other) = self.drivers();
        let Ok(sample) = other.sample(started, outcome) else { return };
        let raw = if self.onboard_flies { sample.raw } else { self.turned(sample.raw) };
        (self.standby, self.fresh) = (Some(raw), Some(raw));
    }

    /// The sample of the sensor that flies, as of the BNO055.
    fn judged(&mut self, sampled: Result<Sample, SensorFault>) -> Result<RawSample, SensorFault> {
        let raw = sampled?.raw;
        let standby = self.fresh.take();
        if self.onboard_flies {
            let turned = self.turned(raw);
            if let Some(bno055) = standby {
                self.compare(&bno055, &turned)?;
                if !self.holds {
                    // On the ground the BNO055 flies again as soon as it samples.
                    self.fly(false);
                }
            }
            return Ok(self.with_differences(turned));
        }
        if let Some(lsm6ds3) = standby {
            self.compare(&raw, &lsm6ds3)?;
        }
        Ok(raw)
    }

    /// The sensor that flies has failed: whether the other takes over from the next tick on.
    fn takes_over(&mut self, now: Micros, fault: SensorFault) -> bool {
        let is_recent = self.standby.is_some_and(|raw| now.since(raw.time) <= STANDBY_AGE_US);
        let takes = is_recent && self.compared >= KNOWN && fault != SensorFault::Disagreement;
        if takes {
            self.fly(!self.onboard_flies);
        }
        takes
    }

    fn fly(&mut self, onboard: bool) {
        self.onboard_flies = onboard;
        self.standby = None;
        let kind = if onboard { Kind::Lsm6ds3 } else { Kind::Bno055 };
        self.refresh = Refresh::with_period(kind.description().refresh_us);
    }
}

impl Imu for Pair {
    fn next(&mut self, now: Micros) -> Next {
        let (next, asked) = self.ask(now);
        self.asked = asked;
        next
    }

    fn complete(&mut self, now: Micros, outcome: Transferred<'_>) {
        match self.asked {
            Asked::Flying => self.drivers().0.complete(now, outcome),
            Asked::Standby => self.drivers().1.complete(now, outcome),
            Asked::Burst(started) => {
                self.burst_made = true;
                self.stand_by(started, outcome);
            }
        }
    }

    fn is_sampling(&self) -> bool {
        self.flying().is_sampling()
    }

    fn bursts(&self) -> Bursts {
        self.flying().bursts()
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        (self.tick, self.burst_made) = (self.tick.wrapping_add(1), false);
        let sampled = self.drivers().0.sample(time, outcome);
        match self.judged(sampled) {
            Ok(raw) => Ok(self.refresh.read(raw)),
            // The next tick has a sample again: what ends the trust in one sensor does not end it in
            // both.
            Err(fault) => Err(if self.takes_over(time, fault) { SensorFault::Late } else { fault }),
        }
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        self.drivers().0.overdue(time, outcome);
    }

    fn missed(&mut self) -> SensorFault {
        (self.tick, self.burst_made) = (self.tick.wrapping_add(1), false);
        self.drivers().0.missed()
    }

    fn fault(&self) -> Option<SensorFault> {
        self.flying().fault()
    }

    fn failed_setups(&self) -> u32 {
        self.flying().failed_setups()
    }

    fn fresh(&self) -> u32 {
        self.flying().fresh()
    }

    fn refresh(&self) -> &Refresh {
        &self.refresh
    }
}
