//! The drone with two rudders: the two-axis successor of the tethered drone.
//!
//! A rigid body hangs in a joint that lets it pitch, roll and spin about the pivot. Each of two
//! rudders in its wash has the linkage and the servo of the one-axis drone. The first moves in the
//! body's x-z plane and makes a pitch moment, the second in its y-z plane and makes a roll moment.
//! Lists of two name pitch first, then roll.
//!
//! Body axes: x forward, y right, z down, from the pivot; earth axes: north, east, down. Of a
//! linkage's plane, `X` is forward or left and `Y` is up, so that positive angles in it are nose up
//! or right side down, as those of [`Drone`](crate::Drone).
//!
//! # Equations
//! With the inertia `J` about the pivot, which depends on both cranks, and the momenta that the
//! linkages have in the body, about the normals `n` of their planes,
//!
//! ```text
//! H = J(th_a, th_b) w + M01(th_a) v_a n_a + M01(th_b) v_b n_b + h z
//! dH/dt = M - w x H            (body axes)
//! ```
//!
//! where `M` are the moments of wash, thrust, gravity and friction about the pivot, and `h` the
//! momentum of propellers that do not cancel. As in one axis, cranks are prescribed: no
//! acceleration of theirs is needed. Nothing but `M` turns the body about its thrust axis.
//!
//! # The body
//! Its centre of mass and inertia are such that the whole is balanced as the one-axis drone of the
//! same [`Parameters`](crate::Parameters) is, and turns as easily about either axis: gains for one
//! axis hold for two. While the second axis is upright and still, the first is the one-axis drone.
//! Each rudder is taken to be in the whole wash, and what moves of a linkage to be as thin as a rod
//! along its length.

mod parameters;
mod shape;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

pub use self::parameters::TwoAxisParameters;
use self::shape::{Body, Shape};
use crate::drone::{Crank, TETHER_STOP_RAD};
use crate::mechanism::Mechanism;
use crate::parameters::Checked;
use crate::servo::Load;
use crate::tilt;

/// Orientation and momentum.
#[derive(Clone, Copy, Debug)]
struct State {
    attitude: Quaternion<f64>,
    /// About the pivot, body axes, kg m2/s; that of the rotors apart.
    momentum: Vector3<f64>,
}

impl State {
    fn ahead(&self, slope: &Self, dt_s: f64) -> Self {
        Self {
            attitude: self.attitude + slope.attitude * dt_s,
            momentum: self.momentum + slope.momentum * dt_s,
        }
    }
}

/// The drone in its joint.
#[derive(Clone, Debug)]
pub struct TwoAxisDrone {
    mechanism: Mechanism,
    parameters: TwoAxisParameters,
    /// The body without its linkages.
    body: Body,
    stop_rad: f64,
    held: bool,
    attitude: UnitQuaternion<f64>,
    momentum: Vector3<f64>,
    cranks: [Crank; 2],
    shape: Shape,
}

impl TwoAxisDrone {
    /// A free drone with an attitude (body to earth) and rates about the body's axes (rad/s),
    /// rudders at zero, cranks at rest.
    ///
    /// # Errors
    /// The first figure out of range, by name, or a body with such an inertia that cannot be.
    pub fn new(
        parameters: &TwoAxisParameters,
        attitude: UnitQuaternion<f64>,
        rates_rad_s: [f64; 3],
    ) -> Checked<Self> {
        let (mechanism, body) = parameters.checked()?;
        let cranks = [Crank::at_rest(mechanism.linkage().zero_rudder_crank_rad()); 2];
        let shape = Shape::at(&mechanism, &body, cranks.map(|crank| crank.angle_rad));
        let mut drone = Self {
            mechanism,
            parameters: *parameters,
            body,
            stop_rad: TETHER_STOP_RAD,
            held: false,
            attitude,
            momentum: Vector3::zeros(),
            cranks,
            shape,
        };
        drone.set_rates(rates_rad_s);
        Ok(drone)
    }

    /// Clamps the drone in an attitude: it stays there until it is released.
    pub fn clamp(&mut self, attitude: UnitQuaternion<f64>) {
        self.attitude = attitude;
        self.held = true;
        self.set_rates([0.0; 3]);
    }

    /// Lets go of a clamped drone, or pushes a free one, with rates about the body's axes, rad/s.
    pub fn release(&mut self, rates_rad_s: [f64; 3]) {
        self.held = false;
        self.set_rates(rates_rad_s);
    }

    /// Adds an angular impulse about the pivot, body axes, N m s. A clamp swallows it.
    pub fn kick(&mut self, impulse_n_m_s: [f64; 3]) {
        if !self.held {
            self.momentum += Vector3::from(impulse_n_m_s);
        }
    }

    /// Changes the thrust (N) from now on; motion stays as it is.
    pub fn set_thrust(&mut self, thrust_n: f64) {
        if thrust_n != self.mechanism.parameters().thrust_n {
            self.mechanism = self.mechanism.with_thrust(thrust_n);
            self.shape = self.shape_at(self.cranks.map(|crank| crank.angle_rad));
        }
    }

