//! A control channel: from the angle about an axis to the pulse of its servo.

use tvc_pid::{Coefficients, Q16};

use crate::axis::Axis;
use crate::controller::{Controller, LawState, Sample};
use crate::params::Params;
use crate::servo::{Commanded, PulseUs, Servo};
use crate::words::Words;

/// Control law and servo of one axis.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    axis: Axis,
    controller: Controller,
    servo: Servo,
}

/// What they remember.
#[derive(Clone, Debug)]
pub(crate) struct ChannelState {
    law: LawState,
    /// Crank angle that control asked for last, rad, before limits; zero while it is not active.
    pub(crate) crank: Q16,
    pub(crate) commanded: Commanded,
}

impl Channel {
    /// The channel of an axis.
    #[inline(never)]
    pub(crate) fn new(params: &Params, axis: Axis) -> Self {
        let servo = Servo::new(params, axis);
        Self { axis, controller: Controller::new(params, axis, servo.travel_rad()), servo }
    }

    /// Take over changed parameters. The last pulse stays, so that the next one still obeys the
    /// slew rate.
    pub(crate) fn configure(&mut self, state: &mut ChannelState, params: &Params) {
        self.servo = Servo::new(params, self.axis);
        let travel_rad = self.servo.travel_rad();
        self.controller.configure(&mut state.law, params, self.axis, travel_rad);
    }

    /// The control law moves the rudder, `dt_us` after the last time. `gains` are those of a
    /// schedule.
    pub(crate) fn control(
        &self,
        state: &mut ChannelState,
        sample: &Sample,
        gains: Option<&Coefficients<Q16>>,
        dt_us: u32,
    ) {
        state.crank = self.controller.update(&mut state.law, sample, gains);
        self.command(state, dt_us);
    }

    /// The rudder of a vehicle that is held answers its tilt, `dt_us` after the last time. That the
    /// vehicle does not follow its rudder is no disturbance.
    pub(crate) fn show(&self, state: &mut ChannelState, sample: &Sample, dt_us: u32) {
        self.controller.reset(&mut state.law);
        state.crank = self.controller.show(sample);
        self.command(state, dt_us);
    }

    fn command(&self, state: &mut ChannelState, dt_us: u32) {
        state.commanded = self.servo.command(state.commanded, state.crank, dt_us);
    }

    /// Control goes on without a sample: the last command stays.
    pub(crate) fn coast(&self, state: &mut ChannelState, is_carried: bool) {
        self.controller.coast(&mut state.law, is_carried);
    }

    /// Nobody controls the rudder: it is neutral, or follows a test pulse.
    pub(crate) fn rest(&self, state: &mut ChannelState, test: Option<PulseUs>) {
        state.crank = Q16::default();
        self.controller.reset(&mut state.law);
        state.commanded = test.map_or(self.servo.neutral(), Commanded::now);
    }

    /// The pulse of the rudder at rest.
    pub(crate) fn neutral_pulse(&self) -> PulseUs {
        self.servo.neutral_pulse()
    }
}

impl ChannelState {
    /// Of a rudder that rests at neutral.
    #[inline(never)]
    pub(crate) fn at_rest(params: &Params, axis: Axis) -> Self {
        Self {
            law: LawState::at_rest(params),
            crank: Q16::default(),
            commanded: Servo::new(params, axis).neutral(),
        }
    }

    /// The plant's gain that the law estimates, in those of `PITCH_GAIN`.
    pub(crate) fn plant_gain(&self) -> Q16 {
        self.law.plant_gain()
    }

    /// Its words.
    pub(crate) const WORDS: usize = LawState::WORDS + Q16::WORDS + Commanded::WORDS;

    /// Shows the words.
    pub(crate) fn tell(&self, each: &mut dyn FnMut(i32)) {
        self.law.tell(each);
        self.crank.tell(each);
        self.commanded.tell(each);
    }

    /// Takes over the words that a channel of the same law [told](Self::tell).
    pub(crate) fn resume(&mut self, next: &mut dyn FnMut() -> i32) {
        self.law.resume(next);
        self.crank = Words::told(next);
        self.commanded = Words::told(next);
    }
}
