//! Gains as the image flies them on the virtual rig.

use anyhow::Result;
use plant::Setup;
use rayon::prelude::*;
use rig::flight::prepare;
use rig::{Image, ServoKind};
use tvc_nano::Axis;

use super::design::{BAND, START_RATE_RAD_S, STARTS_RAD};

/// Length of a flight, s.
const FLIGHT_S: f64 = 3.0;

/// Overshoot, percent, and 5 % settling, s, of flights from each start.
pub type Flights = Vec<Vec<(f64, Option<f64>)>>;

/// Flies vehicles of these seeds, to either side in turn, from every start.
///
/// # Errors
/// The image does not come to standby, or refuses to fly.
pub fn fly(
    image: &Image,
    (setup, servo): (&Setup, ServoKind),
    gains: &[(String, f32)],
    seeds: u32,
) -> Result<Flights> {
    let of_seed = |seed: u32| -> Result<Vec<(f64, Option<f64>)>> {
        let mut flown = rig::flight::Setup::with_polarity(servo, seed.into());
        flown.parameters.extend_from_slice(gains);
        flown.rig.bench.parameters = setup.drone;
        flown.rig.bench.servo = setup.servo;
        let ready = prepare(image, &flown, &mut |_| {})?;
        let side = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
        let flights = STARTS_RAD.into_iter().map(|start_rad| {
            let (start_rad, rate_rad_s) = (side * start_rad, side * START_RATE_RAD_S);
            let flight = ready.fly(start_rad, rate_rad_s, FLIGHT_S, &mut |_| {})?;
            let response = flight.response(Axis::Pitch)?;
            Ok((response.overshoot_pct(), response.settling_s(BAND)))
        });
        flights.collect()
    };
    let flights: Vec<_> = (0..seeds).into_par_iter().map(of_seed).collect::<Result<_>>()?;
    let of_start = |start: usize| flights.iter().map(|flights| flights[start]).collect();
    Ok((0..STARTS_RAD.len()).map(of_start).collect())
}
