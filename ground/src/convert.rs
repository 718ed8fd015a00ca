//! `tvc convert`: a log in another form.

use anyhow::Result;

use crate::cli::Convert;
use crate::failure::Verdict;
use crate::log::convert;

/// Writes the file that `options` ask for.
pub fn run(options: &Convert) -> Result<Verdict> {
    convert(&options.log, &options.file)?;
    eprintln!("wrote {}", options.file.display());
    Ok(Verdict::Met)
}
