//! What is fixed when the image is built, and why. What an operator may change is in
//! [`crate::params`].

use crate::sensor::{ACC_COUNTS, GYR_COUNTS};

/// Largest disturbance that control trims away, rad of servo: it holds against 3 cm of lateral
/// offset of the centre of mass.
pub const TRIM_LIMIT_RAD: f32 = 0.25;

/// Age of the newest sample beyond which the attitude is no longer trusted: a glitch of 40 ms on
/// the cable, the sample that it spoils, the repair of the bus, and the two samples around them. At
/// the 6 rad/s of a fall that is 0.4 rad, still inside the rudder's reach.
pub const DATA_AGE_LIMIT_US: u64 = 65_000;

/// What a good sample takes from the age of the data, us: two ticks, its own and one without a
/// sample. Each gap adds an error to the attitude. Where less than half of the samples are good,
/// the attitude is soon not trusted.
pub const SAMPLE_MAKES_UP_US: u64 = 13_400;

/// Longest clock stretching of a byte that is measured, us.
pub const STRETCH_MAX_US: u32 = 1_000;

/// The stretch of a byte is taken over anew when it is longer by more than this than what the
/// timing is made for, us: a third of the reserve that a burst has.
pub const STRETCH_LONGER_US: u32 = 15;
/// As [`STRETCH_LONGER_US`], where it is shorter: that costs latency alone.
pub const STRETCH_SHORTER_US: u32 = 40;

/// The clock's FINE is kept anew when it differs by more than this: some 0.1 % of 48 MHz.
pub const CLOCK_CHANGE: u16 = 4;

/// Good samples in a row after which a sensor that was lost counts as back.
pub const RECOVERY_SAMPLES: u8 = 5;

/// A gap between samples after which the attitude starts over from accelerometer and magnetometer
/// instead of being integrated across the gap. Longer than any gap that [`DATA_AGE_LIMIT_US`] lets
/// pass while control is active.
pub const ESTIMATOR_GAP_US: u64 = 500_000;

/// A magnetometer that has measured no field for so long is taken as dead, us.
pub const FIELD_LOST_US: u32 = 1_000_000;

/// Standard deviation of the tilt beyond which nothing is armed, deg. After some seconds of rest it
/// is 0.3 deg; a gap in the samples makes it some tens.
pub const ARM_TILT_SD_DEG: f32 = 2.0;

/// How long before the time of the attitude the accelerometer has measured, s. The newest rates
/// turn the attitude for a whole period of the sensor, half of it behind their time. The
/// accelerometer's filter lags besides. Flights from 0.8 rad show it: 0, 4.5 and 8 ms leave the
/// attitude 2.0, 0.6 and -0.4 mrad off.
pub const ACC_LAG_S: f32 = 0.0062;

/// Rest within which the estimator has learned the gyroscope's offset, us, counted from when it
/// first takes the sensor to be at rest: its blocks last a third of a second at most.
pub const BIAS_REST_US: u32 = 340_000;

/// How long the attitude is levelled anew once the gyroscope's offset is known, us: until then the
/// offset was taken for a rotation, at 3 deg/s by up to 50 mrad. The estimator begins with its next
/// block, a third of a second at most, and has its first gain for two.
pub const LEVEL_US: u32 = 1_000_000;

/// A rate beyond the offset that is a motion while the attitude is levelled, counts: 3 deg/s.
pub const LEVEL_RATE: i32 = (3.0 * GYR_COUNTS) as i32;

/// Tilt up to which the drone may be armed and released, deg. The largest test start, 0.8 rad =
/// 45.8 deg, must pass.
pub const ARM_TILT_DEG: u32 = 50;

/// Cosine of [`ARM_TILT_DEG`], Q30: that is what a quaternion gives without trigonometry.
pub const COS_ARM_TILT_Q30: i32 = 690_187_940;

/// Tilt beyond which control gives up, deg, inside the tether's stops at 1.2 rad = 68.8 deg.
pub const FAILSAFE_TILT_DEG: u32 = 60;

/// Cosine of [`FAILSAFE_TILT_DEG`], Q30.
pub const COS_FAILSAFE_TILT_Q30: i32 = 1 << 29;

