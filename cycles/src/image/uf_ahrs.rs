//! The filters of the crate `uf-ahrs`. Rad/s and m/s^2.

use core::time::Duration;

use ::uf_ahrs::{Ahrs, Madgwick, MadgwickParams, Mahony, MahonyParams, Vqf, VqfParams};
use nalgebra_0_35::{UnitQuaternion, Vector3};

use super::subject::{Float, PERIOD_US, Subject, up_of};

const PERIOD: Duration = Duration::from_micros(PERIOD_US as u64);

/// One of its filters, with or without a magnetometer, and the orientation that an update gives:
/// not all of them have it in their state.
pub struct Filter<F, const MAG: bool>(F, UnitQuaternion<f32>);

/// Made with its own defaults.
pub trait Make {
    /// A filter before its first sample.
    fn make() -> Self;
}

impl Make for Mahony {
    fn make() -> Self {
        Self::new(PERIOD, MahonyParams::default())
    }
}

impl Make for Madgwick {
    fn make() -> Self {
        Self::new(PERIOD, MadgwickParams::default())
    }
}

impl Make for Vqf {
    fn make() -> Self {
        Self::new(PERIOD, VqfParams::default())
    }
}

impl<F: Ahrs + Make, const MAG: bool> Subject for Filter<F, MAG> {
    type Input = Float;
    type Output = ();

    fn new() -> Self {
        Self(F::make(), UnitQuaternion::identity())
    }

    fn update(&mut self, input: &Float) {
        let (gyr, acc) = (Vector3::from(input.gyr), Vector3::from(input.acc));
        self.1 = if MAG {
            self.0.update(gyr, acc, Vector3::from(input.mag))
        } else {
            self.0.update_imu(gyr, acc)
        };
    }

    fn up(&self) -> [f32; 3] {
        let q = self.1;
        up_of([q.w, q.i, q.j, q.k])
    }
}
