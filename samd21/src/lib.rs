//! The emulated chip.
