//! The rocket's ascent on the model, under the image's law in float: what `tvc tune` flies.
//! The attitude is the true one.

use std::f64::consts::PI;

use anyhow::{Context, Result};
use nalgebra::{UnitQuaternion, Vector3};
use rig::bench::{Rocket, RocketConfig};
use rig::rocket::{Airframe, Design};
use tvc_pid::Law as _;
use tvc_pid::{Config, Controller, Gains, Pid, Schedule};

/// Period of the control, s, and steps of the physics to one.
const PERIOD_S: f64 = 1.0 / 150.0;
const STEPS: u32 = 4;
/// Ticks of control to a servo frame, the last of which the next pulse carries.
const TICKS: u32 = 3;
/// From the sample until its pulse has ended, in steps of the physics: 12 ms.
const EFFECT_STEPS: usize = 7;
/// The first part of the flight, which is not counted, s, and a share of the burn at most.
const LEFT_OUT_S: f64 = 2.1;
const LEFT_OUT: f64 = 0.25;
/// A rocket that is tilted by more is lost, rad.
const LOST_RAD: f64 = 60.0 * PI / 180.0;

/// How gains come about.
#[derive(Clone, Copy, Debug)]
pub enum Law {
    /// A schedule's, made for this.
    Scheduled(Design),
    /// The same throughout.
    Constant(Gains),
}

/// How a flight ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// With the burn: the axis' angle from the vertical, rad rms.
    Flown(f64),
    /// The rocket leaned too far at this time, s.
    LostAt(f64),
}

/// Flies a rocket from its pad to the end of its burn, with gains that are made for an `airframe`.
/// The gimbal is sent to `effect` times what the law asks for.
pub fn fly(on_pad: &RocketConfig, airframe: &Airframe, law: Law, effect: f64) -> Result<Outcome> {
    let [pitch, roll] = on_pad.start_rad;
    let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(roll, pitch, 0.0));
    let burn_s = on_pad.parameters.rocket.burn_s;
    let mut rocket = Rocket::new(on_pad, attitude)?;
    let table = plant::rocket::Rocket::new(airframe.rocket())?;
    // The gains are off, not how far the gimbal turns.
    let limit = (airframe.rocket().gimbal_limit_rad / effect) as f32;
    let config = |gains| Config { gains, limit: -limit..=limit, ..Config::new(PERIOD_S as f32) };
    let (first, schedule) = match law {
        Law::Constant(gains) => (gains, Schedule::<f32, 6>::default()),
        Law::Scheduled(design) => {
            let row = |at_s: f64| (at_s as f32, config(design.gains(&table, at_s)));
            let schedule = Schedule::new(airframe.rows_s().map(row));
            let schedule = schedule.map_err(|error| anyhow::anyhow!("the schedule: {error}"))?;
            (design.gains(&table, 0.0), schedule)
        }
    };
    let law = || Controller::<f32, Pid<f32>>::new(&config(first)).ok();
    let mut laws = [law().context("gains")?, law().context("gains")?];
    let dt_s = PERIOD_S / f64::from(STEPS);
    // What the actuators are sent to over the next steps, the nearest first.
    let mut under_way = [[0.0; 2]; EFFECT_STEPS];
    let (mut square, mut counted) = (0.0, 0.0);
    let mut output = [0.0; 2];
    rocket.ignite();
    let ticks = (burn_s / PERIOD_S) as u32;
    for tick in 0..ticks {
        let now_s = f64::from(tick) * PERIOD_S;
        let tilt = rocket.ascent().tilt_rad();
        let error = tilt[0].hypot(tilt[1]);
        if error > LOST_RAD {
            return Ok(Outcome::LostAt(now_s));
        }
        if now_s >= LEFT_OUT_S.min(LEFT_OUT * burn_s) {
            square += error * error;
            counted += 1.0;
        }
        let [roll_rate, pitch_rate, _] = rocket.ascent().rates_rad_s();
        if let Some(gains) = schedule.at(now_s as f32) {
            laws.iter_mut().for_each(|law| law.law.set_gains(&gains));
        }
        let inputs = tilt.into_iter().zip([pitch_rate, roll_rate]);
        for ((law, (angle, rate)), output) in laws.iter_mut().zip(inputs).zip(&mut output) {
            *output = -f64::from(law.update(0.0, angle as f32, rate as f32));
        }
        for step in 0..STEPS {
            if tick % TICKS == TICKS - 1 && step == 0 {
                under_way[EFFECT_STEPS - 1] = output;
            }
            let [now, rest @ ..] = under_way;
            rocket.step(dt_s, now.map(|gimbal| effect * gimbal * on_pad.shaft_per_gimbal));
            under_way[..EFFECT_STEPS - 1].copy_from_slice(&rest);
        }
    }
    let error_rad = f64::sqrt(square / f64::max(counted, 1.0));
    Ok(Outcome::Flown(error_rad))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_airframes_stay_upright_with_the_shipped_gains() {
        for airframe in [Airframe::stable(), Airframe::unstable()] {
            for law in [Law::Scheduled(airframe.design), Law::Constant(airframe.constant_gains)] {
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
        let outcome = fly(&airframe.on_pad(1), &airframe, Law::Constant(none), 1.0).unwrap();
        assert!(matches!(outcome, Outcome::LostAt(at_s) if at_s < 30.0), "{outcome:?}");
    }
}
