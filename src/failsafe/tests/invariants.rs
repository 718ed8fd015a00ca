//! What holds on every edge and in every state that can be reached.

use super::*;

/// Nothing but an order to release, to a vehicle that is armed, makes it active.
fn is_active_by_release_alone(before: &Seat, event: &Event, reply: &Reply, after: &Seat) -> bool {
    before.state().is_active()
        || !after.state().is_active()
        || before.state() == State::Armed
            && *event == Event::Order(Command::Release)
            && *reply == Some(Ok(()))
}

/// Nothing but an order to arm, to a vehicle in standby, arms it.
fn is_armed_by_order_alone(before: &Seat, event: &Event, reply: &Reply, after: &Seat) -> bool {
    before.state().is_armed()
        || !after.state().is_armed()
        || before.state() == State::Standby
            && *event == Event::Order(Command::Arm)
            && *reply == Some(Ok(()))
}

/// What is armed or released has passed each check at that instant. Nothing is left to acknowledge,
/// the sensor delivers, the attitude has settled and is known, the tilt is small, and the host is
/// heard where it is asked for.
fn is_checked(before: &Seat, _: &Event, _: &Reply, after: &Seat) -> bool {
    let enters = before.state().kind() != after.state().kind() && after.state().is_armed();
    let Supervisor { report, health, good_run, host_required, .. } = &before.supervisor;
    let certain = health.certain || after.state().is_active();
    let sound = health.valid && health.settled && health.bias == BiasState::Known && certain;
    let heard = before.supervisor.host_is_heard(before.now) || !host_required;
    !enters
        || report.latch().is_none()
            && *good_run == RECOVERY_SAMPLES
            && sound
            && health.cos_tilt_q30 >= COS_ARM_TILT_Q30
            && heard
}

/// An order that is refused changes nothing, and one that is obeyed leads where it says.
fn is_done_as_answered(before: &Seat, event: &Event, reply: &Reply, after: &Seat) -> bool {
    let state = after.state();
    match (reply, event) {
        (Some(Err(_)), _) => format!("{before:?}") == format!("{after:?}"),
        (Some(Ok(())), Event::Order(command)) => match command {
            Command::Arm => state == State::Armed,
            Command::Release => state.is_active(),
            Command::TestPulse(..) => state.is_idle() && before.key() == after.key(),
            // What is left to acknowledge comes one at a time.
            Command::Disarm => {
                let more = matches!(state, State::Latched(Latch::ParametersLost));
                state.is_idle() || more && before.state() != state
            }
        },
        (Some(Ok(())), Event::Calibrate) => {
            let health = &after.supervisor.health;
            state == State::Boot && !health.settled && health.bias == BiasState::Unknown
        }
        _ => true,
    }
}

/// The question whether an order would be obeyed is answered as the order is.
fn is_told_beforehand(before: &Seat, event: &Event, reply: &Reply, _: &Seat) -> bool {
    match event {
        Event::Order(command) => Some(before.supervisor.may(before.now, *command)) == *reply,
        _ => true,
    }
}

/// A failsafe and a latched fault stay, with their first reason, until somebody acknowledges them.
fn is_ended_by_disarm_alone(before: &Seat, event: &Event, reply: &Reply, after: &Seat) -> bool {
    let holds = matches!(before.state(), State::Failsafe(_) | State::Latched(_));
    let acknowledged = *event == Event::Order(Command::Disarm) && *reply == Some(Ok(()));
    !holds || acknowledged || before.state() == after.state()
}

/// Without a sample control ends with the step at which the newest one is older than
/// [`DATA_AGE_LIMIT_US`].
fn ends_without_samples(seat: &Seat) -> bool {
    let mut seat = seat.clone();
    let fresh = seat.supervisor.fresh.unwrap_or(seat.now);
    while seat.state().is_active() && seat.now.since(fresh) <= DATA_AGE_LIMIT_US {
        seat.miss(SensorFault::Nak);
    }
    !seat.state().is_active()
}

