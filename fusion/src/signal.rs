//! Small filters for one sensor axis: windows of fixed size, no allocation.
//!
//! | filter | delay in samples | good for |
//! |---|---|---|
//! | [`MovingAverage`] | `(N - 1) / 2`, exactly, at every frequency | white noise |
//! | [`Exponential`] | `w / (1 - w)` for slow signals | white noise, with one number of memory |
//! | [`Weighted`] | the centre of its weights | less delay, more noise: newer samples count more |
//! | [`Median`] | `(N - 1) / 2` for a ramp | single outliers, which it removes |
//! | [`SavitzkyGolay`] | `(N - 1) / 2` | the height of peaks: it follows a parabola exactly |
//!
//! Until a window is full, each filter uses the samples so far: the first output is the first
//! input. Keep NaN out: it stays in a window for `N` samples and in [`Exponential`] for ever.

use core::array;

/// The last `N` samples, oldest first after [`Window::in_order`].
#[derive(Clone, Debug)]
struct Window<const N: usize> {
    samples: [f32; N],
    next: usize,
    count: usize,
}

impl<const N: usize> Default for Window<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Window<N> {
    const fn new() -> Self {
        const { assert!(N > 0, "a window holds at least one sample") };
        Self { samples: [0.0; N], next: 0, count: 0 }
    }

    fn push(&mut self, sample: f32) {
        if let Some(place) = self.samples.get_mut(self.next) {
            *place = sample;
        }
        self.next = (self.next + 1) % N;
        self.count = (self.count + 1).min(N);
    }

    /// The samples so far, oldest first.
    fn in_order(&self) -> impl DoubleEndedIterator<Item = f32> {
        let first = self.next + N - self.count;
        (0..self.count).filter_map(move |i| self.samples.get((first + i) % N).copied())
    }

    /// Their mean.
    fn mean(&self) -> f32 {
        self.in_order().sum::<f32>() / self.count as f32
    }
}

/// The mean of the last `N` samples. Delay `(N - 1) / 2` samples at every frequency; noise falls to
/// `1 / sqrt(N)`.
#[derive(Clone, Debug, Default)]
pub struct MovingAverage<const N: usize> {
    window: Window<N>,
}

impl<const N: usize> MovingAverage<N> {
    /// An empty window.
    pub const fn new() -> Self {
        Self { window: Window::new() }
    }

    /// Take a sample, give the mean. It sums anew each time, because a running sum would keep its
    /// rounding for ever.
    pub fn update(&mut self, sample: f32) -> f32 {
        self.window.push(sample);
        self.window.mean()
    }
}

/// Exponential moving average: `y += (1 - w)(x - y)`. Delay `w / (1 - w)` samples for signals that
/// are slow beside it; noise falls to `sqrt((1 - w) / (1 + w))`.
#[derive(Clone, Debug)]
pub struct Exponential {
    weight: f32,
    mean: Option<f32>,
}

impl Exponential {
    /// With the weight of the past, clamped to 0..=1. A weight that is not a number counts as 0:
    /// no filter.
    pub const fn new(weight: f32) -> Self {
        let weight = if weight > 1.0 { 1.0 } else { weight };
        Self { weight: if weight > 0.0 { weight } else { 0.0 }, mean: None }
    }

    /// Take a sample, give the mean.
    pub fn update(&mut self, sample: f32) -> f32 {
        let mean = self.mean.unwrap_or(sample);
        let mean = mean + (1.0 - self.weight) * (sample - mean);
        self.mean = Some(mean);
        mean
    }
}

/// The weighted mean of the last `N` samples. Delay: the weights' centre, so `(N - 1) / 3` samples
/// for [`Weighted::linear`].
#[derive(Clone, Debug)]
pub struct Weighted<const N: usize> {
    window: Window<N>,
    /// Newest first.
    weights: [f32; N],
}