    /// Advances by `dt_s` (greater than zero), at whose end the cranks stand at `end`, which they
    /// reach evenly. Fourth-order Runge-Kutta; a tether stop is inelastic.
    pub fn step(&mut self, dt_s: f64, end: [Crank; 2]) {
        let start = self.cranks;
        let angles = |share: f64| {
            [0, 1].map(|axis| {
                let (from, to) = (start[axis].angle_rad, end[axis].angle_rad);
                from + share * (to - from)
            })
        };
        let finish = self.shape_at(angles(1.0));
        if !self.held {
            let middle = self.shape_at(angles(0.5));
            let speeds = [0, 1].map(|axis| (end[axis].angle_rad - start[axis].angle_rad) / dt_s);
            let from = State { attitude: self.attitude.into_inner(), momentum: self.momentum };
            let slope = |shape: &Shape, state: &State| self.slope(shape, speeds, state);
            let k1 = slope(&self.shape, &from);
            let k2 = slope(&middle, &from.ahead(&k1, 0.5 * dt_s));
            let k3 = slope(&middle, &from.ahead(&k2, 0.5 * dt_s));
            let k4 = slope(&finish, &from.ahead(&k3, dt_s));
            let state = from
                .ahead(&k1, dt_s / 6.0)
                .ahead(&k2, dt_s / 3.0)
                .ahead(&k3, dt_s / 3.0)
                .ahead(&k4, dt_s / 6.0);
            self.attitude = UnitQuaternion::from_quaternion(state.attitude);
            self.momentum = state.momentum;
        }
        (self.cranks, self.shape) = (end, finish);
        if self.held {
            self.set_rates([0.0; 3]);
        } else {
            self.stop();
        }
    }

    /// Attitude, body to north-east-down.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        self.attitude
    }

    /// Rates about the body's axes, rad/s.
    pub fn rates_rad_s(&self) -> [f64; 3] {
        self.shape.rates(self.speeds(), &self.momentum).into()
    }

    /// The tilt of the body's vertical against the earth's as a vector (the reduced attitude), rad:
    /// its parts about the body's y and x. Upside down, one of the shortest ways is taken.
    pub fn tilt_rad(&self) -> [f64; 2] {
        tilt::tilt_rad(&self.attitude)
    }

    /// The cranks as last given.
    pub fn cranks(&self) -> [Crank; 2] {
        self.cranks
    }

    /// Rudder angles, rad.
    pub fn rudder_rad(&self) -> [f64; 2] {
        self.shape.linkages.map(|at| at.linkage.rudder_rad())
    }

    /// Torques of wash and gravity on the cranks, in N m.
    pub fn hinge_torque_n_m(&self) -> [f64; 2] {
        let down = self.attitude.inverse() * Vector3::z();
        let gravity = self.parameters.one_axis.gravity_m_s2;
        [0, 1].map(|axis| {
            let at = &self.shape.linkages[axis];
            let [x, y] = at.first_moment_slope;
            let (along_x, along_y) = ([down.x, -down.y][axis], -down.z);
            at.wash_torque + gravity * (along_x * x + along_y * y)
        })
    }

    /// What the servos turn, each as [`Drone::crank_load`](crate::Drone::crank_load) has it about
    /// its own axis.
    pub fn crank_loads(&self) -> [Load; 2] {
        let hinges = self.hinge_torque_n_m();
        let state = State { attitude: self.attitude.into_inner(), momentum: self.momentum };
        let moment = self.slope(&self.shape, self.speeds(), &state).momentum;
        [0, 1].map(|axis| {
            let (at, about) = (&self.shape.linkages[axis], [1, 0][axis]);
            let inertia = self.shape.inertia[(about, about)];
            let share = if self.held { 0.0 } else { at.m01 / inertia };
            Load {
                torque_n_m: hinges[axis] - share * moment[about],
                inertia_kg_m2: at.m11 - share * at.m01,
            }
        })
    }

    /// Whether the clamp holds the drone.
    pub fn held(&self) -> bool {
        self.held
    }

    /// The mechanism of either axis, for its linkage and parameters.
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    fn shape_at(&self, cranks_rad: [f64; 2]) -> Shape {
        Shape::at(&self.mechanism, &self.body, cranks_rad)
    }

    /// Rates of the cranks, rad/s.
    fn speeds(&self) -> [f64; 2] {
        self.cranks.map(|crank| crank.rate_rad_s)
    }

    fn set_rates(&mut self, rates_rad_s: [f64; 3]) {
        self.momentum = self.shape.momentum(self.speeds(), &rates_rad_s.into());
    }

    /// Derivatives of attitude and momentum, in body axes, in N m.
    fn slope(&self, shape: &Shape, speeds: [f64; 2], state: &State) -> State {
        let p = &self.parameters;
        let attitude = UnitQuaternion::from_quaternion(state.attitude);
        let rates = shape.rates(speeds, &state.momentum);
        let mut momentum = shape.momentum(speeds, &rates);
        momentum.z += p.rotor_momentum_kg_m2_s;
        let down = attitude.inverse() * Vector3::z();
        let weight = p.one_axis.gravity_m_s2 * down;
        let [pitch, roll] = shape.linkages.map(|at| at.thrust_moment);
        let friction = p.one_axis.pivot_friction_n_m_s;
        let moment = Vector3::new(roll - friction * rates.x, pitch - friction * rates.y, 0.0);
        State {
            attitude: state.attitude * Quaternion::from_imag(0.5 * rates),
            momentum: moment + shape.first_moment.cross(&weight) - rates.cross(&momentum),
        }
    }

    /// At a stop the drone loses the part of its rate that would take it beyond.
    fn stop(&mut self) {
        let [pitch, roll] = self.tilt_rad();
        let angle = pitch.hypot(roll);
        if angle < self.stop_rad {
            return;
        }
        let outwards = Vector3::new(roll, pitch, 0.0) / angle;
        self.attitude *= UnitQuaternion::from_scaled_axis(outwards * (self.stop_rad - angle));
        let mut rates = Vector3::from(self.rates_rad_s());
        rates -= outwards * rates.dot(&outwards).max(0.0);
        self.set_rates(rates.into());
    }
}

#[cfg(test)]
mod tests;
