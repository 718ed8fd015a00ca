//! Gains as the image flies them on the virtual rig.

use anyhow::Result;
use plant::Setup;
use plant::response::StepResponse;
use rayon::prelude::*;
use rig::flight::prepare;
use rig::{Image, ServoKind};
use tvc_nano::Axis;

use super::design::{START_RATE_RAD_S, STARTS_RAD};

/// Length of a flight, s.
const FLIGHT_S: f64 = 3.0;

/// Flies vehicles of these seeds, to either side in turn, from a start of each group. Gives the
/// responses from each group; seed by seed its starts take turns.
///
/// # Errors
/// The image does not come to standby, or refuses to fly.
pub fn fly(
    image: &Image,
    (setup, servo): (&Setup, ServoKind),
    gains: &[(String, f32)],
    seeds: u32,
) -> Result<Vec<Vec<StepResponse>>> {
    let of_seed = |seed: u32| -> Result<Vec<StepResponse>> {
        let mut flown = rig::flight::Setup::with_polarity(servo, seed.into());
        flown.parameters.extend_from_slice(gains);
        flown.rig.bench.parameters = setup.drone;
        flown.rig.bench.servo = setup.servo;
        let ready = prepare(image, &flown, &mut |_| {})?;
        let side = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
        let flights = STARTS_RAD.iter().map(|group| {
            let start_rad = side * group[seed as usize % group.len()];
            let flight = ready.fly(start_rad, side * START_RATE_RAD_S, FLIGHT_S, &mut |_| {})?;
            Ok(flight.response(Axis::Pitch)?)
        });
        flights.collect()
    };
    let flights: Vec<_> = (0..seeds).into_par_iter().map(of_seed).collect::<Result<_>>()?;
    let of_start = |start: usize| flights.iter().map(|flights| flights[start].clone()).collect();
    Ok((0..STARTS_RAD.len()).map(of_start).collect())
}
