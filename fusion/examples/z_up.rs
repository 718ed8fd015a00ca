//! A board whose z axis points up, as of ROS: its samples as they are, and axes of the earth that
//! point east, north and up.

use tvc_fusion::{Config, ConfigError, Estimator, Sample, Vqf};

fn main() -> Result<(), ConfigError> {
    let mut estimator = Estimator::<Vqf>::new(&Config::default())?;
    // Level, x to the east: gravity is felt along z, the field lies along y and down.
    let sample = Sample { gyr: [0.0; 3], acc: [0.0, 0.0, 9.81], mag: Some([0.0, 17.0, -47.0]) };
    for _ in 0..500 {
        estimator.update(0.01, &sample);
    }
    let q = estimator.attitude().orientation.to_enu();
    println!("w {:.3}, x {:.3}, y {:.3}, z {:.3}", q.w, q.x, q.y, q.z);
    Ok(())
}
