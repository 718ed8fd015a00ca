//! Keys of `--json`: every command of the laboratory prints those that are stored in
//! `golden/keys/`.

use crate::running::keys::{self, check_all};

/// What is run one after the other in one folder, `--json` behind it.
const ALONE: &[(&str, &str)] = &[
    ("faults", "faults --runs 2 --kind spikes ram-statics --out faults.csv"),
    ("faults-merge", "faults merge faults.csv"),
    (
        "faults-sound",
        "faults --sound --runs 1 --kind rest --phase standby --servo s3003 --vehicle drone --seconds 1",
    ),
    ("faults-rerun", "faults rerun run.toml"),
    ("profile", "profile --seconds 0.1"),
    ("profile-after", "profile --after 0.1 --seconds 0.1"),
    ("stack", "stack --seconds 0.1"),
    ("hardware", "hardware --quick --only wake"),
];

/// What a test that runs it for other reasons compares.
const ELSEWHERE: &[(&str, &str)] = &[("cycles", "cycles")];

#[test]
fn no_command_with_json_is_without_its_keys() {
    keys::assert_complete(&[ALONE, ELSEWHERE].concat(), 5);
}

#[test]
fn every_command_keeps_its_keys() {
    let folder = tempfile::tempdir().unwrap();
    let run = "seed = 1\ncampaign = \"faults\"\nvehicle = \"drone\"\nservo = \"s3003\"\n\
               hardware = \"\"\nphase = \"flight\"\nkind = \"spikes\"\nnumber = 0\n";
    std::fs::write(folder.path().join("run.toml"), run).unwrap();
    let differences = check_all(folder.path(), ALONE, &[]);
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}
