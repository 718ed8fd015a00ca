//! A control channel: from the angle about an axis to the pulse of its servo.

use tvc_pid::{Coefficients, Q16, Scalar};

use crate::axis::Axis;
use crate::controller::{Controller, Sample};
use crate::memory::fixed;
use crate::params::Params;
use crate::servo::{PulseUs, Servo};

/// Control law and servo of one axis.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    axis: Axis,
    controller: Controller,
    /// Crank angle that control asked for last, rad, before limits; zero while it is not active.
    crank: Q16,
    servo: Servo,
}

impl Channel {
    /// Words of its part of [`Flight::memory`](crate::Flight::memory).
    pub(crate) const MEMORY_WORDS: usize = Controller::MEMORY_WORDS + 2;

    /// An axis whose rudder rests at neutral.
    pub(crate) fn new(params: &Params, axis: Axis) -> Self {
        let servo = Servo::new(params, axis);
        Self {
            axis,
            controller: Controller::new(params, axis, servo.travel_rad()),
            crank: Q16::ZERO,
            servo,
        }
    }

    /// Take over changed parameters.
    pub(crate) fn configure(&mut self, params: &Params) {
        self.servo.configure(params, self.axis);
        let travel_rad = self.servo.travel_rad();
        self.controller.configure(params, self.axis, travel_rad);
    }

    /// Whether the servo is as the parameters say.
    pub(crate) fn is_intact(&self, params: &Params) -> bool {
        self.servo.is_as(params, self.axis)
    }

    /// Take over the gains that the schedule has for now.
    pub(crate) fn follow(&mut self, gains: &Coefficients<Q16>) {
        self.controller.follow(gains);
    }

    /// The control law moves the rudder, `dt_us` after the last time.
    pub(crate) fn control(&mut self, sample: &Sample, dt_us: u32) {
        self.crank = self.controller.update(sample);
        self.servo.command(self.crank, dt_us);
    }

    /// The rudder of a vehicle that is held answers its tilt, `dt_us` after the last time. That the
    /// vehicle does not follow its rudder is no disturbance.
    pub(crate) fn show(&mut self, sample: &Sample, dt_us: u32) {
        self.controller.reset();
        self.crank = self.controller.show(sample);
        self.servo.command(self.crank, dt_us);
    }

    /// Control goes on without a sample: the last command stays.
    pub(crate) fn coast(&mut self, is_carried: bool) {
        self.controller.coast(is_carried);
    }

    /// Nobody controls the rudder: it is neutral, or follows a test pulse.
    pub(crate) fn rest(&mut self, test: Option<PulseUs>) {
        self.crank = Q16::ZERO;
        self.controller.reset();
        match test {
            Some(pulse) => self.servo.set(pulse),
            None => self.servo.neutral(),
        };
    }

    /// Crank angle that control asked for last, rad, before limits; zero while it is not active.
    pub(crate) fn crank(&self) -> Q16 {
        self.crank
    }

    /// The pulse for the next servo frame.
    pub(crate) fn pulse(&self) -> PulseUs {
        self.servo.pulse()
    }

    /// The pulse of the rudder at rest.
    pub(crate) fn neutral_pulse(&self) -> PulseUs {
        self.servo.neutral_pulse()
    }

    /// See [`Flight::memory`](crate::Flight::memory).
    pub(crate) fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        self.controller.memory(each);
        self.crank = fixed(self.crank, each);
        self.servo.memory(each);
    }
}
