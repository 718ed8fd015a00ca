//! What the vehicle promises, judged from outside: by what it tells, by its pulses, and by what
//! really happened to it.

use std::format;
use std::vec::Vec;

use mavlink::dialects::common::MavResult;

use super::events::{Event, Ordered};
use super::vehicle::{Rudder, Said, TICK_US, Vehicle};
use super::world::Trouble;
use super::*;
use crate::config::{
    ARM_TILT_DEG, DATA_AGE_LIMIT_US, FAILSAFE_TILT_DEG, FAILSAFE_TILT_US, RECOVERY_SAMPLES,
    TEST_PULSE_US,
};
use crate::params::Polarity;

const ACCEPTED: u8 = MavResult::MAV_RESULT_ACCEPTED as u8;
const IN_PROGRESS: u8 = MavResult::MAV_RESULT_IN_PROGRESS as u8;

/// A packet of the host: the vehicle before and after it, and what it said meanwhile.
pub(super) struct Exchange<'a> {
    pub(super) before: &'a Vehicle,
    pub(super) event: &'a Event,
    pub(super) after: &'a Vehicle,
    pub(super) said: &'a [Said],
}

impl Exchange<'_> {
    fn ordered(&self) -> Option<Ordered> {
        match self.event {
            Event::Order(ordered) => Some(*ordered),
            _ => None,
        }
    }

    /// How the order was answered. A save that was ordered before and ends now is answered later.
    fn result(&self) -> Option<u8> {
        let acks = Vehicle::acks(self.said, self.ordered()?.number());
        acks.first().map(|(result, _)| *result)
    }

    /// All that an order can change, but for what is stored ([`is_stored_as_told`]).
    fn has_changed(&self) -> bool {
        let of = |vehicle: &Vehicle| {
            // Apart from the progress of a self-test: a save counts there.
            let is_testing = matches!(vehicle.state(), State::SelfTest(_));
            (
                vehicle.state().code(),
                (!is_testing).then_some(vehicle.state()),
                vehicle.flight.params().clone(),
                vehicle.world.reset_at,
                vehicle.world.shown,
                vehicle.flight.is_calibrated(),
            )
        };
        of(self.before) != of(self.after)
    }
}

/// An order has one answer at once, or it is noted and has one later. A vehicle that nobody listens
/// to says nothing.
pub(super) fn is_answered_once(exchange: &Exchange<'_>) -> bool {
    let Some(ordered) = exchange.ordered() else {
        return true;
    };
    let answers = Vehicle::acks(exchange.said, ordered.number()).len();
    let is_noted = ordered.is_of_storage() && exchange.after.is_storing();
    match exchange.after.world.port {
        Port::Open => match answers {
            0 => is_noted,
            1 => true,
            _ => answers == 2 && exchange.before.owed.contains(&ordered.number()),
        },
        Port::Absent => answers == 0,
        // A host that was not heard before is listened to, and not obeyed yet.
        Port::Silent => answers <= 1,
    }
}

/// What was accepted is done.
pub(super) fn is_done_if_accepted(exchange: &Exchange<'_>) -> bool {
    let (Some(ordered), Some(ACCEPTED)) = (exchange.ordered(), exchange.result()) else {
        return true;
    };
    let (before, after) = (exchange.before, exchange.after);
    let state = after.state();
    match ordered {
        Ordered::Arm => state == State::Armed,
        Ordered::Release => state.is_active(),
        Ordered::Disarm => {
            let is_next = matches!(state, State::Latched(_)) && state != before.state();
            state.is_idle() || is_next
        }
        Ordered::Check => {
            let mut tried = before.clone();
            tried.flight.command(before.now, Command::Arm).is_ok()
        }
        Ordered::Pulse => {
            let mut tried = after.clone();
            tried.step();
            // The step itself may end in a failsafe.
            tried.rudder() == Rudder::Tested || !tried.state().is_idle()
        }
        Ordered::Reboot => after.world.reset_at.is_some(),
        Ordered::Peek => after.world.shown == before.world.shown + 1,
        Ordered::Reload => after.flight.params() == after.stored().0,
        Ordered::Defaults => *after.flight.params() == Params::default(),
        Ordered::Save => after.flight.params() == after.stored().0,
        Ordered::Calibrate | Ordered::OtherPulse | Ordered::Nonsense | Ordered::Takeoff => false,
    }
}

/// What was not accepted has changed nothing: none is done and not acknowledged.
pub(super) fn is_accepted_if_done(exchange: &Exchange<'_>) -> bool {
    match (exchange.event, exchange.result()) {
        (Event::Order(Ordered::Calibrate), Some(IN_PROGRESS)) => {
            exchange.after.state() == State::Boot && !exchange.after.flight.is_calibrated()
        }
        (Event::Order(_), Some(ACCEPTED)) => true,
        (Event::Order(_) | Event::Heartbeat, _) => !exchange.has_changed(),
        _ => true,
    }
}