impl<const N: usize> Weighted<N> {
    /// With weights from the newest sample to the oldest. `None` if a weight is negative or not
    /// finite, or the newest sample's is 0.
    pub fn new(weights: [f32; N]) -> Option<Self> {
        let is_size = |weight| (0.0..f32::INFINITY).contains(weight);
        let valid = weights.iter().all(is_size);
        let newest = weights.first().is_some_and(|weight| *weight > 0.0);
        (valid && newest).then(|| Self { window: Window::new(), weights })
    }

    /// Weights `N` for the newest sample down to 1 for the oldest.
    pub fn linear() -> Self {
        Self { window: Window::new(), weights: array::from_fn(|age| (N - age) as f32) }
    }

    /// Take a sample, give the weighted mean.
    pub fn update(&mut self, sample: f32) -> f32 {
        self.window.push(sample);
        let pairs = || self.window.in_order().rev().zip(&self.weights);
        let sum: f32 = pairs().map(|(sample, weight)| sample * weight).sum();
        let total: f32 = pairs().map(|(_, weight)| weight).sum();
        sum / total
    }
}

/// The median of the last `N` samples (the mean of the middle two for an even number). Removes
/// outliers of up to `(N - 1) / 2` samples altogether; a ramp comes out `(N - 1) / 2` samples late.
#[derive(Clone, Debug, Default)]
pub struct Median<const N: usize> {
    window: Window<N>,
}

impl<const N: usize> Median<N> {
    /// An empty window.
    pub const fn new() -> Self {
        Self { window: Window::new() }
    }

    /// Take a sample, give the median.
    pub fn update(&mut self, sample: f32) -> f32 {
        self.window.push(sample);
        let mut sorted = [f32::INFINITY; N];
        for (place, sample) in sorted.iter_mut().zip(self.window.in_order()) {
            *place = sample;
        }
        // Places that are still empty sort to the end; so does NaN.
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |i: usize| sorted.get(i).copied().unwrap_or_default();
        let count = self.window.count;
        if count % 2 == 1 { at(count / 2) } else { 0.5 * (at(count / 2 - 1) + at(count / 2)) }
    }
}

/// Savitzky-Golay smoothing: the middle of the parabola that fits the last `N` samples best.
///
/// A. Savitzky, M. Golay, "Smoothing and differentiation of data by simplified least squares
/// procedures", Analytical Chemistry 36(8), 1964. Delay `(N - 1) / 2` samples at every frequency.
/// Parabolas pass unchanged; more of an outlier passes than through a mean. `N` is odd and at
/// least 3. Until the window is full, the output is the mean of the samples so far.
#[derive(Clone, Debug)]
pub struct SavitzkyGolay<const N: usize> {
    window: Window<N>,
    weights: [f32; N],
}

impl<const N: usize> SavitzkyGolay<N> {
    /// An empty window.
    ///
    /// With `m = (N - 1) / 2`, the weight of the sample `k` steps from the middle is
    /// `3 (3 m^2 + 3 m - 1 - 5 k^2) / ((2 m + 3)(2 m + 1)(2 m - 1))`.
    pub fn new() -> Self {
        const { assert!(N % 2 == 1 && N >= 3, "a middle and both its sides") };
        let m = (N / 2) as f32;
        let total = (2.0 * m + 3.0) * (2.0 * m + 1.0) * (2.0 * m - 1.0);
        let weights = array::from_fn(|i| {
            let k = i as f32 - m;
            3.0 * (3.0 * m * m + 3.0 * m - 1.0 - 5.0 * k * k) / total
        });
        Self { window: Window::new(), weights }
    }

    /// Take a sample, give the smoothed value in the middle of the window.
    pub fn update(&mut self, sample: f32) -> f32 {
        self.window.push(sample);
        if self.window.count < N {
            return self.window.mean();
        }
        let pairs = self.window.in_order().zip(&self.weights);
        pairs.map(|(sample, weight)| sample * weight).sum()
    }
}

