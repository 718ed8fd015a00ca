//! The filter of the crate `vqf-rs`, in f32 on `libm`. Rad/s and m/s^2.

use ::vqf_rs::{Quaternion, VQF};

use super::subject::{Float, PERIOD_S, Subject, up_of};

/// Its one filter, with or without a magnetometer, and the orientation, which it works out when
/// asked.
pub struct Filter<const MAG: bool>(VQF, Quaternion);

impl<const MAG: bool> Subject for Filter<MAG> {
    type Input = Float;
    type Output = ();

    fn new() -> Self {
        Self(VQF::new(PERIOD_S, None, None, None), Quaternion(1.0, 0.0, 0.0, 0.0))
    }

    fn update(&mut self, input: &Float) {
        self.0.update(input.gyr, input.acc, MAG.then_some(input.mag));
        self.1 = if MAG { self.0.quat_9d() } else { self.0.quat_6d() };
    }

    fn up(&self) -> [f32; 3] {
        let Quaternion(w, x, y, z) = self.1;
        up_of([w, x, y, z])
    }
}
