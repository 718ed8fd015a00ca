//! The guided calibration at the virtual rig: image, emulated sensor and the hand that does what it
//! is asked.

use std::io::Write;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use rig::inertial::ImuErrors;
use serde_json::Value;

use super::truth;
use crate::running::keys::assert_keys;
use crate::running::{self, json, object, said};

/// A rig in the process of each command, which keeps what the vehicle stores from one to the next.
struct Rig {
    options: String,
    folder: tempfile::TempDir,
}

impl Rig {
    fn start(options: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let memory = folder.path().join("nano.bin");
        let options = format!("--rig={options} --memory {}", memory.display());
        Self { options, folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn tvc(&self, arguments: &[&str]) -> Output {
        self.typing("", arguments)
    }

    /// A command at the rig, with somebody at the keyboard.
    fn typing(&self, keys: &str, arguments: &[&str]) -> Output {
        let mut tvc = running::command(arguments)
            .args([&self.options, "--json"])
            .current_dir(self.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut keyboard = tvc.stdin.take().unwrap();
        keyboard.write_all(keys.as_bytes()).unwrap();
        drop(keyboard);
        tvc.wait_with_output().unwrap()
    }

    /// A command in a terminal: what it has shown, up to a question and a second longer; the answer
    /// is no.
    fn in_terminal(&self, arguments: &[&str], question: &str) -> String {
        let pty = rig::pty::Pty::open().unwrap();
        let terminal = || {
            let mut options = std::fs::File::options();
            options.read(true).write(true).open(pty.path()).unwrap()
        };
        let mut tvc = running::command(arguments)
            .arg(&self.options)
            .env("TERM", "xterm")
            .stdin(terminal())
            .stdout(Stdio::null())
            .stderr(terminal())
            .spawn()
            .unwrap();
        let mut shown = String::new();
        let mut asked = None;
        // A second after the question it still stands at the end.
        while asked.is_none_or(|at: Instant| at.elapsed() < Duration::from_secs(1)) {
            shown += &String::from_utf8_lossy(&pty.read().unwrap());
            if asked.is_none() && shown.contains(question) {
                asked = Some(Instant::now());
            }
            assert!(tvc.try_wait().unwrap().is_none(), "{shown}");
            std::thread::sleep(Duration::from_millis(10));
        }
        pty.write(b"n\n").unwrap();
        tvc.wait().unwrap();
        shown
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.tvc(arguments);
        json(&output)
    }

    /// Every parameter by its name, but for those that the vehicle measures by itself.
    fn parameters(&self) -> Value {
        let list = self.json(&["param", "list"]);
        let rows = list["parameters"].as_array().unwrap().iter();
        let measured = ["CLK_FINE", "I2C_STRETCH_US"];
        let rows = rows.filter(|row| !measured.iter().any(|name| row["name"] == *name));
        rows.map(|row| (row["name"].as_str().unwrap().to_owned(), row["value"].clone()))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}

/// The rig's gyroscope shifts by -0.1 deg/s for 1 g from tail to nose.
#[test]
fn a_rocket_learns_how_acceleration_shifts_its_gyroscope() {
    let rig = Rig::start("--vehicle rocket --seed 5");
    let found = json(&rig.tvc(&["calibrate", "--yes", "--only", "gyr,acc"]));
    for name in ["GYR_PER_G_X", "GYR_PER_G_Y"] {
        let shift = found["parameters"][name].as_f64().unwrap();
        assert!((shift + 0.1).abs() < 0.015, "{name}: {shift}");
    }
    let deviation = found["parameters"]["GYR_PER_G"].as_f64().unwrap();
    assert!((0.001..0.004).contains(&deviation), "{deviation}");
}

#[test]
fn a_sensor_with_the_largest_errors_is_calibrated_at_the_port_and_out_of_the_recording_alike() {
    let rig = Rig::start("--sensor-errors worst --seed 5 --hardware gyro-per-g=0");
    let output = rig.tvc(&["calibrate", "--yes", "--place", "55.79,12.52"]);
    let found = json(&output);
    assert_keys("calibrate", &found);
    assert_eq!(found["written"], true);
    let words = said(&output);
    for step in ["1/4", "2/4", "3/4", "4/4", "read back from the flash"] {
        assert!(words.contains(step), "{words}");
    }
    // What the vehicle has, its power cut in between, is what was found and what is true.
    let has = rig.parameters();
    truth::assert_near(&ImuErrors::LARGEST, &has);
    for (name, value) in found["parameters"].as_object().unwrap() {
        assert_eq!(&has[name], value, "{name}");
    }
    assert!(has["DECLINATION_DEG"].as_f64().unwrap() > 4.0);

    let again = running::command(&["calibrate", "--json", "--place", "55.79,12.52", "--from"])
        .arg(rig.path("report/calibration.tlog"))
        .current_dir(rig.folder.path())
        .output()
        .unwrap();
    let again = json(&again);
    assert_keys("calibrate-from", &again);
    assert_eq!(again["parameters"], found["parameters"]);
    assert_eq!(again["written"], false);
    let page = std::fs::read_to_string(rig.path("report/calibrate.html")).unwrap();
    assert!(page.contains("Directions of the field") && page.contains("before"));
}

/// Status 1 and the reason; the vehicle keeps what it has.
fn assert_refused(hand: &str, only: &str, reason: &str) {
    let rig = Rig::start(&format!("--sensor-errors worst --hand {hand}"));
    let before = rig.parameters();
    let output = rig.tvc(&["calibrate", "--yes", "--only", only]);
    let words = said(&output);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains(&format!("refused: {reason}")), "{words}");
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(figures["written"], false);
    assert!(figures["refused"][0].as_str().unwrap().starts_with(reason));
    assert_eq!(rig.parameters(), before);
}

#[test]
fn a_hand_that_trembles_is_refused_with_the_reason() {
    assert_refused("trembling", "gyr", "it moved during the rest");
}

#[test]
fn a_turn_about_one_axis_is_refused_with_the_reason() {
    assert_refused("lazy", "mag", "the magnetometer has seen");
}

#[test]
fn who_does_not_agree_keeps_the_vehicle_as_it_is() {
    let rig = Rig::start("");
    let before = rig.parameters();
    let output = rig.typing("n\n", &["calibrate", "--only", "gyr"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert_eq!(object(&output)["written"], false);
    assert!(said(&output).contains("the vehicle is as it was"));
    assert_eq!(rig.parameters(), before);
    let output = rig.typing("y\n", &["calibrate", "--only", "gyr"]);
    assert_eq!(json(&output)["written"], true);
    assert_ne!(rig.parameters(), before);
}

#[test]
fn a_nano_out_of_its_box_is_armed_after_its_rudder_was_seen_and_again_after_its_servo_was_turned() {
    let rig = Rig::start("--blank");
    let seen = rig.json(&["calibrate", "polarity", "--yes"]);
    assert_keys("calibrate-polarity", &seen);
    assert_eq!(seen["checked"], true, "{seen}");
    let pulse = |name: &str| seen[name].as_i64().unwrap();
    assert!(pulse("nose_up_us") > pulse("upright_us") + 40, "{seen}");
    assert!(pulse("nose_down_us") < pulse("upright_us") - 40, "{seen}");
    assert_eq!(rig.parameters()["SRV_POLARITY"], 1.0);

    rig.json(&["calibrate", "servo", "--direction=-1", "--yes"]);
    assert_eq!(rig.parameters()["SRV_POLARITY"], 0.0);
    let output = rig.typing("y\nn\n", &["calibrate", "polarity"]);
    assert!(said(&output).contains("us, servo -"), "{}", said(&output));
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let refused = "refused: the rudder answers the wrong way: set SRV_DIR to 1";
    assert!(said(&output).contains(refused), "{}", said(&output));
    assert_eq!(rig.parameters()["SRV_POLARITY"], 0.0);
    let refused = rig.tvc(&["arm"]);
    assert!(said(&refused).contains("run tvc calibrate polarity first"));
}

#[test]
fn a_servo_is_set_up_by_what_is_given_or_by_what_a_person_sees() {
    let rig = Rig::start("");
    let given = rig.json(&[
        "calibrate",
        "servo",
        "--centre",
        "1510",
        "--us-per-deg",
        "9.5",
        "--min",
        "950",
        "--max",
        "2100",
        "--yes",
    ]);
    assert_eq!((&given["written"], &given["changed"]), (&true.into(), &4.into()));
    assert_keys("calibrate-servo", &given);
    assert_eq!(given["polarity_checked"], true);
    // Centre 1530 and a nudge up; 29 and 31 deg; wrong way round; ends.
    let keys = "1530\n+\n\n29\n31\nn\n900\n\n2150\n--\n\ny\n";
    let found = json(&rig.typing(keys, &["calibrate", "servo"]));
    for (name, value) in [
        ("SRV_CENTRE_US", 1535.0),
        ("SRV_US_PER_DEG", 10.0),
        ("SRV_DIR", -1.0),
        ("SRV_MIN_US", 900.0),
        ("SRV_MAX_US", 2140.0),
    ] {
        assert_eq!(found["parameters"][name], value, "{name}");
        assert_eq!(rig.parameters()[name], value, "{name}");
    }
    assert_eq!(found["polarity_checked"], false);
    // The keys stand on a line of their own, and once for each pulse.
    let typed = rig.typing(keys, &["calibrate", "servo"]);
    let asked = said(&typed).matches(" us.\nPulse in us, + or - for 5 us").count();
    assert_eq!(asked, 3, "{}", said(&typed));
    let bad = rig.tvc(&["calibrate", "servo", "--centre", "1700", "--yes"]);
    assert_eq!(bad.status.code(), Some(2));
    assert!(said(&bad).contains("--centre 1700"), "{}", said(&bad));
}

/// 5 mm forward lower the nose: 0.040 rad of servo hold it.
#[test]
fn a_lateral_offset_of_the_mass_is_measured_in_flight_and_held_before_the_next() {
    let rig = Rig::start("--cm-offset 5");
    let first = rig.json(&["calibrate", "hold", "--seconds", "2", "--yes"]);
    let hold_deg = first["hold_deg"].as_f64().unwrap();
    assert!((hold_deg.abs() - 2.3).abs() < 0.4, "{first}");
    assert_keys("calibrate-hold", &first);
    assert_eq!(first["written"], true);
    let second = rig.json(&["calibrate", "hold", "--seconds", "2", "--yes"]);
    assert!(second["crank_deg"].as_f64().unwrap().abs() < 0.4, "{second}");
    assert!((second["hold_deg"].as_f64().unwrap() - hold_deg).abs() < 0.4);
}

#[test]
fn in_a_terminal_a_question_stands_alone_below_what_is_to_be_done() {
    let rig = Rig::start("--blank --speed 5");
    let question = "Does the rudder's lower edge point forward, to the raised side? [y/N] ";
    let shown = rig.in_terminal(&["calibrate", "polarity"], question);
    assert!(shown.ends_with(question), "{shown:?}");
    // What is cleared on a line before is not seen any more.
    let lines = shown.lines().filter_map(|line| line.rsplit("\x1b[2K").next());
    let steps: Vec<_> = lines.filter(|line| line.contains("/3  ")).collect();
    let asked = [
        "1/3  Thrust off. Hold the vehicle upright.",
        "2/3  Tilt it nose up by some 20 deg, hold it, and look at the rudder.",
    ];
    assert_eq!(steps, asked, "{shown:?}");
}
