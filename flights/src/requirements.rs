//! What a flight must achieve: the project's requirements, to which `tvc fly` and `tvc report` hold
//! what they measure.

use rig::ServoKind;

use report::measure::Limit::{self, AtLeast, AtMost, Below, Set};

/// Excursion past upright, percent of the start.
pub const OVERSHOOT_PCT: Limit = AtMost(5.0);
/// Largest angle of an axis that was upright while the other comes up, percent of its start.
pub const CROSS_COUPLING_PCT: Limit = AtMost(10.0);
/// Vehicles out of many dispersed ones that meet the thesis' requirement, percent.
pub const DISPERSED_WITHIN_PCT: Limit = AtLeast(99.0);
/// Largest root mean square of the angle of a rocket's axis from the vertical, deg.
pub const ASCENT_ERROR_MOST_DEG: f64 = 2.0;
/// The same as a requirement.
pub const ASCENT_ERROR_RMS_DEG: Limit = AtMost(ASCENT_ERROR_MOST_DEG);
/// Largest angle of a rocket's axis from the vertical at burnout, deg.
pub const ASCENT_END_MOST_DEG: f64 = 4.0;
/// The same as a requirement.
pub const ASCENT_ERROR_END_DEG: Limit = AtMost(ASCENT_END_MOST_DEG);
/// The firmware is in control until the end.
pub const IN_CONTROL: Limit = Set;
/// Control rate, Hz.
pub const RATE_HZ: Limit = AtLeast(100.0);
/// Largest deviation of the control period, us.
pub const JITTER_US: Limit = Below(100.0);
/// Mean time from the start of a sample's burst to its pulse, us.
pub const LATENCY_US: Limit = AtMost(8000.0);
/// Servo pulses that are not as wide as the firmware has asked for.
pub const STRAY_PULSES: Limit = AtMost(0.0);
/// Messages lost or damaged.
pub const LOST_MESSAGES: Limit = AtMost(0.0);
/// The image in flash, bytes: 96 KB, and 4 for a second sensor that stands by.
pub const FLASH_BYTES: Limit = AtMost(100.0 * 1024.0);
/// Static RAM, bytes.
pub const STATIC_RAM_BYTES: Limit = AtMost(24.0 * 1024.0);
/// Worst case of the stack, percent of the RAM that the statics leave.
pub const STACK_PCT: Limit = AtMost(60.0);
/// Inclination error of a replay, deg.
pub const INCLINATION_DEG: Limit = AtMost(5.0);

/// Overshoot of 95 % of many flights and of the worst, percent of the start.
pub const OVERSHOOT_DISTRIBUTION: [Limit; 2] = [AtMost(2.0), AtMost(3.5)];

/// Longest 5 % settling of 95 % of many flights, over the shortest that the rudder's speed allows.
pub fn most_settling_ratio(servo: ServoKind) -> f64 {
    match servo {
        ServoKind::S3003 => 1.25,
        ServoKind::Digital => 1.2,
    }
}

/// The same as a requirement, and that of the worst flight.
pub fn settling_ratio(servo: ServoKind) -> [Limit; 2] {
    [AtMost(most_settling_ratio(servo)), AtMost(1.32)]
}

/// Time after which pitch stays within 5 % of the start, s.
pub fn settling_s(servo: ServoKind) -> Limit {
    AtMost(match servo {
        ServoKind::S3003 => 0.75,
        ServoKind::Digital => 0.55,
    })
}
