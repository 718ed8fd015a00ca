//! What can be measured.

/// Time between two samples, us: 100 Hz or nearly, as the recording that is played has it.
pub const PERIOD_US: u32 = 10_500;

/// The same, s.
pub const PERIOD_S: f32 = PERIOD_US as f32 * 1e-6;

/// Something with an update.
pub trait Subject {
    /// What an update is given, as it lies in memory; any bits are valid.
    type Input;

    /// What an update returns: a word, or nothing where its result stays in the state.
    type Output;

    /// The state before the first update: the library's own defaults.
    fn new() -> Self;

    /// One update: from a sample in memory to an orientation in memory or an output.
    fn update(&mut self, input: &Self::Input) -> Self::Output;

    /// Up in the body's axes, a unit vector; zeros where there is no such estimate.
    fn up(&self) -> [f32; 3] {
        [0.0; 3]
    }
}

/// A sample in float.
#[repr(C)]
pub struct Float {
    /// Time since the sample before, s.
    pub dt_s: f32,
    /// Rotation rate, rad/s or deg/s as the library has it.
    pub gyr: [f32; 3],
    /// Specific force, m/s^2 or g.
    pub acc: [f32; 3],
    /// Magnetic field, uT.
    pub mag: [f32; 3],
}

/// Up seen by a unit quaternion w, x, y, z from the body to an earth whose z axis points up.
pub fn up_of([w, x, y, z]: [f32; 4]) -> [f32; 3] {
    [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z]
}

/// No update at all: what every image has besides.
pub struct Nothing;

impl Subject for Nothing {
    type Input = ();
    type Output = ();

    fn new() -> Self {
        Self
    }

    fn update(&mut self, (): &()) {}
}
