//! Commands that fly the image on the virtual rig.

pub mod disturb;
pub mod figures;
pub mod fly;
pub mod hardware;
pub mod requirements;
pub mod rig;
pub mod vehicle;
