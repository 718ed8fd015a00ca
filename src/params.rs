//! The parameters: one table of name, unit, range, default and meaning, from which everything else
//! is made.
//!
//! A parameter is added by one entry of the `parameters!` call in `params/table.rs`. Names are at
//! most 16 characters (the width of MAVLink's `param_id`), values are `f32`. A shipped default
//! outside its own range does not compile.

mod table;

use core::fmt;

use tvc_fusion::fixed::AnyGains;
use tvc_fusion::{ComplementaryGains, MadgwickGains, MahonyGains, VqfGains};
use tvc_imu::Refresh;

use crate::axis::Axis;
use crate::config::STRETCH_MAX_US;
use crate::sensor::Kind;
use crate::ticks::{TickPlan, Timing};

use table::COUNT;
pub(crate) use table::Place;
pub use table::{Change, DESCRIPTIONS, Description, Info, Range, TABLE};

/// What is known of the way in which a rudder answers, by `SRV_POLARITY` and `SRV2_POLARITY`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarity {
    /// Nobody has seen it: the drone is not armed.
    Unchecked,
    /// Somebody has seen that it answers a tilt the right way.
    Checked,
    /// Somebody looks: in standby the rudder answers the tilt.
    Watched,
}

/// How a servo is fitted to its rudder: what may differ from one servo of a vehicle to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitting {
    /// Pulse at which the rudder has no effect, us.
    pub centre_us: f32,
    /// Servo angle at which the rudder rests, deg.
    pub hold_deg: f32,
    /// 1: a longer pulse turns the crank to positive angles; -1: reversed.
    pub direction: f32,
    /// Shortest pulse that control commands, us.
    pub min_us: f32,
    /// The longest, us.
    pub max_us: f32,
}

/// The attitude filter, by `FUSE_FILTER`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterKind {
    /// VQF class.
    Vqf,
    /// Mahony's.
    Mahony,
    /// Madgwick's.
    Madgwick,
    /// Complementary.
    Complementary,
}

impl FilterKind {
    /// All, in the order of the parameter's values from 0 on, with the names that commands use.
    pub const ALL: [(Self, &str); 4] = [
        (Self::Vqf, "vqf"),
        (Self::Mahony, "mahony"),
        (Self::Madgwick, "madgwick"),
        (Self::Complementary, "complementary"),
    ];

    /// The parameter's value.
    pub const fn value(self) -> f32 {
        self as u8 as f32
    }

    /// The filter of the image, with its default gains.
    pub(crate) fn gains(self) -> AnyGains {
        match self {
            Self::Vqf => AnyGains::Vqf(VqfGains::default()),
            Self::Mahony => AnyGains::Mahony(MahonyGains::default()),
            Self::Madgwick => AnyGains::Madgwick(MadgwickGains::default()),
            Self::Complementary => AnyGains::Complementary(ComplementaryGains::default()),
        }
    }
}

/// Why a parameter keeps its old value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParamError {
    /// No parameter has this name or index.
    Unknown,
    /// The value is not in the range of this parameter.
    OutOfRange(&'static Info),
    /// `PID_LAW` 1 is a law of older images.
    OldLaw,
    /// The parameter cannot change while the drone is armed.
    Armed {
        /// Its name.
        name: &'static str,
    },
    /// The parameters cannot change as a whole while the drone is armed.
    ArmedAll,
    /// Nobody has looked which way the rudder answers: `SRV_POLARITY` becomes 1 from 2 alone.
    Unseen {
        /// Its name.
        name: &'static str,
    },
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParamError::Unknown => f.write_str("no such parameter"),
            ParamError::OutOfRange(info) => {
                f.write_str(info.name)?;
                write!(f, " must be {}", info.range)
            }
            ParamError::OldLaw => f.write_str("PID_LAW 1 is gone: 2 is its successor"),
            ParamError::Armed { name } => {
                f.write_str(name)?;
                f.write_str(": disarm first")
            }
            ParamError::ArmedAll => f.write_str("parameters: disarm first"),
            ParamError::Unseen { name } => {
                f.write_str(name)?;
                f.write_str(": set 2 and look at the rudder first")
            }
        }
    }
}

