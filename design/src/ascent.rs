//! The rocket's ascent on the model, under the image's law in float: what `tvc tune` and
//! `tvc model margins` fly. The law gets the true attitude and rates, with the bending
//! where there is some.

use std::collections::VecDeque;
use std::f64::consts::PI;

use anyhow::{Result, anyhow};
use nalgebra::{UnitQuaternion, Vector3};
use rig::bench::{Rocket, RocketConfig};
use rig::rocket::Airframe;
use tvc_pid::Law as _;
use tvc_pid::{Config, Controller, Gains, Pid, Schedule};

/// Period of the control, s, and steps of the physics to one.
pub const PERIOD_S: f64 = 1.0 / 150.0;
const STEPS: u32 = 4;
/// A step of the physics, s.
pub const STEP_S: f64 = PERIOD_S / STEPS as f64;
/// Ticks of control to a servo frame, the last of which the next pulse carries.
const TICKS: u32 = 3;
/// From the sample until its pulse has ended, in steps of the physics: 12 ms.
const EFFECT_STEPS: usize = 7;
/// The first part of the flight, which is not counted, s, and a share of the burn at most.
const LEFT_OUT_S: f64 = 2.1;
const LEFT_OUT: f64 = 0.25;
/// A rocket that is tilted by more is lost, rad.
const LOST_RAD: f64 = 60.0 * PI / 180.0;

/// How a flight ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// With the burn: the axis' angle from the vertical, rad rms.
    Flown(f64),
    /// The rocket leaned too far at this time, s.
    LostAt(f64),
}

/// Flies a rocket from its pad to the end of its burn, with `constant` gains or the schedule of an
/// `airframe`. The gimbal is sent to `effect` times what the law asks for.
pub fn fly(
    on_pad: &RocketConfig,
    airframe: &Airframe,
    constant: Option<Gains>,
    effect: f64,
) -> Result<Outcome> {
    let burn_s = on_pad.parameters.rocket.burn_s;
    let mut flight = Flight::new(on_pad, airframe, constant, effect)?;
    let (mut square, mut counted) = (0.0, 0.0);
    while flight.now_s() + PERIOD_S <= burn_s {
        let [pitch, roll] = flight.rocket.ascent().tilt_rad();
        let error = pitch.hypot(roll);
        if error > LOST_RAD {
            return Ok(Outcome::LostAt(flight.now_s()));
        }
        if flight.now_s() >= LEFT_OUT_S.min(LEFT_OUT * burn_s) {
            square += error * error;
            counted += 1.0;
        }
        flight.tick();
    }
    let error_rad = f64::sqrt(square / f64::max(counted, 1.0));
    Ok(Outcome::Flown(error_rad))
}

/// A flight under way.
#[derive(Clone)]
pub struct Flight {
    rocket: Rocket,
    laws: [Controller<f32, Pid<f32>>; 2],
    schedule: Schedule<f32, 6>,
    shaft_per_gimbal: f64,
    /// What the law asks of the gimbal is multiplied by this.
    pub effect: f64,
    /// What the gimbal is sent to over the next steps, the nearest first.
    under_way: VecDeque<[f64; 2]>,
    ticks: u32,
}

