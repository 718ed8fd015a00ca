//! `tvc param`: the vehicle's parameters, with the meaning that this tool's own table gives them.

use std::path::Path;

use anyhow::{Result, bail};
use client::{Parameter, request};
use serde::Serialize;
use serde_json::json;
use tvc_nano::Params;

use crate::vehicle::link::Vehicle;
use flights::param_file::{self, File, NO_POLARITY};
use report::exit::{BadInput, Verdict};
use report::file::{print, write_whole};
use report::measure::{Figure, Figures, data, figure, note, rows, shown};
mod options;
mod row;
pub use options::{Param, ParamAction};
use row::LAW;
pub use row::{Row, is_measured};

/// A parameter whose value on the vehicle is not that of the file or the default.
#[derive(Debug, Serialize)]
struct Difference {
    name: String,
    vehicle: f32,
    other: f32,
}

/// Does what `options` say.
///
/// # Errors
/// Unusable input, no vehicle, or its refusal.
pub fn run(options: &Param) -> Result<Verdict> {
    // Unusable input is reported before the vehicle is contacted.
    let wanted = match &options.action {
        ParamAction::Diff { file } => file.as_deref().map(param_file::read).transpose()?,
        ParamAction::Load { file, .. } => Some(param_file::read(file)?),
        ParamAction::Reset { names, .. } => {
            Some(File { rows: defaults(names)?, names_polarity: false })
        }
        _ => None,
    };
    if wanted.as_ref().is_some_and(|file| file.names_polarity) {
        eprintln!("{NO_POLARITY}");
    }
    let wanted = wanted.map(|file| file.rows);
    let mut vehicle = Vehicle::connect(&options.vehicle.port)?;
    let json = options.vehicle.json;
    match &options.action {
        ParamAction::List => show(&Row::of_all(&vehicle.parameters()?), json),
        ParamAction::Get { names } => {
            let law = vehicle.parameter(LAW).ok();
            let mut rows = Vec::new();
            for name in names {
                let (name, value) = (name.clone(), vehicle.parameter(name)?);
                rows.push(Row::of(&Parameter { name, value }, law));
            }
            show(&rows, json)
        }
        ParamAction::Set { name, value } => {
            vehicle.set_parameter(name, *value)?;
            let (name, value) = (name.clone(), *value);
            done(json, [data("set", &json!({ &name: value }))], format!("{name} = {value}"))?;
            let row = Row::of(&Parameter { name, value }, vehicle.parameter(LAW).ok());
            row.note().inspect(|note| eprintln!("{note}"));
            Ok(Verdict::Met)
        }
        ParamAction::Save => {
            vehicle.command(request::SAVE)?;
            done(json, [figure("saved", true)], "saved")
        }
        ParamAction::Reset { stored, .. } => {
            reset(&mut vehicle, &wanted.unwrap_or_default(), *stored, json)
        }
        ParamAction::Diff { .. } => diff(&vehicle.parameters()?, wanted.as_deref(), json),
        ParamAction::Load { skip_unknown, .. } => {
            let wanted = wanted.unwrap_or_default();
            load(&mut vehicle, wanted, *skip_unknown, json)
        }
        ParamAction::Dump { file } => dump(&mut vehicle, file.as_deref(), json),
    }
}

/// Ends with figures for `--json`, and words for a person.
fn done<const N: usize>(
    json: bool,
    figures: [Figure; N],
    words: impl Into<String>,
) -> Result<Verdict> {
    Figures::from(figures).and(note(words)).conclude(json, None)
}

fn show(parameters: &[Row], json: bool) -> Result<Verdict> {
    let row = |row: &Row| {
        let default = match row.default {
            Some(default) if default == row.value => "same".to_owned(),
            Some(default) => default.to_string(),
            None => String::new(),
        };
        let meaning = match row.unused_by_law {
            Some(law) => format!("(not used by law {law}) {}", row.meaning),
            None => row.meaning.clone(),
        };
        [
            shown("parameter", &row.name),
            shown("value", row.value.to_string()),
            shown("unit", row.unit),
            shown("range", &row.range),
            shown("default", default),
            shown("meaning", meaning),
        ]
    };
    let shown = rows("", parameters.iter().map(row));
    Figures::from([data("parameters", &parameters), shown]).conclude(json, None)
}

/// What differs between the vehicle and a file, or the defaults.
fn differences(have: &[Parameter], wanted: Option<&[Parameter]>) -> Vec<Difference> {
    let defaults = Params::default();
    let other = |name: &str| match wanted {
        Some(file) => file.iter().find(|row| row.name == name).map(|row| row.value),
        None => defaults.value(name).filter(|_| !is_measured(name)),
    };
    let difference = |row: &Parameter| {
        let other = other(&row.name).filter(|other| *other != row.value)?;
        Some(Difference { name: row.name.clone(), vehicle: row.value, other })
    };
    have.iter().filter_map(difference).collect()
}

fn diff(have: &[Parameter], wanted: Option<&[Parameter]>, json: bool) -> Result<Verdict> {
    let differences = differences(have, wanted);
    let other = if wanted.is_some() { "file" } else { "default" };
    let unknown = wanted.unwrap_or_default().iter().map(|row| &row.name);
    let unknown: Vec<&String> =
        unknown.filter(|name| have.iter().all(|row| row.name != **name)).collect();
    let row = |row: &Difference| {
        [
            shown("parameter", &row.name),
            shown("vehicle", row.vehicle.to_string()),
            shown(other, row.other.to_string()),
        ]
    };
    let shown = rows("", differences.iter().map(row));
    let figures = [data("differences", &differences), data("unknown", &unknown), shown];
    Figures::from(figures).conclude(json, None)?;
    for name in &unknown {
        eprintln!("{name} is in the file and not in the vehicle");
    }
    Ok(Verdict::of(differences.is_empty() && unknown.is_empty()))
}

