//! The project's own filters.

use ::tvc_fusion::{Config, Estimator, Euler, Filter, Quaternion, Sample, fixed};

use super::subject::{self, PERIOD_US, Subject};

/// A filter in float, with or without a magnetometer.
pub struct Float<F: Filter, const MAG: bool>(Estimator<F>);

impl<F: Filter<Real = f32>, const MAG: bool> Subject for Float<F, MAG>
where
    F::Gains: Default,
{
    type Input = subject::Float;
    type Output = ();

    fn new() -> Self {
        Self(Estimator::new(&Config::default()).expect("the defaults are valid"))
    }

    #[inline(always)]
    fn update(&mut self, input: &subject::Float) {
        let sample = Sample { gyr: input.gyr, acc: input.acc, mag: MAG.then_some(input.mag) };
        self.0.update(input.dt_s, &sample);
    }

    fn up(&self) -> [f32; 3] {
        self.0.attitude().orientation.up()
    }
}

/// A filter in fixed point, with or without a magnetometer.
pub struct Fixed<F: fixed::Filter, const MAG: bool> {
    estimator: fixed::Estimator<F, fixed::Ideal>,
    state: fixed::State,
}

/// A sample in counts of a BNO055.
#[repr(C)]
pub struct Counts {
    /// Time since the sample before, us.
    dt_us: u32,
    gyr: [i16; 3],
    acc: [i16; 3],
    mag: [i16; 3],
}

impl<F: fixed::Filter, const MAG: bool> Subject for Fixed<F, MAG>
where
    F::Gains: Default,
{
    type Input = Counts;
    type Output = ();

    fn new() -> Self {
        // Sensors of one instant: fusion/docs/measured.md says what lags cost.
        let config = Config::default().without_lags();
        let estimator = fixed::Estimator::new(&config, &fixed::Scale::BNO055, PERIOD_US)
            .expect("the defaults are valid");
        let state = estimator.start();
        Self { estimator, state }
    }

    #[inline(always)]
    fn update(&mut self, input: &Counts) {
        let counts =
            fixed::Counts { gyr: input.gyr, acc: input.acc, mag: MAG.then_some(input.mag) };
        self.estimator.update(&mut self.state, input.dt_us, &counts);
    }

    fn up(&self) -> [f32; 3] {
        self.estimator.orientation(&self.state).quaternion().up()
    }
}

/// Roll, pitch and yaw of a float quaternion.
pub struct FloatAngles(Euler);

impl Subject for FloatAngles {
    /// w, x, y, z.
    type Input = [f32; 4];
    type Output = ();

    fn new() -> Self {
        Self(Quaternion::IDENTITY.euler())
    }

    fn update(&mut self, &[w, x, y, z]: &[f32; 4]) {
        self.0 = Quaternion { w, x, y, z }.euler();
    }
}

/// Roll, pitch and yaw of a quaternion in fixed point.
pub struct FixedAngles(fixed::Angles);

impl Subject for FixedAngles {
    /// w, x, y, z in Q30.
    type Input = [i32; 4];
    type Output = ();

    fn new() -> Self {
        Self(fixed::Angles { roll: 0, pitch: 0, yaw: 0 })
    }

    fn update(&mut self, &wxyz_q30: &[i32; 4]) {
        self.0 = fixed::Orientation { wxyz_q30 }.angles();
    }
}
