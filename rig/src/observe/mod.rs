//! What really happens on the rig, recorded and measured from outside: nothing of it reaches the
//! firmware.

pub mod ground_truth;
pub(crate) mod logic_analyzer;
pub mod measure;
pub mod waves;
