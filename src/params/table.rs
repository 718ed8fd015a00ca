//! The table: one entry a parameter, from which accessors, defaults, checks and what hosts are told
//! are made.

use core::fmt;

use Range::{Between, OneOf};

use super::Params;
use crate::config::{PULSE_MAX_US, PULSE_MIN_US, STRETCH_MAX_US, SYSTEM_ID};
use crate::format::Decimal;
use crate::sensor;

/// The values that a parameter may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// Any finite value from the first to the second, both included.
    Between(f32, f32),
    /// One of these.
    OneOf(&'static [f32]),
}

impl Range {
    /// Whether `value` is allowed. Never true of a NaN.
    pub const fn contains(&self, value: f32) -> bool {
        match self {
            Range::Between(low, high) => value >= *low && value <= *high,
            &Range::OneOf(mut allowed) => {
                while let [first, rest @ ..] = allowed {
                    if *first == value {
                        return true;
                    }
                    allowed = rest;
                }
                false
            }
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Range::Between(low, high) => write!(f, "{} to {}", Decimal(*low), Decimal(*high)),
            Range::OneOf(allowed) => {
                for (index, value) in allowed.iter().enumerate() {
                    let separator = if index == 0 { "" } else { ", " };
                    f.write_str(separator)?;
                    Decimal(*value).fmt(f)?;
                }
                Ok(())
            }
        }
    }
}

/// When a parameter may be changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// At any time: that is how gains are tuned on the tether.
    Live,
    /// Not while the drone is armed or under control: the change would make the rudder jump or stop
    /// a bus.
    Disarmed,
    /// As [`Change::Disarmed`], and the rudder may answer the other way afterwards: a changed value
    /// takes [`Polarity::Checked`](super::Polarity::Checked) back.
    Turning,
    /// As [`Change::Disarmed`], and the vehicle sets it by itself to what it measures.
    Measured,
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Info {
    /// Name, at most 16 ASCII characters.
    pub name: &'static str,
    /// Hash of the name, by which a value goes where parameters are stored.
    pub id: u32,
    /// Allowed values.
    pub range: Range,
    /// Value after a reset.
    pub default: f32,
    /// When it may be changed.
    pub change: Change,
}

/// What people want to know of a row besides. It is kept apart, so that the image does not carry
/// the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Description {
    /// Unit, empty for a pure number.
    pub unit: &'static str,
    /// What the parameter does, in one line.
    pub meaning: &'static str,
}

/// FNV-1a, 32 bits wide.
const fn hash(name: &str) -> u32 {
    let mut hash: u32 = 0x811C_9DC5;
    let mut bytes = name.as_bytes();
    while let [byte, rest @ ..] = bytes {
        hash = (hash ^ *byte as u32).wrapping_mul(0x0100_0193);
        bytes = rest;
    }
    hash
}

const fn all_differ(mut ids: &[u32]) -> bool {
    while let [first, rest @ ..] = ids {
        let mut others = rest;
        while let [other, further @ ..] = others {
            if *first == *other {
                return false;
            }
            others = further;
        }
        ids = rest;
    }
    true
}

