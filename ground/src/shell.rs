//! `tvc completions` and `tvc man`: the command line for a shell, and as manual pages.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use clap_complete::Shell;

use crate::cli;
use report::exit::{BadInput, Verdict};
use report::file::print;

/// Options of `tvc completions`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mkdir -p ~/.local/share/bash-completion/completions
  tvc completions bash > ~/.local/share/bash-completion/completions/tvc
  mkdir -p ~/.zfunc                        with fpath+=~/.zfunc before compinit in ~/.zshrc
  tvc completions zsh > ~/.zfunc/_tvc
  mkdir -p ~/.config/fish/completions
  tvc completions fish > ~/.config/fish/completions/tvc.fish

Exit status: 0 done, 1 something failed, 2 unusable input.")]
pub struct Completions {
    /// The shell.
    #[arg(value_enum, value_name = "SHELL")]
    pub shell: Shell,
}

/// Options of `tvc man`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc man ~/.local/share/man/man1          then `man tvc-fly`

Exit status: 0 written, 1 something failed, 2 unusable input.")]
pub struct Man {
    /// The folder that the pages go to; it is made if it is not there.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Prints the completions of the command line `tvc` for a shell.
///
/// # Errors
/// Standard output cannot be written.
pub fn completions(options: &Completions) -> Result<Verdict> {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut cli::command(), "tvc", &mut script);
    print(String::from_utf8(script).context("the completions")?)?;
    Ok(Verdict::Met)
}

/// Writes a manual page for every command of `tvc`.
///
/// # Errors
/// [`BadInput`] for a folder that cannot be written.
pub fn man(options: &Man) -> Result<Verdict> {
    let folder = &options.folder;
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(cli::command(), folder))
        .map_err(|error| BadInput::new(format!("cannot write {}: {error}", folder.display())))?;
    eprintln!("wrote manual pages to {}", folder.display());
    Ok(Verdict::Met)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn every_shell_and_every_command_is_served() {
        for shell in Shell::value_variants() {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut cli::command(), "tvc", &mut script);
            let script = String::from_utf8(script).unwrap();
            assert!(script.contains("montecarlo"), "{shell}");
        }
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("man1");
        let man = |folder| super::man(&Man { folder });
        man(deep.clone()).unwrap();
        for page in ["tvc.1", "tvc-fly.1", "tvc-param-load.1"] {
            let text = std::fs::read_to_string(deep.join(page)).unwrap();
            assert!(text.contains(".TH"), "{page}");
        }
        std::fs::write(folder.path().join("file"), "").unwrap();
        assert!(man(folder.path().join("file")).is_err());
    }
}
