//! What `tvc fuse` found.

use recordings::{Choice, Mode, Score};
use report::measure::{Figure, Figures, figure, rows};

/// A recording.
#[derive(Debug, Default)]
pub struct Recording {
    /// Its name.
    pub file: String,
    /// File of its estimates, if one was asked for.
    pub out: Option<String>,
    /// Number of samples, and of estimates.
    pub samples: u64,
    /// Number of samples with a fresh magnetic field.
    pub magnetometer_samples: u64,
    /// Errors over the movement; nothing without a reference.
    pub score: Option<Score>,
}

/// Scores of the recordings and their mean. In 6D only the inclination means something.
pub fn figures(choice: &Choice, offline: bool, recordings: &[Recording]) -> Figures {
    let has_heading = choice.mode == Mode::NineD;
    let row = |recording: &Recording| {
        let file = figure("file", &*recording.file);
        [
            // The table has those that are scored.
            match recording.score {
                Some(_) => file.shown("recording", "", 0),
                None => file,
            },
            figure("out", recording.out.clone()),
            figure("samples", recording.samples),
            figure("magnetometer_samples", recording.magnetometer_samples),
            figure("score", recording.score.map(|score| score_figures(score, has_heading, ""))),
        ]
    };
    let scores: Vec<Score> = recordings.iter().filter_map(|recording| recording.score).collect();
    let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    let mean = (!scores.is_empty()).then(|| Score {
        total_deg: mean(|score| score.total_deg),
        heading_deg: mean(|score| score.heading_deg),
        inclination_deg: mean(|score| score.inclination_deg),
        samples: scores.iter().map(|score| score.samples).sum(),
    });
    let mean = figure("mean", mean.map(|mean| score_figures(mean, has_heading, "mean ")));
    Figures::from([
        figure("filter", choice.filter.to_string()),
        figure("mode", choice.mode.to_string()),
        figure("scalar", choice.scalar.to_string()),
        figure("offline", offline),
        rows("files", recordings.iter().map(row)),
        if scores.len() > 1 { mean } else { mean.unseen() },
    ])
}

fn score_figures(score: Score, has_heading: bool, of: &str) -> [Figure; 4] {
    let deg = |key, label, value: Option<f64>| match value {
        Some(deg) => figure(key, deg).shown(format!("{of}{label}"), "deg RMSE", 3),
        None => figure(key, value),
    };
    [
        deg("total_deg", "total", has_heading.then_some(score.total_deg)),
        deg("heading_deg", "heading", has_heading.then_some(score.heading_deg)),
        deg("inclination_deg", "inclination", Some(score.inclination_deg)),
        figure("samples", score.samples).shown(format!("{of}samples"), "", 0),
    ]
}

/// Notes on recordings that lack a magnetometer, or the reference that a score needs.
pub fn notes(mode: Mode, scored: bool, recordings: &[Recording]) -> Vec<String> {
    let note = |recording: &Recording| {
        let file = &recording.file;
        let no_field = mode == Mode::NineD && recording.magnetometer_samples == 0;
        let no_score = scored && recording.score.is_none();
        [
            no_field.then(|| format!("{file} has no magnetometer: its heading drifts")),
            no_score.then(|| format!("{file} has no reference in motion: no score")),
        ]
    };
    recordings.iter().flat_map(note).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use recordings::{FilterName, Scalar};

    fn recordings(inclinations: &[Option<f64>]) -> Vec<Recording> {
        let recording = |inclination: &Option<f64>| Recording {
            file: "walk".into(),
            out: None,
            samples: 20,
            magnetometer_samples: 0,
            score: inclination.map(|inclination_deg| Score {
                total_deg: 3.0 * inclination_deg,
                heading_deg: 2.0 * inclination_deg,
                inclination_deg,
                samples: 10,
            }),
        };
        inclinations.iter().map(recording).collect()
    }

    fn found(mode: Mode, inclinations: &[Option<f64>]) -> (serde_json::Value, String) {
        let choice =
            Choice { filter: FilterName::Vqf, scalar: Scalar::F32, mode, settings: Vec::new() };
        let figures = figures(&choice, false, &recordings(inclinations));
        (serde_json::json!(figures), figures.text())
    }

    #[test]
    fn the_mean_is_of_recordings_and_leaves_out_those_without_a_score() {
        let (object, text) = found(Mode::NineD, &[None, Some(1.0), Some(2.0)]);
        assert_eq!(object["mean"]["total_deg"], 4.5);
        assert_eq!(object["mean"]["inclination_deg"], 1.5);
        assert!(object["files"][0]["score"].is_null());
        assert!(text.contains("mean total") && text.matches("walk").count() == 2, "{text}");
        let (object, text) = found(Mode::NineD, &[None]);
        assert!(object["mean"].is_null() && text.is_empty(), "{text}");
    }

    #[test]
    fn without_a_magnetometer_only_the_inclination_is_given() {
        let (object, text) = found(Mode::SixD, &[Some(1.0), Some(2.0)]);
        assert!(object["mean"]["total_deg"].is_null());
        assert_eq!(object["mean"]["inclination_deg"], 1.5);
        assert!(!text.contains("mean total") && text.contains("mean inclination"), "{text}");
        assert!(notes(Mode::SixD, true, &recordings(&[Some(1.0)])).is_empty());
    }

    #[test]
    fn what_is_missing_is_noted() {
        let notes = notes(Mode::NineD, true, &recordings(&[None]));
        assert!(notes[0].contains("no magnetometer") && notes[1].contains("no reference"));
    }
}
