//! Files that a command is to write, looked at before its work begins. Their places must take
//! files, and none of another kind may be there, which would mostly be the command's own input.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Result;

use super::exit::BadInput;
use super::file::try_place;

/// What is in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A telemetry log.
    Log,
    /// A table.
    Table,
    /// An HTML page.
    Page,
    /// Parameters of the firmware.
    Parameters,
    /// Any TOML file.
    Toml,
    /// Counts of a sensor.
    Recording,
    /// A firmware image.
    Image,
    /// Edges of a logic analyser.
    Waves,
    /// Files in one.
    Archive,
}

/// Every kind, what people call it, and how the names of its files end.
const KINDS: [(Kind, &str, &[&str]); 9] = [
    (Kind::Log, "a telemetry log", &["tlog", "mcap"]),
    (Kind::Table, "a table", &["csv"]),
    (Kind::Page, "a page", &["html", "htm"]),
    (Kind::Parameters, "a parameter file", &["parm", "param", "params"]),
    (Kind::Toml, "a TOML file", &["toml"]),
    (Kind::Recording, "a recording", &["imuq"]),
    (Kind::Image, "an image", &["elf", "bin", "uf2"]),
    (Kind::Waves, "waves", &["vcd"]),
    (Kind::Archive, "an archive", &["zip"]),
];

/// How the text of a page begins.
const PAGE: &[u8] = b"<!DOCTYPE";
/// How much of a file tells what it is, bytes.
const HEAD: u64 = 4096;

/// Parsers of the path of a file to write, by the kinds that it may have. They refuse the name of
/// another kind, a place with a file of another kind, and a place that takes no file; those by
/// [`named`] refuse the name of no kind, too. Those by [`folder_or`] also take a folder that is
/// there.
macro_rules! parsers {
    ($($parse:ident: $($name:ident $([$kind:ident])+),+;)+) => {
        $($(
            pub fn $name(path: &str) -> Result<PathBuf, String> {
                $parse(path, &[$(Kind::$kind),+])
            }
        )+)+
    };
}

parsers! {
    output: page [Page], table [Table], parameters [Parameters], toml [Toml], image [Image];
    named: waves [Waves], archive [Archive], log [Log], log_or_table [Log] [Table];
    folder_or: image_or_folder [Image], table_or_folder [Table];
}

/// The path of a file to write: the one that was given, or else the usual one, which is looked at
/// as the given one has been. A default of the command line would be looked at by commands that
/// write no such file, too.
///
/// # Errors
/// The usual place takes no such file.
pub fn given_or(given: Option<&Path>, usual: impl AsRef<Path>, kind: Kind) -> Result<PathBuf> {
    if let Some(path) = given {
        return Ok(path.to_owned());
    }
    let path = usual.as_ref();
    check(path, &[kind]).map_err(|why| BadInput::of(path, why))?;
    Ok(path.to_owned())
}

/// Tries whether a folder, which need not be there, takes files.
///
/// # Errors
/// It does not.
pub fn try_folder(folder: &Path) -> Result<()> {
    let taken = try_place(&folder.join("file"));
    let refused = |error| BadInput::new(format!("the folder {}: {error}", folder.display()));
    Ok(taken.map_err(refused)?)
}

fn folder_or(path: &str, kinds: &[Kind]) -> Result<PathBuf, String> {
    if Path::new(path).is_dir() { Ok(path.into()) } else { output(path, kinds) }
}

/// The path of a log to write, which must not be there yet.
///
/// # Errors
/// As [`log`], or it is there, or its folder is not.
pub fn new_log(path: &str) -> Result<PathBuf, String> {
    let path = log(path)?;
    let mut folder = path.parent().into_iter();
    if path.exists() {
        Err("it is there already: give the log another name".into())
    } else if folder.any(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        Err("there is no such folder".into())
    } else {
        Ok(path)
    }
}

/// Whether a file is a telemetry log, by its name.
pub fn is_log(path: &Path) -> bool {
    of_name(path).is_some_and(|(kind, _)| kind == Kind::Log)
}

/// Whether two paths lead to one file; a file that is not there yet is none.
pub fn is_one_file(a: &Path, b: &Path) -> bool {
    same_file::is_same_file(a, b).unwrap_or(false)
}

/// Refuses to write a file in the place of one that is read, whatever its names.
///
/// # Errors
/// [`BadInput`] that names both.
pub fn keep_apart<'a>(out: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    match inputs.into_iter().find(|input| is_one_file(out, input)) {
        Some(input) => Err(BadInput::new(format!(
            "{} is read from {}: write to another file",
            out.display(),
            input.display()
        ))
        .into()),
        None => Ok(()),
    }
}

/// The path of a file to write, whose name must say its kind.
fn named(path: &str, kinds: &[Kind]) -> Result<PathBuf, String> {
    match of_name(Path::new(path)) {
        Some(_) => output(path, kinds),
        None => Err(format!("the name must end in {}", ends(kinds))),
    }
}

