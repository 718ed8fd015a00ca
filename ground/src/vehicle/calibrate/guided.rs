//! The guided calibration: a person is led through rest, six faces, a turn and a level stand. Each
//! is watched while it goes on, and refused with the reason where it does not serve.

use anyhow::{Context, Result};
use calibration::coverage::Coverage;
use calibration::ellipsoid::{self, LEAST_COVERAGE};
use calibration::poses::{self, Face};
use calibration::prompt::Prompt;
use calibration::{Found, Sensor, Wanted, fit, rest, stillness};
use client::request;
use tvc_nano::sensor::Kind;

use super::options::{Calibrate, Files, place};
use super::outcome::Outcome;
use super::person::{Ending, Question};
use super::session::Session;
use super::{declination, readings};
use report::exit::{BadInput, Verdict};
use report::file::{print_json_if, write_whole};
use report::measure::{Figures, figure};

/// Length of the tombstone test, s.
const REST_S: f64 = 10.0;
/// Shortest rest that counts as a pose, s: more than the fit needs.
const POSE_S: f64 = 1.5;
/// The same for a vehicle that flies free, whose gyroscope's shift by acceleration counts.
const LONG_POSE_S: f64 = 8.0;
/// Length of the latest samples that show whether the sensor moves now, s.
const NOW_S: f64 = 0.5;
/// Share of all directions that ends the turn at once; after [`LONG_S`] the least share that the
/// fit accepts ends it.
const GOOD_COVERAGE: f64 = 0.85;
const LONG_S: f64 = 60.0;
/// Fewest new fields that the turn must give.
const FIELDS: usize = 300;
/// How long a step may make no progress, s of the vehicle's time.
const PATIENCE_S: f64 = 60.0;
const TURN_PATIENCE_S: f64 = 90.0;

/// Why a step was refused, if it was.
type Refused = Option<String>;

/// Calibrates the vehicle at a port.
///
/// # Errors
/// The vehicle does not answer or is armed, Ctrl-C was pressed, or a file cannot be written.
pub fn run(options: &Calibrate) -> Result<Verdict> {
    // Unusable input is reported before the vehicle is contacted.
    let asked_deg = declination::asked_deg(options)?;
    let files = Files::of(options)?;
    let mut session = Session::connect(options)?;
    let (figures, ending, written) = calibrate(&mut session, &options.wanted(), asked_deg, &files)?;
    if !ending.refused {
        eprintln!("{}", ending.words);
    }
    if ending.met && !session.is_polarity_checked()? {
        eprintln!("next: tvc calibrate servo, then polarity, without which nothing is armed");
    }
    print_json_if(options.vehicle.json, &figures)?;
    written?;
    Ok(Verdict::of(ending.met))
}

/// What is wanted of what the vehicle's sensor has.
///
/// # Errors
/// Only its magnetometer is wanted, and it has none.
fn of_its_sensor(session: &mut Session, wanted: &Wanted) -> Result<Wanted> {
    let sensor = Kind::of(session.vehicle.parameter("SENSOR")?);
    let has = |part: &Sensor| *part != Sensor::Mag || sensor.description().has_mag;
    let all = [Sensor::Gyr, Sensor::Acc, Sensor::Mag, Sensor::Level];
    let only: Vec<_> = all.into_iter().filter(|part| wanted.has(*part) && has(part)).collect();
    if only.is_empty() {
        return Err(BadInput::new("the vehicle's sensor (SENSOR) has no magnetometer").into());
    }
    Ok(Wanted { only, ..wanted.clone() })
}

