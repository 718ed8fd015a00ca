//! An MPU-6050 at 200 Hz, in its counts: roll and pitch of a board that is tilted by 10 deg.

use tvc_fusion::{Config, ConfigError, Estimator, Mahony, Sample};

/// Full scale +-2,000 deg/s and +-8 g: 16.4 counts for a deg/s, 4,096 for a g.
const RAD_S: f32 = 1.0 / 16.4 * core::f32::consts::PI / 180.0;
const M_S2: f32 = 9.806_65 / 4096.0;

/// What the registers from 0x3B on hold: acceleration, temperature, rates.
fn sample(registers: &[i16; 7]) -> Sample {
    let [ax, ay, az, _, gx, gy, gz] = registers.map(f32::from);
    Sample {
        gyr: [gx, gy, gz].map(|rate| rate * RAD_S),
        acc: [ax, ay, az].map(|acc| acc * M_S2),
        mag: None,
    }
}

fn main() -> Result<(), ConfigError> {
    // Its accelerometer and gyroscope have the same low pass.
    let config = Config::default().without_lags();
    let mut estimator = Estimator::<Mahony>::new(&config)?;
    for _ in 0..600 {
        // Nose up, z down.
        estimator.update(0.005, &sample(&[711, 0, -4034, 0, 3, -2, 1]));
    }
    let angles = estimator.attitude().orientation.euler();
    let [roll, pitch] = [angles.roll_rad, angles.pitch_rad].map(f32::to_degrees);
    println!("roll {roll:.1} deg, pitch {pitch:.1} deg");
    Ok(())
}
