//! What happens to a sound vehicle in a run, millisecond by millisecond: what moves, strikes and
//! surrounds its sensor, and what its host does.

use client::request;
use rand::Rng;
use rand::seq::IndexedRandom;
use samd21::board::Ticks;
use tvc_nano::Params;

use super::SoundKind;
use super::parts::{octaves, three};
use crate::bench::{Knock, Magnet};
use crate::bno055::Fault;
use crate::disturbance::Vibration;
use crate::fly::faults::Phase;
use crate::fly::faults::frames::{frame, harmless_frame, near, valid_frame};
use crate::fly::flight::{FlightError, Ready};
use crate::inertial::STANDARD_GRAVITY_M_S2;
use crate::sensor_motion::{SensorMotion, Shake};

/// Greatest force of a knock along an axis, g: twice the sensor's range.
const KNOCK_G: f64 = 16.0;
/// Greatest rate of a knock, and of a hand, deg/s.
const KNOCK_DEG_S: f64 = 300.0;
const HAND_DEG_S: f64 = 900.0;
/// Fast hands change a rate by no more, rad/s^2: 300 deg/s within 10 ms.
const HAND_RAD_S2: f64 = 523.0;
/// Bytes that wait for the vehicle at most, so that it has always some to take.
const QUEUE: usize = 4096;
/// Frames a second, at most.
const MOST_HZ: f64 = 800.0;
const MS: Ticks = Ticks::from_ms(1);

/// What happens at the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    /// Nothing.
    Rest,
    /// Knocks on its board.
    Knocks,
    /// It is moved by hand, not faster than this rate, deg/s.
    Hand(u16),
    /// Magnets pass.
    Magnets,
}

/// What the host does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Host {
    /// It does not read, and no program has the port open.
    Away,
    /// It reads.
    Reads,
    /// It sends [harmless](harmless_frame) frames at this rate, 1/s.
    Frames(f64),
    /// It sends [valid](valid_frame) frames at this rate, 1/s.
    Orders(f64),
    /// It sends those as fast as they are taken.
    Flood,
    /// It sends noise as fast as it is taken.
    Noise,
    /// It changes a parameter and saves all, with this period, ms.
    Saves(u64),
}

/// What happens in a run.
#[derive(Clone, Debug)]
pub(super) struct Acts {
    motion: Motion,
    pub(super) host: Host,
    /// The propeller's, once the vehicle is free.
    pub(super) vibration: Option<Vibration>,
    /// When the sensor falls to CONFIG mode, ms.
    config_at: Option<u64>,
    /// When the next knock, motion or magnet comes, ms.
    next: u64,
    /// Share of a frame that is due.
    due: f64,
    /// Frames sent so far.
    pub(super) frames: u64,
    /// What was done, in words.
    pub(super) words: String,
}

impl Acts {
    /// What a kind of run has in a phase, and as much of the rest as goes with it, for a sensor
    /// that refreshes accelerations and rates `refresh_hz` times a second.
    pub(super) fn draw(
        kind: SoundKind,
        phase: Phase,
        refresh_hz: [f64; 2],
        dice: &mut impl Rng,
    ) -> Self {
        let other = match (phase, dice.random_range(0..4)) {
            (Phase::Start, _) | (_, 0) => Motion::Rest,
            (_, 1) => Motion::Knocks,
            (Phase::Flight, _) | (_, 2) => Motion::Magnets,
            _ => Motion::Hand(200),
        };
        let motion = match kind {
            SoundKind::Rest | SoundKind::Vibration | SoundKind::WarmUp => Motion::Rest,
            SoundKind::Knocks => Motion::Knocks,
            SoundKind::Hand => Motion::Hand(200),
            SoundKind::FastHand => Motion::Hand(HAND_DEG_S as u16),
            SoundKind::Magnet => Motion::Magnets,
            _ => other,
        };
        let hertz = octaves(10.0..MOST_HZ, dice);
        let saves = Host::Saves(dice.random_range(10..=200));
        let hosts = [Host::Away, Host::Reads, Host::Frames(hertz), saves];
        let host = match kind {
            SoundKind::Frames => Host::Frames(hertz),
            SoundKind::Orders => Host::Orders(hertz),
            SoundKind::Flood => Host::Flood,
            SoundKind::Noise => Host::Noise,
            SoundKind::Saves => saves,
            _ => *hosts.choose(dice).unwrap_or(&Host::Reads),
        };
        let vibrates = kind == SoundKind::Vibration
            || phase == Phase::Flight && kind != SoundKind::Rest && dice.random_bool(0.3);
        let vibration = vibrates.then(|| vibration(refresh_hz, dice));
        let mut words = format!("{motion:?}, host {host:?}");
        if let Some(Vibration { acc_m_s2, frequency_hz, .. }) = vibration {
            words += &format!(", {acc_m_s2:.1} m/s2 at {frequency_hz:.0} Hz");
        }
        Self {
            motion,
            host,
            vibration,
            config_at: (kind == SoundKind::SetUp).then(|| dice.random_range(100..2000)),
            next: 0,
            due: 0.0,
            frames: 0,
            words,
        }
    }

