//! The whole pitch loop in the frequency domain, delays included.
//!
//! ```text
//! L(s) = (kp + kd s / (1 + s / wf)) e^(-s (sensor delay + half a control period))
//!        x hold(frame) e^(-s pulse) x 1 / (loop lag s^2 + loop s + 1) x pitch / crank
//! ```
//!
//! The hold is that of the servo frame, `(1 - e^(-sT)) / (sT)`. Deadband, backlash and the speed
//! limit have no linear part and are left out.

use nalgebra::Complex;

use crate::free::State;
use crate::mechanism::Mechanism;
use crate::pitch_loop::{RATE_FILTER_HZ, Timing};
use crate::root;
use crate::servo::ServoModel;

use super::transfer::TransferFunction;

/// Mean width of a servo pulse, the age at which the servo learns a command, in s.
const PULSE_S: f64 = 1.5e-3;
/// Frequencies searched for crossings, in rad/s.
const SEARCH: (f64, f64) = (0.02, 3000.0);
/// Points of the search, evenly spaced in the logarithm.
const POINTS: usize = 4000;

/// The pitch loop, cut open at the crank command.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenLoop {
    /// Gain from pitch to the crank, rad/rad.
    pub kp: f64,
    /// Gain from rate to the crank, rad s/rad.
    pub kd: f64,
    /// Corner of the filter on the rate, in rad/s.
    pub rate_filter_rad_s: f64,
    /// Delay of sensor and computation, in s.
    pub delay_s: f64,
    /// Servo frame, in s.
    pub frame_s: f64,
    /// The servo's position loop, in s.
    pub servo_loop_s: f64,
    /// The servo motor's lag with what it turns at the point, in s.
    pub servo_lag_s: f64,
    /// The servo's target over its crank's angle at rest: more than one where wash and gravity turn
    /// the crank back.
    pub servo_stiffness: f64,
    /// Crank to pitch, sign turned so that the loop is one of negative feedback.
    pub drone: TransferFunction,
}

/// A gain margin and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainMargin {
    /// Gain that may be added, in dB (negative: gain that may be taken away).
    pub db: f64,
    /// Where the phase crosses -180 deg, in rad/s.
    pub at_rad_s: f64,
}

/// A phase margin and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseMargin {
    /// Phase that may be lost, in deg.
    pub deg: f64,
    /// Where the gain crosses one, in rad/s.
    pub at_rad_s: f64,
    /// Delay that may be added, in s.
    pub delay_s: f64,
}

/// How far the loop is from instability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// The smallest gain margin upwards; `None` if the phase never crosses -180 deg above unity
    /// gain's frequency.
    pub gain: Option<GainMargin>,
    /// The smallest phase margin; `None` if the gain never crosses one.
    pub phase: Option<PhaseMargin>,
    /// Largest sensitivity `1 / |1 + L|`: the inverse of the distance from -1 in Nyquist's plane.
    pub peak_sensitivity: f64,
}

/// One point of the frequency response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Frequency, in rad/s.
    pub rad_s: f64,
    /// The open loop there (Nyquist's curve).
    pub value: Complex<f64>,
    /// Gain, in dB.
    pub gain_db: f64,
    /// Phase, continuous from the lowest frequency, in deg.
    pub phase_deg: f64,
}

impl OpenLoop {
    /// The loop of the reference law round a drone at a point. The law goes through the inverse
    /// linkage: away from zero rudder, where the linkage has less gain, the crank moves more.
    pub fn new(
        mechanism: &Mechanism,
        point: &State,
        servo: &ServoModel,
        timing: &Timing,
        kp: f64,
        kd: f64,
    ) -> Self {
        let linkage = mechanism.linkage();
        let nominal = linkage.at(linkage.zero_rudder_crank_rad()).rudder_ratio;
        let gain = nominal / linkage.at(point.crank_rad).rudder_ratio;
        let (kp, kd) = (gain * kp, gain * kd);
        let at = mechanism.configuration(point.crank_rad);
        Self {
            kp,
            kd,
            rate_filter_rad_s: std::f64::consts::TAU * RATE_FILTER_HZ,
            delay_s: mean_delay_s(timing),
            frame_s: timing.frame_s,
            servo_loop_s: servo.loop_s,
            servo_lag_s: servo.lag_s(at.crank_inertia()),
            servo_stiffness: 1.0
                - servo.droop * servo.loop_s * servo.yielding() * hinge_slope(mechanism, point),
            drone: crank_to_pitch(mechanism, point),
        }
    }

    /// The open loop at a frequency (rad/s).
    pub fn at(&self, rad_s: f64) -> Complex<f64> {
        let s = Complex::new(0.0, rad_s);
        let law = s * self.kd / (s / self.rate_filter_rad_s + 1.0) + self.kp;
        let delay = (-s * (self.delay_s + PULSE_S)).exp();
        let frame = s * self.frame_s;
        let hold = if frame.norm() < 1e-9 {
            Complex::new(1.0, 0.0)
        } else {
            (-(-frame).exp() + 1.0) / frame
        };
        let servo = (s * s * self.servo_loop_s * self.servo_lag_s
            + s * self.servo_loop_s
            + self.servo_stiffness)
            .inv();
        law * delay * hold * servo * self.drone.at(s)
    }

    /// The loop with every delay replaced by Pade's approximation and the hold by half a frame:
    /// for poles and the root locus.
    pub fn rational(&self) -> TransferFunction {
        let wf = self.rate_filter_rad_s;
        let law = TransferFunction::new(vec![self.kp / wf + self.kd, self.kp], vec![1.0 / wf, 1.0]);
        let delay = TransferFunction::delay(self.delay_s + PULSE_S + 0.5 * self.frame_s);
        let servo = TransferFunction::new(
            vec![1.0],
            vec![self.servo_loop_s * self.servo_lag_s, self.servo_loop_s, self.servo_stiffness],
        );
        law.series(&delay).series(&servo).series(&self.drone)
    }