/// The value of every parameter. Always within range.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    values: [f32; COUNT],
}

/// The whole part of a number. A conversion takes 40 bytes, so that all go through this one.
#[inline(never)]
pub(crate) fn whole(value: f32) -> i32 {
    value as i32
}

impl Params {
    /// The accelerometer's offset, m/s2.
    pub fn cal_acc_offset(&self) -> [f32; 3] {
        [self.cal_acc_ox(), self.cal_acc_oy(), self.cal_acc_oz()]
    }

    /// The accelerometer's scale, applied after the offset.
    pub fn cal_acc_scale(&self) -> [f32; 3] {
        [self.cal_acc_sx(), self.cal_acc_sy(), self.cal_acc_sz()]
    }

    /// The gyroscope's offset, deg/s.
    pub fn cal_gyr_offset(&self) -> [f32; 3] {
        [self.cal_gyr_ox(), self.cal_gyr_oy(), self.cal_gyr_oz()]
    }

    /// The magnetometer's hard iron, uT.
    pub fn cal_mag_offset(&self) -> [f32; 3] {
        [self.cal_mag_ox(), self.cal_mag_oy(), self.cal_mag_oz()]
    }

    /// The magnetometer's soft iron, undone: a matrix applied after the offset, row by row.
    pub fn cal_mag_matrix(&self) -> [[f32; 3]; 3] {
        [
            [self.cal_mag_xx(), self.cal_mag_xy(), self.cal_mag_xz()],
            [self.cal_mag_yx(), self.cal_mag_yy(), self.cal_mag_yz()],
            [self.cal_mag_zx(), self.cal_mag_zy(), self.cal_mag_zz()],
        ]
    }

