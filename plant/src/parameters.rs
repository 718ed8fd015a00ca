//! Parameters of the drone: presets, units and checks.

use serde::{Deserialize, Serialize};

use crate::linkage::Linkage;

/// The range of crank angles over which the linkage must close, either side of its zero, in rad:
/// the servo's own travel.
const CRANK_TRAVEL_RAD: f64 = 65.0 * std::f64::consts::PI / 180.0;

/// Everything that the equations of motion need to know about the drone.
///
/// Vectors `[x, y]` are components in the frame of body 0, whose origin is the pivot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Mass of body 0: frame, motors, electronics and the servo's case, in kg.
    pub body_mass_kg: f64,
    /// Moment of inertia of body 0 about its own centre of mass, in kg m2.
    pub body_inertia_kg_m2: f64,
    /// Centre of mass of body 0, in m.
    pub body_cm_m: [f64; 2],
    /// Mass of the crank (the servo's horn), in kg.
    pub crank_mass_kg: f64,
    /// Moment of inertia of the crank about its own centre of mass, in kg m2.
    pub crank_inertia_kg_m2: f64,
    /// Distance of the crank's centre of mass from the servo axis along the arm, in m.
    pub crank_cm_m: f64,
    /// Mass of the link, in kg; its centre of mass is half way along it.
    pub link_mass_kg: f64,
    /// Moment of inertia of the link about its own centre of mass, in kg m2.
    pub link_inertia_kg_m2: f64,
    /// Mass of the rudder with its arm, in kg.
    pub rudder_mass_kg: f64,
    /// Moment of inertia of the rudder about its own centre of mass, in kg m2.
    pub rudder_inertia_kg_m2: f64,
    /// Distance of the rudder's centre of mass from its axis along the arm, in m.
    pub rudder_cm_m: f64,
    /// Length of the crank, O to A, in m.
    pub crank_length_m: f64,
    /// Length of the link, A to B, in m.
    pub link_length_m: f64,
    /// Length of the rudder arm, C to B, in m.
    pub arm_length_m: f64,
    /// Distance from the rudder axis C to the servo axis O, along x, in m.
    pub ground_length_m: f64,
    /// The rudder axis C, in m. The servo axis lies `ground_length_m` to its right.
    pub rudder_axis_m: [f64; 2],
    /// Thrust of the propellers along body y, in N.
    pub thrust_n: f64,
    /// Where the thrust acts, in m.
    pub thrust_point_m: [f64; 2],
    /// Share of the thrust that the wash can turn into force on the rudder, 0 to 1.
    pub wash_efficiency: f64,
    /// Distance of the rudder's centre of pressure below its axis, in m.
    pub pressure_centre_m: f64,
    /// Acceleration of gravity, in m/s2.
    pub gravity_m_s2: f64,
    /// Torque of the servo motor on the crank for each volt, in N m/V.
    pub motor_n_m_per_v: f64,
    /// Viscous friction of the pivot, in N m s/rad.
    pub pivot_friction_n_m_s: f64,
    /// Viscous friction of the servo shaft, in N m s/rad.
    pub crank_friction_n_m_s: f64,
    /// Viscous friction of the rudder axis, in N m s/rad.
    pub rudder_friction_n_m_s: f64,
}

/// What is wrong with a set of parameters.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// A parameter lies outside the range in which the equations mean something.
    #[error("{parameter} is {value}, it must be {must}")]
    OutOfRange {
        /// Name of the field.
        parameter: &'static str,
        /// The value found.
        value: f64,
        /// The range, in words.
        must: &'static str,
    },
    /// The four bars cannot be joined at a crank angle that the servo reaches.
    #[error(
        "the linkage cannot close at a crank angle of {crank_deg:.1} deg: crank_length_m, \
         link_length_m, arm_length_m and ground_length_m do not fit"
    )]
    LinkageOpen {
        /// The crank angle at which it fails, in degrees.
        crank_deg: f64,
    },
    /// No crank angle brings the rudder to zero.
    #[error("no crank angle brings the rudder to zero: check the lengths of the linkage")]
    NoZeroRudder,
}

/// What is given where every parameter is in range, or which one is not.
pub type Checked<T = ()> = Result<T, ParameterError>;

