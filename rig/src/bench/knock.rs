//! A knock on the sensor's board: a hit, a propeller that touches its guard, a board that is loose
//! and rattles.

use std::f64::consts::TAU;

/// Time that a board which was pushed takes to tip and come back, s: it is fastest after 5 ms.
const TIP_S: f64 = 0.02;

/// A knock on the sensor's board. The board ends as it lay before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knock {
    /// Specific force along the sensor's axes, m/s^2: of a push all the time, of a rattle to either
    /// side in turn. What is beyond the sensor's range clips it.
    pub acc_m_s2: [f64; 3],
    /// Greatest rate about the sensor's axes, rad/s.
    pub rate_rad_s: [f64; 3],
    /// Swings a second of a rattle; 0 for a single push.
    pub swings_hz: f64,
    /// How long it lasts, s.
    pub seconds: f64,
}

impl Knock {
    /// Specific force (m/s^2) and rate (rad/s) so long after its begin, s.
    pub(super) fn at(&self, since_s: f64) -> ([f64; 3], [f64; 3]) {
        let swings = since_s * self.swings_hz;
        let side = if swings.fract() < 0.5 { 1.0 } else { -1.0 };
        let force = if since_s < self.seconds { side } else { 0.0 };
        // Whole swings, so that it turns back as far as it has turned.
        let (swings, all) = match self.swings_hz {
            0.0 => (since_s / TIP_S, 1.0),
            hertz => (swings, (self.seconds * hertz).ceil()),
        };
        let turn = if swings < all { (TAU * swings).sin() } else { 0.0 };
        (self.acc_m_s2.map(|acc| acc * force), self.rate_rad_s.map(|rate| rate * turn))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1e-4;

    /// Largest rate about x, when it comes, s, and what is left of the turn in the end, rad.
    fn turned(knock: &Knock) -> (f64, f64, f64) {
        let (mut most, mut at_s, mut turned) = (0.0, 0.0, 0.0);
        for step in 0..5000 {
            let since_s = f64::from(step) * STEP_S;
            let (_, [rate, ..]) = knock.at(since_s);
            turned += rate * STEP_S;
            if rate > most {
                (most, at_s) = (rate, since_s);
            }
        }
        (most, at_s, turned)
    }

    #[test]
    fn a_push_is_one_sided_and_a_rattle_is_not_and_neither_turns_the_board_for_good() {
        let push = Knock {
            acc_m_s2: [100.0, 0.0, -50.0],
            rate_rad_s: [5.0, 0.0, 0.0],
            swings_hz: 0.0,
            seconds: 0.003,
        };
        assert_eq!(push.at(0.002).0, [100.0, 0.0, -50.0]);
        assert_eq!(push.at(0.004).0, [0.0; 3]);
        let rattle = Knock { swings_hz: 100.0, seconds: 0.3, ..push };
        assert_eq!(rattle.at(0.002).0, [100.0, 0.0, -50.0]);
        assert_eq!(rattle.at(0.007).0, [-100.0, 0.0, 50.0]);
        assert_eq!(rattle.at(0.301).0, [0.0; 3]);
        for (knock, quarter_s) in [(push, 0.005), (rattle, 0.0025)] {
            let (most, at_s, turned) = turned(&knock);
            assert!((most - 5.0).abs() < 1e-2 && turned.abs() < 1e-6, "{turned}");
            assert!((at_s - quarter_s).abs() < 1e-3, "{at_s}");
        }
    }
}
