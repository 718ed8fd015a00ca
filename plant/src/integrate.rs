//! Integration of ordinary differential equations `dx/dt = f(t, x)` of fixed size.
//!
//! [`Adaptive`] is Dormand and Prince's embedded pair of order 5(4) with the step chosen from the
//! error estimate, as the usual ODE libraries have it. It is written out here because it takes
//! arrays on the stack, lands on the caller's output times exactly, and ends a step on a known
//! kink of the input; `rk4_step` is the classical fixed step.

/// Coefficients of Dormand-Prince 5(4): nodes.
const NODES: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];
/// Coefficients of the stages, row by row.
const STAGES: [[f64; 6]; 7] = [
    [0.0; 6],
    [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// Fifth-order weights minus fourth-order weights: the error estimate.
const ERROR: [f64; 7] = [
    71.0 / 57600.0,
    0.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// Steps after which an integration is given up.
const STEP_BUDGET: u64 = 20_000_000;

/// Integration with step control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptive {
    /// Error allowed in a step, relative to each state.
    pub relative: f64,
    /// Error allowed in a step, absolute, in each state's unit.
    pub absolute: f64,
    /// Longest step, in s.
    pub max_step_s: f64,
}

impl Default for Adaptive {
    /// As tight as `f64` allows: a crank that its link's weight alone drives reaches 100 rad/s.
    fn default() -> Self {
        Self { relative: 1e-13, absolute: 1e-14, max_step_s: 0.02 }
    }
}

/// An integration that could not go on.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum IntegrationError {
    /// The derivative is not finite, or the step has shrunk to nothing.
    #[error("the integration cannot go on past t = {time_s} s: the motion grows without bound")]
    Stuck {
        /// Where it stopped, in s.
        time_s: f64,
    },
    /// The tolerances ask for more steps than are reasonable.
    #[error("the integration needs too many steps by t = {time_s} s")]
    TooManySteps {
        /// Where it stopped, in s.
        time_s: f64,
    },
}

impl Adaptive {
    /// Integrates from `(start_s, state)` to `end_s` and gives the state there.
    ///
    /// `step_s` is the first step to try, and holds the one to try next when it returns, so that
    /// consecutive calls go on where they left off.
    fn advance<const N: usize>(
        &self,
        f: &mut impl FnMut(f64, &[f64; N]) -> [f64; N],
        start_s: f64,
        end_s: f64,
        mut state: [f64; N],
        step_s: &mut f64,
    ) -> Result<[f64; N], IntegrationError> {
        let mut now = start_s;
        for _ in 0..STEP_BUDGET {
            let rest = end_s - now;
            if rest <= 0.0 {
                return Ok(state);
            }
            let proposal = step_s.min(self.max_step_s);
            let last = proposal >= rest * (1.0 - 1e-12);
            let h = if last { rest } else { proposal };
            let (next, error) = self.try_step(f, now, &state, h);
            // Order 5: the step may grow with the fifth root of the error's margin.
            let factor =
                if error.is_finite() { (0.9 * error.powf(-0.2)).clamp(0.2, 5.0) } else { 0.2 };
            if error <= 1.0 {
                state = next;
                now = if last { end_s } else { now + h };
                if !last || factor < 1.0 {
                    *step_s = h * factor;
                }
            } else {
                *step_s = h * factor;
                if *step_s < 1e-14 * now.abs().max(1.0) {
                    return Err(IntegrationError::Stuck { time_s: now });
                }
            }
        }
        Err(IntegrationError::TooManySteps { time_s: now })
    }

    /// Integrates from `start`, which holds at the first of `times_s` (increasing), and gives the
    /// state at each of them. A step ends on each knot, so that none straddles a kink or a jump of
    /// the input.
    ///
    /// # Errors
    /// A derivative that is not finite, or a step that shrinks to nothing.
    pub fn sample<const N: usize>(
        &self,
        slope: impl Fn(f64, &[f64; N]) -> [f64; N],
        times_s: &[f64],
        knots_s: impl IntoIterator<Item = f64>,
        start: [f64; N],
    ) -> Result<Vec<[f64; N]>, IntegrationError> {
        let (mut now, mut state, mut step) = (times_s[0], start, 1e-4);
        let mut knots: Vec<f64> = knots_s.into_iter().filter(|time| *time > now).collect();
        knots.sort_by(f64::total_cmp);
        let mut knots = knots.into_iter().peekable();
        let mut states = Vec::with_capacity(times_s.len());
        let mut advance = |from: f64, to: f64, state| {
            // The input's value from the end on does not belong to this piece.
            let before = to.next_down().max(from);
            let mut slope = |time: f64, x: &[f64; N]| slope(time.min(before), x);
            self.advance(&mut slope, from, to, state, &mut step)
        };
        for &time in times_s {
            while let Some(knot) = knots.next_if(|knot| *knot < time) {
                state = advance(now, knot, state)?;
                now = knot;
            }
            state = advance(now, time, state)?;
            now = time;
            states.push(state);
        }
        Ok(states)
    }

    /// One step of `h`: the fifth-order state and its error against the tolerances.
    fn try_step<const N: usize>(
        &self,
        f: &mut impl FnMut(f64, &[f64; N]) -> [f64; N],
        now: f64,
        state: &[f64; N],
        h: f64,
    ) -> ([f64; N], f64) {
        let mut slopes = [[0.0; N]; 7];
        let mut at = *state;
        for stage in 0..7 {
            at = *state;
            for (slope, weight) in slopes.iter().zip(STAGES[stage]).take(stage) {
                for (x, dx) in at.iter_mut().zip(slope) {
                    *x += h * weight * dx;
                }
            }
            slopes[stage] = f(now + NODES[stage] * h, &at);
        }
        // The last stage is evaluated at the fifth-order result itself.
        let mut worst = 0.0_f64;
        for i in 0..N {
            let error: f64 =
                slopes.iter().zip(ERROR).map(|(slope, weight)| h * weight * slope[i]).sum();
            let scale = self.absolute + self.relative * state[i].abs().max(at[i].abs());
            let ratio = (error / scale).abs();
            // `max` would swallow a NaN; it has to make the step fail.
            worst = if ratio.is_nan() { f64::INFINITY } else { worst.max(ratio) };
        }
        (at, worst)
    }
}

/// One classical Runge-Kutta step of order 4 from `(now_s, state)` over `step_s`.
pub(crate) fn rk4_step<const N: usize>(
    mut f: impl FnMut(f64, &[f64; N]) -> [f64; N],
    now_s: f64,
    state: &[f64; N],
    step_s: f64,
) -> [f64; N] {
    let ahead = |k: &[f64; N], h: f64| std::array::from_fn(|i| state[i] + h * k[i]);
    let k1 = f(now_s, state);
    let k2 = f(now_s + 0.5 * step_s, &ahead(&k1, 0.5 * step_s));
    let k3 = f(now_s + 0.5 * step_s, &ahead(&k2, 0.5 * step_s));
    let k4 = f(now_s + step_s, &ahead(&k3, step_s));
    std::array::from_fn(|i| state[i] + step_s / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oscillator(_: f64, x: &[f64; 2]) -> [f64; 2] {
        [x[1], -x[0]]
    }

    #[test]
    fn the_coefficients_are_consistent() {
        for (row, node) in STAGES.iter().zip(NODES) {
            assert!((row.iter().sum::<f64>() - node).abs() < 1e-15);
        }
        assert!(ERROR.iter().sum::<f64>().abs() < 1e-16);
    }

    /// Ten turns of a harmonic oscillator come back to where they began.
    #[test]
    fn adaptive_keeps_its_tolerance() {
        let end = 20.0 * std::f64::consts::PI;
        let states = Adaptive { max_step_s: 1.0, ..Adaptive::default() }
            .sample(oscillator, &[0.0, 0.3, end], [], [1.0, 0.0])
            .unwrap();
        assert_eq!(states[0], [1.0, 0.0]);
        assert!((states[1][0] - 0.3_f64.cos()).abs() < 1e-12);
        assert!((states[2][0] - 1.0).abs() < 1e-9 && states[2][1].abs() < 1e-9);
    }

    #[test]
    fn rk4_is_of_fourth_order() {
        let error = |steps: u32| {
            let h = 1.0 / f64::from(steps);
            let mut x = [1.0, 0.0];
            for i in 0..steps {
                x = rk4_step(oscillator, f64::from(i) * h, &x, h);
            }
            (x[0] - 1.0_f64.cos()).hypot(x[1] + 1.0_f64.sin())
        };
        let ratio = error(20) / error(40);
        assert!((15.0..17.0).contains(&ratio), "{ratio}");
    }

    /// `x' = x^2` runs away at t = 1.
    #[test]
    fn a_runaway_is_an_error() {
        let result =
            Adaptive::default().sample(|_, x: &[f64; 1]| [x[0] * x[0]], &[0.0, 2.0], [], [1.0]);
        let Err(IntegrationError::Stuck { time_s }) = result else {
            panic!("{result:?}");
        };
        assert!((time_s - 1.0).abs() < 1e-3);
    }
}
