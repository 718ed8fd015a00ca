//! Many runs of the pitch loop with dispersed drones (Monte Carlo), on all cores.
//!
//! Each run draws its own drone, servo, start and noise from the campaign's seed and the run's
//! index alone. A run can be flown again by itself, and a campaign split into shards and merged
//! gives the same runs as one that was not.
//!
//! Ranges, all even unless said otherwise:
//!
//! | what | [`Ranges::REFERENCE`] | [`Ranges::WIDE`] |
//! |---|---|---|
//! | thrust | +-30 % | +-30 % |
//! | inertia of body 0 | +-30 % | +-30 % |
//! | total centre of mass, vertical | +-20 mm | +-20 mm |
//! | total centre of mass, lateral | 0 (option) | 0 (option) |
//! | servo speed | +-20 % | +-20 % |
//! | servo stall torque | 0 | +-20 % |
//! | supply (scales speed and stall torque) | 0 | -15 % to 0 |
//! | backlash | 0 | +-50 % |
//! | sensor delay | 0 | +-2 ms |
//! | frame phase | one frame | one frame |
//! | start, either sign, with 0.2 rad/s away from upright | 0.2, 0.4, 0.8 rad | the same |
//! | noise of pitch, rate (white, normal, at every new reading) | 5 mrad, 20 mrad/s rms | the same |

mod statistics;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::parameters::Checked;
use crate::pitch_loop::{Measurement, PitchLoop, Sample, Timing};
use crate::response::StepResponse;
use crate::setup::Setup;

pub use statistics::{Rate, pass_rate, quantile};

/// Pitch rate at the start, away from upright, in rad/s.
const START_RATE_RAD_S: f64 = 0.2;
/// Starts that the runs are shared among, in rad.
const STARTS_RAD: [f64; 3] = [0.2, 0.4, 0.8];
/// Fixed band of settling, in rad.
const FIXED_BAND_RAD: f64 = 0.02;
/// Overshoot that the thesis allows, in percent.
const REQUIRED_OVERSHOOT_PCT: f64 = 30.0;
/// Settling time to 5 % that the thesis requires, in s.
const REQUIRED_SETTLING_S: f64 = 1.5;

/// How far each quantity may lie from its nominal value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// Thrust, either way, as a share.
    pub thrust: f64,
    /// Inertia of body 0, either way, as a share.
    pub inertia: f64,
    /// Total centre of mass along y, either way, in m.
    pub cm_vertical_m: f64,
    /// Total centre of mass along x, either way, in m.
    pub cm_lateral_m: f64,
    /// Servo speed, either way, as a share.
    pub servo_speed: f64,
    /// Stall torque, either way, as a share.
    pub stall: f64,
    /// Loss of supply voltage, from none to this, as a share.
    pub supply_loss: f64,
    /// Backlash, either way, as a share.
    pub backlash: f64,
    /// Sensor delay, either way, in s.
    pub delay_s: f64,
    /// Noise of the pitch, rms, in rad.
    pub pitch_noise_rad: f64,
    /// Noise of the rate, rms, in rad/s.
    pub rate_noise_rad_s: f64,
}

impl Ranges {
    /// The reference campaign's.
    pub const REFERENCE: Self = Self {
        thrust: 0.3,
        inertia: 0.3,
        cm_vertical_m: 0.02,
        cm_lateral_m: 0.0,
        servo_speed: 0.2,
        stall: 0.0,
        supply_loss: 0.0,
        backlash: 0.0,
        delay_s: 0.0,
        pitch_noise_rad: 5e-3,
        rate_noise_rad_s: 20e-3,
    };

    /// The reference's with servo, supply and sensor delay dispersed too.
    pub const WIDE: Self =
        Self { stall: 0.2, supply_loss: 0.15, backlash: 0.5, delay_s: 2e-3, ..Self::REFERENCE };
}

/// A set of runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Campaign {
    /// Seed of everything random.
    pub seed: u64,
    /// Runs of the whole campaign.
    pub runs: u64,
    /// Which runs to fly, as `(index, of)`: those whose number leaves the remainder `index`;
    /// `(0, 1)` is all.
    pub shard: (u64, u64),
    /// Length of a run, in s.
    pub seconds: f64,
    /// The ranges.
    pub ranges: Ranges,
}

impl Campaign {
    /// All of `runs` runs of 3 s with the reference ranges.
    pub fn new(seed: u64, runs: u64) -> Self {
        Self { seed, runs, shard: (0, 1), seconds: 3.0, ranges: Ranges::REFERENCE }
    }

    /// Numbers of the shard's runs, in order.
    pub fn indices(&self) -> impl Iterator<Item = u64> {
        let (shard, of) = (self.shard.0, self.shard.1.max(1));
        (shard..self.runs).step_by(of.try_into().unwrap_or(usize::MAX))
    }

