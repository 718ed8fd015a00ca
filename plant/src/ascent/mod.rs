//! The rocket's ascent in six degrees of freedom: from the pad along a rail, through the burn and
//! past it, in wind.
//!
//! Body axes: z along the rocket's axis from the nose to the gimbal, so that thrust acts along -z,
//! x forward and y right. Earth axes: north, east, down, with the origin where the centre of mass
//! is on the pad. Upright on the pad is the identity, but for the heading. Lists of two name pitch
//! first (about body y), then roll (about body x, which rockets call yaw), as for the drone. A
//! positive gimbal angle makes a negative moment, so that laws carry over.
//!
//! # Equations
//! Mass, centre of mass and inertia are those of [`RocketParameters`] at the time of the burn. At
//! each instant the rocket is taken as a rigid body with these,
//!
//! ```text
//! m dv/dt = F + m g                         (earth axes, v of the centre of mass)
//! I dw/dt = M - w x I w                     (body axes)
//! ```
//!
//! with the thrust at the gimbal, turned first about y by the pitch gimbal and then about x by the
//! roll gimbal, and with the air's forces at the velocity `u` of the centre of mass against the
//! air:
//!
//! ```text
//! normal force  -1/2 rho |u| S CNa (u_x, u_y)    at the centre of pressure, fixed in the body
//! drag          -1/2 rho |u| S CD u_z            along the axis
//! ```
//!
//! so that the normal force grows with the sine of the angle of attack. While the engine burns, the
//! jet damps the rates across the axis. Bending and slosh (`flexible.rs`) are options.
//!
//! Left out, with sizes for Spica; those with a star are estimates:
//!
//! | what | size |
//! |---|---|
//! | thrust that grows as the ambient pressure falls | 10 % of it * |
//! | slope of the normal force and drag over the Mach number | a factor of 2 at Mach 1 * |
//! | the flow's Coriolis force, `2 m' x_cm w` | 0.02 m/s2 at 0.3 rad/s |
//! | damping of rates by the air | less than the jet's * |
//! | the engine's inertia on the gimbal: it turns the rocket before the thrust does | above 7 Hz * |
//! | the shift of the centre of mass within the rocket as a motion of its own | 0.1 m/s |
//! | the earth's curvature and rotation, gravity that falls with altitude | 2.6 % at 84 km |
//! | friction and tip-off of the rail, the ground after it | |

mod flexible;
mod parameters;
mod wind;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use self::flexible::Flexible;
pub use self::parameters::AscentParameters;
use self::wind::Air;
pub use self::wind::{Gust, Turbulence, Wind};
use crate::parameters::Checked;
use crate::rocket::{GRAVITY_M_S2, MassProperties, RocketParameters};
use crate::tilt;

/// Place and motion, or their slopes.
#[derive(Clone, Copy, Debug)]
struct State {
    /// Of the centre of mass, earth axes, m.
    position: Vector3<f64>,
    /// Earth axes, m/s.
    velocity: Vector3<f64>,
    /// Body to earth.
    attitude: Quaternion<f64>,
    /// Body axes, rad/s.
    rates: Vector3<f64>,
    flexible: Flexible,
}

impl State {
    fn ahead(&self, slope: &Self, dt_s: f64) -> Self {
        Self {
            position: self.position + slope.position * dt_s,
            velocity: self.velocity + slope.velocity * dt_s,
            attitude: self.attitude + slope.attitude * dt_s,
            rates: self.rates + slope.rates * dt_s,
            flexible: self.flexible.ahead(&slope.flexible, dt_s),
        }
    }

    fn attitude(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_quaternion(self.attitude)
    }
}

/// What drives the rocket at an instant.
#[derive(Clone, Copy, Debug)]
struct Drive {
    /// Since ignition, s.
    time_s: f64,
    burning: bool,
    gimbal_rad: [f64; 2],
}

/// What acts on the rocket besides its weight.
#[derive(Clone, Copy, Debug)]
struct Load {
    mass: MassProperties,
    /// Body axes, N.
    force: Vector3<f64>,
    /// About the centre of mass, body axes, N m.
    moment: Vector3<f64>,
}

