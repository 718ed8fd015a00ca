//! The guided calibration: a person is led through rest, six faces, a turn and a level stand, each of which is watched while it
//! goes on and refused with the reason where it does not do.

use std::path::Path;

use anyhow::{Context, Result};
use client::request;
use nalgebra::Vector3;
use rig::instruction::Instruction;
use tvc_nano::calibration::coverage::Coverage;
use tvc_nano::calibration::ellipsoid::{self, LEAST_COVERAGE};
use tvc_nano::calibration::poses::{self, Face};
use tvc_nano::calibration::rest;

use super::figures::Figures;
use super::fit::{self, Found};
use super::keyboard::is_attended;
use super::picture::picture;
use super::session::Session;
use super::write::write;
use super::{asked_declination, declination, keep, parameters, readings, rests, show, tell};
use crate::logs::log::Writer;
use crate::out::exit::Verdict;
use crate::out::file::{print_figures, print_json, write_whole};
use crate::signals;
use crate::vehicle::calibrate::Calibrate;
use crate::vehicle::calibrate::Sensor;
use crate::vehicle::calibrate::place;
use crate::vehicle::link::Vehicle;

/// Length of the tombstone test, s.
const REST_S: f64 = 10.0;
/// Shortest rest that is taken for a pose, s: more than the fit asks for.
const POSE_S: f64 = 1.5;
/// End of the samples that says whether the sensor moves now, s.
const NOW_S: f64 = 0.5;
/// Share of all directions that ends the turn at once; after [`LONG_S`] the least share that is enough does.
const GOOD_COVERAGE: f64 = 0.85;
const LONG_S: f64 = 60.0;
/// New fields that the turn must have given.
const FIELDS: usize = 300;
/// How long a step may make no progress, s of the vehicle's time.
const PATIENCE_S: f64 = 60.0;
const TURN_PATIENCE_S: f64 = 90.0;

/// Why a step was refused, if it was.
type Refused = Option<String>;

/// Calibrates the vehicle at a port.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    let stop = signals::on_signal()?;
    let declination_deg = asked_declination(options)?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let log = folder.path().join("calibration.tlog");
    let mut vehicle = Vehicle::connect(&options.port.port())?;
    vehicle.link().log_to(Writer::create(&log)?);
    vehicle.parameters()?;
    let mut session = Session::begin(vehicle, stop)?;
    let declination_deg = match declination_deg {
        None if is_attended() && !options.yes => ask_declination(&mut session)?,
        given => given,
    };
    let led = lead(&mut session, options);
    session.end();
    let told = session.vehicle.link().send(&Instruction::Done.message());
    session.vehicle.link().end_log()?;
    write_whole(&options.record, &std::fs::read(&log)?)?;
    eprintln!("recording: {}", options.record.display());
    let refused = led?;
    told?;
    if let Some(why) = refused {
        let found = Found {
            refused: vec![why],
            ..Found::default()
        };
        let figures = Figures::new(session.readings(), &found, None, &[]);
        show(
            &options.record,
            session.readings(),
            &found,
            &figures,
            options,
        )?;
        print_figures(&figures, options.port.json, Figures::text)?;
        return Ok(Verdict::Missed);
    }
    finish(&mut session, &log, declination_deg, options)
}

/// Fits, shows, asks and writes.
fn finish(
    session: &mut Session,
    log: &Path,
    declination_deg: Option<f64>,
    options: &Calibrate,
) -> Result<Verdict> {
    // Fitted from the recording, so that the file gives the same result later.
    let readings = readings::read(log)?;
    let found = fit::fit(&readings, options);
    let rows = parameters(&found, declination_deg)?;
    let mut figures = Figures::new(&readings, &found, declination_deg, &rows);
    show(&options.record, &readings, &found, &figures, options)?;
    if !found.refused.is_empty() {
        print_figures(&figures, options.port.json, Figures::text)?;
        return Ok(Verdict::Missed);
    }
    keep(&rows, options)?;
    tell(&figures.text(), options.port.json);
    if options.yes || session.agrees("Write this to the vehicle, and into its flash?")? {
        let changed = write(&mut session.vehicle, &rows)?;
        eprintln!(
            "{changed} parameters changed; all {} read back from the flash as they should be",
            rows.len()
        );
        figures.written = true;
        if session.vehicle.parameter("SRV_POLARITY")? != 1.0 {
            eprintln!("next: tvc calibrate polarity, without which nothing is armed");
        }
        // The estimate begins anew with the new calibration; a vehicle that waits for something else tells so by itself.
        let _ = session.vehicle.command(request::CALIBRATE);
    } else {
        eprintln!(
            "the vehicle is as it was; `tvc param load {}` writes it later",
            options.out.display()
        );
    }
    if options.port.json {
        print_json(&figures)?;
    }
    Ok(Verdict::Met)
}

