//! The images for a debug probe: they log over RTT, and are linked above the bootloader or in its
//! place.

use std::path::Path;

use rig::image::{Builder, Source};
use rig::{Image, ServoKind, Setup, prepare};

const RAM_START: u32 = 0x2000_0000;

pub(crate) fn image(features: &[&str]) -> Image {
    let tree = Path::new(env!("CARGO_MANIFEST_DIR"));
    let source = Source { features, ..Source::firmware(tree) };
    Builder::new(&mut |line| eprintln!("{line}"))
        .and_then(|builder| builder.build(&source))
        .unwrap_or_else(|error| panic!("{error}"))
}

/// It comes to standby on the rig, and a probe would find its log.
fn boots(image: &Image, address: u32) {
    assert_eq!(image.address(), address);
    let setup = Setup::with_polarity(ServoKind::S3003, 1);
    let ready = prepare(image, &setup, &mut |_| {}).unwrap_or_else(|error| panic!("{error}"));
    let log = image.symbol("_SEGGER_RTT").expect("RTT's control block");
    let name = &ready.rig.chip.memory.ram()[(log - RAM_START) as usize..][..10];
    assert_eq!(name, b"SEGGER RTT");
}

#[test]
fn a_probe_image_boots_above_the_bootloader_and_in_its_place() {
    boots(&image(&["probe"]), 0x2000);
    boots(&image(&["probe", "no-bootloader"]), 0x0);
}
