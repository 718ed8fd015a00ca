//! Files of text: parameters, configuration, scenarios, and what is done to the rig by hand.

use std::str::FromStr;

use plant::Setup;
use plant::pitch_loop::PitchLoop;
use plant::rocket::Motor;
use plant::scenario::Scenario;
use rig::RigConfig;
use rig::action::Action;
use rig::bench::Hardware;

use super::{Outcome, expect};
use design::montecarlo::Case;
use design::vehicle::Vehicle;
use flights::param_file;
use ground::config::Config;
use ground::flight::fly::faults;
use ground::vehicle::signing::Signing;

/// Text in one of this many cases is also computed with, where that takes longer than reading.
const COMPUTED: u64 = 64;
/// Longest motion that is computed, s, and most rows of it.
const LONGEST_S: f64 = 2.0;
const MOST_ROWS: f64 = 2_000.0;

pub fn parameters(bytes: &[u8], _: u64) -> Outcome {
    let Ok(text) = str::from_utf8(bytes) else {
        return Ok(());
    };
    let Ok(param_file::File { rows, .. }) = param_file::parse(text) else {
        return Ok(());
    };
    if rows.is_empty() {
        return Ok(());
    }
    let again = |text: String| param_file::parse(&text).map(|again| again.rows.len());
    let written = [param_file::text(&rows), param_file::columns(&rows, 1)];
    let holds = written.map(|text| again(text) == Ok(rows.len()));
    expect(holds == [true; 2], "what it writes is not what it reads")
}

pub fn config(bytes: &[u8], _: u64) -> Outcome {
    let _ = str::from_utf8(bytes).map(Config::parse);
    Ok(())
}

pub fn faults(bytes: &[u8], number: u64) -> Outcome {
    let _ = str::from_utf8(bytes).map(|text| faults::parse(text, number, 3.0));
    Ok(())
}

pub fn scenario(bytes: &[u8], number: u64) -> Outcome {
    let Ok(Ok(scenario)) = str::from_utf8(bytes).map(Scenario::parse) else {
        return Ok(());
    };
    let rows = scenario.seconds / scenario.dt_s;
    if number.is_multiple_of(COMPUTED) && scenario.seconds <= LONGEST_S && rows <= MOST_ROWS {
        let _ = scenario.run();
    }
    Ok(())
}

pub fn vehicle_file(bytes: &[u8], _: u64) -> Outcome {
    let Ok(text) = str::from_utf8(bytes) else { return Ok(()) };
    // A motor's file may hold anything, too.
    let motor = |_: &str| Ok(text.to_owned());
    let _ = Motor::parse_rasp(text);
    if let Ok(vehicle) = Vehicle::parse(text, "vehicle", Setup::default(), motor) {
        let _ = vehicle.hang(&mut RigConfig::default());
    }
    let Ok(setup) = Setup::parse(text) else { return Ok(()) };
    let again = Setup::parse(&setup.to_toml());
    expect(again.as_ref() == Ok(&setup), "what it writes is not what it reads")?;
    let Setup { drone, servo, timing } = setup;
    if let Ok(mut pitch_loop) = PitchLoop::new(&drone, servo, timing, 0.1, 0.0) {
        pitch_loop.step(|measurement| measurement.pitch_rad);
    }
    Ok(())
}

pub fn case(bytes: &[u8], number: u64) -> Outcome {
    let Ok(Ok(case)) = str::from_utf8(bytes).map(Case::parse) else {
        return Ok(());
    };
    if number.is_multiple_of(COMPUTED) && case.seconds <= LONGEST_S {
        let _ = case.fly();
    }
    Ok(())
}

pub fn key(bytes: &[u8], _: u64) -> Outcome {
    let is_key = Signing::parse(bytes).is_ok();
    expect(!is_key || bytes.len() == 32, "a key of another length")
}

/// What a rig answers to an action.
pub fn answer(bytes: &[u8], _: u64) -> Outcome {
    let _ = str::from_utf8(bytes).map(ground::flight::rig::answer);
    Ok(())
}

pub fn action(bytes: &[u8], _: u64) -> Outcome {
    // As the rig's socket hands over a line.
    let text = String::from_utf8_lossy(bytes);
    for line in text.lines() {
        let _ = Action::from_str(line);
        let _ = Hardware::from_str(line);
    }
    Ok(())
}
