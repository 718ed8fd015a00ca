//! The root of a function of one variable between two points of opposite sign.

/// Iterations after which the best point so far is returned.
const ITERATIONS: usize = 200;

/// A root of `f` between `low` and `high`, to `tolerance` in the argument; `None` if `f` has the
/// same sign at both.
///
/// The secant through the bracket's ends, with the stale end's weight halved (the Illinois
/// method): superlinear, and never outside the bracket.
pub(crate) fn between(
    mut f: impl FnMut(f64) -> f64,
    low: f64,
    high: f64,
    tolerance: f64,
) -> Option<f64> {
    let (mut a, mut b) = ((low, f(low)), (high, f(high)));
    if a.1 == 0.0 {
        return Some(a.0);
    }
    if b.1 == 0.0 {
        return Some(b.0);
    }
    if a.1.is_nan() || b.1.is_nan() || a.1.signum() == b.1.signum() {
        return None;
    }
    for i in 0..ITERATIONS {
        // Every third try halves the bracket, so that a crooked function cannot stall it.
        let x = if i % 3 == 2 { 0.5 * (a.0 + b.0) } else { (a.0 * b.1 - b.0 * a.1) / (b.1 - a.1) };
        let y = f(x);
        if y == 0.0 {
            return Some(x);
        }
        if y.signum() == b.1.signum() {
            a.1 *= 0.5;
        } else {
            a = b;
        }
        let moved = (x - b.0).abs();
        b = (x, y);
        if (a.0 - b.0).abs() < tolerance || moved < 0.01 * tolerance {
            break;
        }
    }
    Some(b.0)
}

#[cfg(test)]
mod tests {
    use super::between;

    #[test]
    fn finds_roots_and_refuses_none() {
        let root = between(|x| x * x - 2.0, 0.0, 2.0, 1e-14).unwrap();
        assert!((root - 2.0_f64.sqrt()).abs() < 1e-14);
        let kink = between(|x: f64| if x < 0.3 { -1e-6 } else { x - 0.3 + 1e-6 }, 0.0, 5.0, 1e-12);
        assert!((kink.unwrap() - 0.3).abs() < 1e-11);
        assert_eq!(between(|x| x * x + 1.0, -1.0, 1.0, 1e-9), None);
        assert_eq!(between(|x| x, 0.0, 1.0, 1e-9), Some(0.0));
    }
}