    /// The axes that are steered.
    pub fn axes(&self) -> &'static [Axis] {
        const ONE: u32 = 1.0_f32.to_bits();
        match self.axes_steered().to_bits() {
            ONE => &[Axis::Pitch],
            _ => &Axis::ALL,
        }
    }

    /// The angle that an axis is to hold, deg.
    pub fn setpoint_deg(&self, axis: Axis) -> f32 {
        match axis {
            Axis::Pitch => self.pitch_set_deg(),
            Axis::Roll => self.roll_set_deg(),
        }
    }

    /// How an axis' servo is fitted to its rudder.
    pub fn fitting(&self, axis: Axis) -> Fitting {
        match axis {
            Axis::Pitch => Fitting {
                centre_us: self.srv_centre_us(),
                hold_deg: self.srv_hold_deg(),
                direction: self.srv_dir(),
                min_us: self.srv_min_us(),
                max_us: self.srv_max_us(),
            },
            Axis::Roll => Fitting {
                centre_us: self.srv2_centre_us(),
                hold_deg: self.srv2_hold_deg(),
                direction: self.srv2_dir(),
                min_us: self.srv2_min_us(),
                max_us: self.srv2_max_us(),
            },
        }
    }

    /// What is known of the way in which an axis' rudder answers.
    pub fn polarity(&self, axis: Axis) -> Polarity {
        // By their bits: one comparison of words each, where floats take a call.
        const CHECKED: u32 = 1.0_f32.to_bits();
        const WATCHED: u32 = 2.0_f32.to_bits();
        let polarity = match axis {
            Axis::Pitch => self.srv_polarity(),
            Axis::Roll => self.srv2_polarity(),
        };
        match polarity.to_bits() {
            CHECKED => Polarity::Checked,
            WATCHED => Polarity::Watched,
            _ => Polarity::Unchecked,
        }
    }

    /// The values from a place on, in the order of the table.
    #[cfg(feature = "free-flight")]
    pub(crate) fn values_from(&self, place: Place) -> &[f32] {
        self.values.split_at(place as usize).1
    }

    /// The attitude filter.
    pub fn filter(&self) -> FilterKind {
        // By their bits: one comparison of words each, where floats take a call.
        let value = self.fuse_filter().to_bits();
        let mut kinds = FilterKind::ALL.iter().map(|(kind, _)| *kind);
        kinds.find(|kind| kind.value().to_bits() == value).unwrap_or(FilterKind::Vqf)
    }

    /// Index of `I2C_STRETCH_US`.
    pub const STRETCH: usize = Place::i2c_stretch_us as usize;

    /// Index of `CLK_FINE`.
    pub const CLOCK: usize = Place::clk_fine as usize;

    /// Indices of `SRV_POLARITY` and `SRV2_POLARITY`.
    pub const POLARITIES: [usize; Axis::COUNT] =
        [Place::srv_polarity as usize, Place::srv2_polarity as usize];

    /// The rudders may answer another way now.
    pub(crate) fn forget_polarity(&mut self) {
        for place in Self::POLARITIES {
            if let Some(value) = self.values.get_mut(place) {
                *value = 0.0;
            }
        }
    }

    /// A number that changes with any value.
    pub(crate) fn digest(&self) -> i32 {
        let values = self.values.iter();
        values.fold(0, |sum: i32, value| sum.rotate_left(1) ^ value.to_bits() as i32)
    }

    /// Number of parameters.
    pub const fn count() -> usize {
        COUNT
    }

    /// Row and value by index.
    pub fn by_index(&self, index: usize) -> Option<(&'static Info, f32)> {
        Some((TABLE.get(index)?, *self.values.get(index)?))
    }

    /// How the sensor sits on the body: roll, pitch and yaw, deg.
    pub fn mount_deg(&self) -> [f32; 3] {
        [self.mnt_roll_deg(), self.mnt_pitch_deg(), self.mnt_yaw_deg()]
    }

    /// The same of the sensor that stands by.
    pub fn standby_mount_deg(&self) -> [f32; 3] {
        [self.mnt2_roll_deg(), self.mnt2_pitch_deg(), self.mnt2_yaw_deg()]
    }

    /// The sensor that flies.
    pub fn sensor_kind(&self) -> Kind {
        Kind::of(self.sensor())
    }

    /// The refreshes of that sensor, before its first reading.
    pub fn refresh(&self) -> Refresh {
        Refresh::with_period(self.sensor_kind().description().refresh_us)
    }

    /// What the timing of the loop follows from.
    // Not inlined: it is called from several places.
    #[inline(never)]
    pub fn timing(&self) -> Timing {
        Timing {
            sensor: self.sensor_kind(),
            frame_hz: whole(self.srv_rate_hz()) as u32,
            i2c_khz: whole(self.i2c_khz()) as u32,
            stretch_us: whole(self.i2c_stretch_us()) as u32,
        }
    }

    /// FINE of the DFLL, 0 to 1023, if a USB host has disciplined it once.
    pub fn clock_fine(&self) -> Option<u16> {
        let fine = self.clk_fine();
        (fine >= 0.0).then_some(whole(fine) as u16)
    }

    /// USB has disciplined the clock to this FINE.
    #[allow(clippy::indexing_slicing, reason = "there is a value for every place")]
    pub(crate) fn set_clock_fine(&mut self, fine: u16) {
        self.values[Self::CLOCK] = f32::from(fine.min(1023));
    }

    /// The sensor stretches a byte for so long; more than the parameter holds is its largest value.
    #[allow(clippy::indexing_slicing, reason = "there is a value for every place")]
    pub(crate) fn set_stretch(&mut self, us: u32) {
        self.values[Self::STRETCH] = us.min(STRETCH_MAX_US) as f32;
    }

    /// Time from one control step to the next, us, rounded down.
    pub fn control_period_us(&self) -> u32 {
        let timing = self.timing();
        TickPlan::new(&timing).period_us(timing.frame_hz)
    }

    /// Value by name.
    pub fn value(&self, name: &str) -> Option<f32> {
        self.by_index(Self::index_of(name)?).map(|(_, value)| value)
    }

    /// Index of a name.
    pub fn index_of(name: &str) -> Option<usize> {
        TABLE.iter().position(|info| info.name == name)
    }

    /// Row of a name.
    pub fn info(name: &str) -> Option<&'static Info> {
        TABLE.get(Self::index_of(name)?)
    }

    /// Change a value.
    ///
    /// # Errors
    /// [`ParamError::Unknown`] or [`ParamError::OutOfRange`]; the old value stays.
    pub fn set(&mut self, name: &str, value: f32) -> Result<&'static Info, ParamError> {
        self.set_row(|info| info.name == name, value)
    }

    /// Change a value by its row's [`Info::id`].
    ///
    /// # Errors
    /// As [`Params::set`].
    pub fn set_by_id(&mut self, id: u32, value: f32) -> Result<&'static Info, ParamError> {
        self.set_row(|info| info.id == id, value)
    }

    /// Rows and their values, in the order of their indices.
    pub fn iter(&self) -> impl Iterator<Item = (&'static Info, f32)> {
        TABLE.iter().zip(self.values)
    }

    fn set_row(
        &mut self,
        wanted: impl Fn(&Info) -> bool,
        value: f32,
    ) -> Result<&'static Info, ParamError> {
        let mut rows = TABLE.iter().zip(&mut self.values);
        let (info, slot) = rows.find(|(info, _)| wanted(info)).ok_or(ParamError::Unknown)?;
        if !info.range.contains(value) {
            const LAW: &str = "PID_LAW";
            return Err(if info.name == LAW && value == 1.0 {
                ParamError::OldLaw
            } else {
                ParamError::OutOfRange(info)
            });
        }
        *slot = value;
        Ok(info)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn every_row_is_reachable_by_name_and_index_and_starts_at_its_default() {
        let params = Params::default();
        for (index, info) in TABLE.iter().enumerate() {
            assert_eq!(Params::index_of(info.name), Some(index), "{}", info.name);
            let (row, value) = params.by_index(index).unwrap();
            assert_eq!((row.name, value), (info.name, info.default));
            assert!(info.range.contains(info.default));
            assert!(!DESCRIPTIONS[index].meaning.is_empty());
        }
        assert_eq!(params.by_index(TABLE.len()).map(|(info, _)| info.name), None);
    }

    #[test]
    fn a_value_outside_the_range_is_refused_by_name_and_the_old_one_stays() {
        let mut params = Params::default();
        let refused = params.set("PID_KP", 10.5).unwrap_err();
        assert_eq!(refused.to_string(), "PID_KP must be 0 to 10");
        assert_eq!(params.pid_kp(), Params::default().pid_kp());
        assert!(params.set("PID_KP", f32::NAN).is_err());
        assert!(params.set("PID_KP", f32::INFINITY).is_err());
        assert!(params.set("PID_KP", 10.0).is_ok());
        assert_eq!(params.pid_kp(), 10.0);
    }

    #[test]
    fn a_choice_takes_only_what_it_lists() {
        let mut params = Params::default();
        for rate in [50.0, 100.0, 200.0, 300.0, 333.0] {
            assert!(params.set("SRV_RATE_HZ", rate).is_ok());
        }
        let refused = params.set("SRV_RATE_HZ", 150.0).unwrap_err();
        assert_eq!(refused.to_string(), "SRV_RATE_HZ must be 50, 100, 200, 300, 333");
        assert_eq!(params.srv_rate_hz(), 333.0);
    }

    #[test]
    fn an_unknown_name_is_an_error() {
        assert_eq!(Params::default().set("PID_KQ", 1.0).err(), Some(ParamError::Unknown));
    }

    #[test]
    fn the_pulse_limits_never_cross_the_centre_nor_leave_the_hard_range() {
        let bounds = |name| match TABLE[Params::index_of(name).unwrap()].range {
            Range::Between(low, high) => (low, high),
            Range::OneOf(_) => unreachable!(),
        };
        let (min, centre, max) =
            (bounds("SRV_MIN_US"), bounds("SRV_CENTRE_US"), bounds("SRV_MAX_US"));
        assert!(min.0 == 853.0 && min.1 < centre.0 && centre.1 < max.0 && max.1 == 2193.0);
    }
}
