//! Scores every filter on recordings with optical ground truth.
//!
//! ```text
//! cargo run --release -p tvc-fusion --example score -- FOLDER
//! ```
//!
//! FOLDER holds recordings in the container `IMUQ16v1` (`*.imuq`): a header of 64 bytes, then for each sample
//! fourteen `i16`: gyroscope, accelerometer, magnetometer, reference quaternion (sensor to east-north-up),
//! flags (bit 0: movement, bit 1: reference valid). The figures are degrees RMSE over the movement, total /
//! heading / inclination, as the BROAD benchmark defines them (D. Laidig et al., Data 6(7):72, 2021).

use std::error::Error;
use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use tvc_fusion::{
    Complementary, ComplementaryGains, Config, Estimator, Filter, Gyro, Madgwick, MadgwickGains,
    Mahony, MahonyGains, Quaternion, Real, Sample, Vqf, fixed,
};

/// A recording in SI units.
struct Recording {
    name: String,
    dt_s: f32,
    samples: Vec<Sample>,
    counts: Vec<fixed::Counts>,
    scale: fixed::Scale,
    /// Sensor to north-east-down, where it is to be scored.
    reference: Vec<Option<UnitQuaternion<f64>>>,
}

/// Degrees RMSE.
#[derive(Clone, Copy, Default)]
struct Score {
    total: f64,
    heading: f64,
    inclination: f64,
}

impl Recording {
    fn read(path: &Path) -> Result<Self, Box<dyn Error>> {
        let bytes = std::fs::read(path)?;
        let (header, records) = bytes
            .split_at_checked(64)
            .ok_or("shorter than its header")?;
        if !header.starts_with(b"IMUQ16v1") {
            return Err("not an IMUQ16v1 file".into());
        }
        let f32_at = |at: usize| f32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
        let (rate_hz, gyr, acc, mag) = (f32_at(12), f32_at(16), f32_at(20), f32_at(24));
        let enu_to_ned =
            UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.0, 1.0, 1.0, 0.0));
        let mut recording = Self {
            name: path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            dt_s: 1.0 / rate_hz,
            samples: Vec::new(),
            counts: Vec::new(),
            scale: fixed::Scale {
                gyr_rad_s: gyr,
                acc_m_s2: acc,
                mag_ut: mag,
            },
            reference: Vec::new(),
        };
        for record in records.chunks_exact(28) {
            let word = |i: usize| f32::from(i16::from_le_bytes([record[2 * i], record[2 * i + 1]]));
            let vector =
                |i: usize, scale: f32| Vector3::new(word(i), word(i + 1), word(i + 2)) * scale;
            let raw = |i: usize| {
                [i, i + 1, i + 2].map(|i| i16::from_le_bytes([record[2 * i], record[2 * i + 1]]))
            };
            recording.counts.push(fixed::Counts {
                gyr: raw(0),
                acc: raw(3),
                mag: Some(raw(6)),
            });
            recording.samples.push(Sample {
                gyr: vector(0, gyr),
                acc: vector(3, acc),
                mag: Some(vector(6, mag)),
            });
            let q = nalgebra::Quaternion::new(word(9), word(10), word(11), word(12)).cast();
            let scored = record[26] & 3 == 3;
            recording
                .reference
                .push(scored.then(|| enu_to_ned * UnitQuaternion::from_quaternion(q)));
        }
        Ok(recording)
    }

    /// Score the orientations that `step` gives, sample by sample.
    fn score(&self, mut step: impl FnMut(usize) -> UnitQuaternion<f64>) -> Score {
        let mut sum = Score::default();
        let mut count = 0.0;
        for (i, reference) in self.reference.iter().enumerate() {
            let estimate = step(i);
            if let Some(reference) = reference {
                let error = estimate * reference.inverse();
                sum.total += (2.0 * error.w.abs().min(1.0).acos()).powi(2);
                sum.heading += (2.0 * (error.k / error.w).atan()).powi(2);
                sum.inclination += (2.0 * error.w.hypot(error.k).min(1.0).acos()).powi(2);
                count += 1.0;
            }
        }
        let rmse_deg = |sum: f64| (sum / count).sqrt().to_degrees();
        Score {
            total: rmse_deg(sum.total),
            heading: rmse_deg(sum.heading),
            inclination: rmse_deg(sum.inclination),
        }
    }

    fn float<F: Filter>(
        &self,
        config: &Config<F::Gains>,
        magnetometer: bool,
    ) -> Result<Score, Box<dyn Error>> {
        let mut estimator = Estimator::<F>::new(config)?;
        Ok(self.score(|i| {
            let sample = self.samples[i];
            let mag = sample.mag.filter(|_| magnetometer);
            oracle(
                &estimator
                    .update(self.dt_s, &Sample { mag, ..sample })
                    .orientation,
            )
        }))
    }

    fn fixed<F: fixed::Filter>(
        &self,
        config: &Config<F::Gains>,
        magnetometer: bool,
    ) -> Result<Score, Box<dyn Error>> {
        let period_us = (self.dt_s * 1e6).round() as u32;
        let mut estimator =
            fixed::Estimator::<F, fixed::Recovered>::with_recovery(config, &self.scale, period_us)?;
        Ok(self.score(|i| {
            let counts = self.counts[i];
            let mag = counts.mag.filter(|_| magnetometer);
            estimator.update(period_us, &fixed::Counts { mag, ..counts });
            oracle(&estimator.orientation().quaternion())
        }))
    }
}

