//! Whatever ends `tvc test` in armed or active flight, the vehicle is neutral afterwards: at a
//! signal because the tool disarms it, else because the vehicle misses its host.

use std::fmt;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use client::state::state_of;
use client::{StateKind, Wire, text};
use mavlink::dialects::common::MavMessage;
use rand::{Rng, SeedableRng, rngs::StdRng};
use rig::pty::Pty;

use crate::running::{self, Running};

/// A machine that is busy with other tests runs the rig slower than real time.
const PATIENCE: Duration = Duration::from_secs(120);
/// After a signal the tool has disarmed by then.
const DISARMED: Duration = Duration::from_millis(500);
/// The vehicle has missed its host by then, and has said so.
const MISSED: Duration = Duration::from_secs(3);

/// How a flight is ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    /// A signal to the tool.
    Signal(&'static str),
    /// The cable is pulled.
    Port,
}

impl End {
    const ALL: [Self; 5] = [
        Self::Signal("INT"),
        Self::Signal("TERM"),
        Self::Signal("HUP"),
        Self::Signal("KILL"),
        Self::Port,
    ];

    /// Whether the tool can still disarm.
    fn leaves_the_tool(self) -> bool {
        !matches!(self, Self::Port | Self::Signal("KILL"))
    }
}

/// What has been heard of the vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    state: Option<StateKind>,
    /// When the state began, as it was heard and by the vehicle's clock.
    since: Option<Instant>,
    since_ms: u32,
    /// The vehicle's clock.
    now_ms: u32,
    pulse_us: u16,
    host_watched: Option<f32>,
}

/// The cable between the rig and the tool, at which everything is heard.
struct Cable {
    heard: Arc<Mutex<Heard>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    path: String,
}

