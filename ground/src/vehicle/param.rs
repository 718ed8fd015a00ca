//! `tvc param`: the vehicle's parameters, with the meaning that this tool's own table gives them.

use std::path::Path;

use anyhow::Result;
use client::{Parameter, request};
use comfy_table::Table;
use comfy_table::presets::NOTHING;
use serde::Serialize;
use tvc_nano::Params;
use tvc_nano::params::{Change, DESCRIPTIONS};

use crate::out::exit::{BadInput, Verdict};
use crate::out::file::{print, print_json, write_whole};
use crate::param_file;
use crate::vehicle::link::Vehicle;
mod options;
pub use options::{Param, ParamAction, ParamPort};

/// A parameter's value on the vehicle, with this tool's own description of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f32,
    default: Option<f32>,
    unit: &'static str,
    /// The values that it can have, in words.
    pub range: String,
    meaning: &'static str,
}

impl Row {
    /// A parameter with its description; a parameter that this tool does not know has none.
    pub fn of(parameter: &Parameter) -> Self {
        let index = Params::index_of(&parameter.name);
        let info = index.and_then(|index| Params::default().by_index(index).map(|(info, _)| info));
        let description = index.and_then(|index| DESCRIPTIONS.get(index));
        Self {
            name: parameter.name.clone(),
            value: parameter.value,
            default: info.map(|info| info.default),
            unit: description.map_or("", |description| description.unit),
            range: info.map_or(String::new(), |info| info.range.to_string()),
            meaning: description
                .map_or("(unknown to this tool)", |description| description.meaning),
        }
    }
}

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
        ParamAction::Reset { names, .. } => Some(defaults(names)?),
        _ => None,
    };
    let mut vehicle = Vehicle::connect(&options.port.port())?;
    let json = options.port.json;
    match &options.action {
        ParamAction::List => {
            let rows: Vec<Row> = vehicle.parameters()?.iter().map(Row::of).collect();
            show(&rows, json)
        }
        ParamAction::Get { names } => {
            let mut rows = Vec::new();
            for name in names {
                let value = vehicle.parameter(name)?;
                rows.push(Row::of(&Parameter {
                    name: name.clone(),
                    value,
                }));
            }
            show(&rows, json)
        }
        ParamAction::Set { name, value } => {
            vehicle.set_parameter(name, *value)?;
            done(
                json,
                &serde_json::json!({ "set": { name: value } }),
                &format!("{name} = {value}"),
            )
        }
        ParamAction::Save => {
            vehicle.command(request::SAVE)?;
            done(json, &serde_json::json!({ "saved": true }), "saved")
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

fn done(json: bool, object: &serde_json::Value, words: &str) -> Result<Verdict> {
    if json {
        print_json(object)?;
    } else {
        print(format_args!("{words}\n"))?;
    }
    Ok(Verdict::Met)
}

fn show(rows: &[Row], json: bool) -> Result<Verdict> {
    if json {
        print_json(&serde_json::json!({ "parameters": rows }))?;
        return Ok(Verdict::Met);
    }
    let mut table = Table::new();
    table.load_style(NOTHING).set_header([
        "parameter",
        "value",
        "unit",
        "range",
        "default",
        "meaning",
    ]);
    for row in rows {
        let default = match row.default {
            Some(default) if default == row.value => "same".to_owned(),
            Some(default) => default.to_string(),
            None => String::new(),
        };
        table.add_row([
            &row.name,
            &row.value.to_string(),
            row.unit,
            &row.range,
            &default,
            row.meaning,
        ]);
    }
    print(table.trim_fmt() + "\n")?;
    Ok(Verdict::Met)
}

/// What a parameter belongs to, for a person who looks for it.
pub fn group_of(name: &str) -> &'static str {
    const GROUPS: [(&str, &str); 24] = [
        // What the control laws assume of the servo.
        ("SRV_LOOP_S", CONTROL),
        ("SRV_MOTOR_S", CONTROL),
        ("SRV_PLAY_RAD", CONTROL),
        ("SRV_RAD_S", CONTROL),
        ("PID_", CONTROL),
        ("SFC_", CONTROL),
        ("CAS_", CONTROL),
        ("PITCH_", CONTROL),
        ("ROLL_", CONTROL),
        ("AXES", CONTROL),
        ("SRV_POLARITY", SAFETY),
        ("SRV2_POLARITY", SAFETY),
        ("FS_", SAFETY),
        ("SRV_", "Servo"),
        ("SRV2_", "Second servo"),
        ("GS", "Gain schedule"),
        ("LAUNCH_", FREE),
        ("BURN", FREE),
        ("GYR_PER_G", FREE),
        ("MNT_", "Mount and place"),
        ("DECLINATION", "Mount and place"),
        ("FUSE_", "Attitude filter"),
        ("CAL_", "Calibration of the sensors"),
        ("", "Bus, clock and link"),
    ];
    const CONTROL: &str = "Control law";
    const SAFETY: &str = "Safety";
    const FREE: &str = "Free flight";
    let found = GROUPS.iter().find(|(prefix, _)| name.starts_with(prefix));
    found.map_or("", |(_, group)| group)
}

/// Whether the vehicle sets the parameter by itself: its value is no change of the operator's.
pub fn is_measured(name: &str) -> bool {
    Params::info(name).is_some_and(|info| info.change == Change::Measured)
}

/// What differs between the vehicle and a file, or the defaults.
fn differences(have: &[Parameter], wanted: Option<&[Parameter]>) -> Vec<Difference> {
    let defaults = Params::default();
    let other = |name: &str| match wanted {
        Some(file) => file
            .iter()
            .find(|row| row.name == name)
            .map(|row| row.value),
        None => defaults.value(name).filter(|_| !is_measured(name)),
    };
    let difference = |row: &Parameter| {
        let other = other(&row.name).filter(|other| *other != row.value)?;
        Some(Difference {
            name: row.name.clone(),
            vehicle: row.value,
            other,
        })
    };
    have.iter().filter_map(difference).collect()
}

fn diff(have: &[Parameter], wanted: Option<&[Parameter]>, json: bool) -> Result<Verdict> {
    let differences = differences(have, wanted);
    let other = if wanted.is_some() { "file" } else { "default" };
    if json {
        print_json(&serde_json::json!({ "differences": differences }))?;
    } else {
        for row in &differences {
            print(format_args!(
                "{:<16} vehicle {:<12} {other} {}\n",
                row.name, row.vehicle, row.other
            ))?;
        }
    }
    for row in wanted.unwrap_or_default() {
        if !have.iter().any(|other| other.name == row.name) {
            eprintln!("{} is in the file and not in the vehicle", row.name);
        }
    }
    Ok(Verdict::of(differences.is_empty()))
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
        return Err(BadInput::new(format!(
            "the vehicle has no parameter {names}; nothing was changed (--skip-unknown sets the others)"
        ))
        .into());
    }
    if !unknown.is_empty() {
        eprintln!("the vehicle has no parameter {names}");
    }
    let changes = differences(&have, Some(&wanted));
    for change in &changes {
        vehicle.set_parameter(&change.name, change.other)?;
        eprintln!("{}: {} -> {}", change.name, change.vehicle, change.other);
    }
    let count = changes.len();
    done(
        json,
        &serde_json::json!({ "changed": count, "differences": changes }),
        &format!("{count} of {} changed", wanted.len()),
    )
}

