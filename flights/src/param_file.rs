//! Parameter files: a name and a value a line, as MAVProxy writes them, or QGroundControl's five
//! columns. `#` begins a comment. Neither program reads the other's form (but for QGroundControl's
//! newest), so the file's name decides: QGroundControl's end in `.params`.
//!
//! That somebody saw a rudder answer the right way is true of one vehicle as it stands: it is never
//! taken from a file, and written as a comment.

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use client::Parameter;
use tvc_nano::Params;

use crate::log::has_extension;
use report::exit::BadInput;
use report::input;

/// Whether a person has seen the rudder answer a tilt the right way. The vehicle forgets it where
/// another parameter that decides about it changes.
pub const POLARITY: &str = "SRV_POLARITY";
/// The same of the second rudder, where roll is steered.
pub const SECOND_POLARITY: &str = "SRV2_POLARITY";

/// What is said where a file names a polarity.
pub const NO_POLARITY: &str = "polarity is not taken from a file: tvc calibrate polarity";

/// What a file says.
#[derive(Debug, Default, PartialEq)]
pub struct File {
    /// The parameters, without polarities.
    pub rows: Vec<Parameter>,
    /// It names a polarity, too.
    pub names_polarity: bool,
}

/// Whether a parameter is one that is never taken from a file.
pub fn is_polarity(name: &str) -> bool {
    [POLARITY, SECOND_POLARITY].contains(&name)
}

/// Reads a file. Every value is checked against this tool's own table before any is set.
///
/// # Errors
/// [`BadInput`] naming file and line.
pub fn read(path: &Path) -> Result<File> {
    let text = input::text(path)
        .map_err(|error| BadInput::new(format!("cannot read {}: {error}", path.display())))?;
    parse(&text).map_err(|why| BadInput::of(path, why).into())
}

/// The parameters in the text of a file. Every value is checked as in [`read`].
///
/// # Errors
/// What is wrong, with its line.
pub fn parse(text: &str) -> Result<File, String> {
    let mut file = File::default();
    let mut names: Vec<&str> = Vec::new();
    // Windows' editors put a byte order mark before the text.
    for (index, line) in text.trim_start_matches('\u{FEFF}').lines().enumerate() {
        let refuse = |why: String| format!("line {}: {why}", index + 1);
        let Some((name, value)) = row(line).map_err(refuse)? else {
            continue;
        };
        if names.contains(&name) {
            return Err(refuse(format!("{name} a second time")));
        }
        names.push(name);
        if is_polarity(name) {
            file.names_polarity = true;
        } else {
            file.rows.push(Parameter { name: name.to_owned(), value });
        }
    }
    if names.is_empty() {
        return Err("no parameters in it".into());
    }
    Ok(file)
}

/// The name and the value in a line; none in one without words.
fn row(line: &str) -> Result<Option<(&str, f32)>, String> {
    let line = line.split('#').next().unwrap_or_default();
    let words: Vec<&str> = line
        .split(|c: char| c.is_whitespace() || matches!(c, ',' | ';' | '='))
        .filter(|word| !word.is_empty())
        .collect();
    let (name, value) = match words.as_slice() {
        [] => return Ok(None),
        [name, value] | [_, _, name, value, _] => (*name, *value),
        _ if has_decimal_comma(line) => return Err("a decimal comma: write 1.85, not 1,85".into()),
        _ => return Err("not a name and a value".into()),
    };
    // A mark in the midst of a file would stand before a name that looks like another one.
    if !name.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Err(format!("{name:?} is no name of a parameter"));
    }
    let value = value.parse().map_err(|_| format!("{value} is no number"))?;
    let capitals = name.to_uppercase();
    if Params::info(name).is_some() {
        Params::default().set(name, value).map_err(|error| error.to_string())?;
    } else if Params::info(&capitals).is_some() {
        return Err(format!("{name} is written {capitals}"));
    }
    Ok(Some((name, value)))
}

/// Whether a comma stands between two digits, as in the files of many spreadsheets.
fn has_decimal_comma(line: &str) -> bool {
    let is_one =
        |three: &[u8]| three[0].is_ascii_digit() && three[1] == b',' && three[2].is_ascii_digit();
    line.as_bytes().windows(3).any(is_one)
}

/// MAV_PARAM_TYPE_REAL32.
const REAL32: u8 = 9;
/// MAVLink component id of the vehicle.
const COMPONENT: u8 = 1;

/// Whether a file is QGroundControl's, by its name.
pub fn is_for_qgroundcontrol(path: &Path) -> bool {
    has_extension(path, "params")
}

