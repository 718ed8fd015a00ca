//! Thrust over a burn, and motors from RASP files.

/// Points that a curve has at most, as many as RASP allows.
const MOST_POINTS: usize = 32;

/// Thrust over a burn, straight between points, and 0 at both ends unless points stand there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustCurve {
    /// Times as shares of the burn, thrusts as shares of their mean, and the impulse until then as
    /// a share of the whole. The last point fills the rest.
    points: [[f64; 3]; MOST_POINTS],
}

/// A motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// How its thrust changes.
    pub curve: ThrustCurve,
    /// Mean thrust, in N.
    pub thrust_n: f64,
    /// Duration of the burn, in s.
    pub burn_s: f64,
}

/// Why a motor is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotorError {
    /// The points are no thrust over time.
    #[error(
        "a thrust curve has 2 to {MOST_POINTS} points [s, N], times that rise from 0 on, and thrusts of 0 or more, one of them above"
    )]
    Curve,
    /// The first line that says something is no head of a motor.
    #[error(
        "no head of a RASP file: name, diameter in mm, length in mm, delays, propellant in kg, total mass in kg, maker"
    )]
    Head,
    /// A line that is no point.
    #[error("line {0} is not a time in s and a thrust in N")]
    Line(usize),
}

impl Motor {
    /// A motor whose thrust goes through these points, `[s, N]`, and ends with the last.
    ///
    /// # Errors
    /// [`MotorError::Curve`].
    pub fn new(points: &[[f64; 2]]) -> Result<Self, MotorError> {
        let rising = points.windows(2).all(|pair| pair[0][0] < pair[1][0]);
        let possible =
            |point: &[f64; 2]| point.iter().all(|value| value.is_finite() && *value >= 0.0);
        // Where the points begin later, the thrust rises from nothing at 0 s.
        let first = points.first().filter(|first| first[0] > 0.0).map(|_| [0.0; 2]);
        let points: Vec<[f64; 2]> = first.into_iter().chain(points.iter().copied()).collect();
        let Some(&[burn_s, _]) = points.last() else { return Err(MotorError::Curve) };
        let impulses = points.windows(2).map(|pair| {
            let ([from_s, from_n], [to_s, to_n]) = (pair[0], pair[1]);
            0.5 * (from_n + to_n) * (to_s - from_s)
        });
        let impulses: Vec<f64> = impulses.collect();
        let whole: f64 = impulses.iter().sum();
        let counted = (2..=MOST_POINTS).contains(&points.len());
        if !counted || !rising || !points.iter().all(possible) || whole <= 0.0 {
            return Err(MotorError::Curve);
        }
        let thrust_n = whole / burn_s;
        let mut shares = [[1.0, points[points.len() - 1][1] / thrust_n, 1.0]; MOST_POINTS];
        let mut until = 0.0;
        for (index, [at_s, force_n]) in points.iter().take(points.len() - 1).enumerate() {
            shares[index] = [at_s / burn_s, force_n / thrust_n, until / whole];
            until += impulses[index];
        }
        Ok(Self { curve: ThrustCurve { points: shares }, thrust_n, burn_s })
    }

    /// The first motor of a RASP file (`.eng`), and its propellant, in kg.
    ///
    /// # Errors
    /// [`MotorError`]: what is wrong with the text.
    pub fn parse_rasp(text: &str) -> Result<(Self, f64), MotorError> {
        let lines = (1..).zip(text.lines().map(str::trim));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with(';'));
        let (_, head) = lines.next().ok_or(MotorError::Head)?;
        let head: Vec<&str> = head.split_whitespace().collect();
        let propellant_kg: f64 =
            head.get(4).and_then(|word| word.parse().ok()).ok_or(MotorError::Head)?;
        let mut points = Vec::new();
        for (number, line) in lines {
            let mut words = line.split_whitespace().map(str::parse::<f64>);
            let (Some(Ok(at_s)), Some(Ok(force_n))) = (words.next(), words.next()) else {
                return Err(MotorError::Line(number));
            };
            points.push([at_s, force_n]);
            // The end of the burn; another motor may follow.
            if force_n == 0.0 && at_s > 0.0 {
                break;
            }
        }
        Ok((Self::new(&points)?, propellant_kg))
    }
}

impl ThrustCurve {
    /// Thrust at a share of the burn, as a share of the mean, and the impulse until then as a share
    /// of the whole.
    pub(super) fn at(&self, share: f64) -> (f64, f64) {
        let after = self.points.partition_point(|[at, ..]| *at <= share);
        let Some(&[to, to_thrust, _]) = self.points.get(after) else {
            return (self.points[MOST_POINTS - 1][1], 1.0);
        };
        let [from, from_thrust, until] = self.points[after.saturating_sub(1)];
        let part = (share - from) / (to - from);
        let thrust = from_thrust + part * (to_thrust - from_thrust);
        (thrust, until + 0.5 * (from_thrust + thrust) * (share - from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOBBY: &str = "\
; a motor of a hobby rocket
F15 29 114 0 0.06 0.102 E
   0.2 10.0
   0.4 25.0
   1.4 15.0
   3.4 15.0
   3.5 0.0
;
G8 29 124 0 0.08 0.13 E
";

    /// By hand: 1 + 3.5 + 20 + 30 + 0.75 N s.
    #[test]
    fn a_rasp_file_gives_thrust_impulse_and_propellant() {
        let (motor, propellant_kg) = Motor::parse_rasp(HOBBY).unwrap();
        assert_eq!((propellant_kg, motor.burn_s), (0.06, 3.5));
        assert!((motor.thrust_n * motor.burn_s - 55.25).abs() < 1e-9);
        for (at_s, thrust_n, impulse_n_s) in [
            (0.0, 0.0, 0.0),
            (0.1, 5.0, 0.25),
            (0.4, 25.0, 4.5),
            (0.9, 20.0, 15.75),
            (2.4, 15.0, 39.5),
            (3.45, 7.5, 55.0625),
            (3.5, 0.0, 55.25),
            (9.0, 0.0, 55.25),
        ] {
            let (thrust, impulse) = motor.curve.at(at_s / motor.burn_s);
            assert!((thrust * motor.thrust_n - thrust_n).abs() < 1e-9, "{at_s}: {thrust}");
            assert!((impulse * 55.25 - impulse_n_s).abs() < 1e-9, "{at_s}: {impulse}");
        }
    }

    #[test]
    fn what_is_no_motor_is_refused() {
        assert_eq!(Motor::parse_rasp("; nothing"), Err(MotorError::Head));
        assert_eq!(Motor::parse_rasp("F15 29 114 0 heavy 1 E"), Err(MotorError::Head));
        let broken = HOBBY.replace("0.4 25.0", "0.4");
        assert_eq!(Motor::parse_rasp(&broken), Err(MotorError::Line(4)));
        for points in [
            &[][..],
            &[[0.0, 5.0]],
            &[[0.0, 0.0], [1.0, 0.0]],
            &[[0.0, 1.0], [0.0, 2.0]],
            &[[0.0, 1.0], [1.0, f64::NAN]],
            &[[-1.0, 1.0], [1.0, 2.0]],
            &[[0.0, 1.0], [1.0, -2.0]],
            &[[0.0; 2]; MOST_POINTS + 1],
        ] {
            assert_eq!(Motor::new(points), Err(MotorError::Curve), "{points:?}");
        }
    }
}
