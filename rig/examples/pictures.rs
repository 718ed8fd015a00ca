//! Data of two pictures in the documents, as CSV on standard output; `tools/pictures.py` draws
//! them.
//!
//! `cargo run --release -p rig --example pictures -- ticks` flies from 0.4 rad and gives the
//! bursts, steps and pulses of two servo frames. `-- laws` flies with the PD law and with the
//! switching surface.

use std::error::Error;

use rig::flight::FlightError;
use rig::image::build;
use rig::{Image, Ready, ServoKind, Setup, Ticks, prepare};
use tvc_nano::Axis;

const START_RAD: f64 = 0.4;
const RATE_RAD_S: f64 = 0.2;
/// From the release to the first pulse that is drawn, s.
const AFTER_S: f64 = 0.3;
const FRAME_MS: f64 = 20.0;

fn main() -> Result<(), Box<dyn Error>> {
    let image = build(&mut |words| eprintln!("{words}"))?;
    match std::env::args().nth(1).as_deref() {
        Some("ticks") => ticks(&image),
        Some("laws") => laws(&image),
        _ => Err("the argument is `ticks` or `laws`".into()),
    }
}

/// The vehicle in standby, with these parameters.
fn standby(image: &Image, parameters: &[(&str, f32)]) -> Result<Ready, FlightError> {
    let mut setup = Setup::with_polarity(ServoKind::S3003, 1);
    setup.parameters = parameters.iter().map(|(name, value)| ((*name).into(), *value)).collect();
    prepare(image, &setup, &mut |_| ())
}

fn ticks(image: &Image) -> Result<(), Box<dyn Error>> {
    let Ready { mut rig, mut station, .. } = standby(image, &[])?;
    rig.environment.tilt_clamp_to([START_RAD, 0.0]);
    station.run(&mut rig, Ticks::from_secs_f64(5.0))?;
    station.arm(&mut rig)?;
    station.release(&mut rig, RATE_RAD_S)?;
    let released = rig.now();
    station.run(&mut rig, Ticks::from_secs_f64(1.0))?;
    let truth = rig.truth();
    let pulses = truth.pulses_since(Axis::Pitch, released + Ticks::from_secs_f64(AFTER_S));
    let begin_ms = pulses.first().ok_or("no pulse")?.rise.as_us_f64() / 1e3;
    println!("what,start_ms,end_ms");
    let show = |what: &str, start: Ticks, end: Ticks| {
        let [start, end] = [start, end].map(|at| at.as_us_f64() / 1e3 - begin_ms);
        if end > 0.0 && start < 2.0 * FRAME_MS {
            println!("{what},{start:.3},{end:.3}");
        }
    };
    for burst in &truth.bursts {
        show(if burst.alone { "rates" } else { "burst" }, burst.start, burst.end);
    }
    truth.steps.iter().for_each(|step| show("step", step.start, step.end));
    truth.pulses[0].iter().for_each(|pulse| show("pulse", pulse.rise, pulse.fall));
    Ok(())
}

fn laws(image: &Image) -> Result<(), Box<dyn Error>> {
    println!("law,time_s,pitch_deg");
    // The thesis' gains.
    let pd = [("PID_LAW", 0.0), ("PID_KP", 1.9), ("PID_KD", 0.435)];
    for (law, parameters) in [("PD", &pd[..]), ("switching surface", &[])] {
        let flight = standby(image, parameters)?.fly(START_RAD, RATE_RAD_S, 1.5, &mut |_| ())?;
        for motion in flight.motion.iter().step_by(10) {
            let time_s = motion.time.saturating_sub(flight.released).as_secs_f64();
            println!("{law},{time_s:.3},{:.3}", motion.tilt_rad[0].to_degrees());
        }
    }
    Ok(())
}
