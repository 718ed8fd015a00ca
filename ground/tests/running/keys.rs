//! The paths of the keys that a command prints with `--json`, such as `runs[].overshoot_pct`, held
//! against those stored in `golden/keys/`. Values are the subject of other tests.
//!
//! A change of the keys that is meant is taken over by running the tests with `TRYCMD=overwrite`,
//! and read as a difference before it is committed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Where the keys are stored, a file for each command and a path a line.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/keys")
}

/// The keys of `object` are those of `name`.
pub(crate) fn assert_keys(name: &str, object: &Value) {
    if let Some(difference) = difference(name, std::slice::from_ref(object)) {
        panic!("{difference}");
    }
}

/// What the keys of `objects`, together, have lost and gained over those of `name`.
pub(crate) fn difference(name: &str, objects: &[Value]) -> Option<String> {
    let mut found = BTreeSet::new();
    for object in objects {
        assert!(object.is_object(), "{name}: {object}");
        collect(object, "", &mut found);
    }
    // A place that is empty in one object and has keys in another has those keys.
    let bare: Vec<String> = found
        .iter()
        .filter(|path| {
            let below = |other: &&String| {
                other
                    .strip_prefix(path.as_str())
                    .is_some_and(|rest| rest.starts_with(['.', '[']))
            };
            found.iter().any(|other| below(&other))
        })
        .cloned()
        .collect();
    found.retain(|path| !bare.contains(path));
    let file = folder().join(format!("{name}.txt"));
    if std::env::var("TRYCMD").is_ok_and(|how| how == "overwrite") {
        let text: String = found.iter().map(|path| format!("{path}\n")).collect();
        std::fs::create_dir_all(folder()).unwrap();
        std::fs::write(&file, text).unwrap();
        return None;
    }
    let expected = std::fs::read_to_string(&file)
        .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let expected: BTreeSet<String> = expected.lines().map(str::to_owned).collect();
    let lost: Vec<_> = expected.difference(&found).collect();
    let new: Vec<_> = found.difference(&expected).collect();
    (found != expected).then(|| format!("keys of {name}: lost {lost:?}, new {new:?}"))
}

/// The paths of all that `value` holds; an element of an array is `[]`, whatever its place.
fn collect(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(members) if !members.is_empty() => {
            for (key, member) in members {
                let dot = if path.is_empty() { "" } else { "." };
                collect(member, &format!("{path}{dot}{key}"), found);
            }
        }
        Value::Array(elements) if !elements.is_empty() => {
            for element in elements {
                collect(element, &format!("{path}[]"), found);
            }
        }
        Value::Array(_) => {
            found.insert(format!("{path}[]"));
        }
        _ => {
            found.insert(path.to_owned());
        }
    }
}
