//! The parameter protocol.

use super::*;
use crate::store::tests::Mock;

const STORAGE: MavCmd = MavCmd::MAV_CMD_PREFLIGHT_STORAGE;
const RELOAD: f32 = 0.0;
const SAVE: f32 = 1.0;

fn values(messages: &[MavMessage]) -> Vec<(String, f32)> {
    messages
        .iter()
        .filter_map(|message| match message {
            MavMessage::PARAM_VALUE(p) => {
                Some((p.param_id.to_str().unwrap().to_string(), p.param_value))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn the_parameter_list_comes_complete_in_order_and_one_a_step() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let request = from_host(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 });
    assert!(link.tell(&request).is_empty());
    let mut seen = Vec::new();
    for _ in 0..Params::count() + 5 {
        link.record_step();
        let found = values(&take(&mut link.telemetry));
        assert!(found.len() <= 1);
        seen.extend(found);
    }
    let params = link.desk.flight.params();
    let expected: Vec<_> = (0..Params::count())
        .filter_map(|index| params.by_index(index))
        .map(|(info, value)| (info.name.to_string(), value))
        .collect();
    assert_eq!(seen, expected);
}

#[test]
fn a_parameter_out_of_range_is_refused_in_words_and_the_old_value_told() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let answer = link.tell(&set("PID_KP", 11.0));
    assert_eq!(texts(&answer), ["PID_KP must be 0 to 10"]);
    assert_eq!(values(&answer), [("PID_KP".to_string(), Params::default().pid_kp())]);
    let answer = link.tell(&set("NO_SUCH_NAME_AT_A", 1.0));
    assert_eq!(texts(&answer), ["no such parameter"]);
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let answer = link.tell(&set("SRV_RATE_HZ", 100.0));
    assert_eq!(texts(&answer), ["SRV_RATE_HZ: disarm first"]);
    assert_eq!(values(&answer), [("SRV_RATE_HZ".to_string(), 50.0)]);
}

#[test]
fn a_turned_servo_or_mount_is_told_with_the_polarity_that_it_takes_back() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let answer = values(&link.tell(&set("SRV_DIR", -1.0)));
    let expected = [("SRV_DIR", -1.0), ("SRV_POLARITY", 0.0), ("SRV2_POLARITY", 0.0)];
    assert_eq!(answer, expected.map(|(name, value)| (name.to_string(), value)));
}

#[test]
fn a_pulse_is_tried_within_the_hard_range_and_not_while_armed() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let result = |link: &mut Link, servo, us| {
        acks(&link.tell(&order(MavCmd::MAV_CMD_DO_SET_SERVO, servo, us)))[0].1
    };
    for (servo, us) in [(1.0, 852.0), (1.0, 2194.0), (1.0, f32::NAN), (3.0, 1500.0)] {
        let refused = result(&mut link, servo, us);
        assert_eq!(refused, MavResult::MAV_RESULT_DENIED, "{servo} {us}");
    }
    assert_eq!(result(&mut link, 1.0, 1700.0), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(link.desk.step().pulses[0].0, 1700);
    let answer = link.tell(&order(MavCmd::MAV_CMD_DO_SET_SERVO, 2.0, 1700.0));
    assert_eq!(texts(&answer), ["pulse refused: no servo there: AXES 1"]);
    link.tell(&set("AXES", 2.0));
    assert_eq!(result(&mut link, 2.0, 1600.0), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(link.desk.step().pulses.map(|pulse| pulse.0), [1524, 1600]);
    link.tell(&set("AXES", 1.0));
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    let answer = link.tell(&order(MavCmd::MAV_CMD_DO_SET_SERVO, 1.0, 1700.0));
    assert_eq!(texts(&answer), ["pulse refused: in armed"]);
}

#[test]
fn a_parameter_is_read_by_name_or_index() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let read = |param_index, name: &str| {
        from_host(&PARAM_REQUEST_READ_DATA {
            param_index,
            target_system: 1,
            target_component: 1,
            param_id: name.into(),
        })
    };
    let rate = ("SRV_RATE_HZ".to_string(), 50.0);
    assert_eq!(values(&link.tell(&read(-1, "SRV_RATE_HZ"))), [rate]);
    assert_eq!(
        values(&link.tell(&read(0, ""))),
        [("PID_KP".to_string(), Params::default().pid_kp())]
    );
    assert_eq!(texts(&link.tell(&read(200, ""))), ["no such parameter"]);
    assert_eq!(texts(&link.tell(&read(-1, "PID_KQ"))), ["no such parameter"]);
}

