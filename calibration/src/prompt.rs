//! What a person is asked to do with the vehicle, step by step, while it is calibrated.
//!
//! `tvc calibrate` shows a prompt on the screen and sends its text down the link as STATUSTEXT,
//! which the firmware ignores. So a log of the link says what was asked for and when, and the
//! virtual rig does what a person would do.

use crate::poses::Face;

/// A step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prompt {
    /// Lay the sensor down and leave it.
    Rest,
    /// Rest it on a face.
    Pose(Face),
    /// Turn it through all directions.
    Turn,
    /// Stand the body level.
    Level,
    /// Tilt the vehicle by hand.
    Tilt(Tilt),
    /// That is all.
    Done,
}

/// How the vehicle is tilted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tilt {
    /// Nose up, some 20 deg.
    NoseUp,
    /// Nose down, some 20 deg.
    NoseDown,
    /// Right side down, some 20 deg.
    RightDown,
    /// Left side down, some 20 deg.
    LeftDown,
    /// Back upright.
    Upright,
}

impl Tilt {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoseUp => "nose up",
            Self::NoseDown => "nose down",
            Self::RightDown => "right side down",
            Self::LeftDown => "left side down",
            Self::Upright => "upright",
        }
    }
}

impl Prompt {
    /// Every prompt.
    pub fn all() -> impl Iterator<Item = Self> {
        let poses = Face::ALL.into_iter().map(Self::Pose);
        let tilts = [Tilt::NoseUp, Tilt::NoseDown, Tilt::RightDown, Tilt::LeftDown, Tilt::Upright]
            .map(Self::Tilt);
        [Self::Rest, Self::Turn, Self::Level, Self::Done].into_iter().chain(poses).chain(tilts)
    }

    /// In words, at most the 50 characters of a STATUSTEXT.
    pub fn text(self) -> String {
        match self {
            Self::Rest => "calibration: lay the sensor down, leave it".into(),
            Self::Pose(face) => format!("calibration: rest it {}", face.name()),
            Self::Turn => "calibration: turn it through all directions".into(),
            Self::Level => "calibration: stand the body level".into(),
            Self::Tilt(Tilt::Upright) => "calibration: hold the vehicle upright".into(),
            Self::Tilt(way) => format!("calibration: tilt the vehicle {}", way.name()),
            Self::Done => "calibration: done".into(),
        }
    }

    /// The prompt with this text, if there is one.
    pub fn from_text(text: &str) -> Option<Self> {
        Self::all().find(|prompt| prompt.text() == text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_prompt_is_understood_and_nothing_else() {
        assert_eq!(Prompt::all().count(), 15);
        for prompt in Prompt::all() {
            assert!(prompt.text().len() <= 50, "{}", prompt.text());
            assert_eq!(Prompt::from_text(&prompt.text()), Some(prompt));
        }
        assert_eq!(Prompt::from_text("calibration"), None);
    }
}
