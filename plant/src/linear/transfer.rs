//! Transfer functions as ratios of polynomials in `s`.

use nalgebra::{Complex, DMatrix};

use super::{eigenvalues, sorted};

/// Leading coefficients smaller than this share of the largest are rounding, not degree.
const NEGLIGIBLE: f64 = 1e-11;

/// `numerator(s) / denominator(s)`, coefficients from the highest power down.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    pub(super) numerator: Vec<f64>,
    pub(super) denominator: Vec<f64>,
}

impl TransferFunction {
    /// From coefficients, highest power first. Leading coefficients that are rounding are cut off.
    pub fn new(numerator: Vec<f64>, denominator: Vec<f64>) -> Self {
        Self { numerator: trimmed(numerator), denominator: trimmed(denominator) }
    }

    /// Pade's approximation of a delay (s), of order two numerator and denominator.
    pub fn delay(delay_s: f64) -> Self {
        let t = delay_s;
        if t == 0.0 {
            return Self::new(vec![1.0], vec![1.0]);
        }
        Self::new(vec![t * t / 12.0, -0.5 * t, 1.0], vec![t * t / 12.0, 0.5 * t, 1.0])
    }

    /// The value at a complex frequency `s` (rad/s).
    pub fn at(&self, s: Complex<f64>) -> Complex<f64> {
        evaluate(&self.numerator, s) / evaluate(&self.denominator, s)
    }

    /// Roots of the denominator, in rad/s.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        roots(&self.denominator)
    }

    /// Roots of the numerator, in rad/s.
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        roots(&self.numerator)
    }

    /// The two in series: this one, then `next`.
    pub fn series(&self, next: &Self) -> Self {
        Self::new(
            product(&self.numerator, &next.numerator),
            product(&self.denominator, &next.denominator),
        )
    }

    /// The poles of the loop closed round `gain` times this by negative feedback.
    pub fn closed_poles(&self, gain: f64) -> Vec<Complex<f64>> {
        let mut sum = self.denominator.clone();
        let scaled = self.numerator.iter().map(|c| gain * c);
        // Align the lowest powers; a proper loop has no longer numerator than denominator.
        let missing = self.numerator.len().saturating_sub(sum.len());
        sum.splice(0..0, std::iter::repeat_n(0.0, missing));
        let shift = sum.len() - self.numerator.len();
        for (s, n) in sum[shift..].iter_mut().zip(scaled) {
            *s += n;
        }
        roots(&trimmed(sum))
    }
}

fn evaluate(coefficients: &[f64], s: Complex<f64>) -> Complex<f64> {
    coefficients.iter().fold(Complex::new(0.0, 0.0), |sum, c| sum * s + c)
}

fn product(x: &[f64], y: &[f64]) -> Vec<f64> {
    let mut result = vec![0.0; x.len() + y.len() - 1];
    for (i, a) in x.iter().enumerate() {
        for (j, b) in y.iter().enumerate() {
            result[i + j] += a * b;
        }
    }
    result
}

fn trimmed(coefficients: Vec<f64>) -> Vec<f64> {
    let largest = coefficients.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    let first = coefficients
        .iter()
        .position(|c| c.abs() > NEGLIGIBLE * largest)
        .unwrap_or(coefficients.len().saturating_sub(1));
    coefficients[first..].to_vec()
}

/// Roots of a polynomial as eigenvalues of its companion matrix.
///
/// Exact zeros at the low end are split off, and the variable is scaled by the geometric mean of
/// the roots, so that the matrix is well balanced.
fn roots(coefficients: &[f64]) -> Vec<Complex<f64>> {
    let nonzero = coefficients.iter().rposition(|c| *c != 0.0).unwrap_or(0);
    let mut found = vec![Complex::new(0.0, 0.0); coefficients.len() - 1 - nonzero];
    let core = &coefficients[..=nonzero];
    let degree = core.len() - 1;
    if degree > 0 {
        let scale = (core[degree] / core[0]).abs().powf(1.0 / degree as f64);
        let mut companion = DMatrix::zeros(degree, degree);
        let mut power = 1.0;
        for i in 0..degree {
            power *= scale;
            companion[(0, i)] = -core[i + 1] / core[0] / power;
            if i > 0 {
                companion[(i, i - 1)] = 1.0;
            }
        }
        found.extend(eigenvalues(companion).iter().map(|r| r * scale));
    }
    sorted(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_by_hand() {
        // (s + 1)(s - 2)(s^2 + 9) s
        let found = roots(&[1.0, -1.0, 7.0, -9.0, -18.0, 0.0]);
        let expected = [(-1.0, 0.0), (0.0, -3.0), (0.0, 0.0), (0.0, 3.0), (2.0, 0.0)];
        for (re, im) in expected {
            let near = |r: &Complex<f64>| (r - Complex::new(re, im)).norm() < 1e-12;
            assert!(found.iter().any(near), "{re} {im}: {found:?}");
        }
        assert!(roots(&[3.0]).is_empty());
    }

    /// Every loop's locus comes to an end, also where the QR iteration would circle for ever.
    #[test]
    fn no_polynomial_hangs() {
        for i in 0..2000 {
            let gain = 10.0_f64.powf(-3.0 + 6.0 * f64::from(i) / 2000.0);
            // (s^2 + 1)^2 s^2 + gain (s - 1)^4: pairs of equal size, double roots at no gain.
            let found =
                roots(&[1.0, 0.0, 2.0 + gain, -4.0 * gain, 1.0 + 6.0 * gain, -4.0 * gain, gain]);
            assert!(found.iter().all(|root| root.norm().is_finite()));
        }
        assert!(roots(&[1.0, f64::NAN, 1.0])[0].re.is_nan());
    }

    /// 1 / (s (s + 2)) closed with gain 5: s = -1 +- 2j.
    #[test]
    fn closed_poles_of_a_double_lag() {
        let open = TransferFunction::new(vec![1.0], vec![1.0, 2.0, 0.0]);
        assert!((open.closed_poles(0.0)[0] + 2.0).norm() < 1e-12);
        assert!((open.closed_poles(5.0)[1] - Complex::new(-1.0, 2.0)).norm() < 1e-12);
    }

    #[test]
    fn pade_delays_by_its_time() {
        let s = Complex::new(0.0, 20.0);
        let exact = (-s * 0.01).exp();
        let delay = TransferFunction::delay(0.01);
        assert!((delay.at(s) - exact).norm() < 1e-5);
        let twice = delay.series(&delay);
        assert!((twice.at(s) - exact * exact).norm() < 2e-5);
    }
}