impl Parameters {
    /// The recommended parameters: the total centre of mass lies at the pivot, the crank is the
    /// bare horn, and the rudder trails its axis.
    pub const PHYS: Self = Self {
        body_mass_kg: 2.75,
        body_inertia_kg_m2: 0.1,
        // The total centre of mass lies at the pivot when the crank stands at zero.
        body_cm_m: [-9.920289272812934e-5, 0.03856436400891244],
        crank_mass_kg: 0.003,
        crank_inertia_kg_m2: 6.25e-7,
        crank_cm_m: 0.0,
        link_mass_kg: 0.001,
        // A slender rod: m L^2 / 12.
        link_inertia_kg_m2: 0.001 * 0.08 * 0.08 / 12.0,
        rudder_mass_kg: 0.54,
        rudder_inertia_kg_m2: 0.0022,
        rudder_cm_m: 0.0,
        crank_length_m: 0.020,
        link_length_m: 0.080,
        arm_length_m: 0.036,
        ground_length_m: 0.078,
        rudder_axis_m: [0.0, -0.195],
        thrust_n: 30.0,
        thrust_point_m: [0.0, 0.09],
        wash_efficiency: 1.0,
        pressure_centre_m: 0.045,
        gravity_m_s2: 9.81,
        motor_n_m_per_v: 0.051_733_333_333_333_33,
        pivot_friction_n_m_s: 0.0,
        crank_friction_n_m_s: 0.0,
        rudder_friction_n_m_s: 0.0,
    };

    /// The table of thesis section 5.2, with the right equations: body 0 balanced at the pivot by
    /// itself, so that the whole is a pendulum, and a crank six times the inertia of the drone.
    pub const THESIS_TABLE: Self = Self {
        body_cm_m: [0.0, 0.0],
        crank_mass_kg: 0.05,
        crank_inertia_kg_m2: 0.625,
        link_mass_kg: 5e-5,
        link_inertia_kg_m2: 2.408e-26,
        pressure_centre_m: 0.0,
        gravity_m_s2: 9.8,
        ..Self::PHYS
    };

    /// The text of thesis section 5.2.1, with the right equations.
    pub const THESIS_TEXT: Self = Self {
        crank_mass_kg: 0.003,
        crank_inertia_kg_m2: 6.25e-7,
        link_mass_kg: 0.001,
        link_inertia_kg_m2: 2.408e-15,
        ..Self::THESIS_TABLE
    };

