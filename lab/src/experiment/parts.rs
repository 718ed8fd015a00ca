//! The parts of the experiments that the thesis left for later (7.2): vibration, jerks and lasting
//! acceleration, each part with another strength of it.

use std::f64::consts::{PI, SQRT_2, TAU};

use tvc_fusion::GRAVITY;

/// Time between two parts, s, in which nothing acts: errors of one are not to be the next one's.
const PAUSE_S: f64 = 10.0;
/// Length of a part with vibration or jerks, s: at 0.2 Hz from the sampling rate four periods of
/// what the samples show.
const PART_S: f64 = 20.0;
/// How long the errors of a push are followed after its end, s.
const AFTER_S: f64 = 20.0;
/// Time between two pulses or steps, s.
const EVERY_S: f64 = 2.0;

/// What acts on the sensor in a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Act {
    /// Vibration of this frequency, Hz, along all axes; 0 for none.
    Vibration(f64),
    /// Forward and backward in turn, so many g for so long, s.
    Pulses(f64, f64),
    /// Pitch up and down again by so many degrees, each within so long, s.
    Steps(f64, f64),
    /// Forward with so many g for so long, s, and on with the speed that this has made.
    Push(f64, f64),
}

/// Frequencies around those of the gyroscope's and the accelerometer's filters, and around the
/// sampling rate of 100 Hz and twice that, where samples show a vibration as a slow swing.
const VIBRATION_HZ: [f64; 15] = [
    0.0, 10.0, 20.0, 40.3, 60.0, 80.0, 95.0, 99.0, 99.8, 100.2, 101.0, 110.0, 150.0, 199.8, 250.0,
];

const JERK: [Act; 7] = [
    Act::Pulses(0.5, 0.05),
    Act::Pulses(2.0, 0.02),
    Act::Pulses(2.0, 0.1),
    Act::Pulses(4.0, 0.05),
    Act::Pulses(8.0, 0.02),
    Act::Steps(45.0, 0.4),
    Act::Steps(45.0, 0.15),
];

const ACCELERATION: [Act; 6] = [
    Act::Push(0.1, 10.0),
    Act::Push(0.3, 10.0),
    Act::Push(0.5, 5.0),
    Act::Push(1.0, 3.0),
    Act::Push(2.0, 2.0),
    Act::Push(4.0, 1.0),
];

/// A part, and when it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// What acts.
    pub act: Act,
    /// When it begins, s.
    pub from_s: f64,
    /// When its errors are no longer counted, s.
    pub to_s: f64,
}

/// What acts on the sensor at a time, level but for its pitch.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Acting {
    /// Pitch, rad, and its rate, rad/s.
    pub pitch: (f64, f64),
    /// Acceleration forward, along the heading, m/s2.
    pub forward_m_s2: f64,
    /// Vibration, as a part of its strength, along each of the sensor's axes.
    pub vibration: [f64; 3],
}

/// The parts of the experiment on vibration.
pub fn vibration() -> Vec<Part> {
    in_turn(&VIBRATION_HZ.map(Act::Vibration))
}

/// Those of the one on jerks.
pub fn jerk() -> Vec<Part> {
    in_turn(&JERK)
}

/// Those of the one on lasting acceleration.
pub fn acceleration() -> Vec<Part> {
    in_turn(&ACCELERATION)
}

fn in_turn(acts: &[Act]) -> Vec<Part> {
    let mut from_s = PAUSE_S;
    let mut parts = Vec::new();
    for act in acts {
        let length_s = match act {
            Act::Push(_, lasting_s) => lasting_s + AFTER_S,
            _ => PART_S,
        };
        parts.push(Part {
            act: *act,
            from_s,
            to_s: from_s + length_s,
        });
        from_s += length_s + PAUSE_S;
    }
    parts
}

impl Part {
    /// Its name in tables.
    pub fn name(&self) -> String {
        match self.act {
            Act::Vibration(0.0) => "none".to_owned(),
            Act::Vibration(hz) => format!("{hz} Hz"),
            Act::Pulses(g, s) => format!("{g} g, {:.0} ms", 1e3 * s),
            Act::Steps(deg, s) => format!("{deg} deg in {:.0} ms", 1e3 * s),
            Act::Push(g, s) => format!("{g} g, {s} s"),
        }
    }