    /// Whether the host gives orders that the vehicle obeys.
    pub(super) fn commands(&self) -> bool {
        matches!(self.host, Host::Orders(_) | Host::Flood)
    }

    /// Whether parameters change by what the host sends.
    pub(super) fn sets(&self) -> bool {
        self.commands() || matches!(self.host, Host::Frames(_) | Host::Saves(_))
    }

    /// Whether parameters are stored in this phase, for which the processor stands still again and
    /// again.
    pub(super) fn saves(&self, phase: Phase) -> bool {
        self.commands() || self.sets() && !matches!(phase, Phase::Armed | Phase::Flight)
    }

    /// Whether the sensor falls to CONFIG mode.
    pub(super) fn resets_sensor(&self) -> bool {
        self.config_at.is_some()
    }

    /// Begins a run.
    pub(super) fn begin(&self, ready: &mut Ready) {
        if self.host == Host::Away {
            let host = &mut ready.rig.chip.usb_host;
            host.set_open(false);
            host.pause_reading(true);
        }
    }

    /// A millisecond of it.
    ///
    /// # Errors
    /// The rig stopped.
    pub(super) fn act(
        &mut self,
        ms: u64,
        phase: Phase,
        params: &Params,
        ready: &mut Ready,
        dice: &mut impl Rng,
    ) -> Result<(), FlightError> {
        if self.config_at == Some(ms) {
            ready.rig.inject(Fault::ConfigReset);
        }
        if ms >= self.next {
            self.next = ms + self.disturb(ready, dice);
        }
        self.talk(ms, phase, params, ready, dice);
        let Ready { rig, station, .. } = ready;
        match self.host {
            Host::Away => rig.run_for(MS)?,
            _ => station.run(rig, MS)?,
        }
        Ok(())
    }

    /// Ends a run: the sensor is at its place and at rest, the host reads again, and all that it
    /// has sent is taken.
    ///
    /// # Errors
    /// The rig stopped.
    pub(super) fn end(&self, ready: &mut Ready) -> Result<(), FlightError> {
        /// Longest time that what has been sent may take.
        const LONGEST: Ticks = Ticks::from_ms(20_000);
        let Ready { rig, station, .. } = ready;
        rig.environment.put_back();
        let host = &mut rig.chip.usb_host;
        host.pause_reading(false);
        if self.host == Host::Away {
            host.set_open(true);
        }
        let end = rig.now() + LONGEST;
        while rig.chip.usb_host.unsent() > 0 && rig.now() < end {
            station.run(rig, Ticks::from_ms(10))?;
        }
        Ok(())
    }

    /// Does something to the sensor; ms until it does the next.
    fn disturb(&self, ready: &mut Ready, dice: &mut impl Rng) -> u64 {
        let environment = &mut ready.rig.environment;
        match self.motion {
            Motion::Rest => u64::MAX / 2,
            Motion::Knocks => {
                environment.knock(knock(dice));
                dice.random_range(400..2500)
            }
            Motion::Hand(most_deg_s) => {
                let shake = shake(f64::from(most_deg_s), dice);
                environment.move_sensor(SensorMotion::Shake(shake));
                (shake.seconds * 1e3) as u64 + dice.random_range(10..1000)
            }
            Motion::Magnets => {
                let seconds = octaves(0.1..3.0, dice);
                let field_ut = three(octaves(20.0..2000.0, dice), dice);
                environment.pass_magnet(Magnet { field_ut, seconds });
                (seconds * 1e3) as u64 + dice.random_range(0..500)
            }
        }
    }

    fn talk(
        &mut self,
        ms: u64,
        phase: Phase,
        params: &Params,
        ready: &mut Ready,
        dice: &mut impl Rng,
    ) {
        let rig = &mut ready.rig;
        match self.host {
            Host::Away | Host::Reads => {}
            Host::Frames(hertz) | Host::Orders(hertz) => {
                self.due += hertz / 1e3;
                while self.due >= 1.0 && rig.chip.usb_host.unsent() < QUEUE {
                    let frame = match self.host {
                        Host::Orders(_) => valid_frame(dice),
                        _ => harmless_frame(phase, params, dice),
                    };
                    rig.usb_write(&frame);
                    self.due -= 1.0;
                    self.frames += 1;
                }
            }
            Host::Flood => {
                while rig.chip.usb_host.unsent() < QUEUE {
                    rig.usb_write(&valid_frame(dice));
                    self.frames += 1;
                }
            }
            Host::Noise => {
                while rig.chip.usb_host.unsent() < QUEUE {
                    let noise: [u8; 512] = std::array::from_fn(|_| dice.random());
                    rig.usb_write(&noise);
                }
            }
            Host::Saves(every) if ms.is_multiple_of(every) => {
                rig.usb_write(&frame(&near(params, dice)));
                rig.usb_write(&frame(&request::SAVE.message()));
                self.frames += 2;
            }
            Host::Saves(_) => {}
        }
    }
}

