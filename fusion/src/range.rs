//! Clipping of the gyroscope: detection, and an estimate of the hidden rotation.
//!
//! A rate that stays at its limit hides part of the rotation. Between the crossings of the limit,
//! the model of the true rate is a cubic with the slopes before and after. With slopes `s0` and
//! `s1` (rad/s^2) and a duration `T`, its area above the limit is `(s0 - s1) T^2 / 12`. The error
//! of this angle grows mostly with the duration. The [recovery](crate::recovery) corrects the
//! attitude by the angle.
//!
//! The limit need not be known, and may differ between the axes and between the two senses of each.
//! Near an axis' largest rate so far, two signs show a limit. Either the rate stays the same to the
//! count for three samples after a fast change, or it hardly changes, because factory calibration
//! mixes a little of the other axes into a clipped axis.
//!
//! A smooth motion has neither sign: around the peak of a sine the steps are as 5, 3, 1, -1. A
//! steady spin may show both. So a limit is only supposed until it appears again, or in another
//! sense or axis. Meanwhile only peaks of up to half a second are compensated.

use crate::real::Real;

/// Slowest rate that can be a limit, rad/s: no gyroscope ends below 115 deg/s.
const MIN_LIMIT: f32 = 2.0;

/// Largest difference of two rates at a limit, as a fraction: one count of 16 bits.
const EQUAL: f32 = 4e-5;

/// Steps without a change that show a limit.
const FLAT_STEPS: u8 = 2;

/// Shortest time of equal rates at a limit, s: noise makes shorter times.
const FLAT_S: f32 = 0.006;

/// A step is small up to this fraction of the largest rate.
const SMALL_STEP: f32 = 0.003;

/// A small step is also below this fraction of the last step that was not small.
const SMALLER: f32 = 0.25;

/// Least angular acceleration in the last step that was not small, rad/s^2: in slower motion,
/// smooth counts stay the same too.
const ARRIVAL_RAD_S2: f32 = 5.0;

/// That step is also above this fraction of the largest rate: at high sampling rates, noise makes
/// larger accelerations than a motion.
const ARRIVAL: f32 = 0.0075;

/// Fraction of the largest rate from which on a limit is possible.
const NEAR: f32 = 0.97;

/// A limit with other axes mixed in, as a fraction of the rate there.
const MIXED: f32 = 0.985;

/// Rates up to this fraction of the largest are not examined.
const QUIET: f32 = 0.85;

/// A rate that exceeds a limit by more than this disproves it.
const BEYOND: f32 = 1.04;

/// Limits closer than this are one range of the sensor.
const AGREE: f32 = 0.05;

/// Longest clipping that slopes describe, s.
const LONGEST_S: f32 = 0.5;

/// Largest angle beyond the limit, as a fraction of the angle at the limit: a hit's slopes say
/// little about a long saturation.
const MAX_HIDDEN: f32 = 0.6;

/// Deviation of that angle, as a fraction of the angle at the limit, and its growth per second.
/// From recordings of hands, arms and hits, clipped at many limits.
const SIGMA: (f32, f32) = (0.04, 1.0);

/// Largest deviation of that angle, as a fraction of the angle itself and of
/// the angle at the limit.
const AREA_SIGMA: (f32, f32) = (1.5, 0.05);

/// Deviation of that angle for a supposed limit, as a fraction of the angle itself.
const SUPPOSED_SIGMA: f32 = 0.3;

/// Largest deviation, rad: the angle is unknown then.
const MAX_SIGMA: f32 = 1.0;

/// Hidden rotation of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Hidden<T> {
    /// Nothing.
    Nothing,
    /// The rate is beyond this limit, rad/s.
    Rate(T),
    /// Clipping has ended: the lost angle and its standard deviation, rad.
    Angle(T, T),
}

#[derive(Clone, Debug)]
pub(crate) struct Range<T> {
    configured: T,
    /// An axis is clipped, or was clipped at the last sample.
    busy: bool,
    axes: [Axis<T>; 3],
}

