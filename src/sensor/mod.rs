//! The sensors of this vehicle, and the choice between them.
//!
//! Only this folder names a sensor. All sensors give their samples in the same units,
//! [`SCALE`]: the rest of the firmware, calibrations and logs do not depend on the choice.

mod bno055;
mod lsm6ds3;
mod standby;

use crate::params::Params;
use tvc_imu::{
    Bursts, Description, Imu, Micros, Next, RawSample, Refresh, Report, Sample, Scale, SensorFault,
    Transfer, Transferred,
};

use standby::{Standby, Turn};

/// A sensor that can be chosen, by the value of `SENSOR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// A BNO055 on the bus of the header.
    #[default]
    Bno055 = 0,
    /// The LSM6DS3 of the Nano 33 IoT.
    Lsm6ds3 = 1,
    /// The BNO055, with the LSM6DS3 standing by.
    Both = 2,
}

impl Kind {
    /// All, in the order of the parameter's values from 0 on, with the names that commands use.
    pub const ALL: [(Self, &str); 3] =
        [(Self::Bno055, "bno055"), (Self::Lsm6ds3, "lsm6ds3"), (Self::Both, "both")];

    /// The name that commands use.
    #[must_use]
    pub fn name(self) -> &'static str {
        let mut kinds = Self::ALL.iter();
        kinds.find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }

    /// The value of `SENSOR`.
    #[must_use]
    pub const fn value(self) -> f32 {
        self as u8 as f32
    }

    /// The kind with this value of `SENSOR`.
    #[must_use]
    pub fn of(value: f32) -> Self {
        let mut kinds = Self::ALL.iter().map(|(kind, _)| *kind);
        kinds.find(|kind| kind.value() == value).unwrap_or_default()
    }

    /// A sample of its chip's counts in the units of [`SCALE`].
    #[must_use]
    pub fn in_common_units(self, raw: RawSample) -> RawSample {
        match self {
            Self::Bno055 | Self::Both => raw,
            Self::Lsm6ds3 => lsm6ds3::convert(raw),
        }
    }

    /// What it is like.
    #[must_use]
    pub const fn description(self) -> &'static Description {
        match self {
            Self::Bno055 | Self::Both => &bno055::DESCRIPTION,
            Self::Lsm6ds3 => &lsm6ds3::DESCRIPTION,
        }
    }
}

/// How the sensors do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorStatus {
    /// Bursts with new words since the start, modulo 2^32.
    pub fresh: u32,
    /// Whether the sensor that stands by could fly from the next tick on; `None` if there is none.
    pub standby: Option<bool>,
}

/// The sensors of this vehicle: one flies, and another may stand by.
#[derive(Clone, Debug)]
pub struct Sensor {
    bno055: bno055::Driver,
    lsm6ds3: lsm6ds3::Driver,
    /// The LSM6DS3 flies.
    onboard_flies: bool,
    /// There is a sensor that stands by.
    standby: Option<Standby>,
    /// Whose transfer was asked for last.
    asked: Asked,
}

/// The transfer that was asked for last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Asked {
    /// By the driver of the sensor that flies.
    #[default]
    Flying,
    /// By the driver of the other.
    Other,
    /// A burst of the other, and when it began.
    Burst(Micros),
}

impl Sensor {
    /// Drivers that will set their sensors up, as the parameters choose them.
    #[must_use]
    pub fn new(params: &Params) -> Self {
        let kind = params.sensor_kind();
        Self {
            bno055: bno055::new(),
            lsm6ds3: lsm6ds3::new(),
            onboard_flies: kind == Kind::Lsm6ds3,
            standby: (kind == Kind::Both).then(|| Standby::new(mounts_deg(params))),
            asked: Asked::Flying,
        }
    }

    /// Whether the parameters choose these sensors.
    #[must_use]
    pub fn is_as(&self, params: &Params) -> bool {
        let kind = params.sensor_kind();
        match &self.standby {
            Some(standby) => kind == Kind::Both && standby.mounts_deg() == mounts_deg(params),
            None => kind != Kind::Both && self.onboard_flies == (kind == Kind::Lsm6ds3),
        }
    }

    /// The sensor whose transfer [`Imu::next`] gave last.
    #[must_use]
    pub fn asked(&self) -> Kind {
        if self.onboard_flies == (self.asked == Asked::Flying) {
            Kind::Lsm6ds3
        } else {
            Kind::Bno055
        }
    }

    /// The 7-bit address of the transfer that [`Imu::next`] gave last.
    #[must_use]
    pub fn address(&self) -> u8 {
        match self.asked {
            Asked::Flying => self.flying().bursts().address,
            Asked::Other | Asked::Burst(_) => self.of(!self.onboard_flies).bursts().address,
        }
    }

    /// How the sensors do at `now`.
    #[must_use]
    pub fn status(&self, now: Micros) -> SensorStatus {
        let standby = self.standby.as_ref().map(|standby| standby.is_ready(now));
        SensorStatus { fresh: self.health().fresh, standby }
    }

    /// While the vehicle is armed, what two sensors differ by stays.
    pub fn hold_offsets(&mut self, holds: bool) {
        if let Some(standby) = &mut self.standby {
            standby.holds = holds;
        }
    }

    fn of(&self, onboard: bool) -> &dyn Imu {
        if onboard { &self.lsm6ds3 } else { &self.bno055 }
    }

    fn of_mut(&mut self, onboard: bool) -> &mut dyn Imu {
        if onboard { &mut self.lsm6ds3 } else { &mut self.bno055 }
    }

    fn flying(&self) -> &dyn Imu {
        self.of(self.onboard_flies)
    }

    fn flying_mut(&mut self) -> &mut dyn Imu {
        self.of_mut(self.onboard_flies)
    }

