//! An angle as a line of characters.

/// Half the width of a gauge, characters.
const HALF_GAUGE: i32 = 15;
/// Angle at the end of the gauge, deg.
const GAUGE_DEG: f64 = 60.0;

/// An angle as a mark on a scale with zero in the middle.
pub fn gauge(angle_deg: f64) -> String {
    let at = (angle_deg / GAUGE_DEG * f64::from(HALF_GAUGE)).round() as i32;
    let at = at.clamp(-HALF_GAUGE, HALF_GAUGE);
    (-HALF_GAUGE..=HALF_GAUGE)
        .map(|i| match i {
            i if i == at => '#',
            0 => '|',
            _ => '.',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gauge_has_its_mark_where_the_angle_is_and_stays_its_width() {
        assert_eq!(gauge(0.0).find('#'), Some(15));
        assert_eq!(gauge(60.0).find('#'), Some(30));
        assert_eq!(gauge(-500.0).find('#'), Some(0));
        assert!(gauge(30.0).contains('|'));
        assert_eq!(gauge(f64::NAN).len(), 31);
    }
}