/// Control ends within 0.3 s where one sample in four is good. Behind a second of good samples it
/// goes on for a second where two in three are good.
fn ends_with_few_samples_alone(seat: &Seat) -> bool {
    let flown = |seat: &Seat, steps: u32, good: fn(u32) -> bool| {
        let mut seat = seat.clone();
        for step in 0..steps {
            match good(step) {
                true => seat.sample(GOOD, 0),
                false => seat.miss(SensorFault::Nak),
            }
        }
        seat.state().is_active()
    };
    let mut rested = seat.clone();
    rested.second([0, -981]);
    rested.undergo(&Event::Heartbeat);
    let goes_on = flown(&rested, 100, |step| step % 3 != 0);
    !flown(seat, 30, |step| step % 4 == 0) && goes_on == rested.state().is_active()
}

/// A fault by which the samples before it were wrong already ends control at once, and so do an
/// attitude that is no rotation and a sample that is too old.
fn ends_at_once(seat: &Seat) -> bool {
    let faults = [
        Event::Miss(SensorFault::Reset),
        Event::Miss(SensorFault::Frozen),
        Event::Miss(SensorFault::Unreliable),
        Event::Sample(Flaw::Invalid, Tilt::Little, 0),
        Event::Sample(Flaw::None, Tilt::Little, DATA_AGE_LIMIT_US + 1),
    ];
    faults.iter().all(|fault| {
        let mut seat = seat.clone();
        seat.undergo(fault);
        !seat.state().is_active()
    })
}

/// Tilt beyond the limit ends control within [`FAILSAFE_TILT_US`] of the step that sees it.
fn ends_by_tilt(seat: &Seat) -> bool {
    let mut seat = seat.clone();
    let steps = FAILSAFE_TILT_US / TICK_US + 1;
    (0..steps).for_each(|_| seat.sample(health(Flaw::None, Tilt::Fallen), 0));
    !seat.state().is_active()
}

/// Where the host is asked for, its silence ends control within three seconds.
fn ends_by_silence(seat: &Seat) -> bool {
    let mut seat = seat.clone();
    seat.undergo(&Event::Silence);
    !seat.supervisor.host_required || !seat.state().is_armed()
}

/// The operator finds a way back from everywhere: the vehicle rests, the host is heard, and what
/// there is to acknowledge is acknowledged.
fn leads_back_to_standby(seat: &Seat) -> bool {
    let mut seat = seat.clone();
    // Behind one latched fault there may be another.
    for _ in 0..3 {
        seat.undergo(&Event::Rest);
        seat.undergo(&Event::Heartbeat);
        let _ = seat.order(Command::Disarm);
    }
    seat.undergo(&Event::Rest);
    seat.state() == State::Standby
}

type OfEdge = fn(&Seat, &Event, &Reply, &Seat) -> bool;
type OfState = fn(&Seat) -> bool;

const OF_EDGES: [(&str, OfEdge); 6] = [
    ("active by release alone", is_active_by_release_alone),
    ("armed by order alone", is_armed_by_order_alone),
    ("checked", is_checked),
    ("done as answered", is_done_as_answered),
    ("told beforehand", is_told_beforehand),
    ("ended by disarm alone", is_ended_by_disarm_alone),
];

const OF_STATES: [(&str, OfState); 6] = [
    ("ends without samples", ends_without_samples),
    ("ends with few samples alone", ends_with_few_samples_alone),
    ("ends at once", ends_at_once),
    ("ends by tilt", ends_by_tilt),
    ("ends by silence", ends_by_silence),
    ("leads back to standby", leads_back_to_standby),
];

#[test]
fn every_state_and_edge_keeps_what_is_promised() {
    let mut kinds = Vec::new();
    explore(
        |seat| {
            for (name, holds) in OF_STATES {
                assert!(holds(seat), "{name}: {seat:?}");
            }
            kinds.push(seat.state().summary());
        },
        |before, event, reply, after| {
            for (name, holds) in OF_EDGES {
                let held = holds(before, event, reply, after);
                assert!(held, "{name}: {before:?}\n{event:?} {reply:?}\n{after:?}");
            }
        },
    );
    // Every state with every reason was among them.
    kinds.sort_unstable_by_key(|code| code.number());
    kinds.dedup();
    assert_eq!(kinds.len(), StateCode::COUNT, "{kinds:?}");
}
