//! Physics of the tethered drone whose rudder stands in for a rocket's gimbal.
//!
//! Four rigid bodies move in a plane: the drone (body 0) turns about a fixed pivot; the servo's
//! crank (1) drives the rudder (3) through a link (2), a planar four-bar linkage whose ground link
//! is part of body 0. The propellers' wash over the rudder makes the pitch moment.
//!
//! ```text
//!        y up                 D pivot, origin of the body frame
//!        ^                    |
//!        |                    |  0.195 m
//!        +--> x right         |
//!                     B ______|_________ A
//!         rudder arm  |   link          \  crank
//!                     C ..ground link... O servo axis
//!                     |
//!                     | fins, trailing in the wash
//! ```
//!
//! Angles are in radians and grow counter-clockwise. `theta0` is the drone's pitch, 0 upright; the
//! crank, link and rudder angles `theta1..3` are relative to body 0. Positive rudder gives a
//! negative pitch moment, so that a controller feeds pitch back to the rudder with a positive sign.
//! All quantities are SI and `f64`; everything is deterministic and `Clone`.
//!
//! | module | what |
//! |---|---|
//! | [`parameters`] | masses, lengths, loads; presets and checks |
//! | [`setup`] | drone, servo and timing from a TOML file, with units |
//! | [`linkage`] | the four-bar linkage: positions, ratios, inverse |
//! | [`mechanism`] | inertia and loads as functions of the crank angle |
//! | [`drone`] | the drone with a prescribed crank: what the virtual rig flies |
//! | [`two_axis`] | the drone with two rudders in a joint, free to pitch, roll and spin |
//! | [`free`] | free motion of pitch and crank |
//! | [`integrate`] | integration with step control |
//! | [`linear`] | state space, poles, zeros, margins |
//! | [`limit`] | the time-optimal limit |
//! | [`servo`] | a position servo from pulse edges to crank angle |
//! | [`pitch_loop`] | servo, delays and a PD law round the drone |
//! | [`dispersion`] | many runs with dispersed drones, on all cores |
//! | [`identify`] | parameters from a recorded run |
//! | [`scenario`] | a simulation described by a TOML file |
//! | [`rocket`] | the rocket that the drone stands for |
//! | [`ascent`] | the rocket in six degrees of freedom, from the pad past burn-out, in wind |
//! | [`response`] | overshoot, rise and settling of a recorded response |
//!
//! A release from 0.4 rad with the reference law:
//!
//! ```
//! use plant::pitch_loop::{Pd, PitchLoop, Timing};
//! use plant::{Parameters, ServoModel};
//!
//! let (drone, timing) = (Parameters::PHYS, Timing::ANALOGUE);
//! let mut law = Pd::new(1.0, 0.30, &drone.linkage(), timing.control_s);
//! let mut sim = PitchLoop::new(&drone, ServoModel::S3003, timing, 0.4, 0.2)?;
//! let response = sim.respond(3.0, |measurement| law.update(measurement))?;
//! assert!(response.overshoot_pct() < 5.0);
//! assert!(response.settling_s(0.05).is_some_and(|seconds| seconds < 0.7));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

pub mod ascent;
pub mod dispersion;
pub mod drone;
pub mod free;
pub mod identify;
pub mod integrate;
pub mod limit;
pub mod linear;
pub mod linkage;
pub mod mechanism;
pub mod parameters;
pub mod pitch_loop;
pub mod response;
pub mod rocket;
mod root;
pub mod scenario;
pub mod servo;
pub mod setup;
mod tilt;
pub mod two_axis;

pub use drone::{Crank, Drone};
pub use linkage::Linkage;
pub use mechanism::Mechanism;
pub use parameters::{Checked, ParameterError, Parameters};
pub use response::StepResponse;
pub use servo::{Servo, ServoModel};
pub use setup::Setup;
