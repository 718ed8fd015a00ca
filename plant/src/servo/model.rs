//! The constants of a servo: presets, checks, and the map from pulse width to crank angle.

use serde::{Deserialize, Serialize};

use crate::parameters::{Checked, finite, named, not_negative, positive};

/// Constants of a servo and of how its horn is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoModel {
    /// Pulse width at the middle of the servo's own travel, in us.
    pub centre_us: f64,
    /// Pulse width for each radian of horn angle, in us/rad.
    pub us_per_rad: f64,
    /// Crank angle `theta1` at the middle of the servo's travel, in rad: how the horn sits on its
    /// spline. A mounting error adds to it.
    pub horn_rad: f64,
    /// Step of the servo's measurement of the pulse, in us.
    pub resolution_us: f64,
    /// Total width of the deadband, in us: within half of it either side, the motor is off.
    pub deadband_us: f64,
    /// Speed without load, in rad/s.
    pub speed_rad_s: f64,
    /// Torque at which the motor stalls, in N m.
    pub stall_n_m: f64,
    /// Time constant of the position loop, in s: speed asked for is error over this.
    pub loop_s: f64,
    /// Share of a load that the loop makes up for by an error alone: 1 in a proportional loop, 0 in
    /// one that integrates.
    pub droop: f64,
    /// Inertia of motor and gears, referred to the horn, in kg m2. What the horn turns adds to it.
    pub rotor_kg_m2: f64,
    /// Play of the gears, total, in rad.
    pub backlash_rad: f64,
    /// Travel either side of the middle, in rad.
    pub travel_rad: f64,
    /// What the servo does when pulses stay away.
    pub signal_loss: SignalLoss,
}

/// What a servo does without pulses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignalLoss {
    /// Holds the last target, as digital servos and most of the bench's do.
    Hold,
    /// Lets the motor go after `after_s` without a pulse; loads then drive the horn along the
    /// motor's torque-speed line.
    Limp {
        /// Time from the end of the last pulse, in s.
        after_s: f64,
    },
}

impl ServoModel {
    /// Futaba S3003 class at 6 V, horn square on the servo: crank angle zero at 1520 us.
    pub const S3003: Self = Self {
        centre_us: 1520.0,
        us_per_rad: 10.0 * 180.0 / std::f64::consts::PI,
        horn_rad: 0.0,
        resolution_us: 1.0,
        deadband_us: 4.0,
        speed_rad_s: std::f64::consts::FRAC_PI_3 / 0.19,
        stall_n_m: 0.40,
        loop_s: 0.030,
        droop: 1.0,
        rotor_kg_m2: 5.3e-5,
        backlash_rad: 0.5 * std::f64::consts::PI / 180.0,
        travel_rad: 65.0 * std::f64::consts::PI / 180.0,
        signal_loss: SignalLoss::Hold,
    };

    /// The same at 5 V: 0.22 s for 60 deg, 0.33 N m.
    pub const S3003_5V: Self =
        Self { speed_rad_s: std::f64::consts::FRAC_PI_3 / 0.22, stall_n_m: 0.33, ..Self::S3003 };

    /// A fast digital servo for frames of 3 ms: 0.12 s for 60 deg.
    pub const DIGITAL: Self = Self {
        deadband_us: 2.0,
        speed_rad_s: std::f64::consts::FRAC_PI_3 / 0.12,
        stall_n_m: 0.8,
        loop_s: 0.015,
        ..Self::S3003
    };

    /// The presets and their names.
    pub(crate) const PRESETS: [(&'static str, Self); 3] =
        [("S3003", Self::S3003), ("S3003_5V", Self::S3003_5V), ("DIGITAL", Self::DIGITAL)];

    /// Checks that every constant is finite and in range.
    ///
    /// # Errors
    /// The first constant out of range, by name.
    pub fn validate(&self) -> Checked {
        positive(&named!(self;
            centre_us, resolution_us, speed_rad_s, stall_n_m, loop_s, rotor_kg_m2, travel_rad,
        ))?;
        not_negative(&named!(self; deadband_us, droop, backlash_rad))?;
        finite(&named!(self; horn_rad))?;
        if let SignalLoss::Limp { after_s } = self.signal_loss {
            not_negative(&[("after_s", after_s)])?;
        }
        // A horn that turns the other way is a servo mounted the other way round: any sign.
        finite(&named!(self; us_per_rad))?;
        positive(&[("us_per_rad (its size)", self.us_per_rad.abs())])
    }

    /// The same servo with its horn fitted so that the crank stands at `crank_rad` when the pulse
    /// is `width_us`.
    pub fn fitted(self, width_us: f64, crank_rad: f64) -> Self {
        let shaft_rad = (width_us - self.centre_us) / self.us_per_rad;
        Self { horn_rad: crank_rad - shaft_rad, ..self }
    }

    /// Crank angle that a pulse width (us) asks for, in rad, travel and resolution left out.
    pub fn crank_for_width(&self, width_us: f64) -> f64 {
        (width_us - self.centre_us) / self.us_per_rad + self.horn_rad
    }

    /// Pulse width that asks for a crank angle (rad), in us.
    pub fn width_for_crank(&self, crank_rad: f64) -> f64 {
        (crank_rad - self.horn_rad) * self.us_per_rad + self.centre_us
    }

    /// Time constant of the motor's speed where the horn turns this inertia (kg m2), in s. A DC
    /// motor's torque falls from the stall's to nothing at the speed without load.
    pub fn lag_s(&self, inertia_kg_m2: f64) -> f64 {
        (self.rotor_kg_m2 + inertia_kg_m2) * self.yielding()
    }

    /// Speed by which a motor gives way to each N m, in rad/s per N m, whatever the supply.
    pub(crate) fn yielding(&self) -> f64 {
        self.speed_rad_s / self.stall_n_m
    }
}
