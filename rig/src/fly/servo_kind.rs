//! The servos that the drone flies with.

use crate::named_enum::named_enum;
use plant::ServoModel;

named_enum! {
    /// The servo on the rig, with what the image must be told about it.
    #[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
    ServoKind, "servo";
    /// Analog, Futaba S3003 class: 0.19 s for 60 degrees, 50 Hz frame.
    S3003 = "s3003",
    /// Digital: 0.12 s for 60 degrees, 300 Hz frame.
    Digital = "digital",
}

impl ServoKind {
    /// Its physical model.
    pub fn model(self) -> ServoModel {
        match self {
            Self::S3003 => ServoModel::S3003,
            Self::Digital => ServoModel::DIGITAL,
        }
    }

    /// The parameters that the image is sent for it, as `tvc tune` found them
    /// (`docs/explanation/control.md`). The image's own defaults are those for the analog servo.
    pub fn parameters(self) -> &'static [(&'static str, f32)] {
        match self {
            Self::S3003 => &[("SRV_RATE_HZ", 50.0)],
            Self::Digital => &[
                ("SRV_RATE_HZ", 300.0),
                ("SRV_RAD_S", 8.73),
                ("SRV_LOOP_S", 0.01237),
                ("SRV_MOTOR_S", 0.01126),
                ("SRV_PLAY_RAD", 0.002685),
                ("SFC_AHEAD_S", 0.01699),
                ("SFC_GAIN_S", 0.3),
                ("SFC_LEAD_RAD", 0.1798),
                ("SFC_NEAR", 19.47),
                ("SFC_CURVE", 0.8574),
                ("SFC_RATE", 1.0),
                ("SFC_PITCH", 0.39),
                ("PID_TRIM_RAD_S", 1.734),
            ],
        }
    }

    /// Frame rate, Hz.
    pub fn frame_hz(self) -> f32 {
        match self {
            Self::S3003 => 50.0,
            Self::Digital => 300.0,
        }
    }
}
