//! `tvc support`: what a bug report needs, in one file without anything personal.

use std::env;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde_json::Value;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use crate::cli::TOOL;
use crate::vehicle::link::Vehicle;
use crate::vehicle::port::{PortOptions, VehicleOptions};
use crate::vehicle::{info, recorder};
use flights::log::write_flight;
use flights::param_file;
use report::exit::{BadInput, Verdict};
use report::file::write_whole;
use report::measure::{Figures, figure};
use report::{input, kind};

/// Options of `tvc support`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc support report.zip                     versions, `tvc info`, parameters, the last release
  tvc support report.zip --log flight.tlog   with a log of the flight, too
  tvc support report.zip --rig               of the virtual rig

The file holds info.json, parameters.param and release.tlog, as far as the vehicle can be reached.
It leaves out the path of your home folder, who may open the port, and other programs.
It asks the vehicle and changes nothing.
Exit status: 0 written, 1 written without the vehicle's part or something failed, 2 unusable input.")]
pub struct Support {
    /// The file to write (.zip).
    #[arg(value_name = "FILE.zip", value_parser = kind::archive)]
    pub file: PathBuf,

    /// A log to put into it.
    #[arg(long, value_name = "LOG")]
    pub log: Option<PathBuf>,

    /// Where the vehicle is, and the form of the answer.
    #[command(flatten)]
    pub vehicle: VehicleOptions,
}

/// A file of the archive: its name and its bytes.
type Entry = (String, Vec<u8>);

/// Collects, and writes the archive.
///
/// # Errors
/// The log cannot be read, or the archive cannot be written.
pub fn run(options: &Support) -> Result<Verdict> {
    let log = options.log.as_deref().map(given).transpose()?;
    let mut info = serde_json::to_value(info::judged(&options.vehicle.port).1)?;
    make_impersonal(&mut info, env::home_dir().as_deref());
    let mut entries = vec![("info.json".to_owned(), serde_json::to_vec_pretty(&info)?)];
    let asked = ask(&options.vehicle.port, &mut entries);
    entries.extend(log);
    write_whole(&options.file, &archive(&entries)?)?;
    let files: Vec<&str> = entries.iter().map(|(name, _)| &**name).collect();
    let missing = asked.as_ref().err().map(|error| format!("{error:#}"));
    let figures = [
        figure("file", options.file.display().to_string()).shown("written", "", 0),
        figure("files", files.join(", ")).shown("holds", "", 0),
        figure("problem", missing).shown("vehicle", "", 0).or("asked"),
    ];
    Figures::from(figures).conclude(options.vehicle.json, None)?;
    Ok(Verdict::of(asked.is_ok()))
}

/// A log that was given, under its own name.
fn given(path: &Path) -> Result<Entry> {
    let bytes = input::bytes(path, input::LOG).map_err(|error| BadInput::of(path, error))?;
    let name = path.file_name().unwrap_or_default();
    Ok((format!("log/{}", name.to_string_lossy()), bytes))
}

/// Asks the vehicle for its parameters and its record of the last release.
fn ask(port: &PortOptions, entries: &mut Vec<Entry>) -> Result<()> {
    let mut vehicle = Vehicle::connect(port)?;
    let parameters = vehicle.parameters()?;
    let text = param_file::text(&parameters);
    entries.push(("parameters.param".to_owned(), text.into_bytes()));
    let steps = vehicle.recording()?;
    if !steps.is_empty() {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("release.tlog");
        write_flight(&recorder::flight(&steps, parameters)?, &path, TOOL)?;
        entries.push(given(&path)?);
    }
    Ok(())
}

/// Takes out what tells of the person: files of the tool, rights at the port, other programs; and
/// writes `~` for the home folder.
fn make_impersonal(value: &mut Value, home: Option<&Path>) {
    match value {
        Value::Object(fields) => {
            fields.retain(|key, _| !["configuration", "access", "held_by"].contains(&&**key));
            for field in fields.values_mut() {
                make_impersonal(field, home);
            }
        }
        Value::Array(items) => {
            for item in items {
                make_impersonal(item, home);
            }
        }
        Value::String(text) => {
            if let Some(home) = home.and_then(Path::to_str).filter(|home| home.len() > 1) {
                *text = text.replace(home, "~");
            }
        }
        _ => {}
    }
}

fn archive(entries: &[Entry]) -> Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        archive.start_file(name.as_str(), SimpleFileOptions::default())?;
        archive.write_all(bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn nothing_personal_stays() {
        let mut value = json!({
            "configuration": ["/home/ada/.config/tvc.toml"],
            "image": { "from": "built from /home/ada/nano", "build": "12" },
            "port": { "name": "/dev/ttyACM0", "access": { "owner": "ada" }, "held_by": ["minicom"] },
            "list": ["/home/ada"],
        });
        make_impersonal(&mut value, Some(Path::new("/home/ada")));
        let expected = json!({
            "image": { "from": "built from ~/nano", "build": "12" },
            "port": { "name": "/dev/ttyACM0" },
            "list": ["~"],
        });
        assert_eq!(value, expected);
    }
}