    fn other_mut(&mut self) -> &mut dyn Imu {
        self.of_mut(!self.onboard_flies)
    }

    /// What the other sensor's driver asks for, with both.
    fn other(&mut self, now: Micros) -> Option<Transfer> {
        self.standby.as_ref()?;
        match self.other_mut().next(now) {
            Next::Transfer(transfer) => Some(transfer),
            Next::Wait(_) | Next::Sample => None,
        }
    }

    /// The next transfer. There is time for one behind each burst of the sensor that flies.
    fn ask(&mut self, now: Micros) -> (Next, Asked) {
        let turn = match &self.standby {
            Some(standby) if self.is_sampling() => standby.turn(),
            _ => Turn::Flying,
        };
        match turn {
            Turn::Burst => match self.of(!self.onboard_flies).bursts().whole {
                Some(burst) => (Next::Transfer(burst), Asked::Burst(now)),
                None => (Next::Sample, Asked::Flying),
            },
            Turn::Other => match self.other(now) {
                Some(transfer) => (Next::Transfer(transfer), Asked::Other),
                None => (Next::Sample, Asked::Flying),
            },
            Turn::Flying => match self.flying_mut().next(now) {
                // Its set-up pauses, and leaves time to the other.
                Next::Wait(until) => match self.other(now) {
                    Some(transfer) => (Next::Transfer(transfer), Asked::Other),
                    None => (Next::Wait(until), Asked::Flying),
                },
                next => (next, Asked::Flying),
            },
        }
    }

    /// Takes a burst of the sensor that stands by.
    fn stand_by(&mut self, started: Micros, outcome: Transferred<'_>) {
        let onboard_flies = self.onboard_flies;
        let sampled = self.other_mut().sample(started, outcome);
        if let Some(standby) = &mut self.standby {
            standby.take(sampled.ok().map(|sample| sample.raw), !onboard_flies);
        }
    }

    /// What a sensor that failed leaves: with another that is ready, the next tick has a sample
    /// again, of the other.
    fn failed(&mut self, now: Micros, fault: SensorFault) -> SensorFault {
        match &mut self.standby {
            // What ends the trust in one sensor does not end it in both.
            Some(standby) if standby.is_ready(now) => {
                self.onboard_flies = !self.onboard_flies;
                standby.change(self.onboard_flies);
                SensorFault::Late
            }
            _ => fault,
        }
    }
}

/// How both sensors sit: roll, pitch and yaw of each, deg.
fn mounts_deg(params: &Params) -> [[f32; 3]; 2] {
    [params.mount_deg(), params.standby_mount_deg()]
}

impl Imu for Sensor {
    fn next(&mut self, now: Micros) -> Next {
        let (next, asked) = self.ask(now);
        self.asked = asked;
        next
    }

    fn complete(&mut self, now: Micros, outcome: Transferred<'_>) {
        match self.asked {
            Asked::Flying => self.flying_mut().complete(now, outcome),
            Asked::Other => self.other_mut().complete(now, outcome),
            Asked::Burst(started) => self.stand_by(started, outcome),
        }
    }

    fn is_sampling(&self) -> bool {
        self.flying().is_sampling()
    }

    fn bursts(&self) -> Bursts {
        self.flying().bursts()
    }

    fn sample(&mut self, time: Micros, outcome: Transferred<'_>) -> Result<Sample, SensorFault> {
        let sampled = self.flying_mut().sample(time, outcome);
        let Some(standby) = &mut self.standby else { return sampled };
        standby.tick();
        match sampled {
            Ok(sample) => {
                let judged = standby.join(sample.raw, self.onboard_flies);
                if self.onboard_flies && standby.is_matched() {
                    // On the ground the BNO055 flies as soon as it samples.
                    self.onboard_flies = false;
                    standby.change(false);
                }
                judged
            }
            Err(fault) => Err(self.failed(time, fault)),
        }
    }

    fn overdue(&mut self, time: Micros, outcome: Transferred<'_>) {
        self.flying_mut().overdue(time, outcome);
    }

    fn missed(&mut self) -> SensorFault {
        if let Some(standby) = &mut self.standby {
            standby.tick();
        }
        self.flying_mut().missed()
    }

    fn report(&self) -> &Report {
        self.flying().report()
    }

    fn report_mut(&mut self) -> &mut Report {
        self.flying_mut().report_mut()
    }

    fn refresh(&self) -> &Refresh {
        match &self.standby {
            Some(standby) => standby.refresh(),
            None => self.flying().refresh(),
        }
    }
}

/// Units of a count: those of the BNO055.
pub const SCALE: Scale = bno055::DESCRIPTION.scale;

/// The smallest range of an accelerometer, counts.
pub const ACC_RANGE: u16 = bno055::DESCRIPTION.acc_range;

/// How long a sensor stretches a byte at most, us, as the vehicle assumes until it has measured it.
pub const STRETCH_US: u32 = bno055::DESCRIPTION.stretch_us;

/// Counts of 1 m/s2.
pub const ACC_COUNTS: f32 = 1.0 / SCALE.acc_m_s2;
/// Counts of 1 deg/s.
pub const GYR_COUNTS: f32 = core::f32::consts::PI / 180.0 / SCALE.gyr_rad_s;
/// Counts of 1 uT.
pub const MAG_COUNTS: f32 = 1.0 / SCALE.mag_ut;

/// Standard deviation of the gyroscope's offset behind a rest of half a minute, deg/s: what its
/// noise leaves, and its wandering since (6.5 deg/h).
pub const GYR_OFFSET_SD_DEG_S: f32 = 0.01;

/// Noise of the gyroscope, deg/s/sqrt(Hz) (data sheet, table 0-2).
pub const GYR_NOISE_DEG_RTS: f32 = 0.014;
