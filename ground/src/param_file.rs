//! Parameter files: a name and a value a line, as MAVProxy writes them, or QGroundControl's five
//! columns. `#` begins a comment.

use std::fmt::Write;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::Result;
use client::Parameter;
use tvc_nano::Params;

use crate::out::exit::BadInput;

/// Longest file, bytes: a thousand times what is needed.
const LONGEST: u64 = 1 << 20;

/// Reads a file. Every value is checked against this tool's own table before any is set.
///
/// # Errors
/// [`BadInput`] naming file and line.
pub fn read(path: &Path) -> Result<Vec<Parameter>> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(LONGEST).read_to_string(&mut text));
    let length =
        read.map_err(|error| BadInput::new(format!("cannot read {}: {error}", path.display())))?;
    let rows = match length as u64 {
        LONGEST => Err("too long for a parameter file".to_owned()),
        _ => parse(&text),
    };
    rows.map_err(|why| BadInput::new(format!("{}: {why}", path.display())).into())
}

/// Reads the text of a file.
///
/// # Errors
/// What is wrong, and in which line.
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
