//! What is measured: every filter of this project, and those of other libraries.

use std::fmt;

use recordings::{Mode, Scalar};

/// This project's own library.
pub const OWN: &str = "tvc-fusion";

/// What an update is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// Float: rad/s, m/s^2, uT.
    Si,
    /// Float: deg/s, g, uT.
    Degrees,
    /// A BNO055's counts.
    Counts,
    /// A quaternion: what is measured follows a filter.
    Quaternion(Scalar),
}

/// One filter, mode and scalar.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Candidate {
    /// Name; those of other libraries begin with the library's.
    pub filter: &'static str,
    /// Crate that it comes from.
    pub library: &'static str,
    /// With or without a magnetometer.
    pub mode: Mode,
    /// What it computes in.
    pub scalar: Scalar,
    /// What an update is given.
    pub input: Input,
}

impl Candidate {
    /// The feature of the package `cycles` that stands for it.
    pub fn feature(&self) -> String {
        let name = format!("{}-{}", self.filter, self.mode);
        match self.scalar {
            Scalar::Fixed => format!("fixed-{name}"),
            _ => name,
        }
    }

    /// Whether it estimates where up is.
    pub fn has_tilt(&self) -> bool {
        !matches!(self.input, Input::Quaternion(_))
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.filter, self.mode, self.scalar)
    }
}

/// What each library has: library, filter, what it computes in, what an update is given.
const FILTERS: [(&str, &str, Scalar, Input); 19] = [
    (OWN, "gyro", Scalar::F32, Input::Si),
    (OWN, "complementary", Scalar::F32, Input::Si),
    (OWN, "complementary", Scalar::Fixed, Input::Counts),
    (OWN, "mahony", Scalar::F32, Input::Si),
    (OWN, "mahony", Scalar::Fixed, Input::Counts),
    (OWN, "madgwick", Scalar::F32, Input::Si),
    (OWN, "madgwick", Scalar::Fixed, Input::Counts),
    (OWN, "vqf", Scalar::F32, Input::Si),
    (OWN, "vqf", Scalar::Fixed, Input::Counts),
    (OWN, "kalman", Scalar::F32, Input::Si),
    (OWN, "roll-pitch-yaw", Scalar::F32, Input::Quaternion(Scalar::F32)),
    (OWN, "roll-pitch-yaw", Scalar::Fixed, Input::Quaternion(Scalar::Fixed)),
    ("ahrs", "ahrs-mahony", Scalar::F32, Input::Si),
    ("ahrs", "ahrs-madgwick", Scalar::F32, Input::Si),
    ("imu-fusion", "imu-fusion", Scalar::F32, Input::Degrees),
    ("uf-ahrs", "uf-ahrs-mahony", Scalar::F32, Input::Si),
    ("uf-ahrs", "uf-ahrs-madgwick", Scalar::F32, Input::Si),
    ("uf-ahrs", "uf-ahrs-vqf", Scalar::F32, Input::Si),
    ("vqf-rs", "vqf-rs", Scalar::F32, Input::Si),
];

/// Everything that can be measured, this project's own first.
pub fn all() -> Vec<Candidate> {
    let in_modes = FILTERS.iter().flat_map(|&(library, filter, scalar, input)| {
        let modes = match input {
            // An orientation's angles cost the same whichever mode it comes from.
            Input::Quaternion(_) => &[Mode::NineD][..],
            _ => &[Mode::SixD, Mode::NineD],
        };
        modes.iter().map(move |&mode| Candidate { filter, library, mode, scalar, input })
    });
    in_modes.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_candidate_has_a_feature_of_the_package_that_builds_it_and_no_other_has_one() {
        let mut features: Vec<_> = include_str!("../../../cycles/Cargo.toml")
            .lines()
            .filter_map(|line| line.split_once(" = ["))
            .map(|(name, _)| name.to_owned())
            .filter(|name| name.ends_with("-6d") || name.ends_with("-9d"))
            .collect();
        let mut wanted: Vec<_> = all().iter().map(Candidate::feature).collect();
        features.sort();
        wanted.sort();
        assert_eq!(wanted, features);
    }
}
