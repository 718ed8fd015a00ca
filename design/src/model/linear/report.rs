//! The HTML report of `tvc model linear`.

use anyhow::Result;
use maud::{Markup, html};
use nalgebra::Complex;
use plant::linear::frequency::Response;
use plant::linear::transfer::TransferFunction;

use super::Analysis;
use report::page::{figure, page, verdict};
use report::plot::{Line, Look, Marks, Plot, Shape};

/// Frequencies of the Bode plots, in rad/s.
const BODE: (f64, f64) = (0.1, 300.0);
/// Points of a curve.
const POINTS: usize = 1200;
/// Height of plots of the complex plane, and the ratio of their axes that makes circles round.
const PLANE_HEIGHT: u32 = 460;
const PLANE_RATIO: f64 = 772.0 / 406.0;

/// The whole page as HTML.
pub fn render(analysis: &Analysis) -> Result<String> {
    let figures = analysis.figures();
    let body = html! {
        p { "The model at " (analysis.place()) "." }
        @if !analysis.is_equilibrium() { p { (analysis.note()) "." } }
        @if analysis.is_stable() {
            (verdict(true, "The closed loop is stable."))
        } @else {
            (verdict(false, "The closed loop is unstable."))
        }
        h2 { "State space" }
        p { "x = (theta0, w0, theta1, w1), u the servo's torque on the crank in N m, y = theta0." }
        (figures.table("").markup())
        h2 { "Figures" }
        (figures.lines().markup())
        h2 { "The drone: torque to pitch" }
        (pole_zero_map(analysis)?)
        (torque_locus(analysis)?)
        h2 { "The loop: crank command to pitch, with servo and delays" }
        (loop_locus(analysis)?)
        (bode(analysis)?)
        (nyquist(analysis)?)
        footer {
            "Deadband, backlash and the servo's speed limit have no linear part and are left out; \
             delays are exact in the Bode and Nyquist plots and second-order Padé approximations in \
             the root locus."
        }
    };
    let title = format!("Linear model, kp {}, kd {}", analysis.gains.0, analysis.gains.1);
    Ok(page(&title, body))
}

/// Real and imaginary parts.
fn parts(values: &[Complex<f64>]) -> Vec<(f64, f64)> {
    values.iter().map(|z| (z.re, z.im)).collect()
}

fn marks<'a>(name: &'a str, colour: usize, shape: Shape, values: &[Complex<f64>]) -> Marks<'a> {
    Marks { name, colour, shape, points: parts(values) }
}

/// A picture of the complex plane whose circles are round, `reach` either side vertically, with
/// the origin at `origin` of the width.
fn plane(reach: f64, origin: f64, marks: Vec<Marks<'_>>) -> Look<'_> {
    let width = 2.0 * reach * PLANE_RATIO;
    Look {
        x: Some((-origin * width, (1.0 - origin) * width)),
        y: Some((-reach, reach)),
        height: Some(PLANE_HEIGHT),
        marks,
        ..Look::default()
    }
}

fn s_plane<'a>(lines: Vec<Line<'a>>) -> Plot<'a> {
    Plot::new("real part, rad/s", "imaginary part, rad/s", lines)
}

/// How far the poles and zeros reach, with some room.
fn reach(values: &[Complex<f64>]) -> f64 {
    1.15 * values.iter().map(|z| z.norm()).fold(1.0, f64::max)
}

/// A plane that holds all of them, marked.
fn poles_and_zeros(poles: &[Complex<f64>], zeros: &[Complex<f64>]) -> Look<'static> {
    let all: Vec<_> = poles.iter().chain(zeros).copied().collect();
    let crosses = marks("poles", 5, Shape::Cross, poles);
    let circles = marks("zeros", 0, Shape::Circle, zeros);
    plane(reach(&all), 0.5, vec![crosses, circles])
}

fn pole_zero_map(analysis: &Analysis) -> Result<Markup> {
    let (poles, zeros) = (analysis.model.poles(), analysis.model.zeros());
    Ok(figure(
        "Poles and zeros from the servo's torque to pitch.",
        s_plane(Vec::new()).svg_as(&poles_and_zeros(&poles, &zeros))?,
    ))
}

/// Branches of a root locus as lines: the poles of one gain and the next are
/// paired nearest first.
fn branches(locus: &[Vec<Complex<f64>>]) -> Vec<Vec<(f64, f64)>> {
    let Some(first) = locus.first() else {
        return Vec::new();
    };
    let mut ends = first.clone();
    let mut lines: Vec<Vec<(f64, f64)>> = ends.iter().map(|z| vec![(z.re, z.im)]).collect();
    for poles in &locus[1..] {
        let mut pairs: Vec<(f64, usize, usize)> = (0..ends.len())
            .flat_map(|from| (0..poles.len()).map(move |to| (from, to)))
            .map(|(from, to)| ((poles[to] - ends[from]).norm(), from, to))
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut taken = (vec![false; ends.len()], vec![false; poles.len()]);
        for (_, from, to) in pairs {
            if !taken.0[from] && !taken.1[to] {
                (taken.0[from], taken.1[to]) = (true, true);
                ends[from] = poles[to];
                lines[from].push((ends[from].re, ends[from].im));
            }
        }
    }
    lines
}

/// Gains of a locus around `gain`, zero first, then evenly spaced in the logarithm.
fn gains_around(gain: f64) -> impl Iterator<Item = f64> {
    let steps = POINTS as f64;
    std::iter::once(0.0)
        .chain((0..POINTS).map(move |i| gain * 10.0_f64.powf(-3.0 + 6.0 * i as f64 / steps)))
}

