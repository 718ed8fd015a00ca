//! What `tvc model linear` prints.

use nalgebra::Complex;
use plant::linear::Rank;
use serde_json::json;

use super::Analysis;
use report::measure::{Figure, Figures, data, figure, note, rows, shown};

/// Residual pitch acceleration below which a point counts as an equilibrium, in rad/s2.
const AT_REST_RAD_S2: f64 = 1e-2;

/// Names of the states, as in `plant::linear`.
const STATES: [&str; 4] = ["theta0", "w0", "theta1", "w1"];

impl Analysis {
    /// Whether the drone rests at the point.
    pub fn is_equilibrium(&self) -> bool {
        self.residual_rad_s2[0].abs() < AT_REST_RAD_S2
    }

    /// What to say about a point that is no equilibrium.
    pub fn note(&self) -> String {
        format!(
            "not an equilibrium: the drone accelerates by {:.3} rad/s2 at this point",
            self.residual_rad_s2[0]
        )
    }

    /// The point in words.
    pub fn place(&self) -> String {
        format!(
            "theta0 {:.5} rad, theta1 {:.7} rad (rudder {:.3} deg), torque {:.4} N m: {} equilibrium",
            self.point.pitch_rad,
            self.point.crank_rad,
            self.rudder_rad.to_degrees(),
            self.torque_n_m,
            if self.is_equilibrium() { "an" } else { "not an" }
        )
    }

    /// The poles of the loop with every delay as Pade's approximation.
    fn closed_poles(&self) -> Vec<Complex<f64>> {
        self.open.rational().closed_poles(1.0)
    }

    /// Whether the closed loop is stable.
    pub fn is_stable(&self) -> bool {
        self.closed_poles().iter().all(|pole| pole.re < 0.0)
    }

    /// The figures.
    pub fn figures(&self) -> Figures {
        let model = &self.model;
        let a: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| model.a[(i, j)]));
        let b: [f64; 4] = model.b.into();
        let c: [f64; 4] = std::array::from_fn(|j| model.c[j]);
        let matrix_row = |name: String, row: [f64; 4], input: f64| {
            let cells = STATES.iter().chain([&"B"]).zip(row.iter().chain([&input]));
            let cells = cells.map(|(head, value)| shown(*head, digits(*value)));
            let row: Vec<Figure> = [shown("", name)].into_iter().chain(cells).collect();
            row
        };
        let derivatives = (0..4).map(|i| matrix_row(format!("{}'", STATES[i]), a[i], b[i]));
        let output = matrix_row("y = theta0".into(), c, 0.0);
        Figures::from([
            self.point_figures(),
            note(self.place()),
            rows("", derivatives.chain([output])),
            data("states", &STATES),
            figure("input", "torque on the crank, N m"),
            figure("output", "theta0"),
            data("A", &a),
            data("B", &b),
            data("C", &c),
            figure("D", 0.0),
            complex("poles", &model.poles(), "poles, rad/s"),
            complex("zeros", &model.zeros(), "zeros, rad/s"),
            rank("controllability", model.controllability()),
            rank("observability", model.observability()),
            self.loop_figures(),
        ])
    }

    fn point_figures(&self) -> Figure {
        figure(
            "point",
            [
                figure("theta0_rad", self.point.pitch_rad),
                figure("theta1_rad", self.point.crank_rad),
                figure("theta3_rad", self.rudder_rad),
                figure("torque_n_m", self.torque_n_m),
                figure("equilibrium", self.is_equilibrium()),
                data("residual_rad_s2", &self.residual_rad_s2),
            ],
        )
    }

    fn loop_figures(&self) -> Figure {
        let open = &self.open;
        let margins = open.margins();
        let (gain, phase) = (margins.gain, margins.phase);
        let margin = |key, value: Option<f64>, label, unit, decimals| {
            figure(key, value).shown(label, unit, decimals).or("no crossing")
        };
        let (gain_db, gain_at) = gain.map(|m| (m.db, m.at_rad_s)).unzip();
        let (phase_deg, phase_at) = phase.map(|m| (m.deg, m.at_rad_s)).unzip();
        let delay_s = phase.map(|m| m.delay_s);
        let sensitivity = figure("peak_sensitivity", margins.peak_sensitivity);
        let margins = [
            margin("gain_margin_db", gain_db, "gain margin", "dB", 1),
            margin("gain_margin_at_rad_s", gain_at, "  at", "rad/s", 1),
            margin("phase_margin_deg", phase_deg, "phase margin", "deg", 1),
            margin("phase_margin_at_rad_s", phase_at, "  at", "rad/s", 1),
            margin("delay_margin_s", delay_s, "delay margin", "ms", 0).scaled(1e3),
            sensitivity.shown("peak sensitivity", "", 2),
        ];
        let delays_s = [
            figure("sensor_to_pulse", open.delay_s),
            figure("rate_filter", 1.0 / open.rate_filter_rad_s),
            figure("half_servo_frame", 0.5 * open.frame_s),
            figure("servo_loop", open.servo_loop_s),
            figure("servo_lag", open.servo_lag_s),
        ];
        figure(
            "loop",
            [
                data("kp", &self.gains.0).said("gain kp of the loop", self.gains.0.to_string()),
                data("kd", &self.gains.1).said("gain kd of the loop", self.gains.1.to_string()),
                figure("delays_s", delays_s),
                figure("margins", margins),
                complex("closed_loop_poles", &self.closed_poles(), "closed-loop poles, rad/s"),
                figure("stable", self.is_stable()).shown("stable", "", 0),
            ],
        )
    }
}

fn complex(key: &'static str, values: &[Complex<f64>], label: &str) -> Figure {
    let parts = values.iter().map(|z| json!({ "re": z.re, "im": z.im }));
    data(key, &parts.collect::<Vec<_>>()).said(label, complex_list(values))
}

fn rank(key: &'static str, rank: Rank) -> Figure {
    figure(
        key,
        [
            figure("rank", rank.rank).said(format!("{key}, rank of 4"), rank.rank.to_string()),
            data("singular_values", &rank.singular_values),
        ],
    )
}

/// A number with five significant digits; below 1e-9, which is rounding, it is 0.
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
fn complex_list(values: &[Complex<f64>]) -> String {
    let texts: Vec<String> = values
        .iter()
        .filter(|z| z.im >= 0.0)
        .map(|z| {
            // A part that is tiny beside the other is rounding.
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
    if texts.is_empty() { "none".into() } else { texts.join(", ") }
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
        let z = Complex::new;
        assert_eq!(
            complex_list(&[z(1e-12, 23.79), z(1e-12, -23.79), z(-2.0, 0.0)]),
            "±23.790j, -2.0000"
        );
        assert_eq!(complex_list(&[]), "none");
    }
}
