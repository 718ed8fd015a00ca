//! Line plots as SVG text, to stand inside a page.

use anyhow::{Result, anyhow};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::element::DynElement;
use plotters::prelude::*;

/// Size of a plot in SVG units; pages scale it to their width.
const SIZE: (u32, u32) = (860, 300);

/// Points drawn per line at most; a longer trace is thinned evenly.
const MOST_POINTS: usize = 1500;

/// Largest value on an axis, of any unit.
const LARGEST: f64 = 1e12;
/// Least length of an axis, as a share of the largest value on it.
const NARROWEST: f64 = 1e-9;

/// One line of a plot.
pub struct Line<'a> {
    /// Shown in the legend, unless it is empty.
    pub name: &'a str,
    /// Index into the page's palette: the same thing has the same colour in every plot.
    pub colour: usize,
    /// `(x, y)`, x ascending.
    pub points: Vec<(f64, f64)>,
}

/// A plot with one x axis and any number of lines.
pub struct Plot<'a> {
    /// Label of the x axis with its unit.
    pub x: &'a str,
    /// Label of the y axis with its unit.
    pub y: &'a str,
    /// The lines, drawn in this order.
    pub lines: Vec<Line<'a>>,
    /// A shaded band `(low, high)` of y, such as the settling band.
    pub band: Option<(f64, f64)>,
    /// Shaded stretches `(from, to)` of x.
    pub stretches: Vec<(f64, f64)>,
}

impl<'a> Line<'a> {
    /// A line through points `(x, y)`, x ascending.
    pub fn new(name: &'a str, colour: usize, points: Vec<(f64, f64)>) -> Self {
        Self { name, colour, points }
    }
}

/// How a picture differs from the usual one.
#[derive(Default)]
pub struct Look<'a> {
    /// A logarithmic x axis; every x must be above zero.
    pub log_x: bool,
    /// Range of x, in place of that of the points; what lies outside is not drawn.
    pub x: Option<(f64, f64)>,
    /// Range of y, likewise.
    pub y: Option<(f64, f64)>,
    /// Height in SVG units, in place of the usual one.
    pub height: Option<u32>,
    /// Single points, drawn over the lines.
    pub marks: Vec<Marks<'a>>,
}

/// Single points of a kind.
pub struct Marks<'a> {
    /// Shown in the legend.
    pub name: &'a str,
    /// Index into the page's palette.
    pub colour: usize,
    /// Shape of each point.
    pub shape: Shape,
    /// `(x, y)`.
    pub points: Vec<(f64, f64)>,
}

/// Shape of a single point.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A cross: poles, by custom.
    Cross,
    /// An open circle: zeros, by custom.
    Circle,
    /// A filled dot.
    Dot,
}

impl Shape {
    /// A point of this shape, in a chart or in its legend.
    fn drawn<'a, P: Clone + 'static>(
        self,
        at: P,
        colour: RGBColor,
    ) -> DynElement<'static, SVGBackend<'a>, P> {
        let line = colour.stroke_width(2);
        match self {
            Self::Cross => Cross::new(at, 5, line).into_dyn(),
            Self::Circle => Circle::new(at, 5, line).into_dyn(),
            Self::Dot => Circle::new(at, 4, colour.filled()).into_dyn(),
        }
    }
}

/// Colours that stay apart for colour-blind readers and in grey print.
const PALETTE: [RGBColor; 6] = [
    RGBColor(0, 90, 181),
    RGBColor(220, 92, 4),
    RGBColor(20, 130, 80),
    RGBColor(150, 60, 150),
    RGBColor(110, 110, 110),
    RGBColor(200, 30, 60),
];

/// Result of the drawing library.
type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

impl<'a> Plot<'a> {
    /// A plot without a band; axes are labelled with their units.
    pub fn new(x: &'a str, y: &'a str, lines: Vec<Line<'a>>) -> Self {
        Self { x, y, lines, band: None, stretches: Vec::new() }
    }

    /// With a shaded band of y.
    pub fn with_band(mut self, band: Option<(f64, f64)>) -> Self {
        self.band = band;
        self
    }

    /// Draws the plot; an error means that the drawing library refused the numbers.
    pub fn svg(&self) -> Result<String> {
        self.svg_as(&Look::default())
    }