/// Takes the steps one after the other.
fn lead(session: &mut Session, options: &Calibrate) -> Result<Refused> {
    let wants = |sensor| options.only.is_empty() || options.only.contains(&sensor);
    if wants(Sensor::Gyr)
        && let Some(why) = lay_down(session)?
    {
        return Ok(Some(why));
    }
    if wants(Sensor::Acc)
        && let Some(why) = pose(session, options.gravity)?
    {
        return Ok(Some(why));
    }
    if wants(Sensor::Mag)
        && let Some(why) = turn(session)?
    {
        return Ok(Some(why));
    }
    if wants(Sensor::Level) {
        return level(session, options);
    }
    Ok(None)
}

/// Degrees, or a place.
fn ask_declination(session: &mut Session) -> Result<Option<f64>> {
    loop {
        let answer = session.question(
            "Magnetic declination in deg, or latitude,longitude (Enter: leave it as it is):",
            &mut |_| Ok(()),
        )?;
        let answer = match answer {
            Some(answer) if !answer.is_empty() => answer,
            _ => return Ok(None),
        };
        match (answer.parse::<f64>(), place(&answer)) {
            (Ok(deg), _) if deg.abs() <= 180.0 => return Ok(Some(deg)),
            (_, Ok(place)) => return declination::declination_deg(place, None).map(Some),
            _ => eprintln!("a declination is such as 4.37, a place such as 55.79,12.52"),
        }
    }
}

/// The tombstone test.
fn lay_down(session: &mut Session) -> Result<Refused> {
    session.ask(
        Instruction::Rest,
        "1/4  Lay the sensor down and leave it alone, the table too.",
    )?;
    let (begun_s, mut start) = (session.readings().length_s(), session.moments().len());
    let mut why = None;
    loop {
        session.look()?;
        let now_s = session.readings().length_s();
        let recent = session
            .moments()
            .partition_point(|m| m.time_s < now_s - NOW_S);
        if !rests::is_still(&session.moments()[recent..]) {
            start = session.moments().len();
            session.progress(0.0, "it moves".into());
        }
        let rest = &session.moments()[start..];
        let still_s = rests::length_s(session.moments(), &(start..session.moments().len()));
        if still_s >= REST_S {
            match rest::bias(rest) {
                Ok(_) => {
                    session.say("gyroscope: at rest for 10 s");
                    return Ok(None);
                }
                Err(moved) => {
                    session.say(&format!("again: {moved}"));
                    why = Some(moved);
                    start = session.moments().len();
                }
            }
        } else if still_s > 0.0 {
            session.progress(still_s / REST_S, format!("{still_s:.0} of {REST_S:.0} s"));
        }
        if now_s - begun_s > PATIENCE_S {
            let end = session
                .moments()
                .partition_point(|m| m.time_s < now_s - REST_S);
            let moved = why.or(rest::bias(&session.moments()[end..]).err());
            return Ok(Some(moved.map_or_else(
                || "it never lay still for 10 s".into(),
                |moved| moved.to_string(),
            )));
        }
    }
}

