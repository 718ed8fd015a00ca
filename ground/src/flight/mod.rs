//! Commands that fly the image on the virtual rig.

pub mod disturb;
pub mod faults;
pub mod figures;
pub mod fly;
pub mod functions;
pub mod hardware;
pub mod hardware_campaign;
pub mod profile;
pub mod requirements;
pub mod rig;
pub mod stack;
pub mod vehicle;
