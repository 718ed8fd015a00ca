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
    pub filter: String,
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

/// Everything that can be measured, this project's own first.
pub fn all() -> Vec<Candidate> {
    let own_filters = [
        ("gyro", Scalar::F32),
        ("complementary", Scalar::F32),
        ("complementary", Scalar::Fixed),
        ("mahony", Scalar::F32),
        ("mahony", Scalar::Fixed),
        ("madgwick", Scalar::F32),
        ("madgwick", Scalar::Fixed),
        ("vqf", Scalar::F32),
        ("vqf", Scalar::Fixed),
        ("kalman", Scalar::F32),
    ];
    let field = [
        ("ahrs", "ahrs-mahony", Input::Si),
        ("ahrs", "ahrs-madgwick", Input::Si),
        ("imu-fusion", "imu-fusion", Input::Degrees),
        ("uf-ahrs", "uf-ahrs-mahony", Input::Si),
        ("uf-ahrs", "uf-ahrs-madgwick", Input::Si),
        ("uf-ahrs", "uf-ahrs-vqf", Input::Si),
        ("vqf-rs", "vqf-rs", Input::Si),
    ];
    let modes = [Mode::SixD, Mode::NineD];
    let own_filters = own_filters.iter().flat_map(|&(filter, scalar)| {
        modes.map(|mode| Candidate {
            filter: filter.into(),
            library: OWN,
            mode,
            scalar,
            input: match scalar {
                Scalar::Fixed => Input::Counts,
                _ => Input::Si,
            },
        })
    });
    // An orientation's angles cost the same whichever mode it comes from.
    let angles = [Scalar::F32, Scalar::Fixed].map(|scalar| Candidate {
        filter: "roll-pitch-yaw".into(),
        library: OWN,
        mode: Mode::NineD,
        scalar,
        input: Input::Quaternion(scalar),
    });
    let field = field.iter().flat_map(|&(library, filter, input)| {
        modes.map(|mode| Candidate {
            filter: filter.into(),
            library,
            mode,
            scalar: Scalar::F32,
            input,
        })
    });
    own_filters.chain(angles).chain(field).collect()
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
