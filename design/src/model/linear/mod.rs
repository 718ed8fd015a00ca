//! `tvc model linear`: the linear model at a point, and the margins of the loop.

mod figures;
mod report;

use anyhow::Result;
use plant::free::State;
use plant::linear::frequency::OpenLoop;
use plant::linear::{StateSpace, equilibrium, equilibrium_at_crank, linearise};
use plant::pitch_loop::Timing;
use plant::{Mechanism, ServoModel, Setup};

use crate::model::Linear;
use ::report::exit::{BadInput, Verdict};
use rig::ServoKind;

/// Frames shorter than this (s) belong to a digital servo, whose gains are higher.
const FAST_FRAME_S: f64 = 0.010;
/// Gains that suit an analogue servo and a digital one, if none are given.
const GAINS: [(f64, f64); 2] = [(1.0, 0.30), (1.6, 0.35)];

/// A point that the model was taken at, with the models there.
struct Analysis {
    /// The point, and the torque on the crank.
    point: State,
    torque_n_m: f64,
    /// Rudder angle there, in rad.
    rudder_rad: f64,
    /// Accelerations of pitch and crank there, in rad/s2: zero at an equilibrium.
    residual_rad_s2: [f64; 2],
    model: StateSpace,
    /// The gains as given.
    gains: (f64, f64),
    open: OpenLoop,
}

/// Analyses as `options` say.
pub fn run(options: &Linear) -> Result<Verdict> {
    let analysis = analyse(options)?;
    let page = report::render(&analysis)?;
    if !analysis.is_equilibrium() {
        eprintln!("note: {}", analysis.note());
    }
    analysis.figures().conclude(options.json, Some((&options.report, page)))
}

fn analyse(options: &Linear) -> Result<Analysis> {
    let setup = setup(options)?;
    let mechanism = Mechanism::new(&setup.drone).map_err(BadInput::new)?;
    let (point, torque_n_m) = point(options, &mechanism)?;
    let fast = setup.timing.frame_s < FAST_FRAME_S;
    let gains = options.gains.unwrap_or(GAINS[usize::from(fast)]);
    Ok(Analysis {
        point,
        torque_n_m,
        rudder_rad: mechanism.linkage().at(point.crank_rad).rudder_rad(),
        residual_rad_s2: mechanism.accelerations(&point, torque_n_m),
        model: linearise(&mechanism, &point, torque_n_m),
        gains,
        open: OpenLoop::new(&mechanism, &point, &setup.servo, &setup.timing, gains.0, gains.1),
    })
}

fn setup(options: &Linear) -> Result<Setup> {
    let mut setup = options.vehicle.read_over(Setup::default())?.drone()?;
    setup.drone = options.preset.as_deref().copied().unwrap_or(setup.drone);
    match options.servo {
        None => {}
        Some(ServoKind::S3003) => {
            (setup.servo, setup.timing) = (ServoModel::S3003, Timing::ANALOGUE);
        }
        Some(ServoKind::Digital) => {
            (setup.servo, setup.timing) = (ServoModel::DIGITAL, Timing::DIGITAL);
        }
    }
    Ok(setup)
}

/// The point asked for, and the torque that holds the crank there.
fn point(options: &Linear, mechanism: &Mechanism) -> Result<(State, f64), BadInput> {
    let linkage = mechanism.linkage();
    if let Some(pitch_rad) = options.pitch {
        return equilibrium(mechanism, pitch_rad)
            .map(|rest| (rest.state, rest.torque_n_m))
            .ok_or_else(|| {
                BadInput::new(format!("--pitch {pitch_rad}: no rudder angle holds the drone there"))
            });
    }
    let upright = |crank_rad| State { crank_rad, ..State::default() };
    let Some(crank_rad) = options.at else {
        return Ok((upright(linkage.zero_rudder_crank_rad()), 0.0));
    };
    // Beyond the dead points the rudder turns back, and a rudder angle has no one crank angle.
    let (within, range) = match linkage.dead_points() {
        Some(((low, _), (high, _))) => {
            ((low..high).contains(&crank_rad), format!("{low:.3} to {high:.3} rad"))
        }
        None => (linkage.closes_at(crank_rad), "where the linkage closes".into()),
    };
    if !within {
        return Err(BadInput::new(format!(
            "--at {crank_rad}: the rudder follows the crank between its dead points only, {range}"
        )));
    }
    Ok(match equilibrium_at_crank(mechanism, crank_rad) {
        Some(rest) => (rest.state, rest.torque_n_m),
        None => {
            let at = mechanism.configuration(crank_rad);
            (upright(crank_rad), -mechanism.crank_load(&at, 0.0, 0.0))
        }
    })
}