    /// Drone, servo, start and noise of run `index`. The random numbers do not depend on the
    /// ranges: campaigns with and without an offset fly drones that are otherwise the same.
    pub fn draw(&self, index: u64) -> Draw {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(index);
        let mut either = |half: f64| half * rng.random_range(-1.0..=1.0);
        let r = &self.ranges;
        // The order of the fields is that of the draws: another one gives other runs.
        Draw {
            index,
            thrust: 1.0 + either(r.thrust),
            inertia: 1.0 + either(r.inertia),
            cm_vertical_m: either(r.cm_vertical_m),
            cm_lateral_m: either(r.cm_lateral_m),
            servo_speed: 1.0 + either(r.servo_speed),
            stall: 1.0 + either(r.stall),
            supply: 1.0 - either(r.supply_loss).abs(),
            backlash: 1.0 + either(r.backlash),
            delay_s: either(r.delay_s),
            phase: 0.5 * (1.0 + either(1.0)),
            start_rad: {
                let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
                sign * STARTS_RAD[(index % STARTS_RAD.len() as u64) as usize]
            },
            // Within what a TOML file can hold.
            noise_seed: rng.random::<u64>() >> 1,
        }
    }
}

/// One run's drone, servo, start and noise, relative to the nominal setup.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Draw {
    /// Number of the run.
    pub index: u64,
    /// Pitch at the start, in rad.
    pub start_rad: f64,
    /// Factor on the thrust.
    pub thrust: f64,
    /// Factor on the inertia of body 0.
    pub inertia: f64,
    /// Offset of the total centre of mass along y, in m.
    pub cm_vertical_m: f64,
    /// Offset of the total centre of mass along x, in m.
    pub cm_lateral_m: f64,
    /// Factor on the servo's speed.
    pub servo_speed: f64,
    /// Factor on the servo's stall torque.
    pub stall: f64,
    /// Supply, as a share of the nominal one.
    pub supply: f64,
    /// Factor on the backlash.
    pub backlash: f64,
    /// Change of the sensor's delay, in s.
    pub delay_s: f64,
    /// Frame phase, 0 to 1 of a frame.
    pub phase: f64,
    /// Seed of the sensor's noise.
    pub noise_seed: u64,
}

impl Draw {
    /// The setup that this run flies.
    pub fn setup(&self, nominal: &Setup) -> Setup {
        let mut setup = *nominal;
        let drone = &mut setup.drone;
        drone.thrust_n *= self.thrust;
        drone.body_inertia_kg_m2 *= self.inertia;
        // The offset is that of the whole drone; body 0 carries it.
        let share = drone.total_mass_kg() / drone.body_mass_kg;
        *drone = drone.with_lateral_offset(self.cm_lateral_m);
        drone.body_cm_m[1] += self.cm_vertical_m * share;
        setup.servo.speed_rad_s *= self.servo_speed * self.supply;
        setup.servo.stall_n_m *= self.stall * self.supply;
        setup.servo.backlash_rad *= self.backlash;
        setup.timing.delay_s = (setup.timing.delay_s + self.delay_s).max(0.0);
        setup.timing.phase_s = self.phase * setup.timing.frame_s;
        setup
    }

    /// Flies the run under a law; `watch` gets every sample.
    ///
    /// # Errors
    /// A dispersed parameter out of range.
    pub fn fly(
        &self,
        nominal: &Setup,
        ranges: &Ranges,
        seconds: f64,
        mut law: impl FnMut(Measurement) -> f64,
        mut watch: impl FnMut(&Sample),
    ) -> Checked {
        let setup = self.setup(nominal);
        let rate = START_RATE_RAD_S * self.start_rad.signum();
        let mut sim =
            PitchLoop::new(&setup.drone, setup.servo, setup.timing, self.start_rad, rate)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.noise_seed);
        // A sensor that repeats a reading repeats its noise.
        let mut newest = None;
        let mut noisy = |m: Measurement| {
            let exact = m.rate_rad_s;
            let (_, noise) = newest.take_if(|(before, _)| *before == exact).unwrap_or_else(|| {
                let mut normal = || -> f64 { rng.sample(StandardNormal) };
                (exact, (ranges.pitch_noise_rad * normal(), ranges.rate_noise_rad_s * normal()))
            });
            newest = Some((exact, noise));
            law(Measurement {
                pitch_rad: m.pitch_rad + noise.0,
                rate_rad_s: m.rate_rad_s + noise.1,
                ..m
            })
        };
        watch(&sim.sample());
        for _ in 0..(seconds / setup.timing.step_s).round() as u64 {
            watch(&sim.step(&mut noisy));
        }
        Ok(())
    }
}

/// Figures of a run's response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Number of the run.
    pub index: u64,
    /// Pitch at the start, in rad.
    pub start_rad: f64,
    /// Overshoot, in percent.
    pub overshoot_pct: f64,
    /// Rise to 10 % of the start, in s.
    pub rise_s: Option<f64>,
    /// Settling to 5 % of the start, in s.
    pub settling_5pct_s: Option<f64>,
    /// Settling to 2 % of the start, in s.
    pub settling_2pct_s: Option<f64>,
    /// Settling to 0.02 rad, in s.
    pub settling_20mrad_s: Option<f64>,
    /// Mean error at the end, in rad.
    pub final_error_rad: f64,
}

