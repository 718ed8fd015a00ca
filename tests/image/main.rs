//! The firmware image on the virtual rig: its flights, its behaviour when something fails, and its
//! attitude from a real recording. One test binary, so that the image is built and booted once.

mod boards;
mod campaign;
mod faults;
mod flights;
mod hardware;
mod hosts;
mod parameters;
mod probe;
mod recorder;
mod replay;
mod rocket;
mod sound;
mod symbols;
mod two_axes;

use rig::bench::{TwoAxes, VehicleConfig};
use rig::{Image, Ready, ServoKind, Setup, image, prepare};
use std::sync::OnceLock;

/// The firmware image; the test fails with the builder's own words where there is none.
fn firmware() -> &'static Image {
    static IMAGE: OnceLock<Image> = OnceLock::new();
    IMAGE.get_or_init(|| match image::build(&mut |line| eprintln!("{line}")) {
        Ok(image) => image,
        Err(error) => panic!("{error}"),
    })
}

/// The same with two rudders, both of which have been seen to answer.
fn with_two_axes(mut setup: Setup) -> Setup {
    setup.rig.bench.vehicle = VehicleConfig::TwoAxes(TwoAxes::default());
    let stored = setup.rig.stored.as_mut().unwrap();
    stored.set("AXES", 2.0).unwrap();
    stored.set("SRV2_POLARITY", 1.0).unwrap();
    setup
}

/// A rig with an S3003, parameters set, in standby.
fn ready() -> Ready {
    static READY: OnceLock<Ready> = OnceLock::new();
    READY
        .get_or_init(|| {
            prepare(firmware(), &Setup::with_polarity(ServoKind::S3003, 1), &mut |_| {}).unwrap()
        })
        .clone()
}
