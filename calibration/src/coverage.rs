//! How much of the sphere of directions a recording covers.

use nalgebra::Vector3;

/// Cells round the vertical axis.
pub const AROUND: usize = 8;
/// Bands from the lowest to the highest direction, of equal area: equal steps of the sine of
/// elevation.
pub const BANDS: usize = 6;

/// How often each cell of the sphere was seen; all cells have the same area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    counts: [[u32; AROUND]; BANDS],
}

impl Coverage {
    /// The directions from the middle of the readings, as long as no ellipsoid fits them.
    pub fn about_middle<'a>(readings: impl Iterator<Item = &'a Vector3<f64>> + Clone) -> Self {
        let (middle, _) = extent(readings.clone());
        readings.map(|reading| reading - middle).collect()
    }

    /// Counts a direction; its length does not matter, and a zero one is ignored.
    fn add(&mut self, direction: &Vector3<f64>) {
        let norm = direction.norm();
        if norm.is_nan() || norm <= 0.0 {
            return;
        }
        let cell = |share: f64, of: usize| ((share * of as f64) as usize).min(of - 1);
        let band = cell((direction.z / norm + 1.0) / 2.0, BANDS);
        let turn = libm::atan2(direction.y, direction.x) / std::f64::consts::TAU + 0.5;
        let count = self.counts.get_mut(band).and_then(|band| band.get_mut(cell(turn, AROUND)));
        if let Some(count) = count {
            *count = count.saturating_add(1);
        }
    }

    /// Share of the cells that were seen, 0 to 1.
    pub fn share(&self) -> f64 {
        let cells = self.counts.as_flattened();
        cells.iter().filter(|count| **count > 0).count() as f64 / cells.len() as f64
    }

    /// How often each cell was seen: bands from -z to +z, in each from the azimuth -180 deg on.
    pub fn counts(&self) -> &[[u32; AROUND]; BANDS] {
        &self.counts
    }
}

impl FromIterator<Vector3<f64>> for Coverage {
    fn from_iter<I: IntoIterator<Item = Vector3<f64>>>(directions: I) -> Self {
        let mut coverage = Self::default();
        for direction in directions {
            coverage.add(&direction);
        }
        coverage
    }
}

/// The middle of the ranges of the readings, and the largest distance from it.
pub(crate) fn extent<'a>(
    mut readings: impl Iterator<Item = &'a Vector3<f64>> + Clone,
) -> (Vector3<f64>, f64) {
    let all = readings.clone();
    let Some(first) = readings.next() else {
        return (Vector3::zeros(), 0.0);
    };
    let (low, high) = readings.fold((*first, *first), |(low, high), m| (low.inf(m), high.sup(m)));
    let middle = (low + high) / 2.0;
    (middle, all.map(|m| (m - middle).norm()).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_equal_areas() {
        // Evenly spread points: Fibonacci's lattice.
        let points: Vec<Vector3<f64>> = (0..4800)
            .map(|i| {
                let z = (f64::from(i) + 0.5) / 2400.0 - 1.0;
                let turn = f64::from(i) * 2.399_963_229_728_653;
                let r = (1.0 - z * z).sqrt();
                Vector3::new(r * turn.cos(), r * turn.sin(), z) * 50.0
            })
            .collect();
        let coverage: Coverage = points.into_iter().collect();
        assert_eq!(coverage.share(), 1.0);
        for count in coverage.counts().as_flattened() {
            assert!((85..=115).contains(count), "{count}");
        }
    }

    #[test]
    fn a_turn_about_one_axis_is_little() {
        let ring: Vec<Vector3<f64>> = (0..360)
            .map(|deg| f64::from(deg).to_radians())
            .map(|a| Vector3::new(a.cos(), a.sin(), 0.5))
            .collect();
        let coverage: Coverage = ring.into_iter().collect();
        assert_eq!(coverage.share(), 8.0 / 48.0);
        assert_eq!(Coverage::from_iter([Vector3::zeros()]).share(), 0.0);
    }
}
