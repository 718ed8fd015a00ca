//! `tvc fuse` on a piece of a real recording, read back by an oracle of its own.

use std::fs;
use std::path::{Path, PathBuf};

use crate::running;

/// An IMUQ16v1 file: 64 bytes of header, 28 bytes a sample.
const HEADER: usize = 64;
const RECORD: usize = 28;

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/broad_11_cut.imuq")
}

fn json(arguments: &[&str]) -> serde_json::Value {
    running::json(&running::tvc(&[&["fuse"], arguments].concat()))
}

/// One line on standard error with all of `parts` in it; nothing is written to `folder`.
fn assert_refused(folder: &Path, arguments: &[&str], parts: &[&str]) {
    let before = fs::read_dir(folder).unwrap().count();
    let said = running::refused(&[&["fuse"], arguments].concat());
    for part in parts {
        assert!(said.contains(part), "{arguments:?}: {part} in {said}");
    }
    assert_eq!(fs::read_dir(folder).unwrap().count(), before, "{said}");
}

/// The file's rows as numbers, below the line `t,w,x,y,z`.
fn estimates(path: &Path) -> Vec<[f64; 5]> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("t,w,x,y,z"));
    lines
        .map(|line| {
            let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            row.try_into().unwrap()
        })
        .collect()
}

/// Where the vertical of the earth (z) and its east (x) stand in the sensor's axes.
fn axes([w, x, y, z]: [f64; 4]) -> ([f64; 3], [f64; 3]) {
    let up = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z];
    let east = [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)];
    (up, east)
}

fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cos = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
    cos.clamp(-1.0, 1.0).acos().to_degrees()
}

/// RMS angles between the estimated and the true vertical, and between both easts, over the
/// movement.
fn errors_deg(estimates: &[[f64; 5]], bytes: &[u8]) -> (f64, f64) {
    let (mut squares, mut count) = ((0.0, 0.0), 0.0);
    for (estimate, record) in estimates.iter().zip(bytes[HEADER..].chunks_exact(RECORD)) {
        let word = |i: usize| f64::from(i16::from_le_bytes([record[2 * i], record[2 * i + 1]]));
        if record[26] & 3 == 3 {
            let [_, w, x, y, z] = *estimate;
            let (up, east) = axes([w, x, y, z]);
            let (true_up, true_east) = axes([word(9), word(10), word(11), word(12)]);
            squares.0 += angle_deg(up, true_up).powi(2);
            squares.1 += angle_deg(east, true_east).powi(2);
            count += 1.0;
        }
    }
    ((squares.0 / count).sqrt(), (squares.1 / count).sqrt())
}

#[test]
fn every_sample_has_a_row_in_the_recordings_frame_and_the_score_is_that_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (recording(), folder.path().join("est/e.csv"));
    let bytes = fs::read(&file).unwrap();
    for (filter, scalar) in [
        ("mahony", "f32"),
        ("mahony", "fixed"),
        ("madgwick", "f64"),
        ("complementary", "f32"),
        ("vqf", "f32"),
        ("vqf", "fixed"),
    ] {
        let arguments = [
            file.to_str().unwrap(),
            "--filter",
            filter,
            "--scalar",
            scalar,
            "--json",
            "--out",
            out.to_str().unwrap(),
        ];
        let said = json(&arguments);
        let rows = estimates(&out);
        assert_eq!(rows.len(), (bytes.len() - HEADER) / RECORD);
        for (index, [t, w, x, y, z]) in rows.iter().enumerate() {
            assert!((t - index as f64 * 0.0035).abs() < 1e-4, "{t} at {index}");
            let norm = w * w + x * x + y * y + z * z;
            assert!((norm - 1.0).abs() < 1e-6, "{norm} at {index}");
        }
        let (inclination, east) = errors_deg(&rows, &bytes);
        let score = &said["files"][0]["score"];
        let reported = score["inclination_deg"].as_f64().unwrap();
        assert!((reported - inclination).abs() < 1e-4, "{score} against {inclination}");
        // The axis off the vertical turns by most of the whole error, and by no more.
        let total = score["total_deg"].as_f64().unwrap();
        assert!(east <= total && total < 3.0, "{filter} {scalar}: {score}, east {east}");
        assert_eq!(said["mean"]["total_deg"], score["total_deg"]);
    }
}

#[test]
fn fixed_point_and_double_precision_are_close_to_single_precision() {
    let file = recording();
    let score = |filter: &str, scalar: &str, mode: &str| {
        let said = json(&[
            file.to_str().unwrap(),
            "--filter",
            filter,
            "--scalar",
            scalar,
            "--mode",
            mode,
            "--json",
        ]);
        let mean = &said["mean"];
        ["inclination_deg", "total_deg"].map(|part| mean[part].as_f64())
    };
    for filter in ["vqf", "mahony"] {
        for mode in ["6d", "9d"] {
            let single = score(filter, "f32", mode);
            for (scalar, most) in [("f64", 0.01), ("fixed", 0.05)] {
                let other = score(filter, scalar, mode);
                // Without a magnetometer only the inclination means something.
                let parts = if mode == "6d" { 1 } else { 2 };
                for (a, b) in single.iter().zip(other).take(parts) {
                    let apart = (a.unwrap() - b.unwrap()).abs();
                    assert!(apart < most, "{filter} {scalar} {mode}: {apart}");
                }
            }
        }
    }
}