impl<const N: usize> Default for SavitzkyGolay<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// Delay behind a ramp of slope 1, once the window is full.
    fn ramp_delay(mut update: impl FnMut(f32) -> f32) -> f32 {
        (0..400).map(|k| k as f32 - update(k as f32)).last().expect("some samples")
    }

    #[test]
    fn delays_are_as_documented() {
        let mut average = MovingAverage::<9>::new();
        assert!((ramp_delay(|x| average.update(x)) - 4.0).abs() < 1e-4);
        let mut exponential = Exponential::new(0.9);
        assert!((ramp_delay(|x| exponential.update(x)) - 9.0).abs() < 1e-3);
        let mut weighted = Weighted::<10>::linear();
        assert!((ramp_delay(|x| weighted.update(x)) - 3.0).abs() < 1e-4);
        let mut median = Median::<7>::new();
        assert!((ramp_delay(|x| median.update(x)) - 3.0).abs() < 1e-4);
        let mut savitzky_golay = SavitzkyGolay::<11>::new();
        assert!((ramp_delay(|x| savitzky_golay.update(x)) - 5.0).abs() < 1e-3);
    }

    #[test]
    fn the_weights_of_five_are_those_of_the_paper() {
        let expected = [-3.0, 12.0, 17.0, 12.0, -3.0].map(|w: f32| w / 35.0);
        for (ours, theirs) in SavitzkyGolay::<5>::new().weights.iter().zip(expected) {
            assert!((ours - theirs).abs() < 1e-6);
        }
    }

    #[test]
    fn a_parabola_passes_savitzky_golay_unchanged() {
        let mut filter = SavitzkyGolay::<7>::new();
        let parabola = |t: f32| 0.5 * t * t - 3.0 * t + 2.0;
        for k in 0..20 {
            let smooth = filter.update(parabola(k as f32));
            if k >= 6 {
                assert!((smooth - parabola(k as f32 - 3.0)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn an_outlier_does_not_reach_the_median() {
        let mut filter = Median::<5>::new();
        let out: Vec<f32> =
            [1.0, 1.0, 1.0, 100.0, 1.0, 1.0, -50.0, 1.0].map(|x| filter.update(x)).into();
        assert!(out.iter().all(|y| *y == 1.0), "{out:?}");
    }

    #[test]
    fn weights_by_hand() {
        let mut filter = Weighted::new([0.5, 0.3, 0.2]).expect("valid");
        filter.update(1.0);
        filter.update(2.0);
        assert!((filter.update(3.0) - (0.5 * 3.0 + 0.3 * 2.0 + 0.2)).abs() < 1e-6);
        assert!(Weighted::new([0.0, 1.0]).is_none());
        assert!(Weighted::new([1.0, f32::NAN]).is_none());
    }

    #[test]
    fn impossible_weights_are_clamped() {
        assert_eq!(Exponential::new(f32::NAN).update(3.0), 3.0);
        let mut stuck = Exponential::new(7.0);
        stuck.update(1.0);
        assert_eq!(stuck.update(5.0), 1.0);
    }

    proptest! {
        #[test]
        fn a_constant_passes_and_outputs_stay_within_the_inputs(xs in prop::collection::vec(-1e3f32..1e3, 1..60)) {
            let (low, high) = xs.iter().fold((f32::MAX, f32::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
            let (mut a, mut e, mut w, mut m) =
                (MovingAverage::<8>::new(), Exponential::new(0.9), Weighted::<8>::linear(), Median::<8>::new());
            for x in &xs {
                for y in [a.update(*x), e.update(*x), w.update(*x), m.update(*x)] {
                    prop_assert!((low - 1e-2..=high + 1e-2).contains(&y));
                }
            }
            let first = xs.first().copied().unwrap_or_default();
            let mut s = SavitzkyGolay::<9>::new();
            for _ in 0..20 {
                prop_assert!((s.update(first) - first).abs() <= 1e-3);
            }
        }

        #[test]
        fn the_median_is_that_of_a_sorted_window(xs in prop::collection::vec(-1e3f32..1e3, 7..40)) {
            let mut filter = Median::<7>::new();
            let last = xs.iter().map(|x| filter.update(*x)).last().expect("some samples");
            let mut window: Vec<f32> = xs.iter().rev().take(7).copied().collect();
            window.sort_by(f32::total_cmp);
            prop_assert_eq!(Some(&last), window.get(3));
        }
    }
}