fn output(path: &str, kinds: &[Kind]) -> Result<PathBuf, String> {
    let path = PathBuf::from(path);
    check(&path, kinds).map(|()| path)
}

fn check(path: &Path, kinds: &[Kind]) -> Result<(), String> {
    let may = |kind: &Kind| may_replace(path, *kind);
    let is_free = match of_name(path) {
        Some((kind, words)) if !kinds.contains(&kind) => {
            return Err(format!(
                "that is the name of {words}; what is written ends in {}",
                ends(kinds)
            ));
        }
        Some((kind, _)) => may(&kind),
        None => kinds.iter().any(may),
    };
    if !is_free {
        return Err("there is another kind of file already: give another name".into());
    }
    try_place(path).map_err(|error| format!("it cannot be written: {error}"))
}

/// The kind of a file by its name, and what people call it.
fn of_name(path: &Path) -> Option<(Kind, &'static str)> {
    let found = path.extension()?.to_str()?;
    let is = |ends: &[&str]| ends.iter().any(|end| end.eq_ignore_ascii_case(found));
    let kind = KINDS.iter().find(|(_, _, ends)| is(ends))?;
    Some((kind.0, kind.1))
}

/// The ends of names, in words.
fn ends(kinds: &[Kind]) -> String {
    let all = KINDS.iter().filter(|(kind, ..)| kinds.contains(kind));
    let all = all.flat_map(|(_, _, ends)| ends.iter());
    let all: Vec<String> = all.map(|end| format!(".{end}")).collect();
    all.join(" or ")
}

/// Whether a file of this kind may take the place of what is there: nothing, a device, or a file
/// that may be of the same kind. A folder is refused elsewhere.
fn may_replace(path: &Path, kind: Kind) -> bool {
    if !path.is_file() {
        return true;
    }
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    if read.is_err() || head.is_empty() {
        return true;
    }
    let is_page = head.len() >= PAGE.len() && head[..PAGE.len()].eq_ignore_ascii_case(PAGE);
    match kind {
        Kind::Page => is_page,
        // Logs and recordings hold zeros, text does not.
        Kind::Table | Kind::Parameters | Kind::Toml | Kind::Waves => !is_page && !head.contains(&0),
        // Where a log is written there must be none, and images are told by their names.
        Kind::Log | Kind::Recording | Kind::Image => true,
        Kind::Archive => head.starts_with(b"PK"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parser of paths, and a file that it must refuse.
    type Case = (fn(&str) -> Result<PathBuf, String>, &'static str);

    #[test]
    fn a_name_of_another_kind_is_refused() {
        let wrong: [Case; 6] = [
            (page, "flight.tlog"),
            (table, "flight.MCAP"),
            (parameters, "drone.toml"),
            (toml, "gains.param"),
            (log, "flight.csv"),
            (log, "flight.foo"),
        ];
        for (parse, name) in wrong {
            assert!(parse(name).is_err(), "{name}");
        }
        for name in ["flight.html", "no-extension", "/dev/null"] {
            assert_eq!(page(name), Ok(PathBuf::from(name)));
        }
        assert!(page("Cargo.toml/flight.html").is_err(), "no folder");
        assert!(is_log(Path::new("a.TLOG")) && !is_log(Path::new("a.csv")));
        assert!(log("a.tlog").is_ok() && log_or_table("a.CSV").is_ok());
        assert!(new_log("new.tlog").is_ok() && new_log("no/such.tlog").is_err());
    }

    #[test]
    fn a_file_of_another_kind_is_kept_whatever_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path.to_str().unwrap().to_owned()
        };
        let log = write("log.html", b"\x00\x06\x12\x34\xfd");
        let gains = write("gains", b"PID_KP 1.2\n");
        let old = write("old.html", b"<!doctype html><title>");
        assert!(page(&log).is_err() && page(&gains).is_err() && page(&old).is_ok());
        let log = write("log", b"\x00\x06\x12\x34\xfd");
        assert!(table(&log).is_err() && parameters(&log).is_err() && toml(&log).is_err());
        assert!(parameters(&gains).is_ok() && parameters(&old).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_file_is_the_same_by_another_name() {
        let folder = tempfile::tempdir().unwrap();
        let [read, linked, other] = ["read.csv", "linked.csv", "other.csv"].map(|name| {
            let path = folder.path().join(name);
            std::fs::write(&path, "x").unwrap();
            path
        });
        std::fs::remove_file(&linked).unwrap();
        std::fs::hard_link(&read, &linked).unwrap();
        assert!(keep_apart(&linked, [read.as_path()]).is_err());
        assert!(keep_apart(&other, [read.as_path()]).is_ok());
        assert!(keep_apart(Path::new("no/such.csv"), [read.as_path()]).is_ok());
    }
}