/// The accelerometer's six faces, in any order.
fn pose(session: &mut Session, gravity: f64) -> Result<Refused> {
    let mut done: Vec<Face> = Vec::new();
    let mut asked = None;
    let mut news_s = session.readings().length_s();
    loop {
        let moments = session.moments();
        let found = rests::find(moments, POSE_S);
        let forces = rests::forces(moments, &found);
        for face in forces.iter().filter_map(Face::of) {
            if !done.contains(&face) {
                done.push(face);
                news_s = session.readings().length_s();
                session.say(&format!("accelerometer: {} seen", face.name()));
            }
        }
        let Some(next) = Face::ALL.into_iter().find(|face| !done.contains(face)) else {
            return Ok(None);
        };
        if asked != Some(next) {
            asked = Some(next);
            let words = format!(
                "2/4  Rest the sensor with its {} (x is the nose, y the right side, z the bottom).",
                next.name()
            );
            session.ask(Instruction::Pose(next), &words)?;
        }
        let count = done.len();
        session.progress(count as f64 / 6.0, format!("{count} of 6 faces"));
        session.look()?;
        if session.readings().length_s() - news_s > PATIENCE_S {
            let missing = poses::fit(&forces, gravity).err();
            return Ok(Some(missing.map_or_else(
                || format!("the sensor was never at rest {}", next.name()),
                |missing| missing.to_string(),
            )));
        }
    }
}

/// The magnetometer, turned through all directions.
fn turn(session: &mut Session) -> Result<Refused> {
    session.ask(
        Instruction::Turn,
        "3/4  Turn the sensor slowly through all directions, upside down too, away from iron.",
    )?;
    let (begun_s, begun) = (
        session.readings().length_s(),
        session.readings().fresh.len(),
    );
    loop {
        session.look()?;
        let fields = session.readings().fields();
        let elapsed_s = session.readings().length_s() - begun_s;
        let fitted = ellipsoid::fit(&fields);
        let coverage = fitted
            .as_ref()
            .map_or_else(|_| about_middle(&fields), |fitted| fitted.coverage);
        let share = coverage.share();
        let enough = share >= GOOD_COVERAGE || elapsed_s > LONG_S && share >= LEAST_COVERAGE;
        if fitted.is_ok() && enough && fields.len() - begun >= FIELDS {
            session.say(&format!(
                "magnetometer: {:.0} % of all directions seen\n{}",
                share * 100.0,
                picture(&coverage)
            ));
            return Ok(None);
        }
        session.progress(
            share / GOOD_COVERAGE,
            format!(
                "{:.0} % of all directions, {:.0} s\n{}",
                share * 100.0,
                elapsed_s,
                picture(&coverage)
            ),
        );
        if elapsed_s > TURN_PATIENCE_S {
            return Ok(Some(fitted.err().map_or_else(
                || "the magnetometer gave too few readings".into(),
                |why| why.to_string(),
            )));
        }
    }
}

/// Directions about the middle of what was read, while there is no ellipsoid yet.
fn about_middle(fields: &[Vector3<f64>]) -> Coverage {
    let (low, high) = fields.iter().fold((None, None), |(low, high), field| {
        let low = low.map_or(*field, |low: Vector3<f64>| low.inf(field));
        let high = high.map_or(*field, |high: Vector3<f64>| high.sup(field));
        (Some(low), Some(high))
    });
    let middle = (low.unwrap_or_default() + high.unwrap_or_default()) / 2.0;
    let directions: Vec<_> = fields.iter().map(|field| field - middle).collect();
    directions.iter().collect()
}

/// The mount, with the body level.
fn level(session: &mut Session, options: &Calibrate) -> Result<Refused> {
    session.ask(
        Instruction::Level,
        "4/4  Mount the sensor, stand the body level, and leave it.",
    )?;
    if is_attended() && !options.yes {
        session.question("Enter when it stands level:", &mut |_| Ok(()))?;
    }
    let (begun_s, begun) = (session.readings().length_s(), session.moments().len());
    loop {
        session.look()?;
        let now_s = session.readings().length_s();
        let found = rests::find(&session.moments()[begun..], POSE_S);
        if !found.is_empty() {
            session.say("mount: level seen");
            return Ok(None);
        }
        session.progress((now_s - begun_s) / 5.0, "hold it level".into());
        if now_s - begun_s > PATIENCE_S {
            return Ok(Some(
                "the body did not rest when it was to stand level".into(),
            ));
        }
    }
}
