//! `tvc bringup` on the rig: nothing differs on a board as it should be, and of ten planted
//! differences each shows in its own row and in no other.

use std::path::PathBuf;

use crate::running::{object, said, tvc};

/// The image, built once for all runs.
fn image(folder: &std::path::Path) -> PathBuf {
    let path = folder.join("image.elf");
    let output = tvc(&["flash", "--elf", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", said(&output));
    path
}

/// Name, result and what was found of each row, on a rig with these options.
fn rows(image: &str, options: &str) -> (Option<i32>, Vec<[String; 3]>) {
    let rig = format!("--rig=--image {image} {options}");
    let output = tvc(&["bringup", rig.trim_end(), "--json"]);
    let told = object(&output);
    let rows =
        told["rows"].as_array().unwrap().iter().map(|row| {
            ["check", "result", "found"].map(|key| row[key].as_str().unwrap().to_owned())
        });
    (output.status.code(), rows.collect())
}

/// The rows that neither pass nor are skipped.
fn strange(rows: &[[String; 3]]) -> Vec<(&str, &str)> {
    let strange = rows.iter().filter(|[_, result, _]| result != "pass" && result != "skipped");
    strange.map(|[check, result, _]| (check.as_str(), result.as_str())).collect()
}

#[test]
fn each_planted_difference_shows_in_its_own_row_alone() {
    let folder = tempfile::tempdir().unwrap();
    let image = image(folder.path());
    let image = image.to_str().unwrap();

    let (status, all) = rows(image, "");
    assert_eq!(strange(&all), [], "{all:#?}");
    assert_eq!(status, Some(0));
    let skipped = all.iter().filter(|[_, result, _]| result == "skipped");
    assert_eq!(skipped.map(|row| row[0].as_str()).collect::<Vec<_>>(), ["gyro scale"]);
    for sensor in ["lsm6ds3", "both"] {
        let (status, all) = rows(image, &format!("--sensor {sensor}"));
        assert_eq!((strange(&all), status), (vec![], Some(0)), "{sensor}: {all:#?}");
    }

    for (hardware, check, result) in [
        ("clock=-3.1", "free clock", "differ"),
        ("stretch=120", "stretch", "differ"),
        ("stop-read=300", "stop", "differ"),
        ("refresh=50/50/20", "refresh", "differ"),
        ("address=0x29", "address", "differ"),
        ("field=dead", "field", "fail"),
        ("flash-time=2", "flash", "differ"),
        ("crc-cycles=100", "crc engine", "differ"),
        ("jumper=no", "servo pulse", "fail"),
        ("watchdog=dead", "watchdog", "fail"),
        ("usb-loss=0.01", "usb", "differ"),
        ("bootloader=uf2", "bootloader", "differ"),
        ("user-row=bootprot", "fuses", "differ"),
    ] {
        let (status, all) = rows(image, &format!("--hardware {hardware}"));
        assert_eq!(strange(&all), [(check, result)], "{hardware}: {all:#?}");
        assert_eq!(status, Some(1), "{hardware}");
    }
}
