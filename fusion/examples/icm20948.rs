//! An ICM-20948 at 102 Hz in fixed point: heading of a board that points east.

use tvc_fusion::fixed::{Angles, Counts, Estimator, Scale, Vqf};
use tvc_fusion::{Config, ConfigError};

/// Full scale +-2,000 deg/s, +-8 g and +-4,900 uT.
const SCALE: Scale = Scale {
    gyr_rad_s: 1.0 / 16.4 * core::f32::consts::PI / 180.0,
    acc_m_s2: 9.806_65 / 4096.0,
    mag_ut: 0.15,
};
const PERIOD_US: u32 = 9_804;

fn main() -> Result<(), ConfigError> {
    let estimator = Estimator::<Vqf>::new(&Config::default(), &SCALE, PERIOD_US)?;
    let mut state = estimator.start();
    // Level, z down; the field points north and down.
    let counts = Counts { gyr: [4, -6, 2], acc: [0, 0, -4096], mag: Some([0, -113, 313]) };
    for _ in 0..500 {
        estimator.update(&mut state, PERIOD_US, &counts);
    }
    let yaw_deg = Angles::to_rad(estimator.orientation(&state).angles().yaw).to_degrees();
    println!("heading {yaw_deg:.1} deg");
    Ok(())
}