    /// Draws the plot with a look of its own.
    pub fn svg_as(&self, look: &Look<'_>) -> Result<String> {
        let mut svg = String::new();
        let (x, y) = self.ranges(look);
        let drawn = if look.log_x {
            self.draw(&mut svg, look, (x.start..x.end).log_scale(), (x, y))
        } else {
            self.draw(&mut svg, look, x.start..x.end, (x, y))
        };
        drawn.map_err(|error| anyhow!("drawing a plot of {}: {error}", self.y))?;
        Ok(svg)
    }

    fn draw<X: AsRangedCoord<Value = f64>>(
        &self,
        svg: &mut String,
        look: &Look<'_>,
        x_axis: X,
        (x, y): (std::ops::Range<f64>, std::ops::Range<f64>),
    ) -> Drawn
    where
        X::CoordDescType: ValueFormatter<f64>,
    {
        let size = (SIZE.0, look.height.unwrap_or(SIZE.1));
        let area = SVGBackend::with_string(svg, size).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .margin_right(18)
            .x_label_area_size(38)
            .y_label_area_size(62)
            .build_cartesian_2d(x_axis, y.clone())?;
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .x_labels(12)
            .y_labels(7)
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .axis_style(RGBColor(120, 120, 120))
            .label_style(("sans-serif", 13))
            .draw()?;
        if let Some((low, high)) = self.band {
            chart.draw_series([Rectangle::new(
                [(x.start, low), (x.end, high)],
                RGBColor(20, 130, 80).mix(0.15).filled(),
            )])?;
        }
        let shade = RGBColor(110, 110, 110).mix(0.2).filled();
        chart.draw_series(self.stretches.iter().map(|(from, to)| {
            let [from, to] = [from, to].map(|at| at.clamp(x.start, x.end));
            Rectangle::new([(from, y.start), (to, y.end)], shade)
        }))?;
        let inside = |&(px, py): &(f64, f64)| {
            (x.start..=x.end).contains(&px) && (y.start..=y.end).contains(&py)
        };
        for line in &self.lines {
            let style = PALETTE[line.colour % PALETTE.len()].stroke_width(2);
            let points = thinned(&line.points);
            // A line that leaves the picture is drawn in the pieces that lie inside.
            let pieces = points.split(|point| !inside(point));
            for (i, piece) in pieces.filter(|piece| !piece.is_empty()).enumerate() {
                let drawn = chart.draw_series(LineSeries::new(piece.iter().copied(), style))?;
                if i == 0 && !line.name.is_empty() {
                    drawn
                        .label(line.name)
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
                }
            }
        }
        for marks in &look.marks {
            let (shape, colour) = (marks.shape, PALETTE[marks.colour % PALETTE.len()]);
            let points = marks.points.iter().copied().filter(inside);
            let drawn = chart.draw_series(points.map(|at| shape.drawn(at, colour)))?;
            drawn.label(marks.name).legend(move |(x, y)| shape.drawn((x + 9, y), colour));
        }
        let named = self.lines.iter().any(|line| !line.name.is_empty());
        if self.lines.len() + look.marks.len() > 1 && (named || !look.marks.is_empty()) {
            chart
                .configure_series_labels()
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(200, 200, 200))
                .label_font(("sans-serif", 13))
                .position(SeriesLabelPosition::UpperRight)
                .draw()?;
        }
        area.present()?;
        Ok(())
    }

    /// Axis ranges around all points that can be drawn, never empty, unless the look says which.
    fn ranges(&self, look: &Look<'_>) -> (std::ops::Range<f64>, std::ops::Range<f64>) {
        let mut x = (f64::INFINITY, f64::NEG_INFINITY);
        let mut y = self.band.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
        let lines = self.lines.iter().flat_map(|line| &line.points);
        let marks = look.marks.iter().flat_map(|marks| &marks.points);
        for &(px, py) in lines.chain(marks) {
            if can_be_drawn(px) && can_be_drawn(py) {
                x = (x.0.min(px), x.1.max(px));
                y = (y.0.min(py), y.1.max(py));
            }
        }
        if x.0 >= x.1 {
            x = if x.0.is_finite() { (x.0, x.0 + 1.0) } else { (0.0, 1.0) };
        }
        if y.0 >= y.1 {
            y = if y.0.is_finite() { (y.0 - 1.0, y.0 + 1.0) } else { (0.0, 1.0) };
        }
        let margin = 0.06 * (y.1 - y.0);
        let (x0, x1) = look.x.unwrap_or(x);
        let (y0, y1) = look.y.unwrap_or((y.0 - margin, y.1 + margin));
        (apart(x0, x1), apart(y0, y1))
    }
}