    /// Whether errors count at this time, s.
    pub fn counts(&self, time_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&time_s)
    }

    /// When what acts ends, s, where errors are followed after that.
    pub fn released_s(&self) -> Option<f64> {
        match self.act {
            Act::Push(_, lasting_s) => Some(self.from_s + lasting_s),
            _ => None,
        }
    }

    /// What acts at a time, s.
    pub fn acting(&self, time_s: f64) -> Acting {
        if !self.counts(time_s) {
            return Acting::default();
        }
        let since_s = time_s - self.from_s;
        // The number of the pulse or step, and the time in it.
        let (number, within_s) = ((since_s / EVERY_S).floor(), since_s.rem_euclid(EVERY_S));
        let up = number.rem_euclid(2.0) == 0.0;
        let m_s2 = |g: f64| g * f64::from(GRAVITY);
        let mut acting = Acting::default();
        match self.act {
            Act::Vibration(hz) => {
                acting.vibration = std::array::from_fn(|axis| {
                    let phase = TAU * (hz * time_s + axis as f64 / 3.0);
                    if hz > 0.0 { SQRT_2 * phase.sin() } else { 0.0 }
                });
            }
            Act::Pulses(g, lasting_s) => {
                if within_s < lasting_s {
                    acting.forward_m_s2 = if up { m_s2(g) } else { -m_s2(g) };
                }
            }
            Act::Steps(deg, lasting_s) => {
                // From one angle to the other as half a cosine.
                let share = (within_s / lasting_s).min(1.0);
                let (mut risen, mut rate) = (0.5 - 0.5 * (PI * share).cos(), 0.0);
                if share < 1.0 {
                    rate = 0.5 * PI / lasting_s * (PI * share).sin();
                }
                if !up {
                    (risen, rate) = (1.0 - risen, -rate);
                }
                acting.pitch = (deg.to_radians() * risen, deg.to_radians() * rate);
            }
            Act::Push(g, lasting_s) => {
                if since_s < lasting_s {
                    acting.forward_m_s2 = m_s2(g);
                }
            }
        }
        acting
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other_with_pauses_between() {
        for parts in [vibration(), jerk(), acceleration()] {
            assert_eq!(parts[0].from_s, PAUSE_S);
            for pair in parts.windows(2) {
                assert!((pair[1].from_s - pair[0].to_s - PAUSE_S).abs() < 1e-9);
            }
            for part in &parts {
                assert_eq!(part.acting(part.from_s - 0.001), Acting::default());
                assert_eq!(part.acting(part.to_s), Acting::default());
            }
        }
    }

    #[test]
    fn vibration_has_the_strength_that_is_asked_for() {
        for part in &vibration()[1..] {
            let mut squares = [0.0; 3];
            for ms in 0..20_000 {
                let acting = part.acting(part.from_s + f64::from(ms) * 1e-3);
                for (sum, value) in squares.iter_mut().zip(acting.vibration) {
                    *sum += value * value / 20_000.0;
                }
            }
            assert!(
                squares.iter().all(|mean| (mean - 1.0).abs() < 0.01),
                "{}",
                part.name()
            );
        }
    }

    /// Pulses leave no speed, and a push leaves what its time makes of it.
    #[test]
    fn speeds_are_those_of_the_accelerations() {
        let speed = |part: &Part| -> f64 {
            let length_ms = ((part.to_s - part.from_s) * 1e3) as u32;
            let at = |ms| part.acting(part.from_s + f64::from(ms) * 1e-3 + 5e-4);
            (0..length_ms).map(|ms| at(ms).forward_m_s2 * 1e-3).sum()
        };
        for part in &jerk()[..5] {
            assert!(speed(part).abs() < 1e-6, "{}", part.name());
        }
        let pushes = acceleration();
        for (part, expected) in pushes.iter().zip([1.0, 3.0, 2.5, 3.0, 4.0, 4.0]) {
            assert!((speed(part) / f64::from(GRAVITY) - expected).abs() < 1e-3);
            let released_s = part.released_s().expect("pushes end");
            assert!((part.to_s - released_s - AFTER_S).abs() < 1e-9);
        }
    }

    #[test]
    fn the_rate_of_a_step_is_the_slope_of_its_pitch() {
        for part in &jerk()[5..] {
            let pitch = |ms: i32| part.acting(part.from_s + f64::from(ms) * 1e-3).pitch;
            let mut most = 0.0_f64;
            for ms in 2..19_998 {
                let slope = (pitch(ms + 1).0 - pitch(ms - 1).0) / 2e-3;
                assert!((pitch(ms).1 - slope).abs() < 0.1, "{} at {ms}", part.name());
                most = most.max(pitch(ms).0.to_degrees());
            }
            assert!((most - 45.0).abs() < 1e-9);
        }
    }
}
