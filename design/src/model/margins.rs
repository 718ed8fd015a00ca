//! `tvc model margins`: how far a rocket's loop is from instability along its burn.
//!
//! At ten times of the burn a flight in calm air is kicked. The gain is raised, and lowered, or
//! delay is added, until the oscillation that follows keeps half of the kick. Delay changes no
//! gain, so that the rocket then oscillates at the loop's crossover: delay times crossover is the
//! phase margin.

use std::f64::consts::TAU;

use anyhow::{Result, bail};
use rig::bench::{Kick, RocketConfig};
use rig::rocket::{Airframe, Conditions, dispersed};

use super::Margins;
use crate::ascent::{Flight, PERIOD_S, STEP_S};
use report::campaign::carry_out;
use report::exit::{BadInput, Verdict};
use report::measure::{Figure, Figures, Limit, Limit::AtLeast, figure, rows};

/// Times of the burn at which a loop is looked at.
const TIMES: u32 = 10;
/// For how long an oscillation is followed, s: before the next time, and within the burn.
const FOLLOWED_S: f64 = 7.0;
const SHORTEST_BURN_S: f64 = (FOLLOWED_S + 1.0) * TIMES as f64;
/// The kick, rad/s: too small for any limit of the gimbal.
const KICK_RAD_S: f64 = 0.005;
/// The largest margins that are looked for, dB and s, and halvings of the interval in which each
/// lies.
const MOST_DB: (f64, u32) = (20.0, 7);
const MOST_DELAY_S: (f64, u32) = (1.2, 9);

/// Required of a rocket as its image was told, dB and deg.
const NOMINAL: (f64, f64) = (6.0, 30.0);
/// Required of dispersed ones, and of how many of them.
const DISPERSED: (f64, f64) = (4.0, 20.0);
const DISPERSED_PCT: Limit = AtLeast(99.0);

/// Margins at a time of the burn.
#[derive(Clone, Copy, Debug)]
struct At {
    at_s: f64,
    /// Gain that may be added, and taken away, dB.
    more_db: f64,
    less_db: f64,
    /// Delay that may be added, s.
    delay_s: f64,
    /// Crossover, rad/s.
    crossover_rad_s: f64,
}

impl At {
    fn phase_deg(&self) -> f64 {
        (self.delay_s * self.crossover_rad_s).to_degrees()
    }

    fn keeps(&self, (gain_db, phase_deg): (f64, f64)) -> bool {
        self.more_db.min(self.less_db) >= gain_db && self.phase_deg() >= phase_deg
    }

    fn row(&self, airframe: &Airframe) -> [Figure; 6] {
        let (gain_db, phase_deg) = NOMINAL;
        let gain = |key, margin_db, name| {
            figure(key, margin_db).shown(name, "dB", 1).limit(AtLeast(gain_db))
        };
        [
            figure("airframe", airframe.name.as_str()).shown("airframe", "", 0),
            figure("at_s", self.at_s).shown("time of the burn", "s", 1),
            gain("more_db", self.more_db, "gain may rise by"),
            gain("less_db", self.less_db, "fall by"),
            figure("phase_deg", self.phase_deg())
                .shown("phase margin", "deg", 0)
                .limit(AtLeast(phase_deg)),
            figure("crossover_rad_s", self.crossover_rad_s).shown("crossover", "rad/s", 1),
        ]
    }
}

/// Finds the margins as `options` say.
pub fn run(options: &Margins) -> Result<Verdict> {
    let mut calm = options.vehicle.rockets()?;
    calm.iter_mut().for_each(|airframe| airframe.conditions = Conditions::CALM);
    if let Some(short) = calm.iter().find(|one| one.rocket().burn_s < SHORTEST_BURN_S) {
        bail!(BadInput::new(format!(
            "{}: a burn of {} s is too short; an oscillation is followed for {FOLLOWED_S} s at {TIMES} times",
            short.name,
            short.rocket().burn_s
        )));
    }
    let nominal = carry_out("airframes", &calm, None, |airframe| {
        along_the_burn(airframe.on_pad(1), airframe)
    })?;
    let table = nominal
        .iter()
        .zip(&calm)
        .flat_map(|(found, airframe)| found.iter().map(|at| at.row(airframe)));
    let mut figures = Figures::from([rows("nominal", table.collect::<Vec<_>>())]);
    if let Some(count) = options.dispersed {
        let seeds: Vec<u64> = (options.seed..).take(count as usize).collect();
        let keeping = carry_out("rockets", &seeds, None, |seed| {
            let airframe = &calm[(seed % calm.len() as u64) as usize];
            let found = along_the_burn(dispersed(*seed, airframe), airframe)?;
            Ok(found.iter().all(|at| at.keeps(DISPERSED)))
        })?;
        let share = keeping.iter().filter(|keeps| **keeps).count() as f64 / f64::from(count);
        figures = figures
            .and(figure("seed", options.seed))
            .and(figure("dispersed", count).shown("dispersed rockets", "", 0))
            .and(
                figure("dispersed_pct", 100.0 * share)
                    .shown("with 4 dB and 20 deg throughout", "%", 1)
                    .limit(DISPERSED_PCT),
            );
    }
    figures.conclude(options.json, None)
}

