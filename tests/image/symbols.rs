//! The filters in fixed point as they are built for the chip: no float, and no multiplication,
//! division or shift of 64 bits. All of these are library calls there, so that the linked names
//! show them.

use std::path::Path;

use rig::Image;
use rig::image::{Builder, Source};

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

/// Names of the run-time library's arithmetic on floats and on 64 bits: ARM's own (run-time ABI,
/// chapter 4) and those of the compiler's builtins.
fn library_calls(image: &Image) -> Vec<String> {
    let arm = [
        "lmul", "ldivmod", "uldivmod", "llsl", "llsr", "lasr", "lcmp", "ulcmp",
    ];
    let builtins = [
        "add", "sub", "mul", "div", "cmp", "eq", "ne", "lt", "le", "gt", "ge", "fix", "float",
        "neg", "ashl", "ashr", "lshr",
    ];
    image
        .symbols()
        .map(|(name, _)| name.to_owned())
        .filter(|name| {
            let eabi = name.strip_prefix("__aeabi_").is_some_and(|rest| {
                arm.contains(&rest)
                    || rest.starts_with(['f', 'd'])
                    || ["i2f", "i2d", "ui2f", "ui2d", "l2f", "l2d", "ul2f", "ul2d"].contains(&rest)
            });
            let builtin = builtins.iter().any(|operation| {
                ["sf", "df", "di"]
                    .iter()
                    .any(|kind| name.contains(&format!("__{operation}")) && name.contains(kind))
            });
            eabi || builtin
        })
        .collect()
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
