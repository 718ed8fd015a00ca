//! What a ground station may want to know of the parameters: units, ranges and meanings, as the
//! files of MAVLink's component metadata protocol.

use serde_json::{Value, json};
use tvc_nano::params::{Change, DESCRIPTIONS, Description, Info, Range, TABLE};

use super::ftp::File;
use crate::vehicle::param::meaning;

/// Address of the file that names the others.
pub const GENERAL: &str = "mftp:///general.json";
const PARAMETERS: &str = "mftp:///parameters.json";
/// COMP_METADATA_TYPE_PARAMETER.
const PARAMETER_TYPE: u8 = 1;
/// Digits that the range of a parameter is shown with.
const DIGITS: i32 = 6;

/// The files: first the one that names the other.
pub fn files() -> [File; 2] {
    let rows = TABLE.iter().zip(DESCRIPTIONS);
    let parameters = File {
        path: PARAMETERS.trim_start_matches("mftp://"),
        // QGroundControl reads version 1 only.
        content: content(&json!({
            "version": 1,
            "parameters": rows.map(|(info, about)| row(info, about)).collect::<Vec<_>>(),
        })),
    };
    let general = File {
        path: GENERAL.trim_start_matches("mftp://"),
        content: content(&json!({
            "version": 1,
            "vendorName": "tvc-nano",
            "modelName": "tvc-nano",
            "firmwareVersion": env!("CARGO_PKG_VERSION"),
            "metadataTypes": [{
                "type": PARAMETER_TYPE,
                "uri": PARAMETERS,
                "fileCrc": parameters.checksum(),
            }],
        })),
    };
    [general, parameters]
}

fn content(object: &Value) -> Vec<u8> {
    object.to_string().into_bytes()
}

fn row(info: &Info, about: &Description) -> Value {
    let note = match info.change {
        Change::Live => "",
        Change::Disarmed => " Cannot be changed while armed.",
        Change::Turning => " Cannot be changed while armed; the polarity is to be checked anew.",
        Change::Measured => " The vehicle sets it by itself.",
    };
    let mut row = json!({
        "name": info.name,
        "type": "Float",
        "shortDesc": meaning(info.name),
        "longDesc": format!("{}.{note}", meaning(info.name)),
        "units": about.unit,
        "default": exact(info.default),
        "group": info.name.split('_').next(),
        "category": "Standard",
        "volatile": info.change == Change::Measured,
    });
    match info.range {
        Range::Between(low, high) => {
            let decimals = DIGITS - (high - low).log10().ceil() as i32;
            row["min"] = exact(low);
            row["max"] = exact(high);
            row["decimalPlaces"] = decimals.clamp(0, 7).into();
        }
        Range::OneOf(values) => {
            let value =
                |value: &f32| json!({ "value": exact(*value), "description": value.to_string() });
            row["values"] = values.iter().map(value).collect();
        }
    }
    row
}

/// The number that a person would write: 0.1, not 0.10000000149.
fn exact(value: f32) -> Value {
    value
        .to_string()
        .parse::<f64>()
        .unwrap_or(value.into())
        .into()
}
