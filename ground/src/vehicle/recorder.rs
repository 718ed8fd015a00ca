//! The steps around the last release, as the vehicle keeps them in its own memory.

use anyhow::{Result, bail};
use client::Parameter;
use tvc_nano::recorder::{self, STEP_BYTES};
use tvc_nano::{Axis, Micros, PulseUs, RawSample};

use flights::log::{Event, Flight, Step, whole_us};

/// The recorder's bytes as a flight, with the vehicle's present parameters.
///
/// # Errors
/// They are no whole steps.
pub fn flight(bytes: &[u8], parameters: Vec<Parameter>) -> Result<Flight> {
    let (steps, rest) = bytes.as_chunks::<STEP_BYTES>();
    if !rest.is_empty() {
        bail!(
            "the recording has {} bytes, which are no whole steps: is this tool as old as the firmware?",
            bytes.len()
        );
    }
    let mut flight = Flight::default();
    let told = parameters.into_iter();
    flight.events.extend(told.map(|row| Event::Parameter(row.name, row.value)));
    let (mut code, mut now_us) = (None, None);
    for step in steps.iter().map(recorder::Step::decode) {
        if code.replace(step.code) != Some(step.code) {
            flight.events.push(Event::State(step.code.into()));
        }
        // The recorder keeps the lower 32 bits of the clock.
        let low_us = step.now.0 as u32;
        let time_us = whole_us(low_us, now_us.unwrap_or(step.now.0));
        now_us = Some(time_us);
        let aged = |sample: RawSample| RawSample {
            // A sample cannot be older than the clock: its time is cut off at zero.
            time: Micros(time_us.saturating_sub(low_us.wrapping_sub(sample.time.0 as u32).into())),
            ..sample
        };
        let (q, rate) = (step.orientation, step.rate);
        flight.events.push(Event::Step(Step {
            now_us: time_us,
            sample: step.sample.map(aged),
            quaternion: [q.w, q.x, q.y, q.z],
            rate_rad_s: [rate[0], rate[1], rate[2]],
            cranks_rad: Axis::ALL.map(|axis| {
                let axis = axis.index();
                (step.pulses[axis] != PulseUs::NONE).then_some(step.cranks_rad[axis])
            }),
            pulses_us: step.pulses.map(|pulse| pulse.0),
        }));
    }
    Ok(flight)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step at a time of the short clock, 4 ms after its sample, in a state.
    fn step(now_us: u32, code: u8) -> Vec<u8> {
        let mut bytes = vec![0; STEP_BYTES];
        bytes[..4].copy_from_slice(&now_us.to_le_bytes());
        bytes[4..6].copy_from_slice(&4_000_u16.to_le_bytes());
        bytes[56] = code;
        bytes
    }

    #[test]
    fn the_clock_goes_on_where_its_lower_half_begins_anew() {
        let bytes = [step(u32::MAX - 999, 3), step(5_667, 4)].concat();
        let flight = flight(&bytes, Vec::new()).unwrap();
        let times: Vec<_> =
            flight.steps().map(|step| (step.now_us, step.sample.unwrap().time.0)).collect();
        let begin = u64::from(u32::MAX) - 999;
        assert_eq!(times, [(begin, begin - 4_000), (begin + 6_667, begin + 2_667)]);
        assert_eq!(flight.events[0], Event::State(3));
        assert_eq!(flight.events[2], Event::State(4));
    }

    #[test]
    fn half_a_step_is_no_recording() {
        assert!(flight(&step(1, 3)[1..], Vec::new()).is_err());
    }
}
