//! What the page of `tvc web` tells beside the motion: why nothing is armed, what is stored, files
//! of parameters, and releases to compare.

use serde_json::{Value, json};

use super::page::{Page, Server, vehicle};

/// Waits until a parameter has this value, and this one in flash.
fn wait_for(page: &Page, name: &str, value: f64, stored: &Value) {
    page.wait("parameters", |rows| {
        rows.as_array().is_some_and(|rows| {
            let row = rows.iter().find(|row| row["name"] == name);
            row.is_some_and(|row| row["value"] == value && row["stored"] == *stored)
        })
    });
}

#[test]
fn before_arm_is_pressed_the_page_has_the_reason_for_which_it_would_be_refused() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait("condition", |now| now["can_arm"] == true);
    page.set("SRV_POLARITY", 0.0);
    let now = page.wait("condition", |now| now["refusal"] != "");
    assert_eq!(now["can_arm"], false, "{now}");
    let said = page.refused("arm", Value::Null);
    let refusal = now["refusal"].as_str().unwrap();
    assert_eq!(said, format!("arm refused: {refusal}"));
    page.set("SRV_POLARITY", 2.0);
    page.set("SRV_POLARITY", 1.0);
    let now = page.wait("condition", |now| now["can_arm"] == true);
    assert_eq!(now["refusal"], "", "{now}");
    page.arm();
    page.wait("condition", |now| now["can_arm"] == false);
}

#[test]
fn the_page_knows_what_is_in_flash_and_reads_and_writes_files() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    let default = f64::from(tvc_nano::Params::default().pid_kd());
    let default = (default * 1e6).round() / 1e6;
    wait_for(&page, "PID_KD", default, &json!(default));
    page.set("PID_KD", 0.5);
    wait_for(&page, "PID_KD", 0.5, &json!(default));
    page.press("save");
    wait_for(&page, "PID_KD", 0.5, &json!(0.5));
    page.set("PID_KD", 0.25);
    page.press("reload");
    wait_for(&page, "PID_KD", 0.5, &json!(0.5));
    // The watch over this program is not the operator's, and what the vehicle measures neither.
    wait_for(&page, "FS_HOST", 1.0, &Value::Null);
    page.wait("parameters", |rows| {
        let mut rows = rows.as_array().unwrap().iter();
        rows.any(|row| row["name"] == "CLK_FINE" && row["stored"].is_null())
    });

    let answer = page.give("write-file", Value::Null, 0);
    let text = answer["note"].as_str().unwrap();
    let line = text.lines().find(|line| line.starts_with("PID_KD "));
    assert_eq!(line.unwrap().split_whitespace().nth(1), Some("0.5"));
    assert_eq!(text.lines().count(), tvc_nano::Params::count());
    let file = "# of QGroundControl\n1\t1\tPID_KP\t1.25\t9\n1\t1\tNO_SUCH\t2\t9\n";
    let answer = page.give("read-file", json!({ "text": file }), 0);
    let words: Vec<_> = answer["note"].as_str().unwrap().split_whitespace().collect();
    assert_eq!(words, ["PID_KP", "1.25", "NO_SUCH", "2"]);
    let said = page.refused("read-file", json!({ "text": "PID_KP 11" }));
    assert!(said.contains("line 1: PID_KP must be 0 to 10"), "{said}");
    // Nothing is set by that.
    wait_for(&page, "PID_KD", 0.5, &json!(0.5));
}

#[test]
fn releases_by_hand_are_kept_with_what_was_changed_between_them() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    for (number, kp) in [(1, 1.9), (2, 1.5)] {
        page.wait_for("standby");
        // The rig has tilted it again.
        let is_tilted = |now: &Value| now["attitude_deg"][1].as_f64() > Some(16.0);
        page.wait("frame", is_tilted);
        page.set("PID_KP", kp);
        page.arm();
        page.press("release");
        page.wait_for("active");
        std::thread::sleep(std::time::Duration::from_secs(2));
        page.press("stop");
        let releases = page.wait("releases", |rows| rows[number - 1].is_object());
        let release = &releases[number - 1];
        assert_eq!(release["number"], number);
        assert!(release["test"].is_null(), "{release}");
        assert_eq!(release["stayed"], true, "{release}");
        let start = release["start_deg"].as_f64().unwrap();
        assert!((start - 17.2).abs() < 2.0, "{start}");
        assert!(release["run"]["rise_s"].as_f64().unwrap() < 1.0);
        let changes = match number {
            1 => json!([]),
            _ => json!([["PID_KP", 1.9, 1.5]]),
        };
        assert_eq!(release["changes"], changes);
    }
    // A page that is opened later has them, too.
    let later = server.page();
    later.wait("releases", |rows| rows.as_array().unwrap().len() == 2);
}
