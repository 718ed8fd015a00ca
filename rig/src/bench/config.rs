//! What stands on the bench, as it is chosen.

use plant::two_axis::{TwoAxisDrone, TwoAxisParameters};
use plant::{Checked, Drone, Parameters, ServoModel};
use serde::{Deserialize, Serialize};
use tvc_nano::Axis;

use super::disturbance::Disturbances;
use super::rocket::{Rocket, RocketConfig};
use super::vehicle::{self, Vehicle};
use super::{EarthField, TimedFault, Wiring};
use crate::bno055;
use crate::inertial::ImuErrors;

/// What a drone that hangs in a joint and has two rudders has besides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TwoAxes {
    /// Roll at which the clamp holds the drone at power-on, rad.
    #[serde(skip)]
    pub start_roll_rad: f64,
    /// Distance of the centre of mass from the thrust axis to the right, m.
    pub lateral_cm_m: f64,
    /// Momentum of propellers that do not cancel, kg m2/s.
    pub rotor_momentum_kg_m2_s: f64,
}

/// What stands on the bench.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum VehicleConfig {
    /// The drone on a pivot, with one rudder.
    #[default]
    OneAxis,
    /// The drone in a joint, with two rudders.
    TwoAxes(TwoAxes),
    /// A rocket.
    Rocket(Box<RocketConfig>),
}

/// The configuration of the bench.
#[derive(Clone, Debug)]
pub struct BenchConfig {
    /// The sensor.
    pub sensor: bno055::Config,
    /// Imperfections of the sensor on the microcontroller's board.
    pub onboard: ImuErrors,
    /// Where the sensor sits, from the pivot along the body's axes (x forward, y right, z down), m.
    pub lever_m: [f64; 3],
    /// The board that the chip sits on: the one that the image is for.
    pub wiring: Wiring,
    /// A jumper leads the servo's signal to D2, where no other servo is.
    pub jumper: bool,
    /// The servo, or both, before its horn is fitted to zero rudder at
    /// [`ZERO_RUDDER_US`](super::ZERO_RUDDER_US).
    pub servo: ServoModel,
    /// Masses, lengths and loads of the drone.
    pub parameters: Parameters,
    /// What stands there.
    pub vehicle: VehicleConfig,
    /// Pitch at which the clamp holds the drone at power-on, rad.
    pub start_rad: f64,
    /// Where the drone's nose points, from true north to the east, rad.
    pub heading_rad: f64,
    /// The magnetic field.
    pub field: EarthField,
    /// What disturbs the flight.
    pub disturbances: Disturbances,
    /// Faults of the sensor and its cable after each release or power-on.
    pub faults: Vec<TimedFault>,
    /// A logic analyser records the edges of bus and pins from each release on.
    pub waves: bool,
}

impl Default for BenchConfig {
    fn default() -> Self {
        Self {
            sensor: bno055::Config::default(),
            onboard: ImuErrors::LSM6DS3,
            lever_m: [0.0; 3],
            wiring: Wiring::NANO_33_IOT,
            jumper: true,
            servo: ServoModel::S3003,
            parameters: Parameters::PHYS,
            vehicle: VehicleConfig::OneAxis,
            start_rad: 0.0,
            heading_rad: 0.5,
            field: EarthField::COPENHAGEN,
            disturbances: Disturbances::default(),
            faults: Vec::new(),
            waves: false,
        }
    }
}

impl BenchConfig {
    /// How many axes of the vehicle are steered.
    pub fn axes(&self) -> usize {
        match self.vehicle {
            VehicleConfig::OneAxis => 1,
            VehicleConfig::TwoAxes(_) | VehicleConfig::Rocket(_) => 2,
        }
    }
}

/// What stands on the bench, its tilt at power-on, and where its cranks are at zero rudder, rad.
pub(super) fn hang(bench: &BenchConfig) -> Checked<(Vehicle, [f64; Axis::COUNT], f64)> {
    match &bench.vehicle {
        VehicleConfig::OneAxis => {
            let drone = Drone::new(&bench.parameters, bench.start_rad, 0.0)?;
            let zero_rad = drone.crank().angle_rad;
            Ok((Vehicle::Pivot(Box::new(drone)), [bench.start_rad, 0.0], zero_rad))
        }
        VehicleConfig::TwoAxes(two_axes) => {
            let parameters = TwoAxisParameters {
                lateral_cm_m: two_axes.lateral_cm_m,
                rotor_momentum_kg_m2_s: two_axes.rotor_momentum_kg_m2_s,
                ..TwoAxisParameters::of(bench.parameters)
            };
            let tilt_rad = [bench.start_rad, two_axes.start_roll_rad];
            let attitude = vehicle::attitude(tilt_rad, bench.heading_rad);
            let drone = TwoAxisDrone::new(&parameters, attitude, [0.0; 3])?;
            let [crank, _] = drone.cranks();
            Ok((Vehicle::Joint(Box::new(drone)), tilt_rad, crank.angle_rad))
        }
        VehicleConfig::Rocket(config) => {
            let attitude = vehicle::attitude(config.start_rad, bench.heading_rad);
            Ok((Vehicle::Rocket(Box::new(Rocket::new(config, attitude)?)), config.start_rad, 0.0))
        }
    }
}
