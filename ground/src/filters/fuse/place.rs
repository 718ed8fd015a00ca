//! Where the estimates of each recording go.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use flights::log::has_extension;
use report::exit::BadInput;
use report::kind::is_one_file;

/// A place for each of `files` under `out`: the file that it names, or, for several recordings or a
/// folder that is there, `STEM.csv` in it.
///
/// # Errors
/// Several recordings and one file, two recordings of one name, an estimate in place of a
/// recording.
pub fn places(files: &[PathBuf], out: Option<&Path>) -> Result<Vec<Option<PathBuf>>, BadInput> {
    let Some(out) = out else {
        return Ok(vec![None; files.len()]);
    };
    if files.len() > 1 && (has_extension(out, "csv") || out.is_file()) {
        return Err(BadInput::new(format!(
            "--out {} is one file for {} recordings; name a folder",
            out.display(),
            files.len()
        )));
    }
    let in_folder = files.len() > 1 || out.is_dir();
    let mut taken = HashSet::new();
    let mut places = Vec::new();
    for file in files {
        let place = if in_folder {
            let stem = file.file_stem().unwrap_or(file.as_os_str());
            let mut name = stem.to_owned();
            name.push(".csv");
            out.join(name)
        } else {
            out.to_path_buf()
        };
        if files.iter().any(|file| is_one_file(&place, file)) {
            return Err(BadInput::new(format!(
                "--out {} would overwrite a recording",
                place.display()
            )));
        }
        if !taken.insert(place.clone()) {
            return Err(BadInput::new(format!(
                "two recordings would be written to {}; rename one",
                place.display()
            )));
        }
        places.push(Some(place));
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn files(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    #[test]
    fn one_recording_has_the_file_that_is_named_and_several_a_folder() {
        let one = places(&files(&["a/walk.imuq"]), Some(Path::new("est.csv"))).unwrap();
        assert_eq!(one, [Some(PathBuf::from("est.csv"))]);
        let two = places(&files(&["a/walk.imuq", "run.csv"]), Some(Path::new("est"))).unwrap();
        assert_eq!(two, [Some(PathBuf::from("est/walk.csv")), Some(PathBuf::from("est/run.csv"))]);
        assert_eq!(places(&files(&["a", "b"]), None).unwrap(), [None, None]);
    }

    #[test]
    fn nothing_is_overwritten_unasked() {
        let said = |names: &[&str], out: &str| {
            places(&files(names), Some(Path::new(out))).unwrap_err().to_string()
        };
        assert!(said(&["a.imuq", "b.imuq"], "e.csv").contains("name a folder"));
        assert!(said(&["a/x.imuq", "b/x.imuq"], "est").contains("two recordings"));
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log.csv");
        fs::write(&log, "").unwrap();
        let log = log.to_str().unwrap();
        assert!(said(&[log], log).contains("overwrite"));
        assert!(said(&[log], folder.path().to_str().unwrap()).contains("overwrite"));
    }
}