    /// The presets and their names.
    pub(crate) const PRESETS: [(&'static str, Self); 3] = [
        ("PHYS", Self::PHYS),
        ("THESIS_TABLE", Self::THESIS_TABLE),
        ("THESIS_TEXT", Self::THESIS_TEXT),
    ];

    /// A preset by its name, in any case: `PHYS`, `THESIS_TABLE`, `THESIS_TEXT`.
    pub fn preset(name: &str) -> Option<Self> {
        by_name(&Self::PRESETS, name)
    }

    /// The servo axis O in the frame of body 0, in m.
    pub fn servo_axis_m(&self) -> [f64; 2] {
        [self.rudder_axis_m[0] + self.ground_length_m, self.rudder_axis_m[1]]
    }

    /// Mass of the four bodies together, in kg.
    pub fn total_mass_kg(&self) -> f64 {
        self.body_mass_kg + self.crank_mass_kg + self.link_mass_kg + self.rudder_mass_kg
    }

    /// The drone with its whole mass so far to +x, m; body 0 carries the offset.
    pub fn with_lateral_offset(mut self, offset_m: f64) -> Self {
        self.body_cm_m[0] += offset_m * self.total_mass_kg() / self.body_mass_kg;
        self
    }

    /// The four-bar linkage between crank and rudder.
    pub fn linkage(&self) -> Linkage {
        Linkage {
            crank_m: self.crank_length_m,
            link_m: self.link_length_m,
            arm_m: self.arm_length_m,
            ground_m: self.ground_length_m,
        }
    }

    /// Checks that every value is finite and in range and that the linkage closes over the
    /// servo's travel.
    ///
    /// # Errors
    /// The first parameter out of range, by name, or the linkage if it does not close.
    pub fn validate(&self) -> Checked {
        positive(&named!(self;
            body_mass_kg, body_inertia_kg_m2, crank_mass_kg, crank_inertia_kg_m2, link_mass_kg,
            link_inertia_kg_m2, rudder_mass_kg, rudder_inertia_kg_m2, crank_length_m,
            link_length_m, arm_length_m, ground_length_m,
        ))?;
        not_negative(&named!(self;
            thrust_n, gravity_m_s2, pivot_friction_n_m_s, crank_friction_n_m_s,
            rudder_friction_n_m_s,
        ))?;
        finite(&named!(self;
            body_cm_m[0], body_cm_m[1], crank_cm_m, rudder_cm_m, rudder_axis_m[0],
            rudder_axis_m[1], thrust_point_m[0], thrust_point_m[1], pressure_centre_m,
            motor_n_m_per_v,
        ))?;
        check(&named!(self; wash_efficiency), "between 0 and 1", |value| {
            (0.0..=1.0).contains(&value)
        })?;
        let linkage = self.linkage();
        // The distance that link and arm must span is monotonic in the sine of the crank angle:
        // where both ends close, so does all between.
        for crank in [-CRANK_TRAVEL_RAD, CRANK_TRAVEL_RAD] {
            if !linkage.closes_at(crank) {
                return Err(ParameterError::LinkageOpen { crank_deg: crank.to_degrees() });
            }
        }
        match linkage.crank_for_rudder(0.0) {
            Some(_) => Ok(()),
            None => Err(ParameterError::NoZeroRudder),
        }
    }
}

/// What has this name among the presets, in any case.
pub(crate) fn by_name<T: Copy>(presets: &[(&str, T)], name: &str) -> Option<T> {
    Some(presets.iter().find(|preset| preset.0.eq_ignore_ascii_case(name))?.1)
}

/// A parameter's name and value, for a check.
pub type Named = (&'static str, f64);

/// Fields of a value, or variables, each with its name, for a check.
macro_rules! named {
    ($owner:expr; $($field:ident $([$i:literal])?),* $(,)?) => {
        [$((stringify!($field), $owner.$field $([$i])?)),*]
    };
    ($($variable:ident),*) => { [$((stringify!($variable), $variable)),*] };
}
pub(crate) use named;

/// Refuses the first value that is not finite and above zero.
pub(crate) fn positive(values: &[Named]) -> Checked {
    check(values, "finite and greater than zero", |value| value.is_finite() && value > 0.0)
}

/// Refuses the first value that is not finite or below zero.
pub(crate) fn not_negative(values: &[Named]) -> Checked {
    check(values, "finite and not negative", |value| value.is_finite() && value >= 0.0)
}

/// Refuses the first value that is not finite.
pub(crate) fn finite(values: &[Named]) -> Checked {
    check(values, "finite", f64::is_finite)
}

/// Refuses the first value that is not `good`; `must` says in words what is.
///
/// # Errors
/// [`ParameterError::OutOfRange`].
pub fn check(values: &[Named], must: &'static str, good: impl Fn(f64) -> bool) -> Checked {
    match values.iter().find(|(_, value)| !good(*value)) {
        None => Ok(()),
        Some(&(parameter, value)) => Err(ParameterError::OutOfRange { parameter, value, must }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_presets_are_valid() {
        for name in ["PHYS", "thesis_table", "Thesis_Text"] {
            Parameters::preset(name).unwrap().validate().unwrap();
        }
        assert_eq!(Parameters::preset("printed"), None);
    }

    #[test]
    fn a_bad_parameter_is_named() {
        let spoil = |f: fn(&mut Parameters)| {
            let mut p = Parameters::PHYS;
            f(&mut p);
            p.validate().unwrap_err().to_string()
        };
        assert!(spoil(|p| p.link_mass_kg = 0.0).starts_with("link_mass_kg is 0"));
        assert!(spoil(|p| p.thrust_n = f64::NAN).starts_with("thrust_n"));
        assert!(spoil(|p| p.wash_efficiency = 1.2).starts_with("wash_efficiency"));
        assert!(spoil(|p| p.body_cm_m[1] = f64::INFINITY).starts_with("body_cm_m"));
        // The link is too short to span the gap between crank and arm.
        let short = spoil(|p| p.link_length_m = 0.040);
        assert!(short.contains("cannot close at a crank angle of -65.0 deg"), "{short}");
    }

    /// What the preset promises: the first moment of all four bodies about the pivot vanishes
    /// with the crank at zero.
    #[test]
    fn phys_hangs_about_its_centre_of_mass() {
        let p = Parameters::PHYS;
        let state = p.linkage().at(0.0);
        let [ox, oy] = p.servo_axis_m();
        let half = p.link_length_m / 2.0;
        let link = [ox + half * state.link.x, oy + p.crank_length_m + half * state.link.y];
        for (axis, link) in link.into_iter().enumerate() {
            let moment = p.body_mass_kg * p.body_cm_m[axis]
                + p.crank_mass_kg * p.servo_axis_m()[axis]
                + p.link_mass_kg * link
                + p.rudder_mass_kg * p.rudder_axis_m[axis];
            assert!(moment.abs() < 1e-15, "axis {axis}: {moment}");
        }
    }
}
