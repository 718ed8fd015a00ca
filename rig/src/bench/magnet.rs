//! A magnet that is led past the sensor: a screwdriver, a loudspeaker, a hand with a tool.

/// How far before and behind the nearest point the way goes, in distances at that point.
const REACH: f64 = 4.0;

/// A magnet that passes the sensor on a straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnet {
    /// Its field where it is nearest, along the sensor's axes, uT.
    pub field_ut: [f64; 3],
    /// How long it takes, s.
    pub seconds: f64,
}

impl Magnet {
    /// Its field along the sensor's axes so long after its begin, s, uT: that of a dipole, by the
    /// third power of its distance.
    pub(super) fn at(&self, since_s: f64) -> [f64; 3] {
        if since_s >= self.seconds {
            return [0.0; 3];
        }
        let along = REACH * (2.0 * since_s / self.seconds - 1.0);
        let share = (1.0 + along * along).powf(-1.5);
        self.field_ut.map(|field| field * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_strongest_half_way_and_gone_in_the_end() {
        let magnet = Magnet { field_ut: [800.0, 0.0, -80.0], seconds: 2.0 };
        assert_eq!(magnet.at(1.0), [800.0, 0.0, -80.0]);
        // A quarter of the way is as far again from the nearest point as that is away, twice.
        let [near, ..] = magnet.at(0.5);
        assert!((near - 800.0 / 5_f64.powf(1.5)).abs() < 1e-9, "{near}");
        let [begin, ..] = magnet.at(0.0);
        assert!(begin < 12.0 && magnet.at(2.0) == [0.0; 3], "{begin}");
    }
}