/// The rocket, on its pad, on its rail or in flight.
#[derive(Clone, Debug)]
pub struct Ascent {
    parameters: AscentParameters,
    air: Air,
    /// Since ignition, s.
    time_s: Option<f64>,
    on_rail: bool,
    state: State,
    gimbal_rad: [f64; 2],
}

impl Ascent {
    /// A rocket on its pad, whose rail holds it in an attitude (body to earth).
    ///
    /// # Errors
    /// As [`AscentParameters::validate`].
    pub fn new(parameters: &AscentParameters, attitude: UnitQuaternion<f64>) -> Checked<Self> {
        parameters.validate()?;
        Ok(Self {
            parameters: *parameters,
            air: Air::new(&parameters.wind),
            time_s: None,
            on_rail: true,
            state: State {
                position: Vector3::zeros(),
                velocity: Vector3::zeros(),
                attitude: attitude.into_inner(),
                rates: Vector3::zeros(),
                flexible: Flexible::default(),
            },
            gimbal_rad: [0.0; 2],
        })
    }

    /// Lights the engine, unless it is or was lit: the burn begins.
    pub fn ignite(&mut self) {
        self.time_s.get_or_insert(0.0);
    }

    /// Adds an angular impulse about the centre of mass, body axes, N m s. The rail swallows it.
    pub fn kick(&mut self, impulse_n_m_s: [f64; 3]) {
        if !self.on_rail {
            let inertia = self.inertia(&self.mass_properties());
            self.state.rates += Vector3::from(impulse_n_m_s).component_div(&inertia);
        }
    }

    /// Advances by `dt_s` (greater than zero) with a command to the gimbal, pitch and roll, rad.
    /// Fourth-order Runge-Kutta; the gimbal moves evenly over the step, and turbulence changes at
    /// its start.
    pub fn step(&mut self, dt_s: f64, gimbal_command_rad: [f64; 2]) {
        let wind = self.air.velocity(self.altitude_m());
        self.air.pass((self.state.velocity - wind).norm() * dt_s);
        let from = self.gimbal_rad;
        let rocket = &self.parameters.rocket;
        self.gimbal_rad =
            [0, 1].map(|axis| gimbal_after(rocket, from[axis], gimbal_command_rad[axis], dt_s));
        let to = self.gimbal_rad;
        let gimbal = |share: f64| [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        let burn_s = self.parameters.rocket.burn_s;
        match self.time_s {
            None => self.advance(0.0, dt_s, false, gimbal),
            // The engine stops within this step: neither part of it has a jump of the thrust.
            Some(now) if now < burn_s && now + dt_s > burn_s => {
                let first = burn_s - now;
                let part = first / dt_s;
                self.advance(now, first, true, |share| gimbal(part * share));
                self.advance(burn_s, dt_s - first, false, |share| {
                    gimbal(part + (1.0 - part) * share)
                });
            }
            Some(now) => self.advance(now, dt_s, now < burn_s, gimbal),
        }
        self.time_s = self.time_s.map(|now| now + dt_s);
    }

    /// Altitude over the pad, in m.
    pub fn altitude_m(&self) -> f64 {
        -self.state.position.z
    }

    /// Attitude, body to north-east-down.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        self.state.attitude()
    }

    /// Rates about the body's axes, rad/s.
    pub fn rates_rad_s(&self) -> [f64; 3] {
        self.state.rates.into()
    }

    /// Rates that a gyroscope at the sensor's place turns with, rad/s: the body's, and those of the
    /// bending.
    pub fn sensed_rates_rad_s(&self) -> [f64; 3] {
        let [_, [x, y]] = self.bent();
        (self.state.rates + Vector3::new(x, y, 0.0)).into()
    }

    /// The tilt that such rates add up to, rad, as [`Self::tilt_rad`].
    pub fn sensed_tilt_rad(&self) -> [f64; 2] {
        let ([pitch, roll], [[x, y], _]) = (self.tilt_rad(), self.bent());
        [pitch + y, roll + x]
    }

    /// How bending turns the sensor about x and y, rad, and its rates, rad/s.
    fn bent(&self) -> [[f64; 2]; 2] {
        let AscentParameters { rocket, sensor_m, .. } = &self.parameters;
        self.state.flexible.turned(rocket, -sensor_m[2]).map(Into::into)
    }

