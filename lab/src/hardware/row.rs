//! The flights of one setting, how they ended, and their row of the table.

use client::StateKind;
use rig::flight::Ready;
use rig::ground_station::BusReport;
use rig::measure::LoopTiming;
use rig::{Image, ServoKind, Setup, fly_at_once, prepare};

use flights::figures::Run;
use flights::requirements;
use ground::flight::fly::flights::{FLIGHT_S, START_RATE_RAD_S, link, pooled, run};
use report::measure::Limit::Set;
use report::measure::{Figure, figure};

/// Longest gap of a skipped tick, us: one at 150 Hz, and how much later the burst of the rates
/// alone begins.
const SKIPPED_TICK_US: f64 = 6_667.0 + 2_700.0;

/// How the flights of a setting end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Every requirement is met.
    Flies,
    /// All but the latency: the burst alone takes most of the 8 ms.
    Late,
    /// All but that a tick now and then goes without its burst; expected, it may also not happen.
    Skips,
    /// In control all the time, but with more overshoot or settling than is required; expected, it
    /// may also fly.
    Unsettled,
    /// The image does not let itself be armed, and names how long its bursts take.
    Refused,
    /// None of these.
    Fails,
}

/// What the flights with one servo gave.
#[derive(Clone, Debug)]
pub struct Flown {
    servo: ServoKind,
    /// From power-on, s.
    standby_s: f64,
    runs: Vec<Run>,
    /// The longest burst that the image told of, with the mean at that time.
    bursts: Option<BusReport>,
    timing: LoopTiming,
    lost: u64,
}

/// Boots to standby and flies from every start; the text says why that cannot be done.
pub fn fly(image: &Image, setup: &Setup, starts_rad: &[f64]) -> Result<Flown, String> {
    let ready = match prepare(image, setup, &mut |_| {}) {
        Ok(ready) => ready,
        Err(silent) => {
            // It may say why when it is asked to arm.
            let armed = fly_at_once(image, setup, starts_rad[0], 0.1, &mut |_| {});
            return Err(armed.err().unwrap_or(silent).to_string());
        }
    };
    let flights = starts_rad.iter().map(|start| {
        ready
            .fly(*start, START_RATE_RAD_S, FLIGHT_S, &mut |_| {})
            .map_err(|error| format!("from {start} rad: {error}"))
    });
    let records: Vec<_> = flights.collect::<Result<_, _>>()?;
    let link = link(&records);
    let reports = records.iter().flat_map(|record| &record.received.bus);
    Ok(Flown {
        servo: setup.servo,
        standby_s: standby_s(&ready),
        runs: records
            .iter()
            .map(run)
            .collect::<Result<_, _>>()
            .map_err(|error| error.to_string())?,
        bursts: reports.max_by(|a, b| a.max_us.total_cmp(&b.max_us)).copied(),
        timing: pooled(&records),
        lost: link.lost + link.crc_errors,
    })
}

/// When the first heartbeat in standby came, s since power-on.
fn standby_s(ready: &Ready) -> f64 {
    let mut beats = ready.station.received().heartbeats.iter();
    let first = beats.find(|beat| beat.state == Some(StateKind::Standby));
    first.map_or(f64::NAN, |beat| beat.at.as_secs_f64())
}

/// The row of `setting`, whose flights should end as `expected`; these are `all` of them or one.
pub fn row(
    setting: &str,
    expected: Ending,
    flights: &[Result<Flown, String>],
    all: bool,
) -> Vec<Figure> {
    let flown: Vec<&Flown> = flights.iter().flatten().collect();
    let figures = measured(&flown);
    let failed = flights.iter().find_map(|flight| flight.as_ref().err());
    let gap_us = flown.iter().map(|flown| flown.timing.jitter_us_max);
    let gap_us = gap_us.fold(0.0, f64::max);
    let (ended, words) = failed.map_or_else(|| judged(&figures, gap_us), |why| refused(why));
    let name = if setting.is_empty() { "default" } else { setting };
    // The latency is that of the worst servo, which one flight may not have.
    let may_fly = match expected {
        Ending::Skips | Ending::Unsettled => true,
        Ending::Late => !all,
        _ => false,
    };
    let is_expected = ended == expected || may_fly && ended == Ending::Flies;
    let as_expected = figure("as_expected", is_expected).shown("expected", "", 0).limit(Set);
    let mut row = vec![figure("hardware", name).shown("hardware", "", 0)];
    // What is expected to miss its limit, or was not flown, is not held to it.
    let excused = |figure: &Figure| !figure.is_met() && (is_expected || failed.is_some());
    row.extend(figures.into_iter().map(|figure| match excused(&figure) {
        true => figure.limit(None),
        false => figure,
    }));
    row.push(figure("ended", words).shown("ended", "", 0));
    row.push(as_expected);
    row
}

