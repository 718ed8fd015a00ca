//! What an operator orders, and who moves a rudder.

use tvc_imu::Micros;

use super::Flight;
use crate::axis::Axis;
use crate::config::TEST_PULSE_US;
use crate::failsafe::{Command, Refusal, State};
use crate::params::Polarity;
use crate::servo::PulseUs;

/// A pulse that an operator has ordered for the servo of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct TestPulse {
    pub(super) axis: Axis,
    pulse: PulseUs,
    /// When it expires.
    until: Micros,
}

impl TestPulse {
    /// None: it expired at time 0.
    pub(super) const NONE: Self =
        Self { axis: Axis::Pitch, pulse: PulseUs::NONE, until: Micros(0) };
}

/// Who moves a rudder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rudder {
    /// The control law.
    Controlled,
    /// The operator, by a test pulse.
    Tested(PulseUs),
    /// Nobody.
    Neutral,
}

impl Flight {
    /// Obey the operator, or say why not.
    ///
    /// # Errors
    /// The [`Refusal`]; nothing changes.
    pub fn command(&mut self, now: Micros, command: Command) -> Result<(), Refusal> {
        self.permit(command)?;
        self.state.supervisor.command(now, command)?;
        self.state.test_pulse = match command {
            Command::TestPulse(axis, pulse) => {
                TestPulse { axis, pulse, until: now.after(TEST_PULSE_US) }
            }
            _ => TestPulse::NONE,
        };
        Ok(())
    }

    /// Whether a command would be obeyed.
    ///
    /// # Errors
    /// The [`Refusal`].
    pub fn may(&self, now: Micros, command: Command) -> Result<(), Refusal> {
        self.permit(command)?;
        self.state.supervisor.may(now, command)
    }

    /// What the parameters say about a command.
    fn permit(&self, command: Command) -> Result<(), Refusal> {
        let timing = &self.settings.timing;
        let mut axes = self.settings.params.axes().iter();
        match (command, self.state()) {
            (Command::Arm, state) if state.is_idle() && timing.is_too_slow() => {
                Err(Refusal::SlowBus(timing.burst_us()))
            }
            (Command::Arm, State::Standby) if !self.settings.free_flight.is_possible() => {
                Err(Refusal::Schedule)
            }
            (Command::Arm, State::Standby)
                if axes.any(|axis| self.settings.params.polarity(*axis) != Polarity::Checked) =>
            {
                Err(Refusal::Polarity)
            }
            (Command::TestPulse(axis, _), state) if state.is_idle() => {
                if !axes.any(|steered| *steered == axis) {
                    Err(Refusal::NotSteered)
                } else if self.settings.params.polarity(axis) == Polarity::Watched {
                    Err(Refusal::RudderAnswers)
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        }
    }

    /// Who moves the rudder of an axis: control while it is active, or in standby while somebody
    /// looks at the polarity by a host that is heard; a test pulse where nobody needs the rudder;
    /// nobody else.
    pub(super) fn rudder(&self, now: Micros, axis: Axis) -> Rudder {
        let test = self.state.test_pulse;
        match (self.state(), self.settings.params.polarity(axis)) {
            (State::Active { .. }, _) => Rudder::Controlled,
            (State::Standby, Polarity::Watched) if self.state.supervisor.host_is_heard(now) => {
                Rudder::Controlled
            }
            (state, _) if state.is_idle() && axis == test.axis && now < test.until => {
                Rudder::Tested(test.pulse)
            }
            _ => Rudder::Neutral,
        }
    }
}
