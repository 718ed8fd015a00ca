//! What a person is asked to do with the vehicle, step by step, while it is calibrated.
//!
//! `tvc calibrate` shows an instruction on the screen and sends it down the link as STATUSTEXT, where the firmware passes it
//! over: a log of the link says what was asked for and when, and the virtual rig's [`Pilot`](crate::pilot::Pilot) obeys it.

use mavlink::dialects::common::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;
use tvc_nano::calibration::poses::Face;

/// A step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instruction {
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
    /// Back upright.
    Upright,
}

impl Instruction {
    /// Every instruction.
    pub fn all() -> impl Iterator<Item = Self> {
        let poses = Face::ALL.into_iter().map(Self::Pose);
        let tilts = [Tilt::NoseUp, Tilt::NoseDown, Tilt::Upright].map(Self::Tilt);
        [Self::Rest, Self::Turn, Self::Level, Self::Done]
            .into_iter()
            .chain(poses)
            .chain(tilts)
    }

    /// In words, at most the 50 characters of a STATUSTEXT.
    pub fn text(self) -> String {
        match self {
            Self::Rest => "calibration: lay the sensor down, leave it".into(),
            Self::Pose(face) => format!("calibration: rest it {}", face.name()),
            Self::Turn => "calibration: turn it through all directions".into(),
            Self::Level => "calibration: stand the body level".into(),
            Self::Tilt(Tilt::NoseUp) => "calibration: tilt the vehicle nose up".into(),
            Self::Tilt(Tilt::NoseDown) => "calibration: tilt the vehicle nose down".into(),
            Self::Tilt(Tilt::Upright) => "calibration: hold the vehicle upright".into(),
            Self::Done => "calibration: done".into(),
        }
    }

    /// As a message.
    pub fn message(self) -> MavMessage {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: MavSeverity::MAV_SEVERITY_NOTICE,
            text: CharArray::from(self.text().as_str()),
        })
    }

    /// The instruction in a message, if there is one.
    pub fn of(message: &MavMessage) -> Option<Self> {
        let MavMessage::STATUSTEXT(said) = message else {
            return None;
        };
        let said = said.text.to_str().ok()?;
        Self::all().find(|instruction| instruction.text() == said)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use client::request;

    #[test]
    fn every_instruction_is_understood_and_nothing_else() {
        assert_eq!(Instruction::all().count(), 13);
        for instruction in Instruction::all() {
            assert!(instruction.text().len() <= 50, "{}", instruction.text());
            assert_eq!(Instruction::of(&instruction.message()), Some(instruction));
        }
        assert_eq!(Instruction::of(&request::heartbeat()), None);
    }
}