fn locus_lines<'a>(
    open: &TransferFunction,
    name: &'a str,
    colour: usize,
    gain: f64,
) -> Vec<Line<'a>> {
    let gains = gains_around(gain.abs()).map(|g| g * gain.signum());
    let locus: Vec<_> = gains.map(|gain| open.closed_poles(gain)).collect();
    // The branches have one entry in the legend, that of the first.
    let names = std::iter::once(name).chain(std::iter::repeat(""));
    let lines = names.zip(branches(&locus));
    lines.map(|(name, points)| Line::new(name, colour, points)).collect()
}

/// What pitch alone, fed back to a torque, can do: the thesis' controller.
fn torque_locus(analysis: &Analysis) -> Result<Markup> {
    let open = analysis.model.transfer_function();
    let (poles, zeros) = (open.poles(), open.zeros());
    let mut lines = locus_lines(&open, "torque = -k pitch, k > 0", 0, 1.0);
    lines.extend(locus_lines(&open, "k < 0", 1, -1.0));
    Ok(figure(
        "Root locus of a torque in proportion to pitch, gains of 0.001 to 1000 N m/rad of either \
         sign. A branch in the right half plane is a drone that runs away: pitch alone does not \
         tell a torque where the crank is.",
        s_plane(lines).svg_as(&poles_and_zeros(&poles, &zeros))?,
    ))
}

fn loop_locus(analysis: &Analysis) -> Result<Markup> {
    let open = analysis.open.rational();
    let lines = locus_lines(&open, "", 4, 1.0);
    let closed = open.closed_poles(1.0);
    // The poles and zeros of the delay lie far out: the picture leaves them out.
    let near: Vec<_> = closed.iter().filter(|z| z.norm() < 120.0).copied().collect();
    let look = plane(
        reach(&near).min(90.0),
        0.65,
        vec![
            marks("open loop", 5, Shape::Cross, &open.poles()),
            marks("zeros", 0, Shape::Circle, &open.zeros()),
            marks("at these gains", 2, Shape::Dot, &closed),
        ],
    );
    Ok(figure(
        "Root locus of the position loop as both gains grow together, from a thousandth to a thousand \
         times what they are.",
        s_plane(lines).svg_as(&look)?,
    ))
}

fn bode(analysis: &Analysis) -> Result<Markup> {
    let response = analysis.open.response(BODE.0, BODE.1, POINTS);
    let margins = analysis.open.margins();
    let nearest = |rad_s: f64| {
        let far = |r: &&Response| (r.rad_s / rad_s).ln().abs();
        response.iter().min_by(|a, b| far(a).total_cmp(&far(b)))
    };
    let plot = |y_label, y, (level, level_name), value: fn(&Response) -> f64| {
        let point = |r: &Response| (r.rad_s, value(r));
        let lines = vec![
            Line::new("open loop", 0, response.iter().map(point).collect()),
            Line::new(level_name, 4, vec![(BODE.0, level), (BODE.1, level)]),
        ];
        let dot = |name, colour, rad_s: Option<f64>| Marks {
            name,
            colour,
            shape: Shape::Dot,
            points: rad_s.and_then(nearest).map(point).into_iter().collect(),
        };
        let marks = vec![
            dot("gain margin", 5, margins.gain.map(|m| m.at_rad_s)),
            dot("phase margin", 2, margins.phase.map(|m| m.at_rad_s)),
        ];
        let look = Look { log_x: true, y, marks, ..Look::default() };
        Plot::new("frequency, rad/s", y_label, lines).svg_as(&look)
    };
    Ok(html! {
        (figure(
            "Gain of the open loop, with its margins.",
            plot("gain, dB", Some((-60.0, 60.0)), (0.0, "unity gain"), |r| r.gain_db)?,
        ))
        (figure(
            "Phase of the open loop, delays included. It jumps by 180 deg at the zeros on the imaginary \
             axis, where the rudder's inertia cancels its force.",
            plot("phase, deg", None, (-180.0, "-180 deg"), |r| r.phase_deg)?,
        ))
    })
}

fn nyquist(analysis: &Analysis) -> Result<Markup> {
    let response = analysis.open.response(0.02, 3000.0, 4 * POINTS);
    // Thinning would cut corners of a curve that is slow in one place and fast in another: what
    // lies far outside the picture goes first.
    let values: Vec<Complex<f64>> =
        response.iter().map(|r| r.value).filter(|z| z.norm() < 12.0).collect();
    let circle = (0..=180).map(|i| f64::from(2 * i).to_radians().sin_cos()).collect();
    let mirrored = values.iter().map(|z| (z.re, -z.im)).collect();
    let lines = vec![
        Line::new("open loop", 0, parts(&values)),
        Line::new("at negative frequencies", 4, mirrored),
        Line::new("unit circle", 2, circle),
    ];
    let plot = Plot::new("real part", "imaginary part", lines);
    let critical = marks("-1", 5, Shape::Cross, &[Complex::new(-1.0, 0.0)]);
    let look = plane(1.6, 0.7, vec![critical]);
    Ok(figure(
        "Nyquist's curve of the open loop. Two integrators take it to infinity at low frequency; a \
         stable loop leaves -1 on its left.",
        plot.svg_as(&look)?,
    ))
}
