//! Names that commands had in version 0.1.0, for one more release.

use clap::error::{ContextKind, ContextValue};

/// Commands that the laboratory has now.
const OF_THE_LABORATORY: [&str; 6] = [
    "cycles",
    "experiment",
    "faults",
    "hardware",
    "profile",
    "stack",
];

/// Where a command went that `tvc` does not know.
pub fn moved(error: &clap::Error) -> Option<String> {
    let ContextValue::String(name) = error.get(ContextKind::InvalidSubcommand)? else {
        return None;
    };
    let is_moved = OF_THE_LABORATORY.contains(&name.as_str());
    is_moved.then(|| format!("`tvc {name}` is `cargo lab {name}` now, in the source tree"))
}
