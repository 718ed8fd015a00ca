//! Clipping of the gyroscope: noticing it, and making good for what was lost.
//!
//! A rate that stays at its limit hides part of the rotation. Between the crossings of the limit the true
//! rate is taken for the cubic that has the slopes seen before and after: with slopes `s0` and `s1` (rad/s^2)
//! and a duration `T`, its area above the limit is `(s0 - s1) T^2 / 12`. That angle is given back when the
//! clipping has ended, about the axis as it stood meanwhile, and its size says how uncertain the attitude
//! has become.
//!
//! The limit need not be known: a rate that stays exactly the same for three samples, at the largest value
//! ever seen on its axis, is a limit.

use nalgebra::Vector3;

use crate::quaternion::{Quaternion, dot};
use crate::real::Real;

/// Slowest rate that can be a limit, rad/s: no gyroscope ends below 115 deg/s.
const LEAST_LIMIT: f32 = 2.0;

/// How equal two rates must be to be at a limit, as a fraction: one count of 16 bits.
const EQUAL: f32 = 4e-5;

/// Steps without a change that show a limit.
const FLAT_STEPS: u8 = 2;

/// Uncertainty of the angle given back: this fraction of it, and this times its square (rad).
const SIGMA: (f32, f32) = (0.2, 0.3);

/// What was lost on all axes, where clipping has just ended.
#[derive(Clone, Debug)]
pub(crate) struct Lost<T> {
    /// Rotation vector to be given back, earth frame, at half length (rad).
    pub(crate) half_angle_earth: Vector3<T>,
    /// Variance that the attitude has gained, rad^2.
    pub(crate) variance: T,
}

#[derive(Clone, Debug)]
pub(crate) struct Range<T> {
    configured: T,
    axes: [Axis<T>; 3],
}

#[derive(Clone, Debug)]
struct Axis<T> {
    /// Rates beyond this have clipped, rad/s: configured or found.
    limit: T,
    /// Rates up to this are not worth a look.
    quiet: T,
    largest: T,
    flat: u8,
    /// The last two rates, newest first.
    last: [T; 2],
    state: State<T>,
    /// Sum of the axis' directions in the earth frame while clipped.
    direction: Vector3<T>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State<T> {
    Clear,
    /// Slope before the crossing (rad/s^2), `None` if not seen; time since the crossing (s).
    Clipped {
        slope: Option<T>,
        time_s: T,
    },
    /// One sample after; the slope after needs a second.
    Leaving {
        slope: Option<T>,
        time_s: T,
        first: T,
    },
}

impl<T: Real> Range<T> {
    pub(crate) fn new(limit_rad_s: f32) -> Self {
        let configured = T::from_f32(limit_rad_s);
        Self {
            configured,
            axes: core::array::from_fn(|_| Axis::new(configured)),
        }
    }

    /// Whether there is nothing to be looked at, which is nearly always and costs no arithmetic.
    #[inline(always)]
    pub(crate) fn is_quiet(&mut self, gyr: &Vector3<T>) -> bool {
        let [x, y, z] = &mut self.axes;
        let quiet = x.is_quiet(gyr.x) && y.is_quiet(gyr.y) && z.is_quiet(gyr.z);
        if quiet {
            x.remember(gyr.x);
            y.remember(gyr.y);
            z.remember(gyr.z);
        }
        quiet
    }

