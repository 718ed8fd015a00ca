//! What an update costs on the chip is held to its limits, and measured as it says.

use std::collections::BTreeSet;

use serde::Deserialize;

use crate::running::keys::assert_keys;
use crate::running::{assert_refused, tvc};

#[derive(Deserialize)]
struct Report {
    filters: Vec<Figures>,
}

#[derive(Deserialize)]
struct Figures {
    filter: String,
    library: String,
    mode: String,
    scalar: String,
    cycles_mean: f64,
    cycles_max: u64,
    cycles_mean_1ws: f64,
    code_bytes: u32,
    ram_bytes: u32,
    stack_bytes: u32,
    support_routines: BTreeSet<String>,
}

fn measure(arguments: &[&str]) -> Report {
    let output = tvc(&[&["cycles"], arguments, &["--json"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let object = serde_json::from_slice(&output.stdout).unwrap();
    assert_keys("cycles", &object);
    serde_json::from_value(object).unwrap()
}

impl Report {
    fn of(&self, filter: &str, mode: &str, scalar: &str) -> &Figures {
        self.filters
            .iter()
            .find(|f| (&*f.filter, &*f.mode, &*f.scalar) == (filter, mode, scalar))
            .unwrap_or_else(|| panic!("no {filter} {mode} {scalar}"))
    }
}

#[test]
fn updates_keep_their_limits_on_the_chip() {
    let report = measure(&[
        "--library=tvc-fusion",
        "--library=imu-fusion",
        "--filter=mahony",
        "--filter=vqf",
        "--filter=roll-pitch-yaw",
        "--filter=imu-fusion",
    ]);
    for f in &report.filters {
        let name = format!("{} {} {}", f.filter, f.mode, f.scalar);
        assert!(f.cycles_mean <= f.cycles_max as f64, "{name}");
        assert!(f.cycles_mean < f.cycles_mean_1ws, "{name}");
        assert!(f.cycles_mean_1ws < 1.5 * f.cycles_mean, "{name}");
        assert!(
            f.code_bytes > 0 && f.ram_bytes > 0 && f.stack_bytes > 0,
            "{name}"
        );
        // Float, 64-bit products and division are calls on this core, and calls have names.
        if f.scalar == "fixed" {
            assert_eq!(f.support_routines, BTreeSet::new(), "{name}");
        } else {
            assert!(f.support_routines.contains("__aeabi_fmul"), "{name}");
        }
    }
    for (filter, most_cycles, most_bytes) in [("mahony", 800, 2_256), ("vqf", 1_000, 2_560)] {
        let fixed = report.of(filter, "9d", "fixed");
        let (cycles, bytes) = (fixed.cycles_max, fixed.code_bytes);
        assert!(cycles <= most_cycles, "{filter}: {cycles} cycles");
        assert!(bytes <= most_bytes, "{filter}: {bytes} bytes");
    }
    let angles = report.of("roll-pitch-yaw", "9d", "fixed");
    assert!(angles.cycles_max <= 1_500, "{}", angles.cycles_max);
    let (own, peer) = (
        report.of("mahony", "9d", "f32"),
        report.of("imu-fusion", "9d", "f32"),
    );
    assert_eq!(
        (&*own.library, &*peer.library),
        ("tvc-fusion", "imu-fusion")
    );
    let (own, peer) = (own.cycles_mean, peer.cycles_mean);
    assert!(own <= peer, "{own} against {peer}");
}

#[test]
fn a_filter_that_is_not_there_is_refused_with_those_that_are() {
    let cases = [
        (
            &["--filter", "kalman"][..],
            "no filter kalman; there are ahrs-madgwick",
        ),
        (&["--library", "xio"], "no library xio; there are ahrs"),
        (
            &["--library", "ahrs", "--filter", "gyro"],
            "ahrs has no filter gyro",
        ),
    ];
    for (arguments, part) in cases {
        assert_refused(&[&["cycles"], arguments].concat(), part);
    }
}