/// Whether a value has a place on an axis.
fn can_be_drawn(value: f64) -> bool {
    value.abs() <= LARGEST
}

/// An axis from one value to another. The drawing library seeks its labels for ever where they are
/// not finite, or where the numbers between them cannot be told apart.
fn apart(low: f64, high: f64) -> std::ops::Range<f64> {
    let within = |value: f64| value.clamp(-LARGEST, LARGEST);
    let (low, high) = (within(low), within(high));
    let least = NARROWEST * low.abs().max(high.abs());
    // Not a number is neither.
    if high - low > least {
        low..high
    } else if low.is_nan() {
        0.0..1.0
    } else {
        low..low + least.max(f64::MIN_POSITIVE)
    }
}

/// At most [`MOST_POINTS`] of the points that can be drawn, the last one always among them.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let stride = points.len().div_ceil(MOST_POINTS).max(1);
    let last = points.len().saturating_sub(1);
    points
        .iter()
        .enumerate()
        .filter(|(i, (x, y))| {
            (i % stride == 0 || *i == last) && can_be_drawn(*x) && can_be_drawn(*y)
        })
        .map(|(_, point)| *point)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<(f64, f64)>) -> Plot<'static> {
        let lines = vec![Line { name: "pitch", colour: 0, points }];
        Plot {
            x: "time, s",
            y: "pitch, deg",
            lines,
            band: None,
            stretches: vec![(0.2, 0.4), (-1.0, f64::INFINITY)],
        }
    }

    #[test]
    fn draws_a_line_with_its_labels() {
        let svg = plot(vec![(0.0, 1.0), (1.0, -1.0)]).svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("pitch, deg") && svg.contains("polyline"));
    }

    #[test]
    fn no_points_constant_points_and_nan_still_give_a_picture() {
        for points in [
            vec![],
            vec![(0.0, 2.0); 3],
            vec![(0.0, f64::NAN), (1.0, 0.0)],
            vec![(0.0, f64::INFINITY), (1.0, 1e300)],
            vec![(1e18, -1e308), (1e18, 1e308)],
            vec![(1e11, 0.0), (1e11 + 1e-5, 1e-320)],
        ] {
            plot(points).svg().unwrap();
        }
        for (low, high) in [
            (0.0, f64::INFINITY),
            (f64::NAN, 1.0),
            (0.0, f64::NAN),
            (5.0, 1.0),
            (1e12, 1e12 + 1.0),
            (0.0, 0.0),
        ] {
            let look = Look { x: Some((low, high)), y: Some((low, high)), ..Look::default() };
            plot(vec![(0.5, 0.5)]).svg_as(&look).unwrap();
        }
    }

    #[test]
    fn marks_are_drawn_and_what_lies_outside_the_picture_is_not() {
        let look = Look {
            x: Some((0.1, 10.0)),
            y: Some((-1.0, 1.0)),
            log_x: true,
            height: Some(400),
            marks: vec![Marks {
                name: "poles",
                colour: 1,
                shape: Shape::Cross,
                points: vec![(1.0, 0.0), (100.0, 0.0)],
            }],
        };
        let plot = plot(vec![(0.1, 0.0), (1.0, 0.5), (2.0, 5.0), (3.0, 0.5), (9.0, 0.0)]);
        let svg = plot.svg_as(&look).unwrap();
        assert!(svg.contains("poles") && svg.contains("height=\"400\""));
        let alone = plot.svg_as(&Look::default()).unwrap();
        let lines = |svg: &str| svg.matches("stroke-width=\"2\" points").count();
        // The line in two pieces, against one.
        assert!(lines(&svg) > lines(&alone), "{} {}", lines(&svg), lines(&alone));
    }

    #[test]
    fn a_long_trace_is_thinned_but_keeps_its_end() {
        let points: Vec<_> = (0..100_000).map(|i| (f64::from(i), 0.0)).collect();
        let thin = thinned(&points);
        assert!(thin.len() <= MOST_POINTS + 1);
        assert_eq!(thin.last(), points.last());
    }
}