    /// The tilt of the rocket's axis against the vertical as a vector (the reduced attitude), rad:
    /// its parts about the body's y and x. Upside down, one of the shortest ways is taken.
    pub fn tilt_rad(&self) -> [f64; 2] {
        tilt::tilt_rad(&self.attitude())
    }

    /// What an accelerometer at the sensor's place feels, body axes, in m/s2: acceleration less
    /// gravity.
    pub fn specific_force_m_s2(&self) -> [f64; 3] {
        let slope = self.slope(&self.drive(), &self.state);
        let felt = slope.velocity - Vector3::new(0.0, 0.0, GRAVITY_M_S2);
        let lever = Vector3::from(self.parameters.sensor_m)
            + Vector3::new(0.0, 0.0, self.mass_properties().cm_m);
        let (rates, turning) = (self.state.rates, slope.rates);
        (self.attitude().inverse() * felt
            + turning.cross(&lever)
            + rates.cross(&rates.cross(&lever)))
        .into()
    }

    /// Gimbal angles, pitch and roll, rad.
    pub fn gimbal_rad(&self) -> [f64; 2] {
        self.gimbal_rad
    }

    /// Time since ignition, s; none before it.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// Whether the engine gives thrust.
    pub fn burning(&self) -> bool {
        self.time_s.is_some_and(|now| now < self.parameters.rocket.burn_s)
    }

    /// Whether the pad or its rail still guides it.
    pub fn on_rail(&self) -> bool {
        self.on_rail
    }

    /// Mass, centre of mass and inertia now.
    pub fn mass_properties(&self) -> MassProperties {
        self.parameters.rocket.mass_at(self.time_s.unwrap_or(0.0))
    }

    /// The parameters.
    pub fn parameters(&self) -> &AscentParameters {
        &self.parameters
    }

    fn drive(&self) -> Drive {
        Drive {
            time_s: self.time_s.unwrap_or(0.0),
            burning: self.burning(),
            gimbal_rad: self.gimbal_rad,
        }
    }

    /// One step of the state, over which the engine burns throughout or not at all; the gimbal is
    /// given at a share of it.
    fn advance(&mut self, now_s: f64, dt_s: f64, burning: bool, gimbal: impl Fn(f64) -> [f64; 2]) {
        let slope = |share: f64, state: &State| {
            let drive = Drive { time_s: now_s + share * dt_s, burning, gimbal_rad: gimbal(share) };
            self.slope(&drive, state)
        };
        let from = self.state;
        let k1 = slope(0.0, &from);
        let k2 = slope(0.5, &from.ahead(&k1, 0.5 * dt_s));
        let k3 = slope(0.5, &from.ahead(&k2, 0.5 * dt_s));
        let k4 = slope(1.0, &from.ahead(&k3, dt_s));
        let mut state = from
            .ahead(&k1, dt_s / 6.0)
            .ahead(&k2, dt_s / 3.0)
            .ahead(&k3, dt_s / 3.0)
            .ahead(&k4, dt_s / 6.0);
        state.attitude = state.attitude().into_inner();
        self.state = state;
        if self.on_rail {
            let moved = self.state.position.dot(&along(&self.state.attitude()));
            if moved < 0.0 {
                (self.state.position, self.state.velocity) = (Vector3::zeros(), Vector3::zeros());
            }
            self.on_rail = moved <= 0.0 || moved < self.parameters.rail_m;
        }
    }

    fn slope(&self, drive: &Drive, state: &State) -> State {
        let attitude = state.attitude();
        let (load, flexible) = self.load(drive, state, &attitude);
        let weightless = attitude * load.force / load.mass.mass_kg;
        let acceleration = weightless + Vector3::new(0.0, 0.0, GRAVITY_M_S2);
        if self.on_rail {
            return on_rail(state, &along(&attitude), &acceleration);
        }
        let inertia = self.inertia(&load.mass);
        let momentum = inertia.component_mul(&state.rates);
        State {
            position: state.velocity,
            velocity: acceleration,
            attitude: state.attitude * Quaternion::from_imag(0.5 * state.rates),
            rates: (load.moment - state.rates.cross(&momentum)).component_div(&inertia),
            flexible,
        }
    }

