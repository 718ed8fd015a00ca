//! The figures of `tvc model linear`, for scripts and for people.

use std::fmt::Write;

use plant::linear::Rank;
use serde::Serialize;

use super::Analysis;

/// Residual pitch acceleration below which a point counts as an equilibrium, in rad/s2.
const AT_REST_RAD_S2: f64 = 1e-2;

/// A complex number, in rad/s.
#[derive(Clone, Copy, Serialize)]
pub struct Complex {
    re: f64,
    im: f64,
}

impl From<&nalgebra::Complex<f64>> for Complex {
    fn from(z: &nalgebra::Complex<f64>) -> Self {
        Self { re: z.re, im: z.im }
    }
}

/// Where the model was taken.
#[derive(Serialize)]
pub struct Point {
    theta0_rad: f64,
    theta1_rad: f64,
    theta3_rad: f64,
    torque_n_m: f64,
    /// Whether the drone rests there.
    pub equilibrium: bool,
    /// Accelerations of pitch and crank that remain.
    residual_rad_s2: [f64; 2],
}

impl Point {
    /// What to say about a point that is no equilibrium.
    pub fn note(&self) -> String {
        format!(
            "not an equilibrium: the drone accelerates by {:.3} rad/s2 at this point",
            self.residual_rad_s2[0]
        )
    }
}

/// A rank and what it was decided on.
#[derive(Serialize)]
pub struct RankFigures {
    rank: usize,
    singular_values: Vec<f64>,
}

impl From<Rank> for RankFigures {
    fn from(rank: Rank) -> Self {
        Self {
            rank: rank.rank,
            singular_values: rank.singular_values,
        }
    }
}

/// Times that the loop loses, in s.
#[derive(Serialize)]
pub struct Delays {
    /// Sensor, and from the law to the pulse.
    sensor_to_pulse: f64,
    rate_filter: f64,
    half_servo_frame: f64,
    servo_loop: f64,
    servo_lag: f64,
}

/// How far the loop is from instability; `null` where a curve never crosses.
#[derive(Serialize)]
pub struct MarginFigures {
    gain_margin_db: Option<f64>,
    gain_margin_at_rad_s: Option<f64>,
    phase_margin_deg: Option<f64>,
    phase_margin_at_rad_s: Option<f64>,
    delay_margin_s: Option<f64>,
    peak_sensitivity: f64,
}

/// The position loop.
#[derive(Serialize)]
pub struct LoopFigures {
    pub kp: f64,
    pub kd: f64,
    delays_s: Delays,
    margins: MarginFigures,
    /// With every delay as Pade's approximation.
    closed_loop_poles: Vec<Complex>,
    pub stable: bool,
}

/// Everything that the command prints.
#[derive(Serialize)]
pub struct Figures {
    pub point: Point,
    states: [&'static str; 4],
    input: &'static str,
    output: &'static str,
    #[serde(rename = "A")]
    a: [[f64; 4]; 4],
    #[serde(rename = "B")]
    b: [f64; 4],
    #[serde(rename = "C")]
    c: [f64; 4],
    #[serde(rename = "D")]
    d: f64,
    poles: Vec<Complex>,
    zeros: Vec<Complex>,
    controllability: RankFigures,
    observability: RankFigures,
    #[serde(rename = "loop")]
    pub position_loop: LoopFigures,
}

impl Figures {
    /// The figures of an analysis.
    pub fn new(analysis: &Analysis) -> Self {
        let (model, open) = (&analysis.model, &analysis.open);
        let margins = open.margins();
        let closed = open.rational().closed_poles(1.0);
        Self {
            point: Point {
                theta0_rad: analysis.point.pitch_rad,
                theta1_rad: analysis.point.crank_rad,
                theta3_rad: analysis.rudder_rad,
                torque_n_m: analysis.torque_n_m,
                equilibrium: analysis.residual_rad_s2[0].abs() < AT_REST_RAD_S2,
                residual_rad_s2: analysis.residual_rad_s2,
            },
            states: ["theta0", "w0", "theta1", "w1"],
            input: "torque on the crank, N m",
            output: "theta0",
            a: std::array::from_fn(|i| std::array::from_fn(|j| model.a[(i, j)])),
            b: model.b.into(),
            c: std::array::from_fn(|j| model.c[j]),
            d: model.d,
            poles: model.poles().iter().map(Complex::from).collect(),
            zeros: model.zeros().iter().map(Complex::from).collect(),
            controllability: model.controllability().into(),
            observability: model.observability().into(),
            position_loop: LoopFigures {
                kp: analysis.gains.0,
                kd: analysis.gains.1,
                delays_s: Delays {
                    sensor_to_pulse: open.delay_s,
                    rate_filter: 1.0 / open.rate_filter_rad_s,
                    half_servo_frame: 0.5 * open.frame_s,
                    servo_loop: open.servo_loop_s,
                    servo_lag: open.servo_lag_s,
                },
                margins: MarginFigures {
                    gain_margin_db: margins.gain.map(|m| m.db),
                    gain_margin_at_rad_s: margins.gain.map(|m| m.at_rad_s),
                    phase_margin_deg: margins.phase.map(|m| m.deg),
                    phase_margin_at_rad_s: margins.phase.map(|m| m.at_rad_s),
                    delay_margin_s: margins.phase.map(|m| m.delay_s),
                    peak_sensitivity: margins.peak_sensitivity,
                },
                stable: closed.iter().all(|pole| pole.re < 0.0),
                closed_loop_poles: closed.iter().map(Complex::from).collect(),
            },
        }
    }