    /// Frequency response from `from` to `to` (rad/s), `points` evenly spaced in the logarithm.
    pub fn response(&self, from: f64, to: f64, points: usize) -> Vec<Response> {
        let ratio = (to / from).ln() / (points.max(2) - 1) as f64;
        let mut turns = 0.0;
        let mut last: Option<f64> = None;
        (0..points)
            .map(|i| {
                let rad_s = from * (ratio * i as f64).exp();
                let value = self.at(rad_s);
                let raw = value.arg().to_degrees();
                let mut phase_deg = raw + turns;
                match last {
                    // The loop starts on a double integrator: its phase begins near -180 deg.
                    None if raw > 90.0 => turns = -360.0,
                    Some(before) if phase_deg - before > 180.0 => turns -= 360.0,
                    Some(before) if before - phase_deg > 180.0 => turns += 360.0,
                    _ => {}
                }
                phase_deg = raw + turns;
                last = Some(phase_deg);
                Response { rad_s, value, gain_db: 20.0 * value.norm().log10(), phase_deg }
            })
            .collect()
    }

    /// Gain, phase and delay margin of the loop with negative feedback.
    pub fn margins(&self) -> Margins {
        let crossing = |a: &Response, b: &Response, f: &dyn Fn(Complex<f64>) -> f64| {
            root::between(|w| f(self.at(w)), a.rad_s, b.rad_s, 1e-9).unwrap_or(a.rad_s)
        };
        let response = self.response(SEARCH.0, SEARCH.1, POINTS);
        let mut phase: Option<PhaseMargin> = None;
        let mut gain: Option<GainMargin> = None;
        let mut peak_sensitivity = 0.0_f64;
        for pair in response.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            peak_sensitivity = peak_sensitivity.max((b.value + 1.0).norm().recip());
            if (a.gain_db > 0.0) != (b.gain_db > 0.0) {
                let at_rad_s = crossing(&a, &b, &|value| value.norm() - 1.0);
                // Phase of -L: the margin, between -180 and 180 deg.
                let deg = (-self.at(at_rad_s)).arg().to_degrees();
                let found = PhaseMargin { deg, at_rad_s, delay_s: deg.to_radians() / at_rad_s };
                if phase.is_none_or(|p| deg.abs() < p.deg.abs()) {
                    phase = Some(found);
                }
            }
            // On the negative real axis the imaginary part changes sign.
            if (a.value.im > 0.0) != (b.value.im > 0.0) && a.value.re + b.value.re < 0.0 {
                let at_rad_s = crossing(&a, &b, &|value| value.im);
                let db = -20.0 * self.at(at_rad_s).norm().log10();
                if db > 0.0 && gain.is_none_or(|g| db < g.db) {
                    gain = Some(GainMargin { db, at_rad_s });
                }
            }
        }
        Margins { gain, phase, peak_sensitivity }
    }
}

/// Mean age of what the law has seen when its pulse begins, s: the sensor's delay, half the period
/// of its refresh, and the time from the law to the pulse. That time is half a control period where
/// the two are not locked.
fn mean_delay_s(timing: &Timing) -> f64 {
    let refresh = 0.5 * timing.refresh_s.unwrap_or(0.0);
    timing.delay_s + refresh + timing.lead_s.unwrap_or(0.5 * timing.control_s)
}

/// Pitch acceleration for each radian of crank, upright at zero rudder, in 1/s2, sign turned: what
/// gains scale with.
pub fn pitch_gain(mechanism: &Mechanism) -> f64 {
    let crank_rad = mechanism.linkage().zero_rudder_crank_rad();
    let transfer = crank_to_pitch(mechanism, &State { crank_rad, ..State::default() });
    transfer.numerator[transfer.numerator.len() - 1] / transfer.denominator[0]
}

/// What the torque on the crank changes by with its angle at a point, in N m/rad.
fn hinge_slope(mechanism: &Mechanism, point: &State) -> f64 {
    const HALF_STEP_RAD: f64 = 1e-4;
    let torque = |crank_rad: f64| {
        mechanism.hinge_torque(&mechanism.configuration(crank_rad), point.pitch_rad)
    };
    let [below, above] = [-HALF_STEP_RAD, HALF_STEP_RAD].map(|h| torque(point.crank_rad + h));
    (above - below) / (2.0 * HALF_STEP_RAD)
}

/// From crank to pitch at a point with a prescribed crank, sign turned:
/// `(K01 + M01 s^2) / (M00 s^2 + b0 s + K00)`, whose `K` are the slopes of the pitch load.
fn crank_to_pitch(mechanism: &Mechanism, point: &State) -> TransferFunction {
    let (pitch, crank) = (point.pitch_rad, point.crank_rad);
    let load =
        |pitch: f64, crank: f64| mechanism.pitch_load(&mechanism.configuration(crank), pitch, 0.0);
    const H: f64 = 1e-4;
    let pitch_slope = (load(pitch + H, crank) - load(pitch - H, crank)) / (2.0 * H);
    let crank_slope = (load(pitch, crank + H) - load(pitch, crank - H)) / (2.0 * H);
    let at = mechanism.configuration(crank);
    let friction = mechanism.parameters().pivot_friction_n_m_s;
    TransferFunction::new(vec![at.m01, 0.0, -crank_slope], vec![at.m00, friction, -pitch_slope])
}
