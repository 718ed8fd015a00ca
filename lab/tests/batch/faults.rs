//! `lab faults` in short campaigns.

use crate::running::tvc;

#[test]
fn faults_as_json_are_one_object_that_adds_up() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("faults.html");
    let output = tvc(&[
        "faults",
        "--json",
        "--runs",
        "4",
        "--kind",
        "unplugged",
        "--kind",
        "spikes",
        "--jobs",
        "2",
        "--report",
        report.to_str().unwrap(),
    ]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let object: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let faults = object["faults"].as_array().unwrap();
    let kinds: Vec<_> = faults
        .iter()
        .map(|row| row["kind"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["unplugged", "spikes"]);
    for row in faults {
        let count = |key: &str| row[key].as_u64().unwrap();
        assert_eq!(count("runs"), 2);
        assert_eq!(count("recovered") + count("neutral") + count("unsafe"), 2);
        assert_eq!(count("unsafe"), 0);
        let worst = row["worst_ms"].as_f64().unwrap();
        assert!((0.0..=150.0).contains(&worst), "{row}");
    }
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("No run was unsafe") && page.contains("unplugged run "));
}
