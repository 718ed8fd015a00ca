//! What stands on the bench round the chip: sensor, drone, servo and clamp, and what disturbs them.

mod clamp;
pub mod disturbance;
mod earth_field;
mod environment;
mod fault_schedule;
pub mod hardware;
mod hung_drone;
pub mod sensor_motion;
mod stimulus;

pub use earth_field::EarthField;
pub use environment::{BenchConfig, Environment, PROBE_PIN, SERVO_PINS, TwoAxes, ZERO_RUDDER_US};
pub use fault_schedule::{FaultEntry, Since, TimedFault};
pub use hardware::Hardware;
pub use hung_drone::HungDrone;
