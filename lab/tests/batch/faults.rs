//! `lab faults` in short campaigns.

use crate::running::{command, object, tvc};

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
    let object = object(&output);
    let faults = object["faults"].as_array().unwrap();
    let kinds: Vec<_> = faults.iter().map(|row| row["kind"].as_str().unwrap()).collect();
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

/// A run depends on its campaign's seed, its kind and its number alone: neither on the runs beside
/// it and before it, nor on how many there are at a time.
#[test]
fn a_campaign_and_rerun_give_the_same_rows_by_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let here = |arguments: &str| {
        let mut command = command(&["faults"]);
        command.args(arguments.split(' ')).current_dir(folder.path());
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{arguments}: {said}");
    };
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let faults = "--seed 78 --runs 4 --kind spikes ram-statics";
    let sound = "--seed 78 --sound --kind magnet saves --phase standby --servo digital \
                 --vehicle drone2 --seconds 1 --runs 4";
    for (campaign, length) in [(faults, ""), (sound, "seconds = 1\n")] {
        here(&format!("{campaign} --jobs 1 --out one.csv"));
        here(&format!("{campaign} --jobs 2 --out two.csv"));
        let table = read("one.csv");
        assert_eq!(table, read("two.csv"));
        let mut rows = csv::Reader::from_reader(table.as_bytes());
        let head = rows.headers().unwrap().clone();
        let rows: Vec<_> = rows.records().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 4);
        for row in rows.iter().rev().step_by(2) {
            let value = |name: &str| &row[head.iter().position(|key| key == name).unwrap()];
            let names = ["campaign", "vehicle", "servo", "phase", "kind"];
            let names = names.map(|name| format!("{name} = \"{}\"\n", value(name)));
            let numbers = ["seed", "number"].map(|name| format!("{name} = {}\n", value(name)));
            let run = [&names.concat(), &numbers.concat(), length, "hardware = \"\"\n"].concat();
            std::fs::write(folder.path().join("run.toml"), run).unwrap();
            here("rerun run.toml --out again.csv");
            let again = read("again.csv");
            let mut again = csv::Reader::from_reader(again.as_bytes());
            assert_eq!(again.records().next().unwrap().unwrap(), *row);
        }
    }
}