#[test]
fn offline_every_sample_has_a_row_and_the_estimate_is_closer() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("est.csv");
    let (file, out_text) = (recording(), out.to_str().unwrap().to_owned());
    let file = file.to_str().unwrap();
    let live = json(&[file, "--json"]);
    let both = json(&[file, "--offline", "--json", "--out", &out_text]);
    assert_eq!((&live["offline"], &both["offline"]), (&false.into(), &true.into()));
    for figure in ["total_deg", "inclination_deg"] {
        let of = |figures: &serde_json::Value| figures["mean"][figure].as_f64().unwrap();
        assert!(of(&both) < of(&live), "{figure}: {} {}", of(&both), of(&live));
    }
    let bytes = fs::read(file).unwrap();
    let rows = estimates(&out);
    assert_eq!(rows.len(), (bytes.len() - HEADER) / RECORD);
    let (inclination, _) = errors_deg(&rows, &bytes);
    let told = both["mean"]["inclination_deg"].as_f64().unwrap();
    assert!((inclination - told).abs() < 1e-3, "{inclination} {told}");
}

/// The same samples as CSV, without magnetometer or reference where asked.
fn as_csv(bytes: &[u8], magnetometer: bool, reference: bool) -> String {
    let scale = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (rate, gyr, acc, mag) = (scale(12), scale(16), scale(20), scale(24));
    let mut text = String::from("t_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2");
    for (asked, columns) in
        [(magnetometer, ",mx_ut,my_ut,mz_ut"), (reference, ",ref_w,ref_x,ref_y,ref_z,movement")]
    {
        text += if asked { columns } else { "" };
    }
    for (index, record) in bytes[HEADER..].chunks_exact(RECORD).enumerate() {
        let word = |i: usize| f32::from(i16::from_le_bytes([record[2 * i], record[2 * i + 1]]));
        let mut fields = vec![index as f32 / rate];
        fields.extend((0..3).map(|i| word(i) * gyr));
        fields.extend((3..6).map(|i| word(i) * acc));
        if magnetometer {
            fields.extend((6..9).map(|i| word(i) * mag));
        }
        let fields: Vec<String> = fields.iter().map(f32::to_string).collect();
        text += "\n";
        text += &fields.join(",");
        if reference && record[26] & 2 != 0 {
            let q: Vec<String> = (9..13).map(|i| (word(i) / 32_767.0).to_string()).collect();
            text += &format!(",{},{}", q.join(","), record[26] & 1);
        } else if reference {
            text += ",,,,,0";
        }
    }
    text + "\n"
}

#[test]
fn a_csv_recording_gives_the_same_as_the_counts_that_it_was_made_of() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    fs::write(&csv, as_csv(&fs::read(recording()).unwrap(), true, true)).unwrap();
    for scalar in ["f32", "fixed"] {
        let of = |file: &Path| {
            let said = json(&[file.to_str().unwrap(), "--scalar", scalar, "--json"]);
            said["mean"]["total_deg"].as_f64().unwrap()
        };
        let (text, counts) = (of(&csv), of(&recording()));
        assert!((text - counts).abs() < 0.05, "{scalar}: {text} against {counts}");
    }
}

#[test]
fn recordings_without_magnetometer_or_reference_work() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, imuq) = (folder.path().join("a.csv"), folder.path().join("b.imuq"));
    let mut bytes = fs::read(recording()).unwrap();
    fs::write(&csv, as_csv(&bytes, false, false)).unwrap();
    bytes[24..32].fill(0);
    for record in bytes[HEADER..].chunks_exact_mut(RECORD) {
        record[12..].fill(0);
    }
    fs::write(&imuq, &bytes).unwrap();
    for file in [&csv, &imuq] {
        for arguments in [["--mode", "6d"], ["--mode", "9d"], ["--scalar", "fixed"]] {
            let out = folder.path().join("e.csv");
            let said = json(
                &[
                    &[file.to_str().unwrap(), "--json", "--out", out.to_str().unwrap()],
                    &arguments[..],
                ]
                .concat(),
            );
            assert_eq!(estimates(&out).len(), (bytes.len() - HEADER) / RECORD);
            assert!(said["files"][0]["score"].is_null() && said["mean"].is_null());
        }
    }
}

#[test]
fn several_recordings_go_to_a_folder_and_have_a_mean() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.imuq");
    fs::copy(recording(), &copy).unwrap();
    let out = folder.path().join("est");
    let file = recording();
    let files = [file.to_str().unwrap(), copy.to_str().unwrap()];
    let arguments = [&files[..], &["--json", "--out", out.to_str().unwrap()]].concat();
    let said = json(&arguments);
    assert_eq!(json(&arguments), said, "the folder is there");
    for name in ["broad_11_cut.csv", "copy.csv"] {
        assert!(!estimates(&out.join(name)).is_empty());
    }
    assert_eq!(said["mean"]["total_deg"], said["files"][1]["score"]["total_deg"]);
    assert_refused(folder.path(), &[&files[..], &["--out", "e.csv"]].concat(), &["name a folder"]);
}

#[test]
fn a_broken_file_is_refused_and_leaves_no_output() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(recording()).unwrap();
    let text = as_csv(&whole[..HEADER + 1000 * RECORD], true, true);
    let broken = folder.path().join("broken.rec");
    fs::write(&broken, format!("{}\n1,2,3\n", text.trim_end())).unwrap();
    let (file, broken) = (recording(), broken.to_str().unwrap());
    let est = folder.path().join("est");
    let est = est.to_str().unwrap();
    assert_refused(folder.path(), &[broken, "--out", est], &[broken]);
    // Nor is the sound one before it written.
    assert_refused(folder.path(), &[file.to_str().unwrap(), broken, "--out", est], &[broken]);
}
