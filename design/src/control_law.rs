//! The image's own control law in the model's pitch loop, with the parameters that it ships with.

use std::path::Path;

use anyhow::Result;
use plant::Parameters;
use plant::pitch_loop::{COMMAND_LIMIT_RAD, Measurement, Timing};
use tvc_nano::controller::Sample;
use tvc_nano::{Axis, Controller, LawState, Micros, Params, RawSample, Refresh};

use crate::vehicle::store;
use flights::param_file;
use report::exit::BadInput;
use rig::ServoKind;

/// The image's controller with the linkage of a drone.
pub struct Law {
    controller: Controller,
    state: LawState,
    zero_rad: f64,
    timing: Timing,
    refresh: Refresh,
    /// When the law ran first, s.
    begun_s: f64,
    /// Which refresh of the sensor was the newest at the last reading, and how many there were; by
    /// its time, s, where the sensor has no clock of its own.
    newest: (f64, i16),
}

impl Law {
    /// The controller with its crank at zero rudder, which has watched the sensor for some seconds.
    pub fn new(params: &Params, drone: &Parameters, timing: &Timing) -> Self {
        const WATCHED_S: f64 = 5.0;
        let control_s = timing.control_s;
        let first_s =
            timing.lead_s.map_or(0.0, |lead_s| (timing.phase_s - lead_s).rem_euclid(control_s));
        let ticks = (WATCHED_S / control_s) as u32;
        let begun_s = first_s - f64::from(ticks) * control_s;
        let controller = Controller::new(params, Axis::Pitch, COMMAND_LIMIT_RAD as f32);
        let state = LawState::at_rest(params);
        let mut law = Self {
            controller,
            state,
            zero_rad: drone.linkage().zero_rudder_crank_rad(),
            timing: *timing,
            refresh: params.refresh(),
            begun_s,
            newest: (f64::NEG_INFINITY, 0),
        };
        for tick in 0..ticks {
            law.watch(begun_s + f64::from(tick) * control_s);
        }
        law
    }

    /// What the firmware makes of a reading's being new.
    fn watch(&mut self, time_s: f64) -> tvc_nano::Sample {
        let timing = &self.timing;
        let refresh =
            timing.refresh_s.map_or(time_s, |period_s| timing.newest_refresh(time_s, period_s));
        let (before, count) = &mut self.newest;
        if refresh != *before {
            (*before, *count) = (refresh, count.wrapping_add(1));
        }
        self.refresh.read(RawSample {
            time: Micros((1e6 * (time_s - self.begun_s)).round() as u64),
            gyr: [*count; 3],
            ..RawSample::default()
        })
    }

    /// Takes a measurement and gives the crank command, in rad.
    pub fn update(&mut self, measurement: Measurement) -> f64 {
        let Measurement { time_s, pitch_rad, rate_rad_s } = measurement;
        let reading = self.watch(time_s);
        let sample = Sample {
            angle: (pitch_rad as f32).into(),
            rate: (rate_rad_s as f32).into(),
            rate_age_us: reading.rates.map(|rates| rates.age_us),
            refresh_us: reading.refresh_us,
            is_carried: self.is_carried(time_s),
        };
        let crank = self.controller.update(&mut self.state, &sample, None);
        self.zero_rad + f64::from(f32::from(crank))
    }

    /// Whether a pulse carries the step at `time_s`.
    fn is_carried(&self, time_s: f64) -> bool {
        let Timing { control_s, frame_s, phase_s, lead_s, .. } = self.timing;
        let per_frame = (frame_s / control_s).round().max(1.0);
        let carried_s = phase_s - lead_s.unwrap_or(0.0);
        let steps = ((carried_s - time_s) / control_s).round();
        steps.rem_euclid(per_frame) == 0.0
    }
}

/// The parameters that the image flies a servo with: its defaults, the rig's parameters for the
/// servo, and those of a file.
///
/// # Errors
/// A file that cannot be used.
pub fn parameters(servo: ServoKind, gains: Option<&Path>) -> Result<Params> {
    let mut params = Params::default();
    store(&mut params, servo.parameters().iter().copied())?;
    if let Some(file) = gains {
        let rows = param_file::read(file)?.rows.into_iter();
        store(&mut params, rows.map(|row| (row.name, row.value)))
            .map_err(|error| BadInput::of(file, error))?;
    }
    Ok(params)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_has_the_image_s_timing() {
        for preset in [Timing::NANO_50HZ, Timing::NANO_300HZ] {
            let mut params = Params::default();
            let frame_hz = (1.0 / preset.frame_s).round() as f32;
            params.set("SRV_RATE_HZ", frame_hz).expect("in range");
            let lead_s = 1e-6 * f64::from(params.timing().sample_lead_us());
            assert!((lead_s - preset.lead_s.expect("locked")).abs() < 1e-5);
            let control_s = 1e-6 * f64::from(params.control_period_us());
            assert!((control_s - preset.control_s).abs() < 2e-6);
        }
    }
}
