//! What stands on the bench round the chip: sensor, drone, servo and clamp, and what disturbs them.

mod clamp;
mod config;
pub mod disturbance;
mod earth_field;
mod environment;
mod fault_schedule;
pub mod hardware;
mod knock;
mod magnet;
mod rocket;
pub mod sensor_motion;
mod stimulus;
mod vehicle;

pub use crate::wiring::Wiring;
pub use config::{BenchConfig, TwoAxes, VehicleConfig};
pub use earth_field::EarthField;
pub use environment::{Environment, ZERO_RUDDER_US};
pub use fault_schedule::{FaultEntry, Since, TimedFault};
pub use hardware::Hardware;
pub use knock::Knock;
pub use magnet::Magnet;
pub use rocket::{Kick, Rocket, RocketConfig};
pub use vehicle::Vehicle;