    /// Rates that are not quiet: clamp them to the configured limit, and say what was lost.
    #[cold]
    #[inline(never)]
    pub(crate) fn examine(
        &mut self,
        dt: T,
        gyr: &mut Vector3<T>,
        orientation: &Quaternion<T>,
    ) -> (bool, Option<Lost<T>>) {
        let mut clipped = false;
        let mut total: Option<Lost<T>> = None;
        let rows = orientation.half_rows();
        let columns = [
            Vector3::new(rows.north.x, rows.east.x, rows.down.x),
            Vector3::new(rows.north.y, rows.east.y, rows.down.y),
            Vector3::new(rows.north.z, rows.east.z, rows.down.z),
        ];
        for ((axis, rate), column) in self.axes.iter_mut().zip(gyr.iter_mut()).zip(&columns) {
            *rate = clamped(*rate, self.configured);
            let lost = axis.examine(dt, *rate, self.configured, column);
            clipped |= axis.state != State::Clear;
            if let Some(lost) = lost {
                let sum = total.get_or_insert(Lost {
                    half_angle_earth: Vector3::new(T::ZERO, T::ZERO, T::ZERO),
                    variance: T::ZERO,
                });
                sum.half_angle_earth.x += lost.half_angle_earth.x;
                sum.half_angle_earth.y += lost.half_angle_earth.y;
                sum.half_angle_earth.z += lost.half_angle_earth.z;
                sum.variance += lost.variance;
            }
        }
        (clipped, total)
    }
}

impl<T: Real> Axis<T> {
    fn new(limit: T) -> Self {
        Self {
            limit,
            quiet: T::from_f32(LEAST_LIMIT),
            largest: T::ZERO,
            flat: 0,
            last: [T::ZERO; 2],
            state: State::Clear,
            direction: Vector3::new(T::ZERO, T::ZERO, T::ZERO),
        }
    }

    #[inline(always)]
    fn is_quiet(&self, rate: T) -> bool {
        rate.within(self.quiet) && matches!(self.state, State::Clear)
    }

    #[inline(always)]
    fn remember(&mut self, rate: T) {
        self.last = [rate, self.last[0]];
    }

    fn examine(&mut self, dt: T, rate: T, configured: T, column: &Vector3<T>) -> Option<Lost<T>> {
        self.find_limit(rate, configured);
        let clipped = !rate.within(self.limit);
        let [last, before] = self.last;
        let mut lost = None;
        self.state = match self.state {
            State::Clear if clipped => {
                let limit = if rate < T::ZERO {
                    -self.limit
                } else {
                    self.limit
                };
                // Found by staying the same, the limit was crossed before the slope could be seen.
                let slope = (self.flat < FLAT_STEPS).then(|| (last - before) * dt.recip());
                let time_s = slope.map_or(dt, |slope| dt - crossing(limit - last, slope, dt));
                State::Clipped { slope, time_s }
            }
            State::Clear => State::Clear,
            State::Clipped { slope, time_s } if clipped => State::Clipped {
                slope,
                time_s: time_s + dt,
            },
            State::Clipped { slope, time_s } => State::Leaving {
                slope,
                time_s,
                first: rate,
            },
            State::Leaving {
                slope,
                time_s,
                first,
            } => {
                let after = (rate - first) * dt.recip();
                let limit = if first < T::ZERO {
                    -self.limit
                } else {
                    self.limit
                };
                let time_s = time_s + dt - crossing(first - limit, after, dt);
                lost =
                    Some(self.give_back(slope.unwrap_or(-after), after, time_s, first < T::ZERO));
                self.direction = Vector3::new(T::ZERO, T::ZERO, T::ZERO);
                if clipped {
                    State::Clipped {
                        slope: Some(after),
                        time_s: dt,
                    }
                } else {
                    State::Clear
                }
            }
        };
        if clipped {
            self.direction.x += column.x;
            self.direction.y += column.y;
            self.direction.z += column.z;
        }
        self.remember(rate);
        lost
    }

    /// Learn the limit from rates that stay the same, and forget it when a rate is beyond it.
    fn find_limit(&mut self, rate: T, configured: T) {
        let size = rate.abs();
        if size > self.largest {
            if size > self.limit * T::from_f32(1.02) {
                self.limit = configured;
            }
            self.largest = size;
        }
        let [last, _] = self.last;
        let nearly = self.largest * T::from_f32(1.0 - 5.0 * EQUAL);
        let same = size > nearly && (rate - last).within(self.largest * T::from_f32(EQUAL));
        self.flat = if same { self.flat.saturating_add(1) } else { 0 };
        if self.flat >= FLAT_STEPS && size >= T::from_f32(LEAST_LIMIT) && nearly < self.limit {
            self.limit = nearly;
        }
        let quiet = if nearly < self.limit {
            nearly
        } else {
            self.limit
        };
        if quiet > self.quiet {
            self.quiet = quiet;
        }
    }

