//! The virtual rig.