/// The rig's port. A process that another test has just begun may still hold its lock.
fn open(rig: &str) -> Box<dyn serialport::SerialPort> {
    let begun = Instant::now();
    loop {
        let port = serialport::new(rig, 115_200).timeout(Duration::from_millis(1));
        match port.open() {
            Ok(port) => return port,
            Err(error) => assert!(begun.elapsed() < PATIENCE, "{rig}: {error}"),
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

impl Cable {
    fn plug(rig: &str) -> Self {
        let mut port = open(rig);
        let pty = Pty::open().unwrap();
        let path = pty.path().to_str().unwrap().to_owned();
        let (heard, over) = (Arc::new(Mutex::default()), Arc::default());
        let (hears, ends) = (Arc::clone(&heard), Arc::<AtomicBool>::clone(&over));
        let thread = std::thread::spawn(move || {
            let mut wire = Wire::default();
            let mut bytes = [0; 4096];
            while !ends.load(Ordering::Relaxed) {
                let count = port.read(&mut bytes).unwrap_or(0);
                for message in wire.receive(&bytes[..count]) {
                    hear(&mut hears.lock().unwrap(), &message);
                }
                if pty.is_open() {
                    pty.write(&bytes[..count]).unwrap();
                    port.write_all(&pty.read().unwrap()).unwrap();
                }
            }
        });
        Self { heard, over, thread: Some(thread), path }
    }

    fn heard(&self) -> Heard {
        *self.heard.lock().unwrap()
    }

    fn wait_for(&self, what: &str, mut done: impl FnMut(&Heard) -> bool) -> Heard {
        let begun = Instant::now();
        loop {
            let heard = self.heard();
            if done(&heard) {
                return heard;
            }
            assert!(begun.elapsed() < PATIENCE, "{what}: {heard:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// The tool's side of the cable ends.
    fn pull(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

fn hear(heard: &mut Heard, message: &MavMessage) {
    match message {
        MavMessage::HEARTBEAT(beat) => {
            let state = state_of(beat.custom_mode);
            if heard.state != state {
                (heard.state, heard.since) = (state, Some(Instant::now()));
                heard.since_ms = heard.now_ms;
            }
        }
        MavMessage::ATTITUDE_QUATERNION(attitude) => heard.now_ms = attitude.time_boot_ms,
        MavMessage::SERVO_OUTPUT_RAW(servo) => heard.pulse_us = servo.servo1_raw,
        MavMessage::PARAM_VALUE(row) if text(&row.param_id) == "FS_HOST" => {
            heard.host_watched = Some(row.param_value);
        }
        _ => {}
    }
}

/// One flight that was ended, and how long it took until the vehicle was neutral.
#[derive(Debug)]
struct Trial {
    end: End,
    from: StateKind,
    to: StateKind,
    took: Duration,
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { end, from, to, took } = self;
        write!(f, "{end:?} while {from}: {to} after {} ms", took.as_millis())
    }
}

fn send(signal: &str, tool: &Child) {
    let sent = Command::new("kill").args([&format!("-{signal}"), &tool.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Flies until `from`, and ends the flight some time later.
fn trial(rig: &str, end: End, from: StateKind, later: Duration) -> Trial {
    let mut cable = Cable::plug(rig);
    let tool = running::command(&["test", "hold", "--seconds", "600", "--port", &cable.path])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    cable.wait_for("standby", |heard| heard.state == Some(StateKind::Standby));
    let neutral_us = cable.wait_for("a pulse", |heard| heard.pulse_us > 0).pulse_us;
    cable.wait_for("the flight", |heard| heard.state == Some(from));
    std::thread::sleep(later);
    let from = cable.heard().state.unwrap();
    assert!(from.is_armed(), "{from}");
    assert_eq!(cable.heard().host_watched, Some(1.0));
    let (ended, ended_ms) = (Instant::now(), cable.heard().now_ms);
    match end {
        End::Signal(signal) => send(signal, &tool),
        End::Port => {
            cable.pull();
            cable = Cable::plug(rig);
        }
    }
    let armed = |state: Option<StateKind>| state.is_none_or(StateKind::is_armed);
    let heard = cable.wait_for("neutral", |heard| !armed(heard.state));
    // The vehicle waits by its own clock, whatever the machine that runs the rig does meanwhile.
    let took = if end.leaves_the_tool() {
        heard.since.unwrap().saturating_duration_since(ended)
    } else {
        Duration::from_millis((heard.since_ms - ended_ms).into())
    };
    cable.wait_for("the neutral pulse", |heard| heard.pulse_us == neutral_us);
    let said = tool.wait_with_output().unwrap();
    let (status, said) = (said.status, String::from_utf8(said.stderr).unwrap());
    let to = heard.state.unwrap();
    if end.leaves_the_tool() {
        assert_eq!(to, StateKind::Standby, "{end:?}: {said}");
        assert_eq!(status.code(), Some(1), "{end:?}: {said}");
        assert!(said.contains("stopped by the operator"), "{end:?}: {said}");
        assert_eq!(cable.heard().host_watched, Some(0.0), "{end:?}: put back");
    } else {
        assert_eq!(to, StateKind::Failsafe, "{end:?}: {said}");
        let disarmed = running::tvc(&["disarm", "--port", &cable.path]);
        assert!(disarmed.status.success(), "{}", running::said(&disarmed));
        let set = ["param", "set", "FS_HOST", "0", "--port", &cable.path];
        assert!(running::tvc(&set).status.success());
    }
    if end == End::Port {
        assert!(said.contains("went away"), "{said}");
    }
    cable.pull();
    Trial { end, from, to, took }
}

/// Ends this number of flights of one vehicle, by one way after the other from `first` on, at
/// random instants.
fn trials(first: usize, count: usize, seed: u64) -> Vec<Trial> {
    let fixed = ["rig", "--pty", "--seconds", "7200"];
    let (_rig, port) = Running::start(&fixed);
    let mut random = StdRng::seed_from_u64(seed);
    let one = |index: usize| {
        let end = End::ALL[(first + index) % End::ALL.len()];
        // The tool releases a quarter of a second after arming.
        let (from, most_ms) = match random.random_bool(0.3) {
            true => (StateKind::Armed, 150),
            false => (StateKind::Active, 2_000),
        };
        let later = Duration::from_millis(random.random_range(0..=most_ms));
        let trial = trial(&port, end, from, later);
        println!("{trial}");
        trial
    };
    (0..count).map(one).collect()
}

#[test]
fn whatever_ends_a_flight_the_vehicle_is_neutral() {
    // Most of a flight is waiting: four vehicles at a time.
    std::thread::scope(|scope| {
        for first in [0, 2, 4, 6] {
            scope.spawn(move || trials(first, 2, first as u64));
        }
    });
}

/// `tvc rig` with these options beside a folder for files, and the path of its port.
fn rig(options: &[&str]) -> (Running, tempfile::TempDir, String) {
    let fixed = ["rig", "--pty", "--seconds", "600"];
    let (running, port) = Running::start(&[&fixed, options].concat());
    (running, tempfile::tempdir().unwrap(), port)
}

#[test]
fn a_vehicle_whose_sensor_is_gone_is_disarmed_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let faults = folder.path().join("gone.toml");
    let gone = "[[fault]]\nkind = \"unplugged\"\nat_s = 0.3\nfor_s = 1000.0\n";
    std::fs::write(&faults, gone).unwrap();
    let (_rig, _, port) = rig(&["--faults", faults.to_str().unwrap()]);
    let flown = running::tvc(&["test", "step", "--port", &port]);
    let said = running::said(&flown);
    assert_eq!(flown.status.code(), Some(1), "{said}");
    assert!(said.contains("the vehicle gave up"), "{said}");
    let disarmed = running::tvc(&["disarm", "--port", &port]);
    assert!(disarmed.status.success(), "{}", running::said(&disarmed));
    let words = String::from_utf8(disarmed.stdout).unwrap();
    assert!(words.starts_with("disarmed; fault remains: IMU"), "{words}");
    let object = running::json(&running::tvc(&["disarm", "--json", "--port", &port]));
    assert_eq!(object["state"], "failsafe", "{object}");
    assert!(object["fault"].as_str().unwrap().starts_with("IMU"), "{object}");
}

#[test]
fn a_log_that_cannot_be_written_ends_the_flight_and_says_so() {
    let (_rig, folder, port) = rig(&[]);
    let log = folder.path().join("full.tlog");
    // The limit of a file's size, in units of 512 bytes, in the place of a full disk: it is reached
    // some seconds after the release.
    let script = "trap '' XFSZ; ulimit -f 500; exec \"$@\"";
    let flown = Command::new("sh")
        .args(["-c", script, "sh", env!("CARGO_BIN_EXE_tvc")])
        .args(["test", "hold", "--seconds", "600", "--port", &port, "--log"])
        .arg(&log)
        .output()
        .unwrap();
    let said = running::said(&flown);
    assert_eq!(flown.status.code(), Some(1), "{said}");
    let name = log.display().to_string();
    assert!(said.contains(&format!("error: writing {name}")), "{said}");
    let cable = Cable::plug(&port);
    let heard = cable.wait_for("a state", |heard| heard.state.is_some());
    assert_eq!(heard.state, Some(StateKind::Standby));
}

/// `cargo test -p ground --test real_time -- --ignored --nocapture hundred`: a hundred flights
/// in a quarter of an hour, whose times count on a machine that does nothing else.
#[test]
#[ignore = "takes a quarter of an hour"]
fn a_hundred_flights_end_in_time() {
    let trials = trials(0, 100, 2);
    for (of_tool, most) in [(true, DISARMED), (false, MISSED)] {
        let took = trials
            .iter()
            .filter(|trial| trial.end.leaves_the_tool() == of_tool)
            .map(|trial| trial.took);
        let worst = took.clone().max().unwrap();
        let who = if of_tool { "the tool" } else { "the vehicle" };
        println!("{} ended by {who}: {worst:?} at most", took.count());
        assert!(worst <= most, "{worst:?}");
    }
}