/// The figures of all flights, the worst of each.
fn measured(flown: &[&Flown]) -> Vec<Figure> {
    let worst = |key, label, unit, decimals, of: fn(&Flown) -> f64| {
        let worst = flown.iter().map(|flown| of(flown)).reduce(f64::max);
        figure(key, worst).shown(label, unit, decimals).or("")
    };
    let slowest = flown.iter().map(|flown| flown.timing.rate_hz).reduce(f64::min);
    let slowest = slowest.map(|rate_hz| (rate_hz * 1e3).round() / 1e3);
    let bursts = flown.iter().filter_map(|flown| flown.bursts);
    let longest = bursts.max_by(|a, b| a.max_us.total_cmp(&b.max_us));
    let us = |key, us: Option<f32>, label| {
        let us = us.map(f64::from);
        figure(key, us).shown(label, "us", 0).or("")
    };
    let overshoot = |flown: &Flown| {
        let runs = flown.runs.iter().map(|run| run.overshoot_pct);
        runs.fold(0.0, f64::max)
    };
    let in_control = flown
        .iter()
        .map(|flown| flown.runs.iter().all(|run| run.stayed_active))
        .reduce(|all, one| all && one);
    vec![
        worst("standby_s", "standby", "s", 1, |flown| flown.standby_s),
        worst("overshoot_pct", "overshoot", "%", 1, overshoot).limit(requirements::OVERSHOOT_PCT),
        settling("settling_s3003_s", "settling S3003", ServoKind::S3003, flown),
        settling("settling_digital_s", "settling digital", ServoKind::Digital, flown),
        us("burst_us_mean", longest.map(|one| one.mean_us), "burst"),
        us("burst_us_max", longest.map(|one| one.max_us), "longest"),
        worst("latency_us", "latency", "us", 0, |flown| flown.timing.latency_us.mean)
            .limit(requirements::LATENCY_US),
        figure("rate_hz", slowest).shown("rate", "Hz", 0).or("").limit(requirements::RATE_HZ),
        worst("jitter_us_max", "jitter", "us", 1, |flown| flown.timing.jitter_us_max)
            .limit(requirements::JITTER_US),
        worst("lost", "lost", "", 0, |flown| flown.lost as f64).limit(requirements::LOST_MESSAGES),
        figure("in_control", in_control)
            .shown("in control", "", 0)
            .or("")
            .limit(requirements::IN_CONTROL),
    ]
}

/// The longest settling of the flights with `servo`.
fn settling(key: &'static str, label: &'static str, servo: ServoKind, flown: &[&Flown]) -> Figure {
    let with_it = flown.iter().filter(|flown| flown.servo == servo);
    let times = with_it.flat_map(|flown| flown.runs.iter().map(|run| run.settling_5pct_s));
    let times: Vec<Option<f64>> = times.collect();
    let all: Option<Vec<f64>> = times.iter().copied().collect();
    let longest = all.and_then(|all| all.into_iter().reduce(f64::max));
    let shown = figure(key, longest).shown(label, "s", 3);
    if times.is_empty() {
        return shown.or("");
    }
    shown.or("never").limit(requirements::settling_s(servo))
}

/// How flights with these figures ended, and in words; `gap_us` is the most that a burst was off
/// its time.
fn judged(figures: &[Figure], gap_us: f64) -> (Ending, String) {
    let missed = figures.iter().filter(|figure| !figure.is_met());
    let missed: Vec<&str> = missed.map(Figure::label).collect();
    let response = |label: &&str| *label == "overshoot" || label.starts_with("settling");
    match missed[..] {
        [] => (Ending::Flies, "flies".into()),
        ["latency"] => (Ending::Late, "flies, latency above 8 ms".into()),
        ["jitter"] if gap_us <= SKIPPED_TICK_US => {
            (Ending::Skips, "flies, a tick was skipped".into())
        }
        _ if missed.iter().all(response) => {
            let words = format!("in control, misses {}", missed.join(", "));
            (Ending::Unsettled, words)
        }
        _ => (Ending::Fails, format!("misses {}", missed.join(", "))),
    }
}