/// How long the tilt must be beyond [`FAILSAFE_TILT_DEG`], so that no single bad sample ends a
/// flight.
pub const FAILSAFE_TILT_US: u64 = 100_000;

/// How long the acceleration must stay below `BURNOUT_ACC` to end control, us: longer than a chug
/// of the engine or a run of bad samples.
pub const BURNOUT_US: u64 = 200_000;

/// Standard deviation of the tilt on the pad, deg: an accelerometer calibrated to 5 mg.
pub const PAD_TILT_SD_DEG: f32 = 0.3;

/// Silence of the host that is a failsafe where `FS_HOST` is on: three heartbeats of a client that
/// sends one a second, less a reserve. Whenever the steps come, the rudder is at neutral within
/// three seconds of the last heartbeat.
pub const HOST_SILENCE_US: u64 = 2_950_000;

/// A host that never says that its port is open counts as gone after so long without a message, us:
/// five heartbeats.
pub const HOST_GONE_US: u64 = 5_000_000;

/// Length of the self-test: the gyro must be still for this long without a break.
pub const SELF_TEST_US: u64 = 1_000_000;

/// Whole bursts that a row or page of flash may spoil, erased or written within 6 ms.
pub const HALTED_BURSTS: u8 = 2;

/// Least sample rate that passes the self-test. The sensor's own clock is good to 1 %.
pub const SELF_TEST_RATE_HZ: u32 = 95;

/// Largest change of a gyro axis within the self-test, in counts of 1/16 deg/s: 3 deg/s, some
/// twenty times the noise of the BMG160 at 116 Hz bandwidth (0.15 deg/s rms), and more at the 47
/// Hz that are set.
pub const SELF_TEST_GYRO_SPAN: i16 = (3.0 * GYR_COUNTS) as i16;

/// Largest gyro reading at rest, in counts: 5 deg/s. The data sheet's zero-rate offset is at most 3
/// deg/s.
pub const SELF_TEST_GYRO_LIMIT: i16 = (5.0 * GYR_COUNTS) as i16;

/// Standard gravity in accelerometer counts of 0.01 m/s2, and the tolerance of the self-test on it:
/// 5 %.
pub const GRAVITY_COUNTS: f32 = 9.806_65 * ACC_COUNTS;
/// See [`GRAVITY_COUNTS`].
pub const SELF_TEST_GRAVITY_TOLERANCE: f32 = 0.05;

/// The servo's hard range: Arduino's 30 to 160 deg, outside which the thesis' Futaba does not
/// answer. No parameter widens it.
pub const PULSE_MIN_US: f32 = 853.0;
/// See [`PULSE_MIN_US`].
pub const PULSE_MAX_US: f32 = 2193.0;

/// How long a test pulse is held: a host that is gone does not leave the servo at its stop.
pub const TEST_PULSE_US: u64 = 2_000_000;

/// MAVLink system id of a vehicle that has been given no other (`MAV_SYSID`).
pub const SYSTEM_ID: u8 = 1;
/// MAVLink component id of an autopilot.
pub const COMPONENT_ID: u8 = 1;

/// Period of HEARTBEAT and SYS_STATUS.
pub const HEARTBEAT_PERIOD_US: u64 = 1_000_000;

/// Bytes of telemetry that wait for the host. The stream may fill all but [`QUEUE_RESERVE_BYTES`];
/// a step writes about 130 bytes, so that this bridges 80 ms of a host's silence at 150 Hz.
pub const QUEUE_BYTES: usize = 2048;

/// Part of the queue that the periodic stream leaves free for answers and events.
pub const QUEUE_RESERVE_BYTES: usize = 512;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosines_are_those_of_the_limits_in_degrees() {
        for (limit_deg, cos) in
            [(ARM_TILT_DEG, COS_ARM_TILT_Q30), (FAILSAFE_TILT_DEG, COS_FAILSAFE_TILT_Q30)]
        {
            let expected = f64::from(limit_deg).to_radians().cos();
            let found = f64::from(cos) / f64::from(1 << 30);
            assert!((found - expected).abs() < 1e-9, "{limit_deg} deg: {found}");
        }
    }
}
