//! The filters in fixed point as they are built for the chip: no float, and no multiplication,
//! division or shift of 64 bits. All of these are library calls there, so that the linked names
//! show them. And the image itself: no panic is linked, and no float routine runs in its control
//! step.

use std::collections::BTreeMap;
use std::path::Path;

use rig::image::{Builder, Source};
use rig::{Image, Ready, Ticks};

use crate::faults::{default_neutral_us, released};
use crate::{firmware, probe, ready};

/// The image of the package `cycles` with one update of a filter and what that calls, and nothing
/// else.
fn update(filter: &str) -> Image {
    Builder::new(&mut |line| eprintln!("{line}"))
        .and_then(|builder| {
            builder.build(&Source {
                folder: &Path::new(env!("CARGO_MANIFEST_DIR")).join("cycles"),
                package: "cycles",
                profile: "release",
                features: &[filter],
            })
        })
        .unwrap_or_else(|error| panic!("{error}"))
}

/// Names of the run-time library's arithmetic on floats and on 64 bits.
fn library_calls(image: &Image) -> Vec<String> {
    image
        .symbols()
        .map(|(name, _)| name.to_owned())
        .filter(|name| is_of_floats(name) || is_of_64_bits(name))
        .collect()
}

/// Whether a name is that of arithmetic on floats: ARM's own (run-time ABI, chapter 4) or one of
/// the compiler's builtins.
fn is_of_floats(name: &str) -> bool {
    let conversions = ["i2f", "i2d", "ui2f", "ui2d", "l2f", "l2d", "ul2f", "ul2d"];
    let eabi = name
        .strip_prefix("__aeabi_")
        .is_some_and(|rest| rest.starts_with(['f', 'd']) || conversions.contains(&rest));
    eabi || is_builtin(name, &["sf", "df"])
}

/// The same for arithmetic on 64 bits.
fn is_of_64_bits(name: &str) -> bool {
    let arm = ["lmul", "ldivmod", "uldivmod", "llsl", "llsr", "lasr", "lcmp", "ulcmp"];
    let eabi = name.strip_prefix("__aeabi_").is_some_and(|rest| arm.contains(&rest));
    eabi || is_builtin(name, &["di"])
}

fn is_builtin(name: &str, kinds: &[&str]) -> bool {
    let builtins = [
        "add", "sub", "mul", "div", "cmp", "eq", "ne", "lt", "le", "gt", "ge", "fix", "float",
        "neg", "ashl", "ashr", "lshr",
    ];
    builtins.iter().any(|operation| {
        kinds.iter().any(|kind| name.contains(&format!("__{operation}")) && name.contains(kind))
    })
}

#[test]
fn fixed_point_calls_no_float_and_no_arithmetic_of_64_bits() {
    for filter in [
        "fixed-mahony-6d",
        "fixed-mahony-9d",
        "fixed-vqf-6d",
        "fixed-vqf-9d",
        "fixed-roll-pitch-yaw-9d",
    ] {
        let calls = library_calls(&update(filter));
        assert!(calls.is_empty(), "{filter} calls {calls:?}");
    }
}

/// Were the names not what the library calls them, the test above could not fail.
#[test]
fn a_float_filter_is_recognised_by_its_calls() {
    let calls = library_calls(&update("mahony-9d"));
    for name in ["__aeabi_fadd", "__aeabi_fmul"] {
        assert!(calls.iter().any(|call| call == name), "{name}: {calls:?}");
    }
}

/// What runs in flight, instruction by instruction, for as long as six steps take: in the steps,
/// and in all.
#[test]
fn a_control_step_runs_no_float_routine() {
    let floats: BTreeMap<u32, &str> = firmware()
        .symbols()
        .filter(|(name, _)| is_of_floats(name))
        .map(|(name, address)| (address & !1, name))
        .collect();
    let mut flight = released(ready(), &default_neutral_us());
    let Ready { rig, .. } = &mut flight;
    let from = rig.now();
    let mut runs = Vec::new();
    while rig.now() < from + Ticks::from_ms(40) {
        if let Some(name) = floats.get(&rig.chip.pc()) {
            runs.push((rig.now(), *name));
        }
        rig.run_for(Ticks(1)).unwrap();
    }
    // Telemetry has floats, behind the step.
    assert!(runs.len() > 6, "{}: nothing is seen", runs.len());
    let steps = rig.truth().steps.iter().filter(|step| step.start >= from);
    assert!(steps.clone().count() >= 5);
    for step in steps {
        let within = |(at, _): &&(Ticks, &str)| (step.start..step.end).contains(at);
        assert_eq!(runs.iter().find(within), None);
    }
}

/// Parts of the names of what a panic calls: the core library's own functions, the program's
/// handler, and what makes text of a place.
const OF_PANICS: [&str; 7] = [
    "panic",
    "rust_begin_unwind",
    "unwrap_failed",
    "expect_failed",
    "slice_index_fail",
    "already_borrowed",
    "already_mutably_borrowed",
];

fn panics(image: &Image) -> Vec<&str> {
    let is_one = |name: &&str| OF_PANICS.iter().any(|part| name.contains(part));
    image.symbols().map(|(name, _)| name).filter(is_one).collect()
}

/// Whether `text` stands in what goes into flash.
fn holds(image: &Image, text: &str) -> bool {
    let bytes = image.bytes();
    bytes.windows(text.len()).any(|window| window == text.as_bytes())
}

/// The handler of panics is called by nothing: it is not linked, and neither is any function that
/// ends in it. One that had been inlined would show by the text or the file that it tells. `tvc
/// stack` follows every call (`ground/tests/batch/stack.rs`).
#[test]
fn no_call_of_a_panic_is_linked() {
    let image = firmware();
    assert_eq!(panics(image), [""; 0]);
    for text in [".rs", "index out of bounds", "called `", "attempt to "] {
        assert!(!holds(image, text), "{text}");
    }
}

/// Were the names not what the compiler calls them, the test above could not fail: the images for a
/// probe print their panics.
#[test]
fn an_image_that_can_panic_is_recognised() {
    let image = probe::image(&["probe"]);
    assert!(!panics(&image).is_empty());
}