/// Why nothing was flown, in the image's own words if it said any.
fn refused(why: &str) -> (Ending, String) {
    let said = why.split_once("it said last: ").map(|(_, said)| said);
    let words = said.map_or(why, |said| said.trim_end_matches(')'));
    match words.strip_prefix("arm refused: IMU bursts of ") {
        Some(_) => (Ending::Refused, words.to_owned()),
        None => (Ending::Fails, words.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use report::measure::{Figures, rows};
    use rig::measure::Spread;

    fn flown(servo: ServoKind) -> Flown {
        Flown {
            servo,
            standby_s: 2.5,
            runs: vec![Run {
                start_rad: 0.2,
                overshoot_pct: 1.0,
                rise_s: Some(0.4),
                settling_5pct_s: Some(0.5),
                final_error_rad: 0.0,
                stayed_active: true,
            }],
            bursts: None,
            timing: LoopTiming {
                rate_hz: 150.0,
                latency_us: Spread { mean: 6500.0, max: 6500.0, count: 150 },
                ..LoopTiming::default()
            },
            lost: 0,
        }
    }

    fn missed(expected: Ending, flights: &[Result<Flown, String>]) -> Vec<String> {
        Figures::from([rows("rows", [row("wake=10", expected, flights, true)])]).missed()
    }

    #[test]
    fn what_ends_as_expected_misses_nothing() {
        let good = [ServoKind::S3003, ServoKind::Digital].map(|servo| Ok(flown(servo)));
        assert_eq!(missed(Ending::Flies, &good), Vec::<String>::new());
        assert_eq!(missed(Ending::Late, &good).len(), 1);
        let words = "refused (it said last: arm refused: IMU bursts of 8920 us too slow)";
        let refused = [Err(words.to_owned())];
        assert_eq!(missed(Ending::Refused, &refused), Vec::<String>::new());
        assert_eq!(missed(Ending::Flies, &refused).len(), 1);
    }

    #[test]
    fn late_is_what_misses_the_latency_and_nothing_else() {
        let mut late = flown(ServoKind::S3003);
        late.timing.latency_us.mean = 9300.0;
        assert_eq!(missed(Ending::Late, &[Ok(late.clone())]), Vec::<String>::new());
        let named = missed(Ending::Flies, &[Ok(late.clone())]);
        assert!(named[0].contains("latency: 9300 us"), "{named:?}");
        late.runs[0].overshoot_pct = 6.0;
        assert_eq!(missed(Ending::Late, &[Ok(late)]).len(), 3);
        // One flight alone need not be late, but where it is to be refused it is.
        let one = |expected| {
            let flights = [Ok(flown(ServoKind::S3003))];
            Figures::from(row("wake=10", expected, &flights, false)).missed()
        };
        assert!(one(Ending::Late).is_empty() && !one(Ending::Refused).is_empty());
    }

    /// The slower servo's limit is not the faster one's.
    #[test]
    fn each_requirement_is_held() {
        let spoil: [fn(&mut Flown); 6] = [
            |f| f.runs[0].settling_5pct_s = Some(0.6),
            |f| f.runs[0].settling_5pct_s = None,
            |f| f.runs[0].stayed_active = false,
            |f| f.timing.rate_hz = 99.0,
            |f| f.timing.jitter_us_max = 100.0,
            |f| f.lost = 1,
        ];
        for (index, spoil) in spoil.iter().enumerate() {
            let mut one = flown(ServoKind::Digital);
            spoil(&mut one);
            let named = missed(Ending::Flies, &[Ok(flown(ServoKind::S3003)), Ok(one)]);
            assert_eq!(named.len(), 2, "requirement {index}: {named:?}");
        }
    }

    #[test]
    fn a_response_beyond_its_limits_can_be_expected_and_a_lost_flight_cannot() {
        let mut slow = flown(ServoKind::S3003);
        slow.runs[0].settling_5pct_s = Some(0.94);
        assert_eq!(missed(Ending::Unsettled, &[Ok(slow.clone())]), Vec::<String>::new());
        slow.runs[0].stayed_active = false;
        assert_eq!(missed(Ending::Unsettled, &[Ok(slow)]).len(), 3);
    }

    #[test]
    fn a_skipped_tick_can_be_expected_and_need_not_come_but_not_two_in_a_row() {
        let mut skips = flown(ServoKind::S3003);
        let none = Vec::<String>::new();
        assert_eq!(missed(Ending::Skips, &[Ok(skips.clone())]), none);
        skips.timing.jitter_us_max = 6_652.0;
        assert_eq!(missed(Ending::Skips, &[Ok(skips.clone())]), none);
        assert_eq!(missed(Ending::Flies, &[Ok(skips.clone())]).len(), 2);
        skips.timing.jitter_us_max = 13_300.0;
        assert_eq!(missed(Ending::Skips, &[Ok(skips)]).len(), 2);
    }

    #[test]
    fn silence_is_no_refusal() {
        let silent = "no heartbeat from the image within 5 s".to_owned();
        assert_eq!(missed(Ending::Refused, &[Err(silent)]).len(), 1);
    }
}