/// Obeys an order about stored parameters to its end.
fn serve(link: &mut Link, flash: &mut Mock) {
    while link.telemetry.has_storage_order() {
        link.telemetry.serve_storage(flash, &mut link.desk.flight);
    }
}

/// Armed in the midst of a save, the vehicle leaves the set that it had.
#[test]
fn a_save_ends_where_the_vehicle_is_armed() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut flash = Mock::new();
    link.tell(&order(STORAGE, SAVE, 0.0));
    serve(&mut link, &mut flash);
    take(&mut link.telemetry);
    link.tell(&set("PID_KP", 2.5));
    link.tell(&order(STORAGE, SAVE, 0.0));
    for _ in 0..7 {
        link.telemetry.serve_storage(&mut flash, &mut link.desk.flight);
    }
    link.tell(&order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    serve(&mut link, &mut flash);
    let refused = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert!(acks(&take(&mut link.telemetry)).contains(&(STORAGE, refused)));
    let (stored, loaded) = crate::store::load(&mut flash, crate::store::BoardId::default());
    assert_eq!(stored.pid_kp(), Params::default().pid_kp());
    assert!(matches!(loaded, crate::store::Loaded::Set { generation: 1, .. }));
}

/// What changes while it is saved is saved as it is in the end.
#[test]
fn a_parameter_that_changes_in_a_save_is_saved_anew() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut flash = Mock::new();
    link.tell(&order(STORAGE, SAVE, 0.0));
    for _ in 0..9 {
        link.telemetry.serve_storage(&mut flash, &mut link.desk.flight);
    }
    link.tell(&set("PID_KP", 2.5));
    serve(&mut link, &mut flash);
    let (stored, loaded) = crate::store::load(&mut flash, crate::store::BoardId::default());
    assert_eq!(stored.pid_kp(), 2.5);
    assert!(loaded.is_as_saved());
}

#[test]
fn a_storage_order_does_not_replace_another_and_each_is_answered() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut flash = Mock::new();
    link.tell(&set("PID_KP", 2.5));
    assert!(link.tell(&order(STORAGE, SAVE, 0.0)).is_empty());
    let answer = link.tell(&order(STORAGE, RELOAD, 0.0));
    assert_eq!(acks(&answer), [(STORAGE, MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]);
    assert_eq!(texts(&answer), ["storage order refused: busy with another"]);
    // The same one again, as a host sends it that has heard nothing, is no other.
    assert!(link.tell(&order(STORAGE, SAVE, 0.0)).is_empty());
    serve(&mut link, &mut flash);
    let saved = acks(&take(&mut link.telemetry));
    assert_eq!(saved, [(STORAGE, MavResult::MAV_RESULT_ACCEPTED)]);
    assert_eq!(crate::store::load(&mut flash, crate::store::BoardId::default()).0.pid_kp(), 2.5);
    serve(&mut link, &mut flash);
    assert!(take(&mut link.telemetry).is_empty());
    // The way is free again.
    link.tell(&set("PID_KP", 3.0));
    assert!(link.tell(&order(STORAGE, RELOAD, 0.0)).is_empty());
    serve(&mut link, &mut flash);
    assert_eq!(link.desk.flight.params().pid_kp(), 2.5);
}

/// RELOAD takes the path of a parameter that is set: another calibration, another estimate.
#[test]
fn a_reload_that_changes_the_calibration_makes_arming_wait() {
    let mut link = Link::new(Desk::in_standby(0.1));
    let mut flash = Mock::new();
    let mut stored = link.desk.flight.params().clone();
    stored.set("CAL_GYR_OY", 3.0).unwrap();
    crate::store::save(&mut flash, &stored, crate::store::BoardId::default()).unwrap();
    link.tell(&order(STORAGE, RELOAD, 0.0));
    serve(&mut link, &mut flash);
    take(&mut link.telemetry);
    let arm = order(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0);
    let answer = link.tell(&arm);
    assert_eq!(texts(&answer), ["arm refused: attitude still settling"]);
}