/// Leads through the calibration of what is wanted, shows what was found and writes it, if the
/// person agrees. Gives also why a file could not be written, which takes nothing of the
/// calibration away. The person is asked for the declination unless it is `asked_deg`.
///
/// # Errors
/// The vehicle does not answer, or the person wants an end.
pub fn calibrate(
    session: &mut Session,
    wanted: &Wanted,
    asked_deg: Option<f64>,
    files: &Files,
) -> Result<(Figures, Ending, Result<()>)> {
    let wanted = &of_its_sensor(session, wanted)?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let log = folder.path().join("calibration.tlog");
    session.vehicle.keep_log(&log)?;
    let declination_deg = match asked_deg {
        None if session.is_attended() => ask_declination(session)?,
        given => given,
    };
    let led = lead(session, wanted);
    let told = session.done();
    session.vehicle.link().end_log()?;
    let kept = write_whole(&files.record, &std::fs::read(&log)?);
    if kept.is_ok() {
        session.say(&format!("recording: {}", files.record.display()));
    }
    let refused = led?;
    told?;
    let outcome = match refused {
        Some(why) => {
            let found = Found { refused: vec![why], ..Found::default() };
            Outcome::of(&files.record, &session.readings, &found, None)?
        }
        None => {
            // From the recording, so that `--from` it gives the same later.
            let readings = readings::read(&log)?;
            let found = fit::fit(&readings, wanted);
            Outcome::of(&files.record, &readings, &found, declination_deg)?
        }
    };
    let written = kept.and(outcome.write(files, &mut |words| session.say(words)));
    let (figures, ending) = finish(session, outcome, files)?;
    Ok((figures, ending, written))
}

/// Shows what was found, asks, and writes it into the vehicle.
fn finish(session: &mut Session, outcome: Outcome, files: &Files) -> Result<(Figures, Ending)> {
    session.person.show(&outcome.figures)?;
    let ending = if !outcome.refused.is_empty() {
        Ending::refused(outcome.refused.join("; "))
    } else if let Some(changed) = session.write_if_agreed(&outcome.rows)? {
        // The estimate begins anew with the new calibration; a vehicle that cannot do that yet says
        // so by itself.
        let _ = session.vehicle.command(request::CALIBRATE);
        Ending::met(format!(
            "{changed} parameters changed; all {} read back from the flash as they should be",
            outcome.rows.len()
        ))
    } else {
        Ending::unchanged(format!(
            "the vehicle is as it was; `tvc param load {}` writes it later",
            files.out.display()
        ))
    };
    let figures = outcome.figures.and(figure("written", ending.met));
    Ok((figures, ending))
}

/// Leads through the steps that are wanted, to the first that is refused.
fn lead(session: &mut Session, wanted: &Wanted) -> Result<Refused> {
    type Step = fn(&mut Session, &Wanted) -> Result<Refused>;
    const STEPS: [(Sensor, Step); 4] =
        [(Sensor::Gyr, lay_down), (Sensor::Acc, pose), (Sensor::Mag, turn), (Sensor::Level, level)];
    for (_, step) in STEPS.iter().filter(|(sensor, _)| wanted.has(*sensor)) {
        if let Some(why) = step(session, wanted)? {
            return Ok(Some(why));
        }
    }
    Ok(None)
}

/// Asks for the declination, as degrees or as a place.
fn ask_declination(session: &mut Session) -> Result<Option<f64>> {
    loop {
        let words = "Magnetic declination in deg, or latitude,longitude";
        let keys = "(Enter: leave it as it is):";
        let question = Question {
            entry: Some("deg, or latitude,longitude"),
            ..Question::new(words, keys, &[("Leave it as it is", "")])
        };
        let Some(answer) = session.question(&question, &mut |_| Ok(()))? else {
            return Ok(None);
        };
        match (answer.parse::<f64>(), place(&answer)) {
            (Ok(deg), _) if deg.abs() <= 180.0 => return Ok(Some(deg)),
            (_, Ok(place)) => return declination::declination_deg(place, None).map(Some),
            _ => session.say("a declination is such as 4.37, a place such as 55.79,12.52"),
        }
    }
}

/// The tombstone test: the sensor lies still for [`REST_S`].
fn lay_down(session: &mut Session, _: &Wanted) -> Result<Refused> {
    session.ask(Prompt::Rest, "1/4  Lay the sensor down and leave it alone, the table too.")?;
    let (begun_s, mut start) = (session.now_s(), session.samples().len());
    let mut why = None;
    loop {
        session.look()?;
        let now_s = session.now_s();
        let recent = session.samples().partition_point(|m| m.time_s < now_s - NOW_S);
        if !stillness::is_still(&session.samples()[recent..]) {
            start = session.samples().len();
            session.progress(0.0, "it moves");
        }
        let rest = &session.samples()[start..];
        let still_s = stillness::length_s(rest);
        if still_s >= REST_S {
            match rest::bias(rest) {
                Ok(_) => {
                    session.say("gyroscope: at rest for 10 s");
                    return Ok(None);
                }
                Err(moved) => {
                    session.say(&format!("again: {moved}"));
                    why = Some(moved);
                    start = session.samples().len();
                }
            }
        } else if still_s > 0.0 {
            session.progress(still_s / REST_S, &format!("{still_s:.0} of {REST_S:.0} s"));
        }
        if now_s - begun_s > PATIENCE_S {
            let end = session.samples().partition_point(|m| m.time_s < now_s - REST_S);
            let moved = why.or(rest::bias(&session.samples()[end..]).err());
            let words = "it never lay still for 10 s";
            return Ok(Some(moved.map_or(words.into(), |moved| moved.to_string())));
        }
    }
}

