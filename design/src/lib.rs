//! The design desk of `tvc`: a drone's physics, simulated, made linear and identified; gains for it
//! from requirements; many dispersed drones under the image's own control law.

#![forbid(unsafe_code)]
#![allow(
    rustdoc::private_intra_doc_links,
    missing_docs,
    unreachable_pub,
    clippy::missing_errors_doc,
    reason = "shared by the programs of this tree alone: `pub` marks what a module offers to others"
)]

mod ascent;
pub mod control_law;
pub mod identify;
pub mod model;
pub mod montecarlo;
pub mod tune;
pub mod vehicle;
