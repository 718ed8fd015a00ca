//! What an estimator says of its errors, against what they are on recordings.

use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use recordings::{Source, enu_from_ned};
use tvc_fusion::{Config, Estimator, Sample, Vqf, VqfGains};

/// Root of the mean square of tilt and heading errors over their deviations, in the movement.
fn normalised(path: &Path) -> [f64; 2] {
    let mut source = Source::open(path).expect("a recording");
    let facts = *source.facts();
    let mut config = Config::<VqfGains>::default();
    if let Some(range) = facts.gyro_range_rad_s {
        config.gyro_range_rad_s = config.gyro_range_rad_s.min(range);
    }
    let mut estimator = Estimator::<Vqf>::new(&config).expect("valid");
    let unit =
        |[w, x, y, z]: [f64; 4]| UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let (mut squares, mut samples) = ([0.0; 2], 0.0);
    while let Some(recorded) = source.next_sample().expect("whole") {
        let single = |v: [f64; 3]| v.map(|c| c as f32);
        let sample = Sample {
            gyr: single(recorded.gyr_rad_s),
            acc: single(recorded.acc_m_s2),
            mag: recorded.mag_ut.map(single),
        };
        let q = estimator.update(facts.period_s as f32, &sample).orientation;
        let Some(reference) = recorded.reference.filter(|_| recorded.movement) else {
            continue;
        };
        let estimate = unit(enu_from_ned([q.w, q.x, q.y, q.z].map(f64::from)));
        let error = estimate * unit(reference).inverse();
        let tilt = (error * Vector3::z()).angle(&Vector3::z());
        let heading = 2.0 * (error.k / error.w).atan();
        let quality = estimator.quality();
        squares[0] += (tilt / f64::from(quality.tilt_rad)).powi(2);
        squares[1] += (heading / f64::from(quality.heading_rad)).powi(2);
        samples += 1.0;
    }
    squares.map(|square| (square / samples).sqrt())
}

#[test]
fn errors_are_as_large_as_they_are_said_to_be() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data");
    let files = ["broad_11_cut.imuq", "broad_16_cut.imuq"].map(|name| root.join(name));
    let mut mean = [0.0; 2];
    for file in &files {
        let errors = normalised(file);
        println!("{}: tilt {:.2}, heading {:.2}", file.display(), errors[0], errors[1]);
        for (error, mean) in errors.iter().zip(&mut mean) {
            assert!((0.3..2.0).contains(error), "{errors:?} in {}", file.display());
            *mean += error / files.len() as f64;
        }
    }
    assert!(mean.iter().all(|mean| (0.5..2.0).contains(mean)), "{mean:?}");
}