    /// Rows of a table: what, and the figure.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let row = |name: &str, value: String| vec![name.to_string(), value];
        let margins = &self.position_loop.margins;
        let at = |value: Option<f64>, unit: &str, place: Option<f64>| match (value, place) {
            (Some(value), Some(place)) => format!("{value:.1} {unit} at {place:.1} rad/s"),
            _ => "no crossing".into(),
        };
        let delay = margins.delay_margin_s.map(|s| format!("{:.0} ms", 1e3 * s));
        vec![
            row("poles, rad/s", complex_list(&self.poles)),
            row("zeros, rad/s", complex_list(&self.zeros)),
            row(
                "controllability, observability",
                format!(
                    "rank {} of 4, rank {} of 4",
                    self.controllability.rank, self.observability.rank
                ),
            ),
            row(
                "gains kp, kd of the loop",
                format!("{}, {}", self.position_loop.kp, self.position_loop.kd),
            ),
            row(
                "gain margin",
                at(margins.gain_margin_db, "dB", margins.gain_margin_at_rad_s),
            ),
            row(
                "phase margin",
                at(
                    margins.phase_margin_deg,
                    "deg",
                    margins.phase_margin_at_rad_s,
                ),
            ),
            row("delay margin", delay.unwrap_or("no crossing".into())),
            row(
                "peak sensitivity",
                format!("{:.2}", margins.peak_sensitivity),
            ),
            row(
                "closed-loop poles, rad/s",
                complex_list(&self.position_loop.closed_loop_poles),
            ),
        ]
    }

    /// The matrices, row by row, as texts.
    pub fn matrix_rows(&self) -> Vec<Vec<String>> {
        (0..4)
            .map(|i| {
                let mut row = vec![format!("{}'", self.states[i])];
                row.extend(self.a[i].iter().chain([&self.b[i]]).map(|x| digits(*x)));
                row
            })
            .collect()
    }

    /// The output's row, C and D.
    pub fn output_row(&self) -> Vec<String> {
        let mut row = vec![format!("y = {}", self.output)];
        row.extend(self.c.iter().chain([&self.d]).map(|x| digits(*x)));
        row
    }

    /// The point in words.
    pub fn place(&self) -> String {
        let p = &self.point;
        format!(
            "theta0 {:.5} rad, theta1 {:.7} rad (rudder {:.3} deg), torque {:.4} N m: {}",
            p.theta0_rad,
            p.theta1_rad,
            p.theta3_rad.to_degrees(),
            p.torque_n_m,
            if p.equilibrium {
                "an equilibrium"
            } else {
                "not an equilibrium"
            }
        )
    }

    /// Everything as text.
    pub fn text(&self) -> String {
        // Writing to a String cannot fail.
        let mut text = format!("{}\n\n", self.place());
        let head = ["", "theta0", "w0", "theta1", "w1", "B"].map(String::from);
        for row in [head.to_vec()]
            .iter()
            .chain(&self.matrix_rows())
            .chain([&self.output_row()])
        {
            let _ = write!(text, "{:>12}", row[0]);
            for cell in &row[1..] {
                let _ = write!(text, "{cell:>14}");
            }
            text.push('\n');
        }
        text.push('\n');
        for row in self.rows() {
            let _ = writeln!(text, "{:<32}{}", row[0], row[1]);
        }
        text
    }
}

/// Five significant digits; what is rounding beside the model's figures is nothing.
fn digits(value: f64) -> String {
    if value.abs() < 1e-9 {
        return "0".into();
    }
    if value == 1.0 {
        return "1".into();
    }
    let places = (4 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.places$}")
}

/// Complex numbers, conjugate pairs as one.
fn complex_list(values: &[Complex]) -> String {
    let texts: Vec<String> = values
        .iter()
        .filter(|z| z.im >= 0.0)
        .map(|z| {
            // Rounding leaves a part that is nothing beside the other.
            let size = z.re.hypot(z.im);
            let re = if z.re.abs() < 1e-6 * size { 0.0 } else { z.re };
            let im = if z.im.abs() < 1e-6 * size { 0.0 } else { z.im };
            match (re, im) {
                (re, 0.0) => digits(re),
                (0.0, im) => format!("±{}j", digits(im)),
                (re, im) => format!("{} ± {}j", digits(re), digits(im)),
            }
        })
        .collect();
    if texts.is_empty() {
        "none".into()
    } else {
        texts.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_people_read_them() {
        assert_eq!(digits(-26.1623), "-26.162");
        assert_eq!(digits(1485.21), "1485.2");
        assert_eq!(digits(-0.00281234), "-0.0028123");
        assert_eq!(digits(0.0), "0");
        let z = |re, im| Complex { re, im };
        assert_eq!(
            complex_list(&[z(1e-12, 23.79), z(1e-12, -23.79), z(-2.0, 0.0)]),
            "±23.790j, -2.0000"
        );
        assert_eq!(complex_list(&[]), "none");
    }
}
