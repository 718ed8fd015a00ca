//! The configuration: what the command line need not say each time. A file in the current folder
//! goes before the user's own, and the command line before both.

use std::env;
use std::path::PathBuf;

use clap::Command;
use rig::ServoKind;
use serde::Deserialize;

use crate::vehicle::calibrate::place;
use report::input;

/// Name of the file in the current folder.
const HERE: &str = "tvc.toml";

/// What a file may say; each is the default of the option of the same name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    port: Option<String>,
    place: Option<String>,
    servo: Option<String>,
}

/// The files that are there, the one that goes before the other first.
pub fn files() -> Vec<PathBuf> {
    let set = |name| env::var_os(name).filter(|value| !value.is_empty());
    let home = if cfg!(windows) { "APPDATA" } else { "HOME" };
    let folder = set("XDG_CONFIG_HOME").map(PathBuf::from).or_else(|| {
        let home = PathBuf::from(set(home)?);
        Some(if cfg!(windows) { home } else { home.join(".config") })
    });
    let own = folder.map(|folder| folder.join("tvc").join("config.toml"));
    let files = [PathBuf::from(HERE)].into_iter().chain(own);
    files.filter(|path| path.is_file()).collect()
}

impl Config {
    /// What the files say together.
    ///
    /// # Errors
    /// File, line and what is wrong.
    pub fn load(files: &[PathBuf]) -> Result<Self, String> {
        let mut all = Self::default();
        for path in files {
            let text = input::text(path).map_err(|error| format!(": {error}"));
            let own = text.and_then(|text| Self::parse(&text));
            let own = own.map_err(|why| format!("{}{why}", path.display()))?;
            all.port = all.port.or(own.port);
            all.place = all.place.or(own.place);
            all.servo = all.servo.or(own.servo);
        }
        Ok(all)
    }

    /// What the text of a file says.
    ///
    /// # Errors
    /// The line and what is wrong, to be put behind the file's name.
    pub fn parse(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map(|span| text[..span.start].matches('\n').count() + 1);
            let line = line.map_or(String::new(), |line| format!(", line {line}"));
            format!("{line}: {}", error.message())
        })?;
        let at = |name: &str, why: String| {
            let is_it = |line: &str| line.trim_start().starts_with(name);
            let line = text.lines().position(is_it).map_or(0, |index| index + 1);
            format!(", line {line}: {name}: {why}")
        };
        if let Some(text) = &config.place {
            place(text).map_err(|why| at("place", why))?;
        }
        if let Some(text) = &config.servo {
            text.parse::<ServoKind>().map_err(|why| at("servo", why))?;
        }
        Ok(config)
    }

    /// The command line with these defaults. A servo is a default only where there is one already:
    /// elsewhere it would replace that of a file.
    pub fn apply(&self, command: Command) -> Command {
        let mut command = command;
        for (name, value) in [("port", &self.port), ("place", &self.place), ("servo", &self.servo)]
        {
            let is_wanted = command.get_arguments().any(|argument| {
                let has_default = !argument.get_default_values().is_empty();
                argument.get_id() == name && (name != "servo" || has_default)
            });
            if let Some(value) = value.clone().filter(|_| is_wanted) {
                command = command.mut_arg(name, |argument| argument.default_value(value));
            }
        }
        let names = command.get_subcommands().map(|inner| inner.get_name().to_owned());
        let names: Vec<String> = names.collect();
        names
            .into_iter()
            .fold(command, |command, name| command.mut_subcommand(name, |inner| self.apply(inner)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::{CommandFactory, FromArgMatches};
    use std::path::Path;

    fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn the_nearer_file_goes_first_and_the_command_line_before_both() {
        let folder = tempfile::tempdir().unwrap();
        let near = write(folder.path(), "a.toml", "port = \"/dev/near\"\n");
        let far = "port = \"/dev/far\"\nservo = \"digital\"\nplace = \"55.79,12.52\"\n";
        let far = write(folder.path(), "b.toml", far);
        let config = Config::load(&[near, far]).unwrap();
        let said = |words: &[&str]| {
            let command = config.apply(Cli::command());
            let matches = command.try_get_matches_from([&["tvc"], words].concat()).unwrap();
            format!("{:?}", Cli::from_arg_matches(&matches).unwrap())
        };
        assert!(said(&["arm"]).contains("/dev/near"));
        assert!(said(&["param", "list"]).contains("/dev/near"));
        let named = said(&["param", "list", "--port", "x"]);
        assert!(named.contains("\"x\"") && !named.contains("/dev/near"), "{named}");
        assert!(said(&["fly"]).contains("Digital"));
        assert!(said(&["fly", "--servo", "s3003"]).contains("S3003"));
        // A parameter file may name another one.
        assert!(said(&["model", "linear"]).contains("servo: None"));
        assert!(said(&["calibrate"]).contains("55.79"));
        config.apply(Cli::command()).debug_assert();
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        for (text, part) in [
            ("# mine\nprot = \"x\"\n", "line 2: unknown field `prot`"),
            ("port = 7\n", "line 1: invalid type"),
            ("\n\nport = \n", "line 3"),
            (
                "\nservo = \"s9999\"\n",
                "line 2: servo: there is no servo s9999; there are s3003, digital",
            ),
            ("place = \"91,0\"\n", "line 1: place: a place is"),
        ] {
            let path = write(folder.path(), "tvc.toml", text);
            let said = Config::load(&[path]).unwrap_err();
            assert!(said.contains(part), "{said}");
        }
        assert_eq!(Config::load(&[]), Ok(Config::default()));
    }
}
