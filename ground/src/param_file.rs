//! Parameter files: a name and a value a line, as MAVProxy writes them, or QGroundControl's five
//! columns. `#` begins a comment. Neither program reads the other's form (but for QGroundControl's
//! newest), so the file's name decides: QGroundControl's end in `.params`.

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use client::Parameter;
use tvc_nano::Params;

use crate::input;
use crate::out::exit::BadInput;

/// Reads a file. Every value is checked against this tool's own table before any is set.
///
/// # Errors
/// [`BadInput`] naming file and line.
pub fn read(path: &Path) -> Result<Vec<Parameter>> {
    let text = input::text(path)
        .map_err(|error| BadInput::new(format!("cannot read {}: {error}", path.display())))?;
    parse(&text).map_err(|why| BadInput::new(format!("{}: {why}", path.display())).into())
}

/// The parameters in the text of a file. Every value is checked as in [`read`].
///
/// # Errors
/// What is wrong, with its line.
pub fn parse(text: &str) -> Result<Vec<Parameter>, String> {
    let mut rows: Vec<Parameter> = Vec::new();
    // Windows' editors put a byte order mark before the text.
    for (index, line) in text.trim_start_matches('\u{FEFF}').lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = line
            .split(|c: char| c.is_whitespace() || c == ',' || c == '=')
            .filter(|word| !word.is_empty())
            .collect();
        let (name, value) = match words.as_slice() {
            [] => continue,
            [name, value] | [_, _, name, value, _] => (*name, *value),
            _ => return Err(format!("line {}: not a name and a value", index + 1)),
        };
        // A mark in the midst of a file would stand before a name that looks like another one.
        if !name.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err(format!(
                "line {}: {name:?} is no name of a parameter",
                index + 1
            ));
        }
        let value = value
            .parse()
            .map_err(|_| format!("line {}: {value} is no number", index + 1))?;
        if Params::info(name).is_some() {
            Params::default()
                .set(name, value)
                .map_err(|error| format!("line {}: {error}", index + 1))?;
        }
        if rows.iter().any(|row| row.name == name) {
            return Err(format!("line {}: {name} a second time", index + 1));
        }
        rows.push(Parameter {
            name: name.to_owned(),
            value,
        });
    }
    if rows.is_empty() {
        return Err("no parameters in it".into());
    }
    Ok(rows)
}

/// MAV_PARAM_TYPE_REAL32.
const REAL32: u8 = 9;
/// MAVLink component id of the vehicle.
const COMPONENT: u8 = 1;

/// Whether a file is QGroundControl's, by its name.
pub fn is_for_qgroundcontrol(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension == "params")
}

/// The text of a file for QGroundControl, which loads it into a vehicle of the same system id.
pub fn columns(rows: &[Parameter], system: u8) -> String {
    let mut text = "# system\tcomponent\tname\tvalue\ttype\n".to_owned();
    for Parameter { name, value } in rows {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{system}\t{COMPONENT}\t{name}\t{value}\t{REAL32}");
    }
    text
}

/// The text of a file.
pub fn text(rows: &[Parameter]) -> String {
    let mut text = String::new();
    for row in rows {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{:<16} {}", row.name, row.value);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let rows = [("PID_KP", 1.1), ("SRV_CENTRE_US", 1523.6)].map(|(name, value)| Parameter {
            name: name.into(),
            value,
        });
        assert_eq!(parse(&text(&rows)).unwrap(), rows);
        assert_eq!(parse(&columns(&rows, 7)).unwrap(), rows);
    }

    /// `ParameterManager::readParametersFromStream` of QGroundControl 4 and 5: a line that does not
    /// begin with `#` is split at its tabs, and counts with five parts, of which the first is the
    /// vehicle's system id.
    #[test]
    fn qgroundcontrol_loads_its_form() {
        let rows = [Parameter {
            name: "PID_KP".into(),
            value: 1.1,
        }];
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
        let rows = parse(text).unwrap();
        let pairs: Vec<_> = rows
            .iter()
            .map(|row| (row.name.as_str(), row.value))
            .collect();
        assert_eq!(pairs, [("PID_KP", 1.2), ("PID_KD", 0.25), ("NEW", 3.0)]);
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_a_name() {
        assert_eq!(parse("\u{FEFF}PID_KP 1.2\r\n").unwrap()[0].name, "PID_KP");
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
            (
                "PID_KP 1\nPID_KD 0.1\nPID_KP 2",
                "line 3: PID_KP a second time",
            ),
        ] {
            assert!(parse(text).unwrap_err().contains(part), "{text}");
        }
    }
}
