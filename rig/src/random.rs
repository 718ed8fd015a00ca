//! Random numbers of the rig: one seed, one independent stream for each purpose, so that drawing
//! more of one kind never shifts another.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// What a stream of random numbers is for.
#[derive(Clone, Copy, Debug)]
pub enum Stream {
    /// Properties of the sensor that stay: bias, clock error, phases of its refreshes, unique id.
    SensorUnit = 1,
    /// Noise of the sensor's signals.
    SensorNoise = 2,
    /// Clock stretching, disturbed bytes on the I2C bus, and how long the sensor boots.
    Bus = 3,
    /// The moment at which the drone is released.
    Release = 4,
    /// What fails in a campaign, when, and how severely.
    Campaign = 5,
    /// What the port loses.
    Port = 6,
    /// Where wind, kicks and misalignment of a rocket point.
    Ascent = 7,
    /// Rate and phase of the chip's slow oscillator.
    SlowClock = 8,
    /// Properties of the on-board sensor that stay.
    SecondSensorUnit = 9,
    /// Noise of the on-board sensor's signals.
    SecondSensorNoise = 10,
    /// Errors of a rocket's calibrated gyroscope.
    GyroCalibration = 11,
}

/// The generator of `stream` under `seed`; the same on every machine.
pub fn generator(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream as u64);
    generator
}
