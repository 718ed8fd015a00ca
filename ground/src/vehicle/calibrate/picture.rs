//! The directions that were seen, as a picture of characters for the terminal.

use calibration::coverage::Coverage;

/// Rows of the sphere from the top down, azimuth along each: full cells were seen often, empty ones
/// never.
pub fn picture(coverage: &Coverage) -> String {
    let rows = coverage.counts().iter().rev().map(|band| {
        let cells = band.iter().map(|count| match count {
            0 => " \u{b7} ",
            1..=3 => "\u{2591}\u{2591}\u{2591}",
            4..=9 => "\u{2592}\u{2592}\u{2592}",
            _ => "\u{2588}\u{2588}\u{2588}",
        });
        format!("   |{}|", cells.collect::<String>())
    });
    let mut text = rows.collect::<Vec<_>>().join("\n");
    text.push_str("\n    -180 deg  azimuth of the field  180");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn what_was_seen_is_filled_with_the_top_above() {
        let up: Coverage = [Vector3::new(0.1, 0.1, 1.0); 4].into_iter().collect();
        let text = picture(&up);
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(rows.len(), 7);
        assert!(rows[0].contains("\u{2592}\u{2592}\u{2592}"), "{text}");
        assert!(!rows[1].contains('\u{2592}'), "{text}");
        assert!(rows[0].matches('\u{b7}').count() == 7);
    }
}
