//! What an update costs on the chip is held to its limits, and measured as it says.

use std::collections::BTreeSet;

use serde::Deserialize;

use crate::running::keys::assert_keys;
use crate::running::tvc;

#[derive(Deserialize)]
struct Report {
    filters: Vec<Figures>,
    laws: Vec<Law>,
}

#[derive(Deserialize)]
struct Figures {
    filter: String,
    library: String,
    mode: String,
    scalar: String,
    #[serde(flatten)]
    cost: Cost,
}

#[derive(Deserialize)]
struct Law {
    law: String,
    scalar: String,
    #[serde(flatten)]
    cost: Cost,
}

#[derive(Deserialize)]
struct Cost {
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

impl Cost {
    fn assert_measured(&self, name: &str, scalar: &str) {
        assert!(self.cycles_mean <= self.cycles_max as f64, "{name}");
        assert!(self.cycles_mean < self.cycles_mean_1ws, "{name}");
        assert!(self.cycles_mean_1ws < 1.5 * self.cycles_mean, "{name}");
        assert!(self.code_bytes > 0 && self.ram_bytes > 0 && self.stack_bytes > 0, "{name}");
        // Float is calls on this core, and calls have names.
        let is_float = self.support_routines.contains("__aeabi_fmul");
        assert_eq!(is_float, scalar != "fixed", "{name}");
    }
}

/// One run, so that what all images have in common is built once. That it ends well says besides
/// that the law's every output was, bit for bit, the host's.
#[test]
fn updates_keep_their_limits_on_the_chip() {
    let report = measure(&[
        "--library=tvc-fusion",
        "--library=imu-fusion",
        "--filter=mahony",
        "--filter=vqf",
        "--filter=roll-pitch-yaw",
        "--filter=imu-fusion",
        "--law=fixed-surface",
    ]);
    for f in &report.filters {
        let name = format!("{} {} {}", f.filter, f.mode, f.scalar);
        f.cost.assert_measured(&name, &f.scalar);
        // So are 64-bit products and division.
        if f.scalar == "fixed" {
            assert_eq!(f.cost.support_routines, BTreeSet::new(), "{name}");
        }
    }
    // The account of the deviations and the code for sensors that lag are part of them.
    for (filter, most_cycles, most_bytes) in [("mahony", 950, 3_560), ("vqf", 1_150, 3_860)] {
        let fixed = report.of(filter, "9d", "fixed");
        let (cycles, bytes) = (fixed.cost.cycles_max, fixed.cost.code_bytes);
        assert!(cycles <= most_cycles, "{filter}: {cycles} cycles");
        assert!(bytes <= most_bytes, "{filter}: {bytes} bytes");
    }
    let angles = report.of("roll-pitch-yaw", "9d", "fixed");
    assert!(angles.cost.cycles_max <= 1_500, "{}", angles.cost.cycles_max);
    let (own, peer) = (report.of("mahony", "9d", "f32"), report.of("imu-fusion", "9d", "f32"));
    assert_eq!((&*own.library, &*peer.library), ("tvc-fusion", "imu-fusion"));
    let (own, peer) = (own.cost.cycles_mean, peer.cost.cycles_mean);
    assert!(own <= peer, "{own} against {peer}");
    let [surface] = &report.laws[..] else { panic!("{} laws", report.laws.len()) };
    assert_eq!((&*surface.law, &*surface.scalar), ("surface", "fixed"));
    surface.cost.assert_measured("surface", "fixed");
    let cycles = surface.cost.cycles_mean;
    assert!(cycles <= 2_750.0, "{cycles} cycles");
}
