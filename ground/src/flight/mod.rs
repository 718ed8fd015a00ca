//! Commands that fly the image on the virtual rig.

pub mod fly;
pub mod hardware;
pub mod rig;
pub mod sensor;
