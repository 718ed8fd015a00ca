//! Valid frames at random.

use client::request::Order;
use client::{Wire, request};
use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, MISSION_REQUEST_LIST_DATA, MavCmd, MavMessage,
};
use rand::Rng;
use rand::seq::IndexedRandom;
use tvc_nano::Params;
use tvc_nano::params::{Change, Range, TABLE};

use super::Phase;

/// Orders that a vehicle in flight refuses or has carried out already; in failsafe, the first six.
const FLYING: [Order; 8] = [
    request::MAY_ARM,
    request::ARM,
    request::RELEASE,
    request::CALIBRATE,
    request::REBOOT,
    request::SAVE,
    request::RELOAD,
    request::RESET,
];

/// The frame of a message.
pub(super) fn frame(message: &MavMessage) -> Vec<u8> {
    Wire::default().frame(message)
}

/// A frame that the vehicle takes: a command of any number with any values, a parameter that it
/// has with any value, or a question.
pub(super) fn valid_frame(dice: &mut impl Rng) -> Vec<u8> {
    let orders = [
        request::MAY_ARM,
        request::ARM,
        request::DISARM,
        request::RELEASE,
        request::CALIBRATE,
        request::VERSION,
        request::SAVE,
        request::RELOAD,
        request::RESET,
    ];
    let message = match dice.random_range(0..10) {
        0..4 => orders.choose(dice).unwrap_or(&request::VERSION).message(),
        4..8 => {
            let info = TABLE.choose(dice).unwrap_or(&TABLE[0]);
            let value = match dice.random_range(0..4) {
                0 => info.default,
                1 => f32::from_bits(dice.random()),
                _ => info.default + dice.random_range(-2.0..2.0),
            };
            request::set_parameter(info.name, value)
        }
        _ => question(dice),
    };
    frame(&message)
}

/// A frame that leaves a vehicle in this phase as it is, but for a parameter that is not far from
/// its value in `params`. It is an order that is refused or already done, a parameter out of its
/// range, or a question. Where nothing is armed, a save is obeyed.
pub(super) fn harmless_frame(phase: Phase, params: &Params, dice: &mut impl Rng) -> Vec<u8> {
    // All but the release.
    let armed = [&FLYING[..2], &FLYING[3..]].concat();
    let orders: &[_] = match phase {
        Phase::Start | Phase::Standby | Phase::Saving => {
            &[request::MAY_ARM, request::RELEASE, request::DISARM, request::SAVE]
        }
        Phase::Armed => &armed,
        Phase::Flight => &FLYING,
        Phase::Failsafe => &FLYING[..6],
    };
    let message = match dice.random_range(0..10) {
        0..3 => orders.choose(dice).unwrap_or(&request::VERSION).message(),
        3..5 => {
            let info = TABLE.choose(dice).unwrap_or(&TABLE[0]);
            let wrong = [f32::NAN, f32::INFINITY, -1e30, 1e30];
            request::set_parameter(info.name, *wrong.choose(dice).unwrap_or(&f32::NAN))
        }
        5..7 => near(params, dice),
        _ => question(dice),
    };
    frame(&message)
}

/// A parameter that may change at any time, to within 3 % of its value in `params`.
pub(super) fn near(params: &Params, dice: &mut impl Rng) -> MavMessage {
    let live = params.iter().filter_map(|(info, value)| match info.range {
        Range::Between(least, most) if info.change == Change::Live && value != 0.0 => {
            Some((info.name, value, least..=most))
        }
        _ => None,
    });
    let live: Vec<_> = live.collect();
    let Some((name, value, range)) = live.choose(dice) else {
        return request::heartbeat();
    };
    let value = value * dice.random_range(0.97..1.03);
    request::set_parameter(name, value.clamp(*range.start(), *range.end()))
}

/// What changes nothing but what is told.
fn question(dice: &mut impl Rng) -> MavMessage {
    let info = TABLE.choose(dice).unwrap_or(&TABLE[0]);
    match dice.random_range(0..11) {
        0 => request::list_parameters(),
        1 => request::heartbeat(),
        2 => request::read_parameter(info.name),
        3 => request::read_parameter_at(dice.random_range(0..=TABLE.len() as u16)),
        4 => request::read_parameter("NO_SUCH"),
        5 => request::time(dice.random()),
        6 => request::list_logs(),
        7 => request::VERSION.message(),
        8 => request::message_interval(ATTITUDE_DATA::ID, dice.random_range(-1.0..1e5)).message(),
        9 => MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA::default()),
        _ => MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_NAV_TAKEOFF,
            ..COMMAND_LONG_DATA::default()
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, generator};

    #[test]
    fn a_parameter_stays_near_its_value_and_within_its_range() {
        let params = Params::default();
        let mut dice = generator(1, Stream::Campaign);
        for _ in 0..1000 {
            let MavMessage::PARAM_SET(set) = near(&params, &mut dice) else {
                panic!("no parameter");
            };
            let name = client::text(&set.param_id).to_owned();
            let value = params.value(&name).unwrap();
            assert!((set.param_value / value - 1.0).abs() < 0.0301, "{name}");
            let changed = params.clone().set(&name, set.param_value);
            assert_eq!(changed.unwrap().change, Change::Live, "{name}");
        }
    }
}