/// A parameter has the value that is told after it was set: the wanted one, or with an error the
/// old one. Of the others only the polarity changes with it.
pub(super) fn is_told_as_it_is(exchange: &Exchange<'_>) -> bool {
    let Event::Set(name, wanted) = exchange.event else {
        return true;
    };
    let values = |vehicle: &Vehicle| -> Vec<_> {
        let params = vehicle.flight.params().iter();
        params.map(|(info, value)| (info.name, value)).collect()
    };
    let is_refused = exchange.said.contains(&Said::Error);
    let told = exchange.said.iter().filter_map(|said| match said {
        Said::Value(name, value) => Some((name.as_str(), *value)),
        _ => None,
    });
    let told: Vec<_> = told.collect();
    let (before, after) = (values(exchange.before), values(exchange.after));
    let changed = before.iter().zip(&after).filter(|(old, new)| old != new);
    let is_open = exchange.after.world.port == Port::Open;
    let all_told = changed.into_iter().all(|(_, new)| told.contains(new));
    let true_ones = told.iter().all(|value| after.contains(value));
    let taken = after.contains(&(*name, *wanted));
    let known = Params::info(name).is_some();
    if is_open {
        let done = if is_refused { before == after } else { taken };
        all_told && true_ones && done && told.is_empty() != known
    } else {
        all_told
    }
}

/// Nothing but an order to release makes the vehicle active, but for a launch that was asked for,
/// and nothing but an order to arm arms it.
pub(super) fn is_moved_by_order(exchange: &Exchange<'_>) -> bool {
    let [before, after] = [exchange.before, exchange.after].map(Vehicle::state);
    let accepted = exchange.result() == Some(ACCEPTED);
    let ordered = |wanted| exchange.ordered() == Some(wanted) && accepted;
    (before.is_active()
        || !after.is_active()
        || before == State::Armed && ordered(Ordered::Release))
        && (before.is_armed()
            || !after.is_armed()
            || before == State::Standby && ordered(Ordered::Arm))
}

/// The same of a step.
pub(super) fn is_moved_by_launch_alone(event: &Event, before: State, after: &Vehicle) -> bool {
    let is_launch = *event == Event::Thrust && after.flight.params().launch_acc() > 0.0;
    (before.is_active() || !after.state().is_active() || before == State::Armed && is_launch)
        && (before.is_armed() || !after.state().is_armed())
}

/// What is armed has been checked: it has rested for a second since its start, its sensor has
/// delivered, it is not tilted, its rudder was seen to answer, its host is heard where that is
/// asked for.
pub(super) fn is_armed_checked(exchange: &Exchange<'_>) -> bool {
    let (before, after) = (exchange.before, exchange.after);
    let enters = before.state().kind() != after.state().kind() && after.state().is_armed();
    let params = before.flight.params();
    let tilt_deg = before.world.chip.pitch_rad.to_degrees().abs();
    !enters
        || before.truth.rest >= 100
            && before.truth.good_run >= u32::from(RECOVERY_SAMPLES)
            && tilt_deg < f64::from(ARM_TILT_DEG) + 1.0
            && params.polarity(Axis::Pitch) == Polarity::Checked
            && (params.fs_host() == 0.0 || before.is_heard())
            && params.i2c_stretch_us() < 370.0
}

/// The rudder is at neutral wherever the vehicle is not active, but for an idle one that is set up.
pub(super) fn is_neutral_unless_active(vehicle: &Vehicle) -> bool {
    vehicle.rudder() == Rudder::Neutral || vehicle.state().is_active() || vehicle.is_set_up()
}

/// Stored parameters are replaced in the turn in which a save is accepted, and in no other. Those
/// in use are replaced by a reload or by the defaults, as they say.
pub(super) fn is_stored_as_told(
    order: Option<Ordered>,
    old: &Params,
    after: &Vehicle,
    said: &[Said],
) -> bool {
    let acks = Vehicle::acks(said, Ordered::Save.number());
    let accepted = acks.iter().any(|(result, _)| *result == ACCEPTED);
    let (new, params) = (after.stored().0, after.flight.params());
    match order {
        Some(Ordered::Save) if accepted => new == params,
        Some(Ordered::Reload) if accepted => new == old && params == new,
        Some(Ordered::Defaults) if accepted => new == old && *params == Params::default(),
        _ => new == old,
    }
}

/// A failure, and the time within which the rudder is at neutral, us.
pub(super) struct Drill {
    pub(super) name: &'static str,
    trouble: Trouble,
    limit_us: u64,
}

