//! Commands that fly the image on the virtual rig.

pub mod disturb;
pub mod faults;
pub mod fly;
pub mod rig;