/// The defaults of the parameters with these names.
fn defaults(names: &[String]) -> Result<Vec<Parameter>> {
    let default = |name: &String| match Params::default().value(name) {
        Some(value) => Ok(Parameter {
            name: name.clone(),
            value,
        }),
        None => Err(BadInput::new(format!(
            "this tool knows no parameter {name}; `tvc param list` shows them"
        ))
        .into()),
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
        &serde_json::json!({ "changed": count, "differences": changes }),
        &format!("{count} changed; `tvc param save` keeps them over a loss of power"),
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
        let rows: Vec<Row> = have.iter().map(Row::of).collect();
        return show(&rows, true);
    }
    if path.is_none() {
        print(text)?;
    }
    Ok(Verdict::Met)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, value: f32) -> Parameter {
        Parameter {
            name: name.into(),
            value,
        }
    }

    #[test]
    fn differences_are_to_the_file_or_to_the_defaults() {
        let kd = Params::default().pid_kd();
        let measured = row("CLK_FINE", 512.0);
        let have = [
            row("PID_KP", 1.5),
            row("PID_KD", kd),
            row("NEW", 7.0),
            measured,
        ];
        let names = |differences: Vec<Difference>| -> Vec<(String, f32)> {
            let pairs = differences.into_iter().map(|row| (row.name, row.other));
            pairs.collect()
        };
        let default = Params::default().pid_kp();
        assert_eq!(
            names(differences(&have, None)),
            [("PID_KP".to_owned(), default)]
        );
        let file = [row("PID_KD", 0.2), row("PID_KP", 1.5)];
        assert_eq!(
            names(differences(&have, Some(&file))),
            [("PID_KD".to_owned(), 0.2)]
        );
    }

    #[test]
    fn every_parameter_of_the_firmware_is_explained() {
        for info in tvc_nano::params::TABLE {
            let row = Row::of(&row(info.name, info.default));
            assert_eq!(row.default, Some(info.default));
            assert!(!row.meaning.is_empty() && !row.range.is_empty());
            assert!(!group_of(info.name).is_empty());
        }
        for (name, group) in [
            ("SRV_CENTRE_US", "Servo"),
            ("SFC_NEAR", "Control law"),
            ("SRV_PLAY_RAD", "Control law"),
            ("SRV_POLARITY", "Safety"),
            ("MAV_SYSID", "Bus, clock and link"),
        ] {
            assert_eq!(group_of(name), group, "{name}");
        }
    }
}