#[derive(Clone, Debug, Default)]
struct Axis<T> {
    /// Limits of positive and of negative rates.
    limits: [Limit<T>; 2],
    /// A limit was found in the present clipping.
    fresh: bool,
    /// Sizes up to this are not examined, rad/s.
    quiet: T,
    /// The largest size so far, rad/s.
    largest: T,
    /// Steps in a row that were small.
    small: u8,
    /// Steps in a row that changed nothing.
    equal: u8,
    /// The last step that was not small, rad/s.
    arrival: T,
    /// The last two rates, newest first; `None` where one was not examined.
    last: [Option<T>; 2],
    state: State<T>,
}

/// The limit of an axis in one sense.
#[derive(Clone, Copy, Debug, Default)]
struct Limit<T> {
    /// Limit, rad/s, configured or found.
    size: T,
    /// It is more than supposed.
    sure: bool,
}

impl<T> Limit<T> {
    fn sure(size: T) -> Self {
        Self { size, sure: true }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State<T> {
    #[default]
    Clear,
    /// Slope before the crossing, rad/s^2, `None` if not seen, and time since the crossing, s.
    Clipped(Option<T>, T),
    /// As before, with the first rate after the clipping. A second rate gives the slope.
    Leaving(Option<T>, T, T),
}

impl<T: Real> Range<T> {
    pub(crate) fn new(limit_rad_s: f32) -> Self {
        let configured = T::from_f32(limit_rad_s);
        Self { configured, busy: false, axes: core::array::from_fn(|_| Axis::new(configured)) }
    }

    /// For going back in time: the limits of positive rates become those of negative rates.
    #[cfg(feature = "offline")]
    pub(crate) fn reversed(&self) -> Self {
        let axes = self.axes.each_ref().map(|axis| {
            let [above, below] = axis.limits;
            Axis {
                limits: [below, above],
                quiet: axis.quiet,
                largest: axis.largest,
                ..Axis::new(self.configured)
            }
        });
        Self { busy: false, axes, ..*self }
    }

    /// Whether there is nothing to examine: the usual case, without arithmetic.
    #[inline(always)]
    pub(crate) fn is_quiet(&self, gyr: &[T; 3]) -> bool {
        let [x, y, z] = &self.axes;
        !self.busy && gyr[0].within(x.quiet) && gyr[1].within(y.quiet) && gyr[2].within(z.quiet)
    }

    /// Clamps rates that are not quiet to the configured limit, and gives the rotation that each
    /// axis hides.
    #[cold]
    #[inline(never)]
    pub(crate) fn examine(&mut self, dt: T, gyr: &mut [T; 3]) -> [Hidden<T>; 3] {
        let mut hidden = [Hidden::Nothing; 3];
        self.busy = false;
        for ((axis, rate), hidden) in self.axes.iter_mut().zip(gyr.iter_mut()).zip(&mut hidden) {
            *rate = rate.limited(self.configured);
            *hidden = axis.examine(dt, *rate, self.configured);
            // An axis forgets its memory if the next sample is not examined.
            self.busy |= axis.last[0].is_some();
        }
        if self.axes.iter().any(|axis| axis.fresh) {
            self.compare();
        }
        hidden
    }

    /// A limit has been found. Another similar limit confirms both.
    fn compare(&mut self) {
        let configured = self.configured;
        let sizes = self.axes.each_ref().map(|axis| axis.limits.map(|limit| limit.size));
        for limit in self.axes.iter_mut().flat_map(|axis| &mut axis.limits) {
            let size = limit.size;
            let near = |other: &&T| (**other - size).within(size * T::from_f32(AGREE));
            // It is like itself.
            limit.sure |= size < configured && sizes.as_flattened().iter().filter(near).count() > 1;
        }
    }
}

impl<T: Real> Axis<T> {
    fn new(limit: T) -> Self {
        Self {
            limits: [Limit::sure(limit); 2],
            quiet: limit.at_most(T::from_f32(MIN_LIMIT)),
            ..Self::default()
        }
    }

    fn limit(&self, negative: bool) -> Limit<T> {
        let [above, below] = self.limits;
        if negative { below } else { above }
    }

    fn limit_mut(&mut self, negative: bool) -> &mut Limit<T> {
        let [above, below] = &mut self.limits;
        if negative { below } else { above }
    }

    fn examine(&mut self, dt: T, rate: T, configured: T) -> Hidden<T> {
        if rate.within(self.quiet) && self.state == State::Clear {
            self.last = [None; 2];
            (self.small, self.equal) = (0, 0);
            return Hidden::Nothing;
        }
        if rate.abs() > self.limit(rate.is_negative()).size * T::from_f32(BEYOND) {
            return self.disprove(rate, configured);
        }
        let found = self.find_limit(dt, rate, configured);
        let Limit { size: limit, sure } = self.limit(rate.is_negative());
        let clipped = !rate.within(limit);
        let [last, before] = self.last;
        let mut hidden = if clipped && sure { Hidden::Rate(limit) } else { Hidden::Nothing };
        self.state = match self.state {
            State::Clear if clipped => {
                let signed = limit.negated(rate.is_negative());
                // A limit found by equal rates was crossed before the slope could be seen.
                let slope = match (last, before) {
                    (Some(last), Some(before)) if !found => Some((last - before) * dt.recip()),
                    _ => None,
                };
                let time_s = match (slope, last) {
                    (Some(slope), Some(last)) => dt - crossing(signed - last, slope, dt),
                    _ => dt,
                };
                State::Clipped(slope, time_s)
            }
            State::Clear => State::Clear,
            State::Clipped(slope, time_s) if clipped => State::Clipped(slope, time_s + dt),
            State::Clipped(slope, time_s) => State::Leaving(slope, time_s, rate),
            State::Leaving(slope, time_s, first) => {
                let after = (rate - first) * dt.recip();
                let negative = first.is_negative();
                let signed = self.limit(negative).size.negated(negative);
                let time_s = time_s + dt - crossing(first - signed, after, dt);
                let slopes = (slope.unwrap_or(-after), after);
                hidden = self.lost(slopes, time_s, negative);
                self.fresh = false;
                if clipped { State::Clipped(Some(after), dt) } else { State::Clear }
            }
        };
        self.last = [Some(rate), last];
        hidden
    }

    /// A rate beyond the supposed limit shows that nothing clipped.
    fn disprove(&mut self, rate: T, configured: T) -> Hidden<T> {
        let unlimited = Limit::sure(configured);
        let sure = core::mem::replace(self.limit_mut(rate.is_negative()), unlimited).sure;
        let state = core::mem::replace(&mut self.state, State::Clear);
        self.fresh = false;
        self.last = [Some(rate), self.last[0]];
        if sure && state != State::Clear {
            Hidden::Angle(T::ZERO, T::from_f32(MAX_SIGMA))
        } else {
            Hidden::Nothing
        }
    }

    /// Learns the limit from equal rates; true if it has just learned one.
    fn find_limit(&mut self, dt: T, rate: T, configured: T) -> bool {
        let size = rate.abs();
        let limit = self.limit(rate.is_negative()).size;
        if size > self.largest {
            self.largest = size;
        }
        // A rate without examination is below `quiet`.
        let step = match self.last[0] {
            Some(last) => (rate - last).abs(),
            None => size - self.quiet,
        };
        let below = |share: f32| step.within(self.largest * T::from_f32(share));
        let is_first = self.last[0].is_none();
        let is_small = !is_first && below(SMALL_STEP) && step < self.arrival * T::from_f32(SMALLER);
        self.equal = next(self.equal, below(EQUAL));
        self.small = next(self.small, is_small);
        if !is_small {
            self.arrival = step;
        }
        let mut learned = false;
        if size > self.largest * T::from_f32(NEAR) {
            let stays = |steps: u8| {
                steps >= FLAT_STEPS && !(T::from_f32(steps.into()) * dt).within(T::from_f32(FLAT_S))
            };
            let arrived = self.arrival > dt * T::from_f32(ARRIVAL_RAD_S2)
                && self.arrival > self.largest * T::from_f32(ARRIVAL);
            let share = if arrived && stays(self.equal) {
                1.0 - 5.0 * EQUAL
            } else if arrived && stays(self.small) {
                MIXED
            } else {
                f32::INFINITY
            };
            let supposed = size * T::from_f32(share);
            // An exact limit replaces an inexact limit.
            let sharper = self.equal == FLAT_STEPS && supposed.within(limit * T::from_f32(BEYOND));
            if supposed < limit || sharper {
                learned = limit == configured;
                self.fresh |= learned;
                let (size, sure) = (supposed, !self.fresh);
                *self.limit_mut(rate.is_negative()) = Limit { size, sure };
            } else if supposed < T::from_f32(f32::INFINITY) && limit < configured && !self.fresh {
                self.limit_mut(rate.is_negative()).sure = true;
            }
        }
        let quiet = self.largest * T::from_f32(QUIET);
        if quiet > self.quiet {
            self.quiet = quiet;
        }
        learned
    }

    /// The angle that clipping of this duration has hidden, from both slopes.
    fn lost(&self, (before, after): (T, T), time_s: T, negative: bool) -> Hidden<T> {
        let area = (before - after) * time_s * time_s * T::from_f32(1.0 / 12.0);
        let limit = self.limit(negative);
        let at_limit = limit.size * time_s;
        let max = at_limit * T::from_f32(MAX_HIDDEN);
        // An area on the wrong side of the limit is not clipping but noise at it.
        let short = time_s.within(T::from_f32(LONGEST_S));
        let peak = short && (area < T::ZERO) == negative;
        let size = if peak { area.abs().at_most(max) } else { T::ZERO };
        let signed = size.negated(negative);
        match (limit.sure, peak) {
            (true, _) => {}
            (false, true) => return Hidden::Angle(signed, size * T::from_f32(SUPPOSED_SIGMA)),
            (false, false) => return Hidden::Nothing,
        }
        let sigma = at_limit * (T::from_f32(SIGMA.0) + T::from_f32(SIGMA.1) * time_s);
        let (of_area, of_limit) = AREA_SIGMA;
        let bound = area.abs() * T::from_f32(of_area) + at_limit * T::from_f32(of_limit);
        Hidden::Angle(signed, sigma.at_most(bound).at_most(T::from_f32(MAX_SIGMA)))
    }
}

/// The number of samples in a row after the next sample.
fn next(count: u8, is_next: bool) -> u8 {
    if is_next { count.saturating_add(1) } else { 0 }
}

/// Time, within 0..`dt`, in which a rate that changes by `slope` covers `distance`.
fn crossing<T: Real>(distance: T, slope: T, dt: T) -> T {
    let time_s = distance * slope.recip();
    if time_s > T::ZERO && time_s.within(dt) { time_s } else { T::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feed a sine of amplitude 10 rad/s about y, clipped at `clip`; angle given back over the run.
    fn run(range: &mut Range<f64>, clip: f64, seconds: f64) -> (f64, u32) {
        let (dt, mut given, mut times) = (0.0025, 0.0, 0);
        for k in 0..(seconds / dt) as u32 {
            let rate = 10.0 * (f64::from(k) * dt * 12.0).sin();
            let mut gyr = [0.0, rate.clamp(-clip, clip), 0.0];
            if !range.is_quiet(&gyr)
                && let Hidden::Angle(angle, _) = range.examine(dt, &mut gyr)[1]
            {
                given += angle;
                times += 1;
            }
        }
        (given, times)
    }

    #[test]
    fn the_hidden_angle_is_given_back() {
        // Half a period from 0 to pi/12 s: of the area above 8 rad/s, 10/12 * 2 cos(a) - 8 * 2 b /
        // 12 with a = asin(0.8), b = pi/2 - a.
        let b = (0.8f64).acos();
        let hidden = 10.0 / 6.0 * b.sin() - 8.0 * b / 6.0;
        let (given, times) = run(&mut Range::new(7.999), 8.0, 0.26);
        assert_eq!(times, 1);
        assert!((given - hidden).abs() < 0.1 * hidden, "{given} of {hidden}");
    }

    #[test]
    fn a_limit_is_found_and_positive_and_negative_angles_cancel() {
        let mut range = Range::new(34.0);
        let (_, times) = run(&mut range, 8.0, 0.53);
        assert_eq!(times, 2);
        assert!((range.axes[1].limits[0].size - 8.0).abs() < 0.01);
        let (given, _) = run(&mut range, 8.0, 2.63);
        assert!(given.abs() < 0.2, "{given}");
    }

    #[test]
    fn a_limit_blurred_by_the_other_axes_is_found() {
        let mut range = Range::new(34.0);
        let (dt, mut given) = (0.0025, 0.0);
        for k in 0..1000 {
            let t = f64::from(k) * dt;
            // Clipped at 8 and -7.8, then a percent of another axis.
            let rate = (10.0 * (12.0 * t).sin()).clamp(-7.8, 8.0);
            let mut gyr = [0.0, rate + 0.08 * (120.0 * t).cos(), 0.0];
            if !range.is_quiet(&gyr)
                && let Hidden::Angle(angle, _) = range.examine(dt, &mut gyr)[1]
            {
                given += angle.abs();
            }
        }
        let [positive, negative] = range.axes[1].limits.map(|limit| limit.size);
        assert!((7.7..8.1).contains(&positive), "{positive}");
        assert!((7.5..7.9).contains(&negative), "{negative}");
        assert!(given > 0.5, "{given}");
    }

    #[test]
    fn a_steady_spin_is_given_nothing() {
        let mut range = Range::new(34.0);
        for k in 0..4000 {
            let t = f64::from(k) * 0.0025;
            let mut gyr = [0.0, (10.0 * t).min(20.0 * (10.0 - t)).min(5.0), 0.0];
            if !range.is_quiet(&gyr)
                && let Hidden::Angle(angle, _) = range.examine(0.0025, &mut gyr)[1]
            {
                assert_eq!(angle, 0.0);
            }
        }
    }

    #[test]
    fn a_rate_beyond_a_supposed_limit_disproves_it() {
        let mut range = Range::new(34.0);
        run(&mut range, 6.0, 0.53);
        assert!(range.axes[1].limits[0].size < 6.0);
        run(&mut range, 20.0, 0.53);
        assert_eq!(range.axes[1].limits[0].size, 34.0);
    }

    #[test]
    fn a_smooth_motion_below_the_limit_loses_nothing() {
        let (given, times) = run(&mut Range::new(34.0), 20.0, 60.0);
        assert_eq!((given, times), (0.0, 0));
    }

    #[test]
    fn a_limit_is_sure_when_it_is_met_again() {
        let mut range = Range::new(34.0);
        // Half periods of pi/12 s, upwards and downwards in turn.
        let mut clipped = [false; 3];
        for k in 0..307 {
            let t = f64::from(k) * 0.0025;
            let mut gyr = [0.0, (10.0 * (12.0 * t).sin()).clamp(-8.0, 8.0), 0.0];
            if !range.is_quiet(&gyr)
                && range.examine(0.0025, &mut gyr)[1]
                    == Hidden::Rate(range.axes[1].limit(gyr[1] < 0.0).size)
            {
                clipped[(t / core::f64::consts::PI * 12.0) as usize] = true;
            }
        }
        assert_eq!(clipped, [false, true, true]);
    }
}