    /// Thrust, air and slosh, and the slope of what is flexible.
    fn load(
        &self,
        drive: &Drive,
        state: &State,
        attitude: &UnitQuaternion<f64>,
    ) -> (Load, Flexible) {
        let p = &self.parameters;
        let mass = p.rocket.mass_at(drive.time_s);
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        let mut thrust = Vector3::zeros();
        if drive.burning {
            let [pitch, roll] =
                [0, 1].map(|axis| drive.gimbal_rad[axis] + p.misalignment_rad[axis]);
            thrust = p.rocket.burn_at(drive.time_s).0 * direction(pitch, roll);
            force += thrust;
            moment += Vector3::new(0.0, 0.0, mass.cm_m).cross(&thrust);
            let damping = mass.inertia_kg_m2 * p.rocket.jet_damping_per_s(drive.time_s);
            moment -= damping * Vector3::new(state.rates.x, state.rates.y, 0.0);
        }
        let altitude_m = -state.position.z;
        let against_air = state.velocity - self.air.velocity(altitude_m);
        let u = attitude.inverse() * against_air;
        let pressed = 0.5 * p.rocket.density_kg_m3(altitude_m) * u.norm() * p.rocket.area_m2();
        let normal = -pressed * p.rocket.normal_force_slope * Vector3::new(u.x, u.y, 0.0);
        force += normal - Vector3::new(0.0, 0.0, pressed * p.rocket.drag * u.z);
        moment += Vector3::new(0.0, 0.0, p.rocket.behind_m(&mass)).cross(&normal);
        let mut load = Load { mass, force, moment };
        let flexible = state.flexible.slope(&p.rocket, drive.time_s, thrust.xy(), &mut load);
        (load, flexible)
    }

    /// About the body's axes through the centre of mass, kg m2.
    fn inertia(&self, mass: &MassProperties) -> Vector3<f64> {
        let gyration = self.parameters.axial_gyration_m;
        let across = mass.inertia_kg_m2;
        Vector3::new(across, across, mass.mass_kg * gyration * gyration)
    }
}

/// The rocket's axis towards its nose, earth axes.
fn along(attitude: &UnitQuaternion<f64>) -> Vector3<f64> {
    attitude * -Vector3::z()
}

/// Direction of a thrust that is turned about y and then about x by these angles, rad, body axes.
fn direction(pitch_rad: f64, roll_rad: f64) -> Vector3<f64> {
    let ((sin_pitch, cos_pitch), (sin_roll, cos_roll)) = (pitch_rad.sin_cos(), roll_rad.sin_cos());
    Vector3::new(-sin_pitch * cos_roll, sin_roll, -cos_pitch * cos_roll)
}

/// What the rail lets through of an acceleration: its part along the rail, and nothing downwards
/// while the rocket stands on the pad.
fn on_rail(state: &State, along: &Vector3<f64>, acceleration: &Vector3<f64>) -> State {
    let forward = acceleration.dot(along);
    let stands = state.position.dot(along) <= 0.0 && state.velocity.dot(along) <= 0.0;
    let forward = if stands { forward.max(0.0) } else { forward };
    State {
        position: along * state.velocity.dot(along),
        velocity: along * forward,
        attitude: Quaternion::from_imag(Vector3::zeros()),
        rates: Vector3::zeros(),
        flexible: Flexible::default(),
    }
}

/// A gimbal angle (rad) after `dt_s` on its way to a command (rad): held within the limit, through
/// the first-order lag, no faster than it can.
fn gimbal_after(p: &RocketParameters, from_rad: f64, command_rad: f64, dt_s: f64) -> f64 {
    let command = command_rad.clamp(-p.gimbal_limit_rad, p.gimbal_limit_rad);
    let approach = 1.0 - (-std::f64::consts::TAU * p.gimbal_hz * dt_s).exp();
    let most = p.gimbal_rate_rad_s * dt_s;
    from_rad + ((command - from_rad) * approach).clamp(-most, most)
}

#[cfg(test)]
mod tests;
