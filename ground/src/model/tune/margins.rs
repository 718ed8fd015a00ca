//! Margins of the loop with the image's own controller in it.
//!
//! The frequency response is that of the controller's own code, with prediction and observer: the
//! transform of its answers to a small impulse of pitch and to one of rate. An answer tends to the
//! constant output of an integrator, whose sum has a closed form: `tail z^-n / (1 - z^-1)`.

use nalgebra::Complex;
use plant::linear::frequency::crank_to_pitch;
use plant::linear::frequency::{self, OpenLoop};
use plant::mechanism::Mechanism;
use plant::pitch_loop::COMMAND_LIMIT_RAD;
use plant::{ParameterError, Setup};
use tvc_nano::{Controller, Params};

use crate::out::measure::{Figure, Limit::AtLeast, figure};

/// Width of a pulse near the middle, s: the servo acts when it has ended.
pub const PULSE_S: f64 = 1.5e-3;
/// Size of the impulse, rad and rad/s: small against the knee, the limit and the servo's speed.
const IMPULSE: f32 = 1e-3;
/// Samples after which only the tail is left: several seconds.
const SAMPLES: usize = 600;

/// How far the loop is from instability.
#[derive(Debug, Clone, Copy)]
pub struct Margins {
    /// Gain that may be added, dB.
    pub gain_db: Option<f64>,
    /// Phase that may be lost, deg.
    pub phase_deg: Option<f64>,
    /// Delay that may be added, s.
    pub delay_s: Option<f64>,
    /// Where the gain crosses one, rad/s.
    pub crossover_rad_s: Option<f64>,
    /// Largest sensitivity `1 / |1 + L|`.
    pub peak_sensitivity: f64,
}

impl Margins {
    /// The figures, the phase margin held to at least `phase_deg`.
    pub fn figures(&self, phase_deg: f64) -> Figure {
        figure(
            "margins",
            [
                figure("gain_db", self.gain_db).shown("gain margin", "dB", 1),
                figure("phase_deg", self.phase_deg)
                    .shown("phase margin", "deg", 1)
                    .limit(AtLeast(phase_deg)),
                figure("delay_s", self.delay_s)
                    .shown("delay margin", "ms", 1)
                    .scaled(1e3),
                figure("crossover_rad_s", self.crossover_rad_s).shown("crossover", "rad/s", 1),
                figure("peak_sensitivity", self.peak_sensitivity).shown("peak sensitivity", "", 2),
            ],
        )
    }
}

/// Margins near upright; `delay_s` is from what is sensed to the end of the pulse.
///
/// # Errors
/// A parameter of the drone out of range.
pub fn of(setup: &Setup, params: &Params, delay_s: f64) -> Result<Margins, ParameterError> {
    let mechanism = Mechanism::new(&setup.drone)?;
    let actuator = OpenLoop {
        kp: 1.0,
        kd: 0.0,
        rate_filter_rad_s: f64::INFINITY,
        // The open loop counts the pulse by itself.
        delay_s: delay_s - PULSE_S,
        frame_s: setup.timing.frame_s,
        servo_loop_s: setup.servo.loop_s,
        servo_lag_s: setup.servo.lag_s,
        drone: crank_to_pitch(&mechanism),
    };
    let pitch = answer(params, IMPULSE, 0.0);
    let rate = answer(params, 0.0, IMPULSE);
    let period_s = setup.timing.control_s;
    let found = frequency::margins(|rad_s| {
        let law = transform(&pitch, rad_s * period_s)
            + transform(&rate, rad_s * period_s) * Complex::new(0.0, rad_s);
        law * actuator.at(rad_s)
    });
    Ok(Margins {
        gain_db: found.gain.map(|gain| gain.db),
        phase_deg: found.phase.map(|phase| phase.deg),
        delay_s: found.phase.map(|phase| phase.delay_s),
        crossover_rad_s: found.phase.map(|phase| phase.at_rad_s),
        peak_sensitivity: found.peak_sensitivity,
    })
}

/// The crank angles that follow an impulse, per unit of it.
fn answer(params: &Params, pitch_rad: f32, rate_rad_s: f32) -> Vec<f64> {
    let mut controller = Controller::new(params, COMMAND_LIMIT_RAD as f32);
    // The first sample initialises the observer.
    controller.update(0.0, 0.0);
    (0..SAMPLES)
        .map(|index| {
            let (pitch, rate) = if index == 0 {
                (pitch_rad, rate_rad_s)
            } else {
                (0.0, 0.0)
            };
            f64::from(controller.update(pitch, rate)) / f64::from(IMPULSE)
        })
        .collect()
}

/// The transform of an answer at an angle a sample (rad), its tail included.
fn transform(answer: &[f64], angle: f64) -> Complex<f64> {
    let turn = Complex::from_polar(1.0, -angle);
    let mut sum = Complex::new(0.0, 0.0);
    let mut factor = Complex::new(1.0, 0.0);
    for value in answer {
        sum += factor * *value;
        factor *= turn;
    }
    let tail = answer.last().copied().unwrap_or(0.0);
    sum + factor * tail / (Complex::new(1.0, 0.0) - turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plant::linear::frequency::OpenLoop;
    use plant::pitch_loop::Timing;

    /// Without prediction and trim the law is proportional-derivative and has the reference's
    /// margins.
    #[test]
    fn a_plain_law_has_the_margins_of_the_reference() {
        let setup = Setup::default();
        let mut params = Params::default();
        for (name, value) in [
            ("PID_KP", 1.0),
            ("PID_KD", 0.3),
            ("PID_AHEAD_S", 0.0),
            ("PID_TRIM_RAD_S", 0.0),
        ] {
            params.set(name, value).unwrap();
        }
        let delay_s = 6e-3;
        let found = of(&setup, &params, delay_s + PULSE_S).unwrap();
        let mechanism = Mechanism::new(&setup.drone).unwrap();
        let mut reference = OpenLoop::new(&mechanism, &setup.servo, &Timing::ANALOGUE, 1.0, 0.3);
        reference.rate_filter_rad_s = f64::INFINITY;
        let expected = reference.margins();
        let (gain, phase) = (expected.gain.unwrap(), expected.phase.unwrap());
        assert!((found.gain_db.unwrap() - gain.db).abs() < 0.05);
        assert!((found.phase_deg.unwrap() - phase.deg).abs() < 0.1);
        assert!((found.crossover_rad_s.unwrap() - phase.at_rad_s).abs() < 0.01);
    }

    #[test]
    fn the_tail_of_an_integrator_is_summed_to_its_end() {
        // Sum of z^-k over all k is 1 / (1 - z^-1).
        let found = transform(&[1.0; 50], 0.3);
        let expected = (Complex::new(1.0, 0.0) - Complex::from_polar(1.0, -0.3)).inv();
        assert!((found - expected).norm() < 1e-12);
    }
}
