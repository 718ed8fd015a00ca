//! The flight loop, no hardware.
#![no_std]
#![forbid(unsafe_code)]
