//! The gain schedule as the parameters configure it: gains of laws 0 and 3 over the time since the
//! release, for a vehicle whose mass, inertia and air change.

use tvc_pid::{Coefficients, Gains, Q16, Schedule};

use crate::controller;
use crate::params::{Params, Place, whole};

/// Rows of the schedule, at most.
const ROWS: usize = 6;

/// Gains over time, linear between rows, constant before the first and behind the last.
#[derive(Clone, Debug, Default)]
pub(crate) struct GainSchedule {
    rows: Schedule<Q16, ROWS>,
    /// The parameters' rows are not those in force: their times do not rise.
    is_refused: bool,
}

impl GainSchedule {
    #[inline(never)]
    pub(crate) fn new(params: &Params) -> Self {
        let mut schedule = Self::default();
        schedule.configure(params);
        schedule
    }

    /// Load the parameters' rows. If their times do not rise, the old rows stay in force.
    // Not inlined: who calls it needs the stack for more.
    #[inline(never)]
    pub(crate) fn configure(&mut self, params: &Params) {
        // A row's four values stand in a line, one row behind the other.
        let (values, _) = params.values_from(Place::gs1_s).as_chunks();
        let used = values.iter().take((whole(params.gs_rows()) as usize).min(ROWS));
        let rows = used.map_while(|&[at_s, kp, ki, kd]| {
            Some((at_s, controller::scheduled(params, Gains { kp, ki, kd })?))
        });
        self.is_refused = self.rows.set(rows).is_err();
    }

    /// Whether the gains are the same throughout.
    pub(crate) fn is_constant(&self) -> bool {
        self.rows.is_empty()
    }

    /// Whether a vehicle can be flown by the parameters' rows.
    pub(crate) fn is_possible(&self) -> bool {
        !self.is_refused
    }

    /// The gains at a time since the release, s; `None` where they are constant.
    pub(crate) fn at(&self, seconds: Q16) -> Option<Coefficients<Q16>> {
        self.rows.at(seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tvc_pid::{Controller, Law, Pid};

    fn params(changes: &[(&str, f32)]) -> Params {
        let mut params = Params::default();
        let rows = [
            ("PID_LAW", 0.0),
            ("GS_ROWS", 2.0),
            ("GS1_S", 0.0),
            ("GS1_KP", 2.0),
            ("GS2_S", 10.0),
            ("GS2_KP", 4.0),
            ("GS2_KD", 1.0),
        ];
        for (name, value) in rows.iter().chain(changes) {
            params.set(name, *value).unwrap();
        }
        params
    }

    fn configured(params: &Params) -> GainSchedule {
        let mut schedule = GainSchedule::default();
        schedule.configure(params);
        schedule
    }

    /// The law is asked, whose output at rest is the gain times the error.
    fn kp(schedule: &GainSchedule, seconds: f32) -> f32 {
        let mut pid = Controller::<Q16, Pid<Q16>>::new(&tvc_pid::Config {
            limit: -100.0..=100.0,
            ..tvc_pid::Config::new(0.01)
        })
        .unwrap();
        pid.law.set_gains(&schedule.at(seconds.into()).unwrap());
        pid.update(1.0.into(), 0.0.into(), 0.0.into()).into()
    }

    #[test]
    fn gains_follow_the_rows() {
        let schedule = configured(&params(&[]));
        assert!(schedule.is_possible() && !schedule.is_constant());
        for (seconds, expected) in [(0.0, 2.0), (5.0, 3.0), (10.0, 4.0), (90.0, 4.0)] {
            assert!((kp(&schedule, seconds) - expected).abs() < 1e-3, "{seconds}");
        }
    }

    #[test]
    fn no_rows_and_laws_without_a_schedule_have_constant_gains() {
        for change in [("GS_ROWS", 0.0), ("PID_LAW", 2.0)] {
            assert!(configured(&params(&[change])).is_constant(), "{change:?}");
        }
        assert!(!configured(&params(&[("PID_LAW", 3.0)])).is_constant());
    }

    #[test]
    fn rows_whose_times_do_not_rise_are_refused_and_the_old_ones_stay() {
        let mut schedule = configured(&params(&[]));
        schedule.configure(&params(&[("GS2_S", 0.0), ("GS1_KP", 9.0)]));
        assert!(!schedule.is_possible());
        assert!((kp(&schedule, 0.0) - 2.0).abs() < 1e-3);
        schedule.configure(&params(&[("GS1_KP", 9.0)]));
        assert!(schedule.is_possible());
        assert!((kp(&schedule, 0.0) - 9.0).abs() < 1e-3);
    }
}