fn oracle<T: Real>(q: &Quaternion<T>) -> UnitQuaternion<f64> {
    let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(|c| f64::from(c.to_f32()));
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
}

/// One line of the table; `score` gives the score of a recording with or without its magnetometer.
fn row(
    name: &str,
    recordings: &[Recording],
    score: impl Fn(&Recording, bool) -> Result<Score, Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    let mut mean = Score::default();
    let mut mean_6d = 0.0;
    let n = recordings.len() as f64;
    print!("| {name} |");
    for recording in recordings {
        let with = score(recording, true)?;
        print!(" {:.2} |", with.total);
        mean.total += with.total / n;
        mean.heading += with.heading / n;
        mean.inclination += with.inclination / n;
        mean_6d += score(recording, false)?.inclination / n;
    }
    println!(
        " {:.3} / {:.3} / {:.3} | {mean_6d:.3} |",
        mean.total, mean.heading, mean.inclination
    );
    Ok(())
}

fn float_row<F: Filter>(
    name: &str,
    config: Config<F::Gains>,
    recordings: &[Recording],
) -> Result<(), Box<dyn Error>> {
    row(name, recordings, |recording, magnetometer| {
        recording.float::<F>(&config, magnetometer)
    })
}

fn fixed_row<F: fixed::Filter>(
    name: &str,
    config: Config<F::Gains>,
    recordings: &[Recording],
) -> Result<(), Box<dyn Error>> {
    row(name, recordings, |recording, magnetometer| {
        recording.fixed::<F>(&config, magnetometer)
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: score FOLDER")?;
    let mut paths: Vec<_> = std::fs::read_dir(&folder)?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "imuq")
        })
        .collect();
    paths.sort();
    let recordings = paths
        .iter()
        .map(|path| Recording::read(path).map_err(|e| format!("{}: {e}", path.display()).into()))
        .collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    if recordings.is_empty() {
        return Err(format!("{folder}: no *.imuq files").into());
    }
    print!("| filter |");
    for recording in &recordings {
        print!(
            " {} |",
            recording
                .name
                .split('_')
                .take(2)
                .collect::<Vec<_>>()
                .join("_")
        );
    }
    println!(" mean 9D | mean 6D inclination |");
    println!("|---|{}---|---|", "---|".repeat(recordings.len()));
    float_row::<Gyro>("integrated gyro", Config::default(), &recordings)?;
    float_row::<Complementary>("complementary", Config::default(), &recordings)?;
    float_row::<Mahony>("Mahony", Config::default(), &recordings)?;
    float_row::<Madgwick>("Madgwick", Config::default(), &recordings)?;
    float_row::<Vqf>("VQF class", Config::default(), &recordings)?;
    fixed_row::<fixed::Mahony>("Mahony, fixed point", Config::default(), &recordings)?;
    fixed_row::<fixed::Vqf>("VQF class, fixed point", Config::default(), &recordings)?;
    let thesis = ComplementaryGains::thesis();
    float_row::<Complementary>(
        "complementary, thesis",
        Config::with_gains(thesis),
        &recordings,
    )?;
    float_row::<Mahony>(
        "Mahony, thesis",
        Config::with_gains(MahonyGains::thesis()),
        &recordings,
    )?;
    float_row::<Madgwick>(
        "Madgwick, thesis",
        Config::with_gains(MadgwickGains::thesis()),
        &recordings,
    )?;
    Ok(())
}