/// The accelerometer's six faces, in any order.
fn pose(session: &mut Session, wanted: &Wanted) -> Result<Refused> {
    let mut done: Vec<Face> = Vec::new();
    let mut asked = None;
    let mut news_s = session.now_s();
    let flies_free = session.vehicle.link().client().parameter("FUSE_ACC") == Some(0.0);
    let pose_s = if flies_free { LONG_POSE_S } else { POSE_S };
    loop {
        let samples = session.samples();
        let found = stillness::find(samples, pose_s);
        let forces = stillness::forces(samples, &found);
        for face in forces.iter().filter_map(Face::of) {
            if !done.contains(&face) {
                done.push(face);
                news_s = session.now_s();
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
            session.ask(Prompt::Pose(next), &words)?;
        }
        let count = done.len();
        session.progress(count as f64 / 6.0, &format!("{count} of 6 faces"));
        session.look()?;
        if session.now_s() - news_s > PATIENCE_S {
            let missing = poses::fit(&forces, wanted.gravity).err();
            let words = format!("the sensor was never at rest {}", next.name());
            return Ok(Some(missing.unwrap_or(words)));
        }
    }
}

/// The magnetometer, turned through all directions.
fn turn(session: &mut Session, _: &Wanted) -> Result<Refused> {
    session.ask(
        Prompt::Turn,
        "3/4  Turn the sensor slowly through all directions, upside down too, away from iron.",
    )?;
    let (begun_s, begun) = (session.now_s(), session.readings.fresh.len());
    loop {
        session.look()?;
        let fields = session.readings.fields();
        let elapsed_s = session.now_s() - begun_s;
        let fitted = ellipsoid::fit(&fields);
        let coverage = match &fitted {
            Ok(fitted) => fitted.coverage,
            Err(_) => Coverage::about_middle(fields.iter()),
        };
        let share = coverage.share();
        let enough = share >= GOOD_COVERAGE || elapsed_s > LONG_S && share >= LEAST_COVERAGE;
        if fitted.is_ok() && enough && fields.len() - begun >= FIELDS {
            let words = format!("magnetometer: {:.0} % of all directions seen", share * 100.0);
            session.person.tell(&words, Some(&coverage));
            return Ok(None);
        }
        let words = format!("{:.0} % of all directions, {elapsed_s:.0} s", share * 100.0);
        let share = share / GOOD_COVERAGE;
        session.person.progress(share, &words, Some(&coverage));
        if elapsed_s > TURN_PATIENCE_S {
            let words = "the magnetometer gave too few readings";
            return Ok(Some(fitted.err().unwrap_or(words.into())));
        }
    }
}

/// The mount, with the body level.
fn level(session: &mut Session, _: &Wanted) -> Result<Refused> {
    session.ask(Prompt::Level, "4/4  Mount the sensor, stand the body level, and leave it.")?;
    if session.is_attended() {
        let words = "Is it mounted, and does the body stand level?";
        let question = Question::new(words, "Enter when it does:", &[("It stands level", "")]);
        session.question(&question, &mut |_| Ok(()))?;
    }
    let (begun_s, begun) = (session.now_s(), session.samples().len());
    loop {
        session.look()?;
        let now_s = session.now_s();
        let found = stillness::find(&session.samples()[begun..], POSE_S);
        if !found.is_empty() {
            session.say("mount: level seen");
            return Ok(None);
        }
        session.progress((now_s - begun_s) / 5.0, "hold it level");
        if now_s - begun_s > PATIENCE_S {
            return Ok(Some("the body did not rest when it was to stand level".into()));
        }
    }
}