impl Flight {
    /// A rocket on its pad that is lit, with `constant` gains or the schedule of an `airframe`.
    pub fn new(
        on_pad: &RocketConfig,
        airframe: &Airframe,
        constant: Option<Gains>,
        effect: f64,
    ) -> Result<Self> {
        let [pitch, roll] = on_pad.start_rad;
        let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0));
        let mut rocket = Rocket::new(on_pad, attitude)?;
        rocket.ignite();
        let table = plant::rocket::Rocket::new(airframe.rocket())?;
        // The gains are off, not how far the gimbal turns.
        let limit = (airframe.rocket().gimbal_limit_rad / effect) as f32;
        let config =
            |gains| Config { gains, limit: -limit..=limit, ..Config::new(PERIOD_S as f32) };
        let (first, schedule) = match constant {
            Some(gains) => (gains, Schedule::default()),
            None => {
                let design = airframe.design;
                let row = |at_s: f64| (at_s as f32, config(design.gains(&table, at_s)));
                let schedule = Schedule::new(airframe.rows_s().map(row));
                let schedule = schedule.map_err(|error| anyhow!("the schedule: {error}"))?;
                (design.gains(&table, 0.0), schedule)
            }
        };
        let law = Controller::<f32, Pid<f32>>::new(&config(first))
            .map_err(|error| anyhow!("the gains: {error}"))?;
        Ok(Self {
            rocket,
            laws: [law.clone(), law],
            schedule,
            shaft_per_gimbal: on_pad.shaft_per_gimbal,
            effect,
            under_way: VecDeque::from([[0.0; 2]; EFFECT_STEPS]),
            ticks: 0,
        })
    }

    /// One period of the control.
    pub fn tick(&mut self) {
        let ascent = self.rocket.ascent();
        let tilt = ascent.sensed_tilt_rad();
        let [roll_rate, pitch_rate, _] = ascent.sensed_rates_rad_s();
        if let Some(gains) = self.schedule.at(self.now_s() as f32) {
            self.laws.iter_mut().for_each(|law| law.law.set_gains(&gains));
        }
        let mut output = [0.0; 2];
        let inputs = tilt.into_iter().zip([pitch_rate, roll_rate]);
        for ((law, (angle, rate)), output) in self.laws.iter_mut().zip(inputs).zip(&mut output) {
            *output = -f64::from(law.update(0.0, angle as f32, rate as f32));
        }
        self.ticks += 1;
        if self.ticks.is_multiple_of(TICKS)
            && let Some(last) = self.under_way.back_mut()
        {
            *last = output;
        }
        for _ in 0..STEPS {
            let last = self.under_way.back().copied();
            let gimbal = self.under_way.pop_front().unwrap_or_default();
            self.under_way.extend(last);
            let shafts = gimbal.map(|gimbal| self.effect * gimbal * self.shaft_per_gimbal);
            self.rocket.step(STEP_S, shafts);
        }
    }

    /// Adds this number of steps of the physics between the law and the gimbal.
    pub fn delay(&mut self, steps: usize) {
        let now = self.under_way.front().copied().unwrap_or_default();
        (0..steps).for_each(|_| self.under_way.push_front(now));
    }

    /// Time since ignition, s.
    pub fn now_s(&self) -> f64 {
        f64::from(self.ticks) * PERIOD_S
    }

    /// Whether the rail still guides the rocket.
    pub fn on_rail(&self) -> bool {
        self.rocket.ascent().on_rail()
    }

    /// The rate about the body's y, rad/s.
    pub fn pitch_rate_rad_s(&self) -> f64 {
        self.rocket.ascent().rates_rad_s()[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_airframes_stay_upright_with_the_shipped_gains() {
        for airframe in [Airframe::stable(), Airframe::unstable()] {
            for law in [None, Some(airframe.constant_gains)] {
                let outcome = fly(&airframe.on_pad(1), &airframe, law, 1.0).unwrap();
                let Outcome::Flown(error_rad) = outcome else {
                    panic!("{airframe:?}, {law:?}: {outcome:?}");
                };
                assert!(error_rad.to_degrees() < 1.2, "{airframe:?}, {law:?}: {error_rad}");
            }
        }
    }

    #[test]
    fn an_unstable_rocket_without_control_is_lost() {
        let none = Gains::default();
        let airframe = Airframe::unstable();
        let outcome = fly(&airframe.on_pad(1), &airframe, Some(none), 1.0).unwrap();
        assert!(matches!(outcome, Outcome::LostAt(at_s) if at_s < 30.0), "{outcome:?}");
    }
}