impl Outcome {
    fn of(draw: &Draw, response: &StepResponse) -> Self {
        Self {
            index: draw.index,
            start_rad: draw.start_rad,
            overshoot_pct: response.overshoot_pct(),
            rise_s: response.rise_s(),
            settling_5pct_s: response.settling_s(0.05),
            settling_2pct_s: response.settling_s(0.02),
            settling_20mrad_s: response.settling_within_s(FIXED_BAND_RAD),
            final_error_rad: response.final_error(),
        }
    }

    /// Whether overshoot and 5 % settling are what the thesis requires.
    pub fn passes(&self) -> bool {
        self.overshoot_pct <= REQUIRED_OVERSHOOT_PCT
            && self.settling_5pct_s.is_some_and(|s| s <= REQUIRED_SETTLING_S)
    }
}

/// How bad a run was: the larger of settling time and overshoot, each as a multiple of its limit. A
/// run that never settled counts as 100.
pub fn badness(settling_5pct_s: Option<f64>, overshoot_pct: f64) -> f64 {
    let settling = settling_5pct_s.map_or(100.0, |s| s / REQUIRED_SETTLING_S);
    settling.max(overshoot_pct / REQUIRED_OVERSHOOT_PCT)
}

/// Flies those of a campaign's shard that `chosen` takes, on all cores of the current thread pool.
///
/// `law` makes a fresh controller for each run, given that run's timing, which the firmware sets
/// itself; `done` is called after each run, from any thread.
/// Outcomes come in the order of their numbers.
///
/// # Errors
/// A nominal or dispersed parameter out of range.
pub fn fly<L>(
    nominal: &Setup,
    campaign: &Campaign,
    chosen: impl Fn(&Draw) -> bool,
    law: impl Fn(&Timing) -> L + Sync,
    done: impl Fn() + Sync,
) -> Checked<Vec<Outcome>>
where
    L: FnMut(Measurement) -> f64,
{
    let draws = campaign.indices().map(|index| campaign.draw(index));
    let draws: Vec<Draw> = draws.filter(chosen).collect();
    draws
        .into_par_iter()
        .map(|draw| {
            let mut samples = Vec::new();
            draw.fly(
                nominal,
                &campaign.ranges,
                campaign.seconds,
                law(&draw.setup(nominal).timing),
                |sample| {
                    samples.push((sample.time_s, sample.pitch_rad));
                },
            )?;
            done();
            // Starts are not zero and the model is finite, so a record is always a response.
            Ok(StepResponse::new(samples, 0.0).map(|response| Outcome::of(&draw, &response)).ok())
        })
        .filter_map(Result::transpose)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pitch_loop::Pd;

    fn campaign(runs: u64) -> Campaign {
        Campaign::new(7, runs)
    }

    fn fly_pd(setup: &Setup, campaign: &Campaign, kp: f64, kd: f64) -> Vec<Outcome> {
        let linkage = setup.drone.linkage();
        let law = |_: &Timing| {
            let mut law = Pd::new(kp, kd, &linkage, setup.timing.control_s);
            move |m| law.update(m)
        };
        fly(setup, campaign, |_| true, law, || ()).unwrap()
    }

    #[test]
    fn draws_stay_in_their_ranges_and_differ() {
        let ranges = Ranges { cm_lateral_m: 5e-3, ..Ranges::WIDE };
        let campaign = Campaign { ranges, ..campaign(0) };
        let draws: Vec<Draw> = (0..300).map(|i| campaign.draw(i)).collect();
        for draw in &draws {
            assert!((0.7..=1.3).contains(&draw.thrust) && (0.85..=1.0).contains(&draw.supply));
            assert!(draw.cm_lateral_m.abs() <= 5e-3 && (0.0..=1.0).contains(&draw.phase));
        }
        let mean = draws.iter().map(|d| d.thrust).sum::<f64>() / 300.0;
        assert!((mean - 1.0).abs() < 0.04, "{mean}");
        assert!(draws.iter().any(|d| d.start_rad < 0.0) && draws.iter().any(|d| d.start_rad > 0.0));
        assert_ne!(draws[0].noise_seed, draws[1].noise_seed);
    }

    #[test]
    fn offsets_are_those_of_the_whole_drone() {
        let mut draw = campaign(1).draw(0);
        draw.cm_lateral_m = 0.01;
        let drone = draw.setup(&Setup::default()).drone;
        let moved = (drone.body_cm_m[0] - Setup::default().drone.body_cm_m[0]) * drone.body_mass_kg;
        assert!((moved / drone.total_mass_kg() - 0.01).abs() < 1e-12);
    }

    #[test]
    fn shards_merge_into_the_whole() {
        let setup = Setup::default();
        let whole = fly_pd(&setup, &campaign(7), 1.0, 0.3);
        let shard = |i| fly_pd(&setup, &Campaign { shard: (i, 3), ..campaign(7) }, 1.0, 0.3);
        let mut all: Vec<Outcome> = (0..3).flat_map(shard).collect();
        all.sort_by_key(|outcome| outcome.index);
        assert_eq!(all, whole);
    }
}