/// The text of a file for QGroundControl, which loads it into a vehicle of the same system id.
pub fn columns(rows: &[Parameter], system: u8) -> String {
    let mut text = "# system\tcomponent\tname\tvalue\ttype\n".to_owned();
    for Parameter { name, value } in rows {
        let line = format!("{system}\t{COMPONENT}\t{name}\t{value}\t{REAL32}");
        push(&mut text, name, &line);
    }
    text
}

/// The text of a file.
pub fn text(rows: &[Parameter]) -> String {
    let mut text = String::new();
    for Parameter { name, value } in rows {
        push(&mut text, name, &format!("{name:<16} {value}"));
    }
    text
}

/// A parameter's line; that of a polarity is a comment.
fn push(text: &mut String, name: &str, line: &str) {
    // Writing to a string does not fail.
    let _ = match is_polarity(name) {
        true => writeln!(text, "# {line}  {NO_POLARITY}"),
        false => writeln!(text, "{line}"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let rows = [("PID_KP", 1.1), ("SRV_CENTRE_US", 1523.6)]
            .map(|(name, value)| Parameter { name: name.into(), value });
        assert_eq!(parse(&text(&rows)).unwrap().rows, rows);
        assert_eq!(parse(&columns(&rows, 7)).unwrap().rows, rows);
    }

    /// `ParameterManager::readParametersFromStream` of QGroundControl 4 and 5: a line that does not
    /// begin with `#` is split at its tabs, and counts with five parts, of which the first is the
    /// vehicle's system id.
    #[test]
    fn qgroundcontrol_loads_its_form() {
        let rows = [Parameter { name: "PID_KP".into(), value: 1.1 }];
        let text = columns(&rows, 7);
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let lines: Vec<Vec<_>> = lines.map(|line| line.split('\t').collect()).collect();
        assert_eq!(lines, [["7", "1", "PID_KP", "1.1", "9"]]);
        for (name, is_its) in [("a.params", true), ("a.parm", false), ("a.param", false)] {
            assert_eq!(is_for_qgroundcontrol(Path::new(name)), is_its, "{name}");
        }
    }

    #[test]
    fn the_forms_of_other_programs_are_read() {
        let text = "# Vehicle-Id Component-Id Name Value Type\n1\t1\tPID_KP\t1.2\t9\n\nPID_KD,0.25\nNEW = 3\n";
        let rows = parse(text).unwrap().rows;
        let pairs: Vec<_> = rows.iter().map(|row| (row.name.as_str(), row.value)).collect();
        assert_eq!(pairs, [("PID_KP", 1.2), ("PID_KD", 0.25), ("NEW", 3.0)]);
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_a_name() {
        let rows = parse("\u{FEFF}PID_KP 1.2\r\n").unwrap().rows;
        assert_eq!(rows[0].name, "PID_KP");
    }

    /// What one vehicle was seen to do is not true of another.
    #[test]
    fn a_polarity_is_neither_taken_nor_given() {
        let read = parse("PID_KP 1.2\nSRV_POLARITY 1\n1 1 SRV2_POLARITY 2 9\n").unwrap();
        assert!(read.names_polarity);
        let names: Vec<_> = read.rows.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(names, ["PID_KP"]);
        assert!(parse("SRV_POLARITY 1").unwrap().rows.is_empty());
        let rows = [("PID_KP", 1.2), ("SRV_POLARITY", 1.0)]
            .map(|(name, value)| Parameter { name: name.into(), value });
        for text in [text(&rows), columns(&rows, 7)] {
            let read = parse(&text).unwrap();
            assert!(!read.names_polarity && read.rows == rows[..1], "{text}");
            let comment = text.lines().last().unwrap();
            assert!(comment.starts_with("# ") && comment.contains("SRV_POLARITY"), "{text}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_file_without_end_is_refused() {
        let refused = read(Path::new("/dev/zero")).unwrap_err().to_string();
        assert!(refused.contains("too long"), "{refused}");
    }

    #[test]
    fn a_bad_line_is_named() {
        for (text, part) in [
            ("PID_KP 1\nPID_KD", "line 2"),
            ("PID_KP one", "one is no number"),
            ("\r\u{FEFF}PID_KP 1", "is no name"),
            ("PID_\u{1b}[2J 1", "is no name"),
            ("PID_KP 11", "PID_KP must be 0 to 10"),
            ("PID_KP NaN", "PID_KP must be"),
            ("# nothing", "no parameters"),
            ("PID_KP 1,85", "line 1: a decimal comma: write 1.85"),
            ("PID_KP;1,85", "line 1: a decimal comma"),
            ("PID_KP 1\npid_kd 0.4", "line 2: pid_kd is written PID_KD"),
            ("SRV_POLARITY 3", "SRV_POLARITY must be"),
            ("PID_KP 1\nPID_KD 0.1\nPID_KP 2", "line 3: PID_KP a second time"),
        ] {
            assert!(parse(text).unwrap_err().contains(part), "{text}");
        }
    }
}