/// A parameter is what it does, in one sentence, and below that its accessor, name, unit, range,
/// default and rule of change. A literal in brackets names the feature that the row belongs to.
macro_rules! parameters {
    ($(
        $(#[doc = $meaning:literal])+
        $([$feature:literal])?
        $field:ident: $name:literal, $unit:literal, $range:expr, $default:expr, $change:ident;
    )+) => {
        /// Every parameter, in the order of its index on the wire.
        pub static TABLE: &[Info] = &[$($(#[cfg(feature = $feature)])? Info {
            name: $name,
            id: hash($name),
            range: $range,
            default: $default,
            change: Change::$change,
        },)+];

        /// The rows' descriptions, in the same order.
        pub static DESCRIPTIONS: &[Description] = &[$($(#[cfg(feature = $feature)])? Description {
            unit: $unit,
            meaning: concat!($($meaning),+).trim_ascii(),
        },)+];

        /// Where a parameter has its value.
        #[allow(non_camel_case_types)]
        pub(crate) enum Place { $($(#[cfg(feature = $feature)])? $field,)+ }

        pub(super) const COUNT: usize = [$($(#[cfg(feature = $feature)])? Place::$field,)+].len();

        // A stored value must find one row only.
        const _: () = assert!(
            all_differ(&[$($(#[cfg(feature = $feature)])? hash($name),)+]),
            "two names have the same hash"
        );

        impl Default for Params {
            fn default() -> Self {
                Self { values: const { [$($(#[cfg(feature = $feature)])? {
                    let value: f32 = $default;
                    assert!($range.contains(value), "default out of range");
                    assert!($name.len() <= 16, "name too long for MAVLink");
                    value
                },)+] } }
            }
        }

        impl Params {
            $(
                $(#[cfg(feature = $feature)])?
                #[doc = concat!("`", $name, "` (", $unit, "):", $($meaning),+)]
                #[allow(clippy::indexing_slicing, reason = "there is a value for every place")]
                pub fn $field(&self) -> f32 {
                    self.values[Place::$field as usize]
                }
            )+
        }
    };
}

parameters! {
    /// servo angle per pitch error, in law 0
    pid_kp: "PID_KP", "rad/rad", Between(0.0, 10.0), 1.9, Live;
    /// servo angle per pitch rate, in laws 0 and 3
    pid_kd: "PID_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// bandwidth of the observer that trims a lateral offset of the mass away, in law 2; 0 is no
    /// trim
    pid_trim_rad_s: "PID_TRIM_RAD_S", "rad/s", Between(0.0, 20.0), 0.95, Live;
    /// servo angle per pitch error and second, in laws 0 and 3
    pid_ki: "PID_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// the control law: 0 PD, with PID_KI PID; 2 the switching surface, SFC_GAIN_S and after; 3 a
    /// loop of the angle around one of the rate, with PID_KI and PID_KD
    pid_law: "PID_LAW", "", OneOf(&[0.0, 2.0, 3.0]), 2.0, Disarmed;
    /// servo angle per deviation of the rate from the switching surface
    sfc_gain_s: "SFC_GAIN_S", "s", Between(0.0, 5.0), 0.565, Live;
    /// slope of the surface near the setpoint
    sfc_near: "SFC_NEAR", "1/s", Between(0.0, 100.0), 11.2, Live;
    /// share of the time-optimal rate at which the pitch approaches
    sfc_curve: "SFC_CURVE", "", Between(0.0, 3.0), 0.838, Live;
    /// how far beyond a pulse's effect the surface is looked at
    sfc_ahead_s: "SFC_AHEAD_S", "s", Between(0.0, 0.1), 0.0282, Live;
    /// largest distance of the command from where the servo will be
    sfc_lead_rad: "SFC_LEAD_RAD", "rad", Between(0.0, 3.0), 0.194, Live;
    /// share of a new rate's innovation that the model takes over
    sfc_rate: "SFC_RATE", "", Between(0.0, 1.0), 0.929, Live;
    /// share of the pitch's innovation that the model takes over
    sfc_pitch: "SFC_PITCH", "", Between(0.0, 1.0), 0.561, Live;
    /// time constant of the servo's position loop, without frame and motor
    srv_loop_s: "SRV_LOOP_S", "s", Between(0.0, 1.0), 0.0233, Live;
    /// lag of the servo's motor
    srv_motor_s: "SRV_MOTOR_S", "s", Between(0.0, 1.0), 0.0152, Live;
    /// play behind the servo, either way
    srv_play_rad: "SRV_PLAY_RAD", "rad", Between(0.0, 0.2), 0.00434, Live;
    /// pitch acceleration per servo angle at zero rudder
    pitch_gain: "PITCH_GAIN", "1/s2", Between(1.0, 1000.0), 31.6, Live;
    /// greatest speed of the servo
    srv_rad_s: "SRV_RAD_S", "rad/s", Between(0.1, 100.0), 5.5, Live;
    /// pitch to hold, nose up positive
    pitch_set_deg: "PITCH_SET_DEG", "deg", Between(-30.0, 30.0), 0.0, Live;
    /// pulse at which the rudder has no effect
    srv_centre_us: "SRV_CENTRE_US", "us", Between(1420.0, 1620.0), 1523.6, Live;
    /// servo angle that holds against a lateral offset of the mass: the rudder rests there
    srv_hold_deg: "SRV_HOLD_DEG", "deg", Between(-10.0, 10.0), 0.0, Disarmed;
    /// +1: a longer pulse turns the crank to positive angles; -1: reversed servo
    srv_dir: "SRV_DIR", "", OneOf(&[-1.0, 1.0]), 1.0, Turning;
    /// pulse change per real degree of the servo shaft
    srv_us_per_deg: "SRV_US_PER_DEG", "us/deg", Between(5.0, 20.0), 10.0, Disarmed;
    /// shortest pulse that control commands
    srv_min_us: "SRV_MIN_US", "us", Between(PULSE_MIN_US, 1400.0), 923.6, Live;
    /// longest pulse that control commands
    srv_max_us: "SRV_MAX_US", "us", Between(1640.0, PULSE_MAX_US), 2123.6, Live;
    /// fastest change of the pulse
    srv_slew_us_s: "SRV_SLEW_US_S", "us/s", Between(500.0, 100_000.0), 10_000.0, Live;
    /// servo frame rate; above 50 only for digital servos, an analog one burns out
    srv_rate_hz: "SRV_RATE_HZ", "Hz", OneOf(&[50.0, 100.0, 200.0, 300.0, 333.0]), 50.0, Disarmed;
    /// speed of the sensor bus; 100 for a cable of more than 1 m
    i2c_khz: "I2C_KHZ", "kHz", OneOf(&[100.0, 400.0]), 400.0, Disarmed;
    /// sensor that flies: 0 a BNO055; 1 the LSM6DS3 of the Nano 33 IoT; 2 the BNO055, with the
    /// LSM6DS3 standing by. Calibrate after a change
    sensor: "SENSOR", "", OneOf(&[0.0, 1.0, 2.0]), 0.0, Disarmed;
    /// FINE of the clock as USB disciplined it, for starts without; set by the vehicle, -1 unknown
    clk_fine: "CLK_FINE", "", Between(-1.0, 1023.0), -1.0, Measured;
    /// how long the sensor stretches a byte; measured and set by the vehicle itself while disarmed
    i2c_stretch_us: "I2C_STRETCH_US", "us", Between(0.0, STRETCH_MAX_US as f32), sensor::STRETCH_US as f32, Measured;
    /// sensor's roll in the body, applied first
    mnt_roll_deg: "MNT_ROLL_DEG", "deg", Between(-180.0, 180.0), 0.0, Turning;
    /// sensor's pitch in the body, applied second
    mnt_pitch_deg: "MNT_PITCH_DEG", "deg", Between(-180.0, 180.0), 0.0, Turning;
    /// sensor's yaw in the body, applied last
    mnt_yaw_deg: "MNT_YAW_DEG", "deg", Between(-180.0, 180.0), 0.0, Turning;
    /// roll in the body of the sensor that stands by, applied first
    mnt2_roll_deg: "MNT2_ROLL_DEG", "deg", Between(-180.0, 180.0), 0.0, Disarmed;
    /// its pitch, applied second
    mnt2_pitch_deg: "MNT2_PITCH_DEG", "deg", Between(-180.0, 180.0), 0.0, Disarmed;
    /// its yaw, applied last
    mnt2_yaw_deg: "MNT2_YAW_DEG", "deg", Between(-180.0, 180.0), 0.0, Disarmed;
    /// magnetic declination, east positive: 4.37 in Copenhagen
    declination_deg: "DECLINATION_DEG", "deg", Between(-180.0, 180.0), 0.0, Disarmed;
    /// attitude filter, which starts over when it is changed: 0 VQF class; 1 Mahony; 2 Madgwick; 3
    /// complementary
    fuse_filter: "FUSE_FILTER", "", OneOf(&[0.0, 1.0, 2.0, 3.0]), 0.0, Disarmed;
    /// 0: the attitude filter leaves the magnetometer out, and heading follows the gyroscope alone
    fuse_mag: "FUSE_MAG", "", OneOf(&[0.0, 1.0]), 1.0, Disarmed;
    /// accelerometer offset along its x
    cal_acc_ox: "CAL_ACC_OX", "m/s2", Between(-2.0, 2.0), 0.0, Disarmed;
    /// accelerometer offset along its y
    cal_acc_oy: "CAL_ACC_OY", "m/s2", Between(-2.0, 2.0), 0.0, Disarmed;
    /// accelerometer offset along its z
    cal_acc_oz: "CAL_ACC_OZ", "m/s2", Between(-2.0, 2.0), 0.0, Disarmed;
    /// accelerometer scale along its x, applied after the offset
    cal_acc_sx: "CAL_ACC_SX", "", Between(0.8, 1.2), 1.0, Disarmed;
    /// accelerometer scale along its y, applied after the offset
    cal_acc_sy: "CAL_ACC_SY", "", Between(0.8, 1.2), 1.0, Disarmed;
    /// accelerometer scale along its z, applied after the offset
    cal_acc_sz: "CAL_ACC_SZ", "", Between(0.8, 1.2), 1.0, Disarmed;
    /// gyroscope offset about its x
    cal_gyr_ox: "CAL_GYR_OX", "deg/s", Between(-10.0, 10.0), 0.0, Disarmed;
    /// gyroscope offset about its y
    cal_gyr_oy: "CAL_GYR_OY", "deg/s", Between(-10.0, 10.0), 0.0, Disarmed;
    /// gyroscope offset about its z
    cal_gyr_oz: "CAL_GYR_OZ", "deg/s", Between(-10.0, 10.0), 0.0, Disarmed;
    /// hard iron along the magnetometer's x
    cal_mag_ox: "CAL_MAG_OX", "uT", Between(-500.0, 500.0), 0.0, Disarmed;
    /// hard iron along the magnetometer's y
    cal_mag_oy: "CAL_MAG_OY", "uT", Between(-500.0, 500.0), 0.0, Disarmed;
    /// hard iron along the magnetometer's z
    cal_mag_oz: "CAL_MAG_OZ", "uT", Between(-500.0, 500.0), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's x goes to x
    cal_mag_xx: "CAL_MAG_XX", "", Between(-1.99, 1.99), 1.0, Disarmed;
    /// soft iron: how much of the magnetometer's y goes to x
    cal_mag_xy: "CAL_MAG_XY", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's z goes to x
    cal_mag_xz: "CAL_MAG_XZ", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's x goes to y
    cal_mag_yx: "CAL_MAG_YX", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's y goes to y
    cal_mag_yy: "CAL_MAG_YY", "", Between(-1.99, 1.99), 1.0, Disarmed;
    /// soft iron: how much of the magnetometer's z goes to y
    cal_mag_yz: "CAL_MAG_YZ", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's x goes to z
    cal_mag_zx: "CAL_MAG_ZX", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's y goes to z
    cal_mag_zy: "CAL_MAG_ZY", "", Between(-1.99, 1.99), 0.0, Disarmed;
    /// soft iron: how much of the magnetometer's z goes to z
    cal_mag_zz: "CAL_MAG_ZZ", "", Between(-1.99, 1.99), 1.0, Disarmed;
    /// 1: three seconds without a host's heartbeat are a failsafe
    fs_host: "FS_HOST", "", OneOf(&[0.0, 1.0]), 0.0, Live;
    /// 2: the rudder answers in standby, to be seen; 1, from 2 alone: it was seen to answer a tilt
    /// the right way, without which nothing is armed
    srv_polarity: "SRV_POLARITY", "", OneOf(&[0.0, 1.0, 2.0]), 0.0, Disarmed;
    /// axes that are steered: 1 pitch, by the servo on D3; 2 roll too, by a like one on D2
    axes_steered: "AXES", "", OneOf(&[1.0, 2.0]), 1.0, Disarmed;
    /// roll to hold, right side down positive
    roll_set_deg: "ROLL_SET_DEG", "deg", Between(-30.0, 30.0), 0.0, Live;
    /// SRV_CENTRE_US of the servo on D2
    srv2_centre_us: "SRV2_CENTRE_US", "us", Between(1420.0, 1620.0), 1523.6, Live;
    /// SRV_HOLD_DEG of the servo on D2
    srv2_hold_deg: "SRV2_HOLD_DEG", "deg", Between(-10.0, 10.0), 0.0, Disarmed;
    /// SRV_DIR of the servo on D2
    srv2_dir: "SRV2_DIR", "", OneOf(&[-1.0, 1.0]), 1.0, Turning;
    /// SRV_MIN_US of the servo on D2
    srv2_min_us: "SRV2_MIN_US", "us", Between(PULSE_MIN_US, 1400.0), 923.6, Live;
    /// SRV_MAX_US of the servo on D2
    srv2_max_us: "SRV2_MAX_US", "us", Between(1640.0, PULSE_MAX_US), 2123.6, Live;
    /// SRV_POLARITY of the rudder on D2
    srv2_polarity: "SRV2_POLARITY", "", OneOf(&[0.0, 1.0, 2.0]), 0.0, Disarmed;
    /// 0: in control the gyroscope alone turns the attitude, as a vehicle in free flight needs it;
    /// 1: the accelerometer corrects it, as one that hangs needs it
    ["free-flight"] fuse_acc: "FUSE_ACC", "", OneOf(&[0.0, 1.0]), 1.0, Disarmed;
    /// deviation of the shift of the gyroscope's offset by 1 g from GYR_PER_G_X and GYR_PER_G_Y;
    /// tilt_sd grows by it
    ["free-flight"] gyr_per_g: "GYR_PER_G", "deg/s", Between(0.0, 1.0), 0.1, Live;
    /// shift of the rate about the body's x by 1 g from tail to nose
    ["free-flight"] gyr_per_g_x: "GYR_PER_G_X", "deg/s", Between(-1.0, 1.0), 0.0, Disarmed;
    /// shift of the rate about the body's y by 1 g from tail to nose
    ["free-flight"] gyr_per_g_y: "GYR_PER_G_Y", "deg/s", Between(-1.0, 1.0), 0.0, Disarmed;
    /// acceleration from tail to nose that releases an armed vehicle; 0: an order alone does
    ["free-flight"] launch_acc: "LAUNCH_ACC", "m/s2", Between(0.0, 100.0), 0.0, Disarmed;
    /// how long LAUNCH_ACC must last
    ["free-flight"] launch_s: "LAUNCH_S", "s", Between(0.0, 1.0), 0.1, Disarmed;
    /// control ends when the acceleration has fallen below this for 0.2 s; 0: it does not
    ["free-flight"] burnout_acc: "BURNOUT_ACC", "m/s2", Between(0.0, 100.0), 0.0, Disarmed;
    /// control ends so long after the release; 0: it does not
    ["free-flight"] burn_s: "BURN_S", "s", Between(0.0, 600.0), 0.0, Disarmed;
    /// rate asked for per angle error, in law 3
    cas_angle: "CAS_ANGLE", "1/s", Between(0.1, 50.0), 3.0, Live;
    /// greatest rate asked for, in law 3
    cas_rate: "CAS_RATE", "rad/s", Between(0.0, 20.0), 1.0, Live;
    /// rows of the gain schedule, in laws 0 and 3; 0: PID_KP, PID_KI and PID_KD throughout
    ["free-flight"] gs_rows: "GS_ROWS", "", OneOf(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), 0.0, Disarmed;
    /// time from the release at which the gains of row 1 count
    ["free-flight"] gs1_s: "GS1_S", "s", Between(0.0, 600.0), 0.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs1_kp: "GS1_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs1_ki: "GS1_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs1_kd: "GS1_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// time from the release at which the gains of row 2 count
    ["free-flight"] gs2_s: "GS2_S", "s", Between(0.0, 600.0), 10.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs2_kp: "GS2_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs2_ki: "GS2_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs2_kd: "GS2_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// time from the release at which the gains of row 3 count
    ["free-flight"] gs3_s: "GS3_S", "s", Between(0.0, 600.0), 20.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs3_kp: "GS3_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs3_ki: "GS3_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs3_kd: "GS3_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// time from the release at which the gains of row 4 count
    ["free-flight"] gs4_s: "GS4_S", "s", Between(0.0, 600.0), 30.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs4_kp: "GS4_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs4_ki: "GS4_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs4_kd: "GS4_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// time from the release at which the gains of row 5 count
    ["free-flight"] gs5_s: "GS5_S", "s", Between(0.0, 600.0), 40.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs5_kp: "GS5_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs5_ki: "GS5_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs5_kd: "GS5_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// time from the release at which the gains of row 6 count
    ["free-flight"] gs6_s: "GS6_S", "s", Between(0.0, 600.0), 50.0, Live;
    /// PID_KP at that time
    ["free-flight"] gs6_kp: "GS6_KP", "rad/rad", Between(0.0, 20.0), 1.9, Live;
    /// PID_KI at that time
    ["free-flight"] gs6_ki: "GS6_KI", "1/s", Between(0.0, 20.0), 0.0, Live;
    /// PID_KD at that time
    ["free-flight"] gs6_kd: "GS6_KD", "s", Between(0.0, 3.0), 0.435, Live;
    /// MAVLink system id, which tells vehicles on one link apart; taken over at the next start
    mav_sysid: "MAV_SYSID", "", Between(1.0, 250.0), SYSTEM_ID as f32, Live;
}
