//! `tvc rig tell`: something done by hand to a rig that runs.

use std::path::PathBuf;

use ::rig::action::{Action, HELP};
use anyhow::Result;
use clap::Args;

use report::exit::{BadInput, Verdict};
use report::file::print;

/// Options of `tvc rig tell`.
#[derive(Debug, Args)]
#[command(after_help = help())]
pub struct Tell {
    /// The link of the rig, as it was given with --link.
    #[arg(value_name = "LINK")]
    pub link: PathBuf,

    /// What to do, in the words below.
    #[arg(
        value_name = "ACTION",
        required = true,
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    pub action: Vec<String>,
}

fn help() -> String {
    let actions: String =
        HELP.iter().map(|(words, what)| format!("  {words}\n      {what}\n")).collect();
    format!(
        "Actions:\n{actions}\n\
Examples:
  tvc rig tell ./nano fault unplugged            before boot: then power-cycle
  tvc rig tell ./nano fault spikes probability=0.05 for_s=0.5
  tvc rig tell ./nano clear all
  tvc rig tell ./nano state                      how the rig is, as one JSON object

Prints how the rig is then. docs/guides/troubleshooting.md has the actions that lead to what it
describes.
Exit status: 0 done, 1 no rig answers, 2 no such action."
    )
}

/// Acts on a rig that runs, and prints how it is then.
///
/// # Errors
/// [`BadInput`] for what is no action or cannot be done to this rig; no rig that answers.
pub fn run(options: &Tell) -> Result<Verdict> {
    let line = options.action.join(" ");
    line.parse::<Action>().map_err(BadInput::new)?;
    let answer = super::ask(&super::control_path(&options.link), &line)?;
    print(format_args!("{answer}\n"))?;
    Ok(Verdict::Met)
}
