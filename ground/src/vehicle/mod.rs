//! Commands that talk to a vehicle over its port, the real one or the virtual rig's.

pub mod admission;
pub mod arm;
pub mod bringup;
pub mod calibrate;
pub mod flash;
pub mod forward;
pub mod info;
pub mod link;
pub mod monitor;
pub mod on_rig;
pub mod param;
pub mod port;
pub mod record;
pub mod recorder;
pub mod release;
pub mod signing;
pub mod support;
pub mod test;
pub mod watch;
pub mod way;
pub mod web;
