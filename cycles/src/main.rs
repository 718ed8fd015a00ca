//! An image that runs one update of one filter or control law again and again, between two
//! breakpoints.
//!
//! Whoever runs it (`lab cycles`) writes a sample to `INPUT` while the image stands at `BKPT #0`.
//! It counts the cycles until `BKPT #1`: the call, the update and the return. A filter's update
//! leads from a sample in memory to an orientation in memory. At `BKPT #2` the direction that the
//! filter takes for up lies in `UP`, which shows whether the filter is fed rightly.
//!
//! A law's update leads from a reading in memory to the output, which is in R0 at `BKPT #1`. There
//! it can be compared with that of the same law elsewhere. `BKPT #3` is a panic.
//!
//! The package's features say which filter or law it is. Without the feature `setup` nothing makes
//! its state, and only the update is linked: that image gives the size and is not run.

// Nothing of a program is reachable from outside; `pub` marks what a module offers to the others.
#![allow(unreachable_pub)]
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image;

#[cfg(not(target_os = "none"))]
fn main() {
    println!("this is for the chip: `cargo lab cycles` builds, runs and weighs it");
}
