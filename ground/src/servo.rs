//! The servos that the rig and the model know, as commands take them.

use clap::ValueEnum;
use rig::ServoKind;
use tvc_nano::Params;

/// The servos that the rig models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ServoChoice {
    /// Analog, Futaba S3003 class: 0.19 s for 60 degrees, 50 Hz frame.
    S3003,
    /// Digital: 0.12 s for 60 degrees, 300 Hz frame.
    Digital,
}

impl ServoChoice {
    /// The servo that firmware parameters are for, by their frame rate.
    pub fn of(params: &Params) -> Self {
        if params.srv_rate_hz() >= ServoKind::Digital.frame_hz() {
            Self::Digital
        } else {
            Self::S3003
        }
    }

    /// As the rig knows it.
    pub fn kind(self) -> ServoKind {
        match self {
            Self::S3003 => ServoKind::S3003,
            Self::Digital => ServoKind::Digital,
        }
    }

    /// As it is typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::S3003 => "s3003",
            Self::Digital => "digital",
        }
    }
}