/// Data are too old after [`DATA_AGE_LIMIT_US`], and a sensor whose rates stand still for 65 ms is
/// frozen. A step more takes notice.
pub(super) const DRILLS: [Drill; 5] = [
    Drill { name: "silent", trouble: Trouble::Silent, limit_us: DATA_AGE_LIMIT_US + TICK_US },
    Drill { name: "late", trouble: Trouble::Late, limit_us: DATA_AGE_LIMIT_US + TICK_US },
    Drill { name: "ones", trouble: Trouble::Ones, limit_us: DATA_AGE_LIMIT_US + TICK_US },
    Drill { name: "wild", trouble: Trouble::Wild, limit_us: DATA_AGE_LIMIT_US + 2 * TICK_US },
    Drill { name: "frozen", trouble: Trouble::Frozen, limit_us: 11 * TICK_US },
];

/// Control ends within the drill's time, and does not come back.
pub(super) fn ends_in_time(vehicle: &Vehicle, drill: &Drill) -> bool {
    let mut vehicle = vehicle.clone();
    vehicle.world.chip.trouble = drill.trouble;
    let since = vehicle.now;
    let mut holds = true;
    while vehicle.now.since(since) < drill.limit_us + 10 * TICK_US {
        vehicle.step();
        let is_due = vehicle.now.since(since) > drill.limit_us;
        holds &= !is_due || !is_controlled(&vehicle);
    }
    holds
}

/// Whether the rudder may move without a further order. Where it may not, a failure has nothing to
/// end: that nothing else moves it is a promise of its own.
pub(super) fn may_move(vehicle: &Vehicle) -> bool {
    vehicle.state().is_armed()
        || vehicle.flight.params().polarity(Axis::Pitch) == Polarity::Watched
        || vehicle.rudder() != Rudder::Neutral
}

/// Control moves the rudder, or would.
fn is_controlled(vehicle: &Vehicle) -> bool {
    vehicle.state().is_active() || vehicle.rudder() == Rudder::Moved
}

/// A sensor that has reset itself ends control in the time that the campaign of faults allows.
pub(super) fn ends_by_sensor_reset(vehicle: &Vehicle) -> bool {
    let mut vehicle = vehicle.clone();
    vehicle.world.chip.power_on();
    (0..15).for_each(|_| vehicle.step());
    // By then it may be back, in standby, for somebody who looks at the rudder.
    !vehicle.state().is_active()
}

/// Thrown over, the vehicle is given up [`FAILSAFE_TILT_US`] after its tilt is beyond the limit.
pub(super) fn ends_by_tilt(vehicle: &Vehicle) -> bool {
    let mut vehicle = vehicle.clone();
    let limit_rad = f64::from(FAILSAFE_TILT_DEG).to_radians();
    let mut over_us = 0;
    vehicle.world.chip.rate_rad_s = 5.0;
    while over_us <= FAILSAFE_TILT_US + TICK_US {
        if vehicle.world.chip.pitch_rad > limit_rad {
            over_us += TICK_US;
        }
        if vehicle.world.chip.pitch_rad >= 1.2 {
            vehicle.world.chip.rate_rad_s = 0.0;
        }
        vehicle.step();
    }
    !vehicle.state().is_active()
}

/// Where the host is asked for, its silence ends control within three seconds. A pulse that is
/// tried ends after two. A rudder that somebody looks at is neutral without a host.
pub(super) fn ends_by_silence(vehicle: &Vehicle) -> bool {
    let mut vehicle = vehicle.clone();
    let steps = |vehicle: &mut Vehicle, us| (0..us / TICK_US).for_each(|_| vehicle.step());
    steps(&mut vehicle, TEST_PULSE_US + TICK_US);
    let is_tried = vehicle.rudder() == Rudder::Tested && !vehicle.state().is_active();
    steps(&mut vehicle, 1_000_000 - TICK_US);
    let is_asked_for = vehicle.flight.params().fs_host() == 1.0;
    let is_bound = is_asked_for || !vehicle.state().is_active();
    !(is_tried || is_bound && is_controlled(&vehicle))
}

/// As long as somebody listens: what is noted is answered, but for a calibration that does not come
/// to its end, of which the vehicle says so every second; and an accepted reboot comes unless the
/// vehicle is armed.
pub(super) fn is_answered_later(vehicle: &Vehicle) -> bool {
    let mut vehicle = vehicle.clone();
    if vehicle.world.port != Port::Open {
        return true;
    }
    if vehicle.world.reset_at.is_some() && !vehicle.state().is_armed() {
        (0..11).for_each(|_| vehicle.step());
        return vehicle.world.is_reset;
    }
    for step in 0..1000 {
        if vehicle.owed.is_empty() {
            return true;
        }
        if step == 890 {
            vehicle.said.clear();
        }
        vehicle.step();
    }
    let calibration = Ordered::Calibrate.number();
    let goes_on = Vehicle::acks(&vehicle.said, calibration);
    vehicle.owed.len() == 1
        && vehicle.owed.contains(&calibration)
        && !vehicle.flight.is_calibrated()
        && goes_on.iter().any(|(result, _)| *result == IN_PROGRESS)
}

/// For a message of what failed.
pub(super) fn shown(vehicle: &Vehicle) -> std::string::String {
    format!("{:?}", vehicle.key())
}