/// The margins of a rocket under the gains of an airframe, at ten times from its rail to the end of
/// its burn.
fn along_the_burn(mut on_pad: RocketConfig, airframe: &Airframe) -> Result<Vec<At>> {
    let mut flight = Flight::new(&on_pad, airframe, None, 1.0)?;
    let burn_s = on_pad.parameters.rocket.burn_s;
    while flight.on_rail() && flight.now_s() < burn_s {
        flight.tick();
    }
    let first_s = flight.now_s() + 2.0 * PERIOD_S;
    let apart_s = (burn_s - first_s - FOLLOWED_S) / f64::from(TIMES - 1);
    let times: Vec<f64> = (0..TIMES).map(|index| first_s + f64::from(index) * apart_s).collect();
    on_pad.kicks =
        times.iter().map(|at_s| Kick { at_s: *at_s, rates_rad_s: [KICK_RAD_S, 0.0] }).collect();
    let mut flight = Flight::new(&on_pad, airframe, None, 1.0)?;
    let found = times.iter().map(|at_s| {
        while flight.now_s() + PERIOD_S < *at_s {
            flight.tick();
        }
        at(&flight)
    });
    Ok(found.collect())
}

/// The margins of a flight that is about to be kicked.
fn at(flight: &Flight) -> At {
    let scaled = |db: f64| {
        let mut other = flight.clone();
        other.effect *= 10_f64.powf(db / 20.0);
        other
    };
    let late = |delay_s: f64| {
        let mut other = flight.clone();
        other.delay((delay_s / STEP_S) as usize);
        other
    };
    let most = |(limit, halvings): (f64, u32), changed: &dyn Fn(f64) -> Flight| {
        if oscillation(changed(limit)).is_none() {
            return [limit; 2];
        }
        let (mut low, mut high) = (0.0, limit);
        for _ in 0..halvings {
            let middle = 0.5 * (low + high);
            *(if oscillation(changed(middle)).is_none() { &mut low } else { &mut high }) = middle;
        }
        [low, high]
    };
    let [delay_s, too_late_s] = most(MOST_DELAY_S, &late);
    At {
        at_s: flight.now_s(),
        more_db: most(MOST_DB, &scaled)[0],
        less_db: most(MOST_DB, &|db| scaled(-db))[0],
        delay_s,
        crossover_rad_s: oscillation(late(too_late_s)).unwrap_or(f64::NAN),
    }
}

/// The frequency, rad/s, of an oscillation that keeps half of the kick at least; `None` where it
/// decays.
fn oscillation(mut flight: Flight) -> Option<f64> {
    let ticks = (FOLLOWED_S / PERIOD_S) as usize;
    let rates: Vec<f64> = (0..ticks)
        .map(|_| {
            flight.tick();
            flight.pitch_rate_rad_s()
        })
        .collect();
    let largest = rates[2 * ticks / 3..].iter().fold(0.0_f64, |most, rate| most.max(rate.abs()));
    if largest < 0.5 * KICK_RAD_S {
        return None;
    }
    let turns = rates.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
    Some(0.5 * TAU * turns as f64 / FOLLOWED_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rocket that nothing but the gimbal turns, halfway through its burn: the gain may rise and
    /// fall by what the frequency response of gains, lag, hold and delay says.
    #[test]
    fn margins_are_those_of_the_frequency_response() {
        let mut airframe = Airframe::stable();
        airframe.conditions = Conditions::CALM;
        let on_pad = airframe.on_pad(1);
        let found = along_the_burn(on_pad.clone(), &airframe).unwrap();
        let at = found[4];
        let flight = plant::rocket::Rocket::new(airframe.rocket()).unwrap().at(at.at_s + 3.0);
        let gains = airframe
            .design
            .gains(&plant::rocket::Rocket::new(airframe.rocket()).unwrap(), at.at_s + 3.0);
        let [kp, ki, kd] = [gains.kp, gains.ki, gains.kd].map(f64::from);
        let lag_s = 1.0 / (TAU * airframe.rocket().gimbal_hz);
        // Seven steps until the pulse has its effect, and half a frame that it holds.
        let delay_s = 7.0 * STEP_S + 1.5 * PERIOD_S;
        let open = |w: f64| {
            let (real, imaginary) = (kp, kd * w - ki / w);
            let size = flight.mu_c * real.hypot(imaginary) / (1.0 + (lag_s * w).powi(2)).sqrt();
            let phase = imaginary.atan2(real) - (lag_s * w).atan() - delay_s * w;
            // The airframe's own stiffness is below all of these frequencies.
            (size / (w * w - flight.mu_a), phase)
        };
        let frequencies = (300..4_000).map(|centi| f64::from(centi) * 0.01);
        let crossing = |is_below: &dyn Fn(f64) -> bool| frequencies.clone().find(|w| is_below(*w));
        let crossover = crossing(&|w| open(w).0 < 1.0).unwrap();
        let phase_deg = open(crossover).1.to_degrees();
        let lost = crossing(&|w| open(w).1 < 0.0).unwrap();
        let gain_db = -20.0 * open(lost).0.log10();
        assert!((at.phase_deg() - phase_deg).abs() < 5.0, "{at:?}: {phase_deg} deg");
        assert!((at.crossover_rad_s - crossover).abs() < 0.6, "{at:?}: {crossover}");
        assert!((at.more_db - gain_db).abs() < 1.5, "{at:?}: {gain_db} dB");
    }

    #[test]
    fn shipped_rockets_keep_their_margins() {
        for mut airframe in [Airframe::stable(), Airframe::unstable()] {
            airframe.conditions = Conditions::CALM;
            let found = along_the_burn(airframe.on_pad(1), &airframe).unwrap();
            assert!(found.iter().all(|at| at.keeps(NOMINAL)), "{found:?}");
        }
    }
}