fn load(
    vehicle: &mut Vehicle,
    wanted: Vec<Parameter>,
    skip_unknown: bool,
    json: bool,
) -> Result<Verdict> {
    let have = vehicle.parameters()?;
    let is_known = |row: &Parameter| have.iter().any(|other| other.name == row.name);
    let (wanted, unknown): (Vec<_>, Vec<_>) = wanted.into_iter().partition(is_known);
    let unknown: Vec<_> = unknown.into_iter().map(|row| row.name).collect();
    let names = unknown.join(", ");
    if !unknown.is_empty() && !skip_unknown {
        bail!(BadInput::new(format!(
            "the vehicle has no parameter {names}; nothing was changed (--skip-unknown sets the others)"
        )));
    }
    if !unknown.is_empty() {
        eprintln!("the vehicle has no parameter {names}");
    }
    let changes = differences(&have, Some(&wanted));
    for change in &changes {
        vehicle.set_parameter(&change.name, change.other)?;
        eprintln!("{}: {} -> {}", change.name, change.vehicle, change.other);
    }
    // A change may have undone another one.
    let mut left = differences(&vehicle.parameters()?, Some(&wanted));
    left.retain(|row| !is_measured(&row.name));
    let count = changes.len();
    done(
        json,
        [figure("changed", count), data("differences", &changes), data("left", &left)],
        format!("{count} of {} changed", wanted.len()),
    )?;
    for Difference { name, vehicle, other } in &left {
        eprintln!("{name} is {vehicle} in the vehicle, {other} in the file");
    }
    Ok(Verdict::of(left.is_empty()))
}

/// The defaults of the parameters with these names.
fn defaults(names: &[String]) -> Result<Vec<Parameter>> {
    let default = |name: &String| match Params::default().value(name) {
        Some(value) => Ok(Parameter { name: name.clone(), value }),
        None => bail!(BadInput::new(format!(
            "this tool knows no parameter {name}; `tvc param list` shows them"
        ))),
    };
    names.iter().map(default).collect()
}

/// Sets the parameters in `some` to their defaults, all of them if it is empty, or loads the stored
/// ones.
fn reset(vehicle: &mut Vehicle, some: &[Parameter], stored: bool, json: bool) -> Result<Verdict> {
    let before = vehicle.parameters()?;
    if stored {
        vehicle.command(request::RELOAD)?;
    } else if some.is_empty() {
        vehicle.command(request::RESET)?;
    }
    for row in some {
        vehicle.set_parameter(&row.name, row.value)?;
    }
    let mut changes = differences(&before, Some(&vehicle.parameters()?));
    changes.retain(|change| !is_measured(&change.name));
    for change in &changes {
        eprintln!("{}: {} -> {}", change.name, change.vehicle, change.other);
    }
    let count = changes.len();
    done(
        json,
        [figure("changed", count), data("differences", &changes)],
        format!("{count} changed; `tvc param save` keeps them over a loss of power"),
    )
}

fn dump(vehicle: &mut Vehicle, path: Option<&Path>, json: bool) -> Result<Verdict> {
    let have = vehicle.parameters()?;
    let text = if path.is_some_and(param_file::is_for_qgroundcontrol) {
        param_file::columns(&have, vehicle.link().client().vehicle())
    } else {
        param_file::text(&have)
    };
    if let Some(path) = path {
        write_whole(path, text.as_bytes())?;
        eprintln!("wrote {}", path.display());
    }
    if json {
        return show(&Row::of_all(&have), true);
    }
    if path.is_none() {
        print(text)?;
    }
    Ok(Verdict::Met)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_to_the_file_or_to_the_defaults() {
        let kd = Params::default().pid_kd();
        let measured = Parameter::new("CLK_FINE", 512.0);
        let have = [
            Parameter::new("PID_KP", 1.5),
            Parameter::new("PID_KD", kd),
            Parameter::new("NEW", 7.0),
            measured,
        ];
        let names = |differences: Vec<Difference>| -> Vec<(String, f32)> {
            let pairs = differences.into_iter().map(|row| (row.name, row.other));
            pairs.collect()
        };
        let default = Params::default().pid_kp();
        assert_eq!(names(differences(&have, None)), [("PID_KP".to_owned(), default)]);
        let file = [Parameter::new("PID_KD", 0.2), Parameter::new("PID_KP", 1.5)];
        assert_eq!(names(differences(&have, Some(&file))), [("PID_KD".to_owned(), 0.2)]);
    }

    #[cfg(unix)]
    #[test]
    fn a_value_that_did_not_stay_is_missed() {
        use crate::vehicle::calibrate::write::tests::{rows, vehicle};
        let has = rows([("SRV_CENTRE_US", 1520.0), ("SRV_DIR", 1.0), ("PID_KP", 1.0)]);
        let wanted = [Parameter::new("SRV_CENTRE_US", 1500.0), Parameter::new("SRV_DIR", -1.0)];
        for (forgets, verdict) in [("SRV_CENTRE_US", Verdict::Missed), ("PID_KP", Verdict::Met)] {
            let (mut vehicle, thread) = vehicle(has.clone(), forgets);
            let loaded = load(&mut vehicle, wanted.to_vec(), false, true);
            assert_eq!(loaded.unwrap(), verdict, "{forgets}");
            drop(vehicle);
            let has = thread.join().unwrap();
            assert_eq!(has[1].value, -1.0);
        }
    }
}
