//! The filters of the crate `ahrs`. Rad/s; the other units do not matter to it.

use ::ahrs::{Ahrs, Madgwick, Mahony};
use nalgebra_0_34::Vector3;

use super::subject::{Float, PERIOD_S, Subject, up_of};

/// One of its filters, with or without a magnetometer.
pub struct Filter<F, const MAG: bool>(F);

/// Made with the gains that its documentation gives as defaults.
pub trait Make {
    /// A filter before its first sample.
    fn make() -> Self;

    /// Its quaternion, body to earth.
    fn wxyz(&self) -> [f32; 4];
}

impl Make for Mahony<f32> {
    fn make() -> Self {
        Self::new(PERIOD_S, 0.5, 0.0)
    }

    fn wxyz(&self) -> [f32; 4] {
        [self.quat.w, self.quat.i, self.quat.j, self.quat.k]
    }
}

impl Make for Madgwick<f32> {
    fn make() -> Self {
        Self::new(PERIOD_S, 0.1)
    }

    fn wxyz(&self) -> [f32; 4] {
        [self.quat.w, self.quat.i, self.quat.j, self.quat.k]
    }
}

impl<F: Ahrs<f32> + Make, const MAG: bool> Subject for Filter<F, MAG> {
    type Input = Float;
    type Output = ();

    fn new() -> Self {
        Self(F::make())
    }

    fn update(&mut self, input: &Float) {
        let (gyr, acc) = (Vector3::from(input.gyr), Vector3::from(input.acc));
        // It refuses vectors without a direction; there is nothing to be done about that here.
        let _ = if MAG {
            self.0.update(&gyr, &acc, &Vector3::from(input.mag))
        } else {
            self.0.update_imu(&gyr, &acc)
        };
    }

    fn up(&self) -> [f32; 3] {
        up_of(self.0.wxyz())
    }
}
