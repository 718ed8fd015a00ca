//! What `tvc fuse` found, for scripts and for people.

use std::fmt::Write;

use recordings::{Choice, Mode, Score};
use serde::Serialize;

/// Everything, as printed by `--json`.
#[derive(Debug, Serialize)]
pub struct Figures {
    filter: String,
    mode: String,
    scalar: String,
    /// Both directions of time.
    offline: bool,
    files: Vec<FileFigures>,
    /// Means over the recordings that have a score; `null` if none has.
    mean: Option<ScoreFigures>,
}

/// A recording.
#[derive(Debug, Serialize)]
pub struct FileFigures {
    /// Its name.
    pub file: String,
    /// File of its estimates, if one was asked for.
    pub out: Option<String>,
    /// Number of samples, and of estimates.
    pub samples: u64,
    /// Number of samples with a fresh magnetic field.
    pub magnetometer_samples: u64,
    /// Errors; `null` without a reference.
    pub score: Option<ScoreFigures>,
}

/// Degrees RMSE over the movement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScoreFigures {
    /// Error of the whole rotation; `null` in 6D, where there is no heading.
    pub total_deg: Option<f64>,
    /// Error about the vertical; `null` in 6D.
    pub heading_deg: Option<f64>,
    /// Error of the vertical.
    pub inclination_deg: f64,
    /// Number of samples that count.
    pub samples: u64,
}

impl From<Score> for ScoreFigures {
    fn from(score: Score) -> Self {
        Self {
            total_deg: Some(score.total_deg),
            heading_deg: Some(score.heading_deg),
            inclination_deg: score.inclination_deg,
            samples: score.samples as u64,
        }
    }
}

impl Figures {
    /// Without a recording yet.
    pub fn new(choice: &Choice, offline: bool) -> Self {
        Self {
            filter: choice.filter.to_string(),
            mode: choice.mode.to_string(),
            scalar: choice.scalar.to_string(),
            offline,
            files: Vec::new(),
            mean: None,
        }
    }

    /// Adds a recording.
    pub fn add(&mut self, mode: Mode, mut file: FileFigures) {
        if let Some(score) = &mut file.score
            && mode == Mode::SixD
        {
            (score.total_deg, score.heading_deg) = (None, None);
        }
        self.files.push(file);
        self.mean = self.means();
    }

    fn means(&self) -> Option<ScoreFigures> {
        let scores: Vec<_> = self.files.iter().filter_map(|file| file.score).collect();
        let mean = |of: fn(&ScoreFigures) -> Option<f64>| -> Option<f64> {
            let sum: f64 = scores.iter().map(of).sum::<Option<f64>>()?;
            (!scores.is_empty()).then(|| sum / scores.len() as f64)
        };
        Some(ScoreFigures {
            total_deg: mean(|score| score.total_deg),
            heading_deg: mean(|score| score.heading_deg),
            inclination_deg: mean(|score| Some(score.inclination_deg))?,
            samples: scores.iter().map(|score| score.samples).sum(),
        })
    }

    /// Notes on recordings that lack a magnetometer, or the reference that a score needs.
    pub fn notes(&self, mode: Mode, scored: bool) -> Vec<String> {
        let mut notes = Vec::new();
        for FileFigures { file, .. } in self
            .files
            .iter()
            .filter(|file| mode == Mode::NineD && file.magnetometer_samples == 0)
        {
            notes.push(format!("{file} has no magnetometer: its heading drifts"));
        }
        for FileFigures { file, .. } in self
            .files
            .iter()
            .filter(|file| scored && file.score.is_none())
        {
            notes.push(format!("{file} has no reference in motion: no score"));
        }
        notes
    }

    /// Where estimates were written.
    pub fn written(&self) -> impl Iterator<Item = &str> {
        self.files.iter().filter_map(|file| file.out.as_deref())
    }

    /// A line for each recording that has a score, and for their mean.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, score: &ScoreFigures| {
            let part = |name: &str, value: Option<f64>| {
                value.map_or(String::new(), |value| format!("{name} {value:.3}  "))
            };
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{name}: {}{}inclination {:.3} deg RMSE over {} samples",
                part("total", score.total_deg),
                part("heading", score.heading_deg),
                score.inclination_deg,
                score.samples
            );
        };
        let mut scored = 0;
        for file in &self.files {
            if let Some(score) = &file.score {
                line(&file.file, score);
                scored += 1;
            }
        }
        if let Some(mean) = &self.mean
            && scored > 1
        {
            line(&format!("mean of {scored}"), mean);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use recordings::{FilterName, Scalar};

    fn figures(mode: Mode, inclinations: &[Option<f64>]) -> Figures {
        let choice = Choice {
            filter: FilterName::Vqf,
            scalar: Scalar::F32,
            mode,
            settings: Vec::new(),
        };
        let mut figures = Figures::new(&choice, false);
        for inclination in inclinations {
            let score = inclination.map(|inclination_deg| ScoreFigures {
                total_deg: Some(3.0 * inclination_deg),
                heading_deg: Some(2.0 * inclination_deg),
                inclination_deg,
                samples: 10,
            });
            let file = FileFigures {
                file: "walk".into(),
                out: None,
                samples: 20,
                magnetometer_samples: 0,
                score,
            };
            figures.add(mode, file);
        }
        figures
    }

    #[test]
    fn the_mean_is_of_recordings_and_leaves_out_those_without_a_score() {
        let mean = figures(Mode::NineD, &[Some(1.0), None, Some(2.0)])
            .mean
            .unwrap();
        assert_eq!((mean.total_deg, mean.inclination_deg), (Some(4.5), 1.5));
        assert_eq!(figures(Mode::NineD, &[None]).mean, None);
    }

    #[test]
    fn without_a_magnetometer_only_the_inclination_is_given() {
        let figures = figures(Mode::SixD, &[Some(1.0), Some(2.0)]);
        let mean = figures.mean.unwrap();
        assert_eq!((mean.total_deg, mean.inclination_deg), (None, 1.5));
        assert!(!figures.text().contains("total") && figures.text().contains("mean of 2"));
        assert!(figures.notes(Mode::SixD, true).is_empty());
    }

    #[test]
    fn what_is_missing_is_noted() {
        let notes = figures(Mode::NineD, &[None]).notes(Mode::NineD, true);
        assert!(notes[0].contains("no magnetometer") && notes[1].contains("no reference"));
    }
}
