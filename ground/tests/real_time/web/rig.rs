//! The panel of the virtual rig.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::page::{PATIENCE, Server, vehicle, vehicle_with};
use super::parameter;
use crate::running::{Running, assert_refused, json as object, said, tvc};

/// A fault before boot and its end, a tilt, a fault in flight, the cable.
#[test]
fn the_panel_acts_on_the_rig_before_boot_and_after() {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait("rig", |rig| rig["held"] == true && rig["usb"] == true);
    page.wait_for("standby");

    page.act("fault unplugged");
    page.act("power-cycle");
    page.wait_for("boot");
    page.wait_for_text("IMU does not answer");
    page.wait("rig", |rig| rig["faults"] == json!(["unplugged"]));
    page.act("clear all");
    page.wait_for("standby");

    page.act("tilt 1");
    page.wait("frame", |frame| frame["attitude_deg"][1].as_f64().is_some_and(|deg| deg > 55.0));
    let said = page.refused("arm", Value::Null);
    assert!(said.contains("refused"), "{said}");
    page.act("tilt 0.3");
    page.wait("frame", |frame| frame["attitude_deg"][1].as_f64().is_some_and(|deg| deg < 18.0));

    page.arm();
    page.press("release");
    page.wait("rig", |rig| rig["held"] == false);
    page.act("fault frozen");
    page.wait_for("failsafe");
    page.wait_for_text("IMU data frozen");
    page.act("clear frozen");
    // The sensor is being set up anew: until then the fault remains.
    let begun = Instant::now();
    while page.wait("rig", |_| true)["held"] == false {
        assert!(begun.elapsed() < PATIENCE, "never caught");
        page.press("stop");
        std::thread::sleep(Duration::from_millis(300));
    }

    // Without a port the panel is still there, and the vehicle keeps the watch over this program,
    // which ends with it.
    page.wait_for_parameter("FS_HOST", 1.0);
    page.act("usb out");
    page.wait("condition", |now| now["connected"] == false);
    std::thread::sleep(Duration::from_secs(3));
    page.act("usb in");
    page.wait("condition", |now| now["connected"] == true);
    page.wait_for("standby");
    page.wait_for_parameter("FS_HOST", 1.0);
    server.end("TERM");
    assert_eq!(parameter(&port, "FS_HOST"), 0.0);
}

/// One command shows everything: the vehicle is released and stopped, and the panel acts.
#[test]
fn the_rig_in_the_process_is_flown_and_acted_on() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::with_rig(folder.path());
    let page = server.page();
    page.wait_for("standby");
    page.wait("rig", |rig| rig["held"] == true && rig["usb"] == true);
    page.arm();
    page.press("release");
    page.wait("rig", |rig| rig["held"] == false);
    page.press("stop");
    page.wait_for("standby");
    page.act("fault unplugged");
    page.wait("rig", |rig| rig["faults"] == json!(["unplugged"]));
    let said = page.refused("rig", json!({ "action": "fault gremlins" }));
    assert!(said.contains("sda-held"), "{said}");
}

#[test]
fn what_is_no_action_comes_late_or_has_no_rig_is_refused() {
    let (folder, port, rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait("rig", |rig| rig["held"] == true);
    for (action, part) in [
        ("fault gremlins", "sda-held"),
        ("tilt", "say `tilt RAD`"),
        ("reset\nreset", "say `reset`"),
        ("hardware address=0x29", "fixed while the rig runs"),
    ] {
        let said = page.refused("rig", json!({ "action": action }));
        assert!(said.contains(part), "{action}: {said}");
    }
    // From then on an order can be so old.
    page.wait_for("standby");
    let late = page.give("rig", json!({ "action": "reset" }), 1_500);
    assert!(late["error"].as_str().unwrap().contains("s old"), "{late}");
    let rig_now = page.wait("rig", |rig| rig.is_object());
    assert_eq!(rig_now["resets"], 0);
    drop(rig);
    page.wait("rig", Value::is_null);
    page.refused("rig", json!({ "action": "reset" }));
    // Its link leads to a number that the next pseudo-terminal may get.
    drop((page, server));

    // A rig without a link cannot be acted on.
    let (_rig, port) = Running::start(&["rig", "--pty", "--seconds", "600"]);
    let server = Server::of(port.as_ref(), folder.path());
    let page = server.page();
    page.wait_for("standby");
    page.wait("rig", Value::is_null);
    let said = page.refused("rig", json!({ "action": "reset" }));
    assert!(said.contains("no virtual rig listens"), "{said}");
}

#[test]
fn a_shell_acts_on_the_rig_too() {
    let (_folder, port, rig) = vehicle_with(&["--blank"]);
    let port = port.to_str().unwrap();
    let tell = |action: &[&str]| tvc(&[&["rig", "tell", port], action].concat());
    let look = object(&tell(&["tilt", "-0.2"]));
    assert_eq!(look["start_rad"], -0.2);
    let look = object(&tell(&["fault", "spikes", "probability=0.05", "for_s=60"]));
    assert_eq!(look["faults"], json!(["spikes"]));
    let look = object(&tell(&["state"]));
    assert_eq!(look["faults"], json!(["spikes"]));
    assert_refused(&["rig", "tell", port, "clamp", "ajar"], "open|closed|auto");
    drop(rig);
    let gone = tell(&["state"]);
    assert_eq!(gone.status.code(), Some(1));
    assert!(said(&gone).contains("no virtual rig listens"), "{}", said(&gone));
}
