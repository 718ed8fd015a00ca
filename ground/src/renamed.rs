//! Names that commands and options had in version 0.1.0, until the next version: what was renamed
//! works and says its present name; what went elsewhere says where.

use std::ffi::{OsStr, OsString};

use clap::error::{ContextKind, ContextValue};

/// Commands that went elsewhere: the name, and what takes its place.
const MOVED: [(&str, &str); 8] = [
    ("cycles", "`cargo lab cycles` in the source tree"),
    ("experiment", "the test `navigation` of the crate rig"),
    ("faults", "`cargo lab faults` in the source tree"),
    ("hardware", "`cargo lab hardware` in the source tree"),
    ("profile", "`cargo lab profile` in the source tree"),
    ("stack", "`cargo lab stack` in the source tree"),
    ("rocket", "`tvc fly --vehicle rocket`"),
    ("validate", "a test of the crate plant, with its table in docs/explanation/model.md"),
];

/// Commands that have other words.
const COMMANDS: [(&[&str], &[&str]); 5] = [
    (&["recorder"], &["record", "--last"]),
    (&["burst"], &["record", "--last"]),
    (&["ports"], &["info", "--ports"]),
    (&["convert"], &["log", "convert"]),
    (&["montecarlo", "replay"], &["montecarlo", "rerun"]),
];

/// Options that have another name: the command, or none for all, the old and the new one, and the
/// end of the values that are meant where the old name has another meaning now.
const OPTIONS: [(&[&str], &str, &str, &str); 8] = [
    (&["fly"], "--replay", "--recording", ""),
    (&["montecarlo"], "--params", "--vehicle", ".toml"),
    (&["montecarlo"], "--gains", "--params", ""),
    (&["tune"], "--params", "--vehicle", ".toml"),
    (&["tune"], "--from", "--params", ""),
    (&["identify"], "--params", "--vehicle", ""),
    (&["model", "linear"], "--params", "--vehicle", ""),
    (&[], "--drone", "--vehicle", ""),
];

/// Where a command went that `tvc` does not know.
pub fn moved(error: &clap::Error) -> Option<String> {
    let ContextValue::String(name) = error.get(ContextKind::InvalidSubcommand)? else {
        return None;
    };
    let (_, place) = MOVED.into_iter().find(|(moved, _)| moved == name)?;
    Some(format!("{name} is not here; it is {place} now"))
}

/// The present words of a command line without the program's name, and what to say of the old ones.
pub fn present(mut words: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let mut said = Vec::new();
    let begins = |words: &[OsString], with: &[&str]| {
        with.len() <= words.len() && words.iter().zip(with).all(|(word, with)| word == with)
    };
    if let Some((old, new)) = COMMANDS.into_iter().find(|(old, _)| begins(&words, old)) {
        words.splice(..old.len(), new.iter().map(OsString::from));
        said.push(format!("`tvc {}` is `tvc {}` now", old.join(" "), new.join(" ")));
    }
    let of_command: Vec<_> =
        OPTIONS.into_iter().filter(|(command, ..)| begins(&words, command)).collect();
    for index in 0..words.len() {
        let next = words.get(index + 1).cloned().unwrap_or_default();
        let Some((name, value, joined)) = option(&words[index], &next) else {
            continue;
        };
        let renamed =
            of_command.iter().find(|(_, old, _, end)| *old == name && value.ends_with(end));
        if let Some((_, old, new, _)) = renamed {
            said.push(format!("{old} is {new} now"));
            words[index] = match joined {
                true => format!("{new}={value}").into(),
                false => new.into(),
            };
        }
    }
    (words, said)
}

/// The name of an option and its value, and whether both stand in one word.
fn option<'a>(word: &'a OsStr, next: &'a OsStr) -> Option<(&'a str, &'a str, bool)> {
    let word = word.to_str().filter(|word| word.starts_with("--"))?;
    match word.split_once('=') {
        Some((name, value)) => Some((name, value, true)),
        None => Some((word, next.to_str().unwrap_or_default(), false)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli;

    fn line(text: &str) -> String {
        let words = text.split(' ').map(OsString::from).collect();
        let (words, said) = present(words);
        let words: Vec<_> = words.iter().map(|word| word.to_str().unwrap()).collect();
        assert_eq!(said.is_empty(), words.join(" ") == text, "{text}: {said:?}");
        words.join(" ")
    }

    #[test]
    fn old_names_become_the_present_ones() {
        for (old, new) in [
            ("recorder a.csv --port x", "record --last a.csv --port x"),
            ("ports --json", "info --ports --json"),
            ("convert a.tlog b.csv", "log convert a.tlog b.csv"),
            ("montecarlo replay worst.toml", "montecarlo rerun worst.toml"),
            ("fly --replay walk.imuq", "fly --recording walk.imuq"),
            ("fly --params a.param", "fly --params a.param"),
            (
                "montecarlo --params heavy.toml --gains my.param",
                "montecarlo --vehicle heavy.toml --params my.param",
            ),
            ("montecarlo --params my.param", "montecarlo --params my.param"),
            (
                "tune --params=heavy.toml --from=my.param",
                "tune --vehicle=heavy.toml --params=my.param",
            ),
            ("identify run.csv --params p.toml", "identify run.csv --vehicle p.toml"),
            ("model linear --params p.toml", "model linear --vehicle p.toml"),
            ("fly --drone p.toml", "fly --vehicle p.toml"),
        ] {
            assert_eq!(line(old), new);
            let words = ["tvc"].into_iter().chain(new.split(' '));
            assert!(cli::command().try_get_matches_from(words).is_ok(), "{new}");
        }
    }

    #[test]
    fn no_command_of_today_is_called_as_one_that_went() {
        let command = cli::command();
        for (name, _) in MOVED {
            assert!(command.find_subcommand(name).is_none(), "{name}");
        }
    }
}
