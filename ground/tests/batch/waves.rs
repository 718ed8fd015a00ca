//! The bus of a flight, decoded by sigrok, whose decoder nobody here wrote.

use std::process::Command;

use crate::running::{said, tvc};

#[test]
fn sigrok_finds_each_burst_of_a_flight_and_no_error() {
    let folder = tempfile::tempdir().unwrap();
    let [waves, report] = ["flight.vcd", "flight.html"].map(|name| folder.path().join(name));
    let [waves, report] = [&waves, &report].map(|path| path.to_str().unwrap());
    let output = tvc(&["fly", "--start", "0.4", "--vcd", waves, "--report", report, "--json"]);
    assert!(output.status.success(), "{}", said(&output));
    let text = std::fs::read_to_string(waves).unwrap();
    for signal in ["sda", "scl", "servo", "servo2", "probe"] {
        assert!(text.contains(&format!(" {signal} $end")), "{signal}");
    }
    let sigrok = Command::new("sigrok-cli")
        .args(["-I", "vcd", "-i", waves, "-P", "i2c:scl=scl:sda=sda", "-A", "i2c"])
        .output();
    let Ok(sigrok) = sigrok else {
        eprintln!("sigrok-cli is not installed: the bus is not decoded");
        return;
    };
    let told = String::from_utf8(sigrok.stdout).unwrap();
    let count = |what: &str| told.lines().filter(|line| line.ends_with(what)).count();
    // In three seconds some 450 bursts and as many verifications, each with one repeated START.
    let (begun, ended) = (count(": Start"), count(": Stop"));
    assert!((850..1_000).contains(&begun), "{begun} transactions");
    // The record may end within a transaction.
    assert!(begun - ended <= 1, "{begun} begin, {ended} end");
    let asked = count("Address write: 28") - count(": Start repeat");
    assert!(asked <= 1, "no other sensor is asked");
    // The master refuses the last byte of a read, nobody anything else.
    assert!(count(": NACK").abs_diff(ended) <= 1, "{} refusals", count(": NACK"));
}
