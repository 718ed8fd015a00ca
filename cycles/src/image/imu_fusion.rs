//! The algorithm of the crate `imu-fusion`, without the calibration that its front end adds. Deg/s
//! and g.

use ::imu_fusion::{FusionAhrs, FusionAhrsSettings, FusionVector};

use super::subject::{Float, Subject, up_of};

/// Its one filter, with or without a magnetometer.
pub struct Filter<const MAG: bool>(FusionAhrs);

impl<const MAG: bool> Subject for Filter<MAG> {
    type Input = Float;
    type Output = ();

    fn new() -> Self {
        let mut ahrs = FusionAhrs::new();
        // As its front end does: only this makes a range and gates of zero mean that there are
        // none.
        ahrs.update_settings(FusionAhrsSettings::new());
        Self(ahrs)
    }

    fn update(&mut self, input: &Float) {
        let vector = |[x, y, z]: [f32; 3]| FusionVector { x, y, z };
        let (gyr, acc) = (vector(input.gyr), vector(input.acc));
        if MAG {
            self.0.update(gyr, acc, vector(input.mag), input.dt_s);
        } else {
            self.0.update_no_mag(gyr, acc, input.dt_s);
        }
    }

    fn up(&self) -> [f32; 3] {
        let q = self.0.quaternion;
        up_of([q.w, q.x, q.y, q.z])
    }
}