/// How far a vibration moves a sensor whose mount is sound, m.
const EXCURSION_M: f64 = 1e-3;
/// A line of a vibration this close to a multiple of a refresh rate, Hz, arrives as a slow swing.
/// Nothing in the samples tells that swing from a motion, so that control follows it.
const ALIAS_HZ: f64 = 5.0;
/// Greatest amplitude of such a line on a sound vehicle, m/s^2: at 50 Hz it turns the sensor by
/// 5.5 deg/s.
const ALIASED_M_S2: f64 = 3.0;

/// A vibration of a sensor that refreshes accelerations and rates `refresh_hz` times a second.
fn vibration(refresh_hz: [f64; 2], dice: &mut impl Rng) -> Vibration {
    let (harmonics, wander_pct) = (dice.random_range(0..=4), dice.random_range(0.0..20.0));
    let wander = wander_pct / 100.0;
    let highest = f64::from(1 + harmonics) * (1.0 + wander);
    let frequency_hz = octaves(20.0..Vibration::HIGHEST_HZ / highest, dice);
    let widest_m_s2 = (std::f64::consts::TAU * frequency_hz).powi(2) * EXCURSION_M;
    let acc_m_s2 = octaves(0.5..widest_m_s2.min(40.0), dice);
    let is_slow = |line_hz: f64| {
        let (lowest, highest) =
            (line_hz * (1.0 - wander) - ALIAS_HZ, line_hz * (1.0 + wander) + ALIAS_HZ);
        refresh_hz.iter().any(|hz| (lowest / hz).floor() < (highest / hz).floor())
    };
    // Each line has half the amplitude of the line before.
    let slow = (0..=harmonics).find(|line| is_slow(frequency_hz * f64::from(line + 1)));
    let most_m_s2 = slow.map_or(acc_m_s2, |line| ALIASED_M_S2 * f64::from(1 << line));
    Vibration {
        acc_m_s2: acc_m_s2.min(most_m_s2),
        rate_dps: None,
        frequency_hz,
        harmonics,
        wander_pct,
    }
}

fn knock(dice: &mut impl Rng) -> Knock {
    let swings_hz = if dice.random() { octaves(20.0..400.0, dice) } else { 0.0 };
    // Nothing pushes a vehicle to one side at 16 g for as long as it can rattle.
    let longest_s = if swings_hz > 0.0 { 0.3 } else { 0.03 };
    Knock {
        acc_m_s2: three(octaves(1.0..KNOCK_G, dice) * STANDARD_GRAVITY_M_S2, dice),
        rate_rad_s: three(octaves(1.0..KNOCK_DEG_S, dice).to_radians(), dice),
        swings_hz,
        seconds: octaves(0.001..longest_s, dice),
    }
}

fn shake(most_deg_s: f64, dice: &mut impl Rng) -> Shake {
    let rate_rad_s = octaves(1.0..most_deg_s, dice).to_radians();
    let fastest_hz = (HAND_RAD_S2 / rate_rad_s / std::f64::consts::TAU).clamp(0.3, 8.0);
    Shake {
        rate_rad_s,
        // A hand at the end of an arm of 0.5 m.
        acc_m_s2: octaves(0.1..50.0, dice).min(0.5 * rate_rad_s * rate_rad_s),
        swings_hz: octaves(0.2..fastest_hz, dice),
        seconds: dice.random_range(0.5..3.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, generator};

    #[test]
    fn no_line_that_arrives_as_a_slow_swing_is_strong() {
        let mut strong = 0;
        for seed in 0..2_000 {
            let mut dice = generator(seed, Stream::Campaign);
            let refresh_hz = [octaves(10.0..200.0, &mut dice), octaves(35.0..200.0, &mut dice)];
            let drawn = vibration(refresh_hz, &mut dice);
            for line in 0..=drawn.harmonics {
                let amplitude_m_s2 = drawn.acc_m_s2 / f64::from(1 << line);
                for part in -20..=20 {
                    let wander = drawn.wander_pct / 100.0 * f64::from(part) / 20.0;
                    let line_hz = drawn.frequency_hz * f64::from(line + 1) * (1.0 + wander);
                    let swing = refresh_hz.map(|hz| (line_hz - (line_hz / hz).round() * hz).abs());
                    let is_slow = swing.iter().any(|hz| *hz < ALIAS_HZ - 1e-9);
                    let why = format!("{drawn:?} at {refresh_hz:?} Hz, line {line}");
                    assert!(!is_slow || amplitude_m_s2 <= ALIASED_M_S2 + 1e-9, "{why}");
                }
            }
            strong += usize::from(drawn.acc_m_s2 > 10.0);
        }
        assert!(strong > 100, "{strong} of 2,000 are strong");
    }
}