    fn give_back(&self, before: T, after: T, time_s: T, negative: bool) -> Lost<T> {
        let area = (before - after) * time_s * time_s * T::from_f32(1.0 / 12.0);
        // At most as much as was measured: slopes of a hit say little about a long saturation.
        let most = self.limit * time_s;
        let size = if area.within(most) { area.abs() } else { most };
        // An area on the wrong side of the limit is not clipping but noise at it.
        let outward = (area < T::ZERO) == negative;
        let size = if outward { size } else { T::ZERO };
        let length2 = dot(&self.direction, &self.direction);
        let unit = if length2 > T::ZERO {
            length2.sqrt().recip()
        } else {
            T::ZERO
        };
        let half = T::HALF * unit * if negative { -size } else { size };
        let sigma = size * (T::from_f32(SIGMA.0) + T::from_f32(SIGMA.1) * size);
        Lost {
            half_angle_earth: Vector3::new(
                self.direction.x * half,
                self.direction.y * half,
                self.direction.z * half,
            ),
            variance: sigma * sigma,
        }
    }
}

/// Time, within 0..`dt`, in which a rate that changes by `slope` makes up `distance`.
fn crossing<T: Real>(distance: T, slope: T, dt: T) -> T {
    let time_s = distance * slope.recip();
    if time_s > T::ZERO && time_s.within(dt) {
        time_s
    } else {
        T::ZERO
    }
}

fn clamped<T: Real>(rate: T, limit: T) -> T {
    match (rate.within(limit), rate < T::ZERO) {
        (true, _) => rate,
        (false, true) => -limit,
        (false, false) => limit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feed a sine of amplitude 10 rad/s about y, clipped at `clip`; angle given back over the run.
    fn run(range: &mut Range<f64>, clip: f64, seconds: f64) -> (f64, u32) {
        let (dt, mut given, mut times) = (0.0025, 0.0, 0);
        for k in 0..(seconds / dt) as u32 {
            let rate = 10.0 * (f64::from(k) * dt * 4.0).sin();
            let mut gyr = Vector3::new(0.0, rate.clamp(-clip, clip), 0.0);
            if !range.is_quiet(&gyr)
                && let (_, Some(lost)) = range.examine(dt, &mut gyr, &Quaternion::IDENTITY)
            {
                given += 2.0 * lost.half_angle_earth.y;
                times += 1;
            }
        }
        (given, times)
    }

    #[test]
    fn the_hidden_angle_is_given_back() {
        // Half a period from 0 to pi/4 s: of the area above 8 rad/s, 10/4 * 2 cos(a) - 8 * 2 b / 4 with
        // a = asin(0.8), b = pi/2 - a.
        let b = (0.8f64).acos();
        let hidden = 10.0 / 2.0 * b.sin() - 8.0 * b / 2.0;
        let (given, times) = run(&mut Range::new(7.999), 8.0, 0.78);
        assert_eq!(times, 1);
        assert!(
            (given - hidden).abs() < 0.05 * hidden,
            "{given} of {hidden}"
        );
    }

    #[test]
    fn a_limit_is_found_and_positive_and_negative_angles_cancel() {
        let mut range = Range::new(34.0);
        let (_, times) = run(&mut range, 8.0, 1.58);
        assert_eq!(times, 2);
        assert!((range.axes[1].limit - 8.0).abs() < 0.01);
        let (given, _) = run(&mut range, 8.0, 7.9);
        assert!(given.abs() < 0.2, "{given}");
    }

    #[test]
    fn a_rate_beyond_a_supposed_limit_disproves_it() {
        let mut range = Range::new(34.0);
        run(&mut range, 6.0, 1.58);
        assert!(range.axes[1].limit < 6.0);
        run(&mut range, 20.0, 1.58);
        assert_eq!(range.axes[1].limit, 34.0);
    }

    #[test]
    fn a_smooth_motion_below_the_limit_loses_nothing() {
        let (given, times) = run(&mut Range::new(34.0), 20.0, 60.0);
        assert_eq!((given, times), (0.0, 0));
    }
}
