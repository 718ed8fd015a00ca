//! `tvc log convert`: a log in another form.

use std::path::Path;

use anyhow::Result;

use crate::cli::TOOL;
use flights::log::{Content, convert};
use report::exit::Verdict;
use report::file::print_json;

/// Writes the log in the form that the name of `file` says.
pub fn run(log: &Path, file: &Path, json: bool) -> Result<Verdict> {
    let written = convert(log, file, TOOL)?;
    if json {
        print_json(&written)?;
    }
    let (count, what) = match written {
        Content::Messages(count) => (count, "messages"),
        Content::Steps(count) => (count, "control steps"),
    };
    eprintln!("wrote {}: {count} {what}", file.display());
    Ok(Verdict::Met)
}
