//! What a campaign adds up to.

use rig::faults::{DEADLINE, Kind, Phase, Plan, WRONG_LIMIT};

use super::table::{End, Row};
use report::measure::Limit::{AtLeast, AtMost};
use report::measure::{Figure, Figures, figure, rows};

/// All figures; `all` is not empty. Of glitches 99 % must be ridden out.
pub fn figures(all: &[Row], wall_s: Option<f64>) -> Figures {
    let wall = wall_s.map(|wall_s| figure("wall_s", wall_s).shown("time that it took", "s", 1));
    let figures = match all[0].campaign {
        Plan::Sound => of_sound(all),
        _ => of_faults(all),
    };
    Figures::from(figures.into_iter().chain(wall))
}

fn of_faults(all: &[Row]) -> Vec<Figure> {
    let share = |is_one: fn(&Row) -> bool, among: fn(&Row) -> bool| {
        let among: Vec<&Row> = all.iter().filter(|row| among(row)).collect();
        let count = among.iter().filter(|row| is_one(row)).count();
        (!among.is_empty()).then(|| 100.0 * count as f64 / among.len() as f64)
    };
    let upset = |row: &Row| matches!(row.kind, Kind::System(kind) if kind.is_upset());
    let mut recovered = figure("recovered_pct", share(|row| row.end == End::Recovered, |_| true))
        .shown("recovered", "%", 1);
    if all[0].campaign == Plan::Glitches {
        recovered = recovered.limit(AtLeast(99.0));
    }
    let groups = groups(all);
    let limit =
        |key, label, ticks: rig::Ticks| figure(key, ticks.as_us_f64() / 1e3).shown(label, "ms", 0);
    let upsets = [
        figure("upset_noticed_pct", share(|row| row.noticed, upset))
            .shown("flipped bits and peripherals: noticed", "%", 1)
            .or("none flown"),
        figure("upset_harmless_pct", share(|row| row.harmless, upset))
            .shown("flipped bits and peripherals: harmless", "%", 1)
            .or("none flown"),
    ];
    let figures = [
        figure("kinds", groups.len()).shown("kinds of faults", "", 0),
        limit("deadline_ms", "longest allowed off neutral without valid data", DEADLINE),
        limit("wrong_limit_ms", "longest allowed to be driven wrongly", WRONG_LIMIT),
        rows("faults", groups.iter().map(|group| of_group(group, all))),
        figure("strays", all.iter().map(|row| row.strays).sum::<usize>()).shown(
            "pulses neither neutral nor asked for",
            "",
            0,
        ),
        recovered,
    ];
    let common = in_common(all).into_iter();
    common.chain(figures).chain(upsets).collect()
}

/// What was flown.
fn in_common(all: &[Row]) -> [Figure; 6] {
    let every = |of: fn(&Row) -> &'static str| {
        let mut values: Vec<_> = all.iter().map(of).collect();
        values.sort_unstable();
        values.dedup();
        values.join(", ")
    };
    [
        figure("campaign", all[0].campaign.name()).shown("campaign", "", 0),
        figure("vehicle", every(|row| row.vehicle.name())).shown("vehicle", "", 0),
        figure("servo", every(|row| row.servo.name())).shown("servo", "", 0),
        figure("phase", every(|row| row.phase.name())).shown("phase", "", 0),
        figure("seed", all[0].seed).shown("seed", "", 0),
        figure("runs", all.len()).shown("runs", "", 0),
    ]
}

/// The groups of the runs, by kind; registers and resets in the order of the runs.
fn groups(all: &[Row]) -> Vec<String> {
    let mut groups: Vec<(Kind, String)> = Vec::new();
    for row in all {
        let group = (row.kind, row.group());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups.sort_by_key(|(kind, _)| *kind);
    groups.into_iter().map(|(_, group)| group).collect()
}

/// A count of a run.
type Count = fn(&Row) -> usize;

/// The alarms of a sound vehicle: key, label, count.
const ALARMS: [(&str, &str, Count); 10] = [
    ("resets", "resets", |row| row.resets),
    ("failsafes", "failsafes", |row| row.failsafes),
    ("latches", "latched", |row| row.latches),
    ("states", "other states", |row| row.states),
    ("refusals", "orders refused", |row| row.refusals),
    ("refused", "bursts refused", |row| row.refused),
    ("lost", "steps lost", |row| row.lost),
    ("late", "late", |row| row.late),
    ("parameters", "parameters lost", |row| row.parameters),
    ("pulses", "pulses", |row| row.pulses),
];

/// The figures of sound vehicles.
fn of_sound(all: &[Row]) -> Vec<Figure> {
    // Not by `sum`: that of no run is -0.
    let hours = |all: &mut dyn Iterator<Item = &Row>| {
        all.map(|row| row.flown_s).fold(0.0, |a, b| a + b) / 3600.0
    };
    let is_in_flight = |row: &&Row| row.phase == Phase::Flight;
    let row_of = |group: &String| {
        let runs = || all.iter().filter(|row| row.group() == *group);
        let alarmed = runs().filter(|row| row.end.is_bad()).count();
        let mut row = vec![
            figure("kind", group.as_str()).shown("what happens", "", 0),
            figure("runs", runs().count()).shown("runs", "", 0),
            figure("hours", hours(&mut runs())).shown("flown", "h", 2),
            figure("alarmed", alarmed).shown("alarmed", "", 0).limit(AtMost(0.0)),
        ];
        row.extend(ALARMS.iter().map(|(key, label, count)| {
            figure(key, runs().map(count).sum::<usize>()).shown(*label, "", 0)
        }));
        row
    };
    let bursts: usize = all.iter().map(|row| row.bursts).sum();
    let frames: u64 = all.iter().map(|row| row.frames).sum();
    let figures = [
        rows("sound", groups(all).iter().map(row_of)),
        figure("hours", hours(&mut all.iter())).shown("watched", "h", 2),
        figure("flight_hours", hours(&mut all.iter().filter(is_in_flight))).shown(
            "of it in flight",
            "h",
            2,
        ),
        figure("bursts", bursts).shown("bursts", "", 0),
        figure("frames", frames).shown("frames of the host", "", 0),
    ];
    in_common(all).into_iter().chain(figures).collect()
}

/// How the runs of a group ended.
fn of_group(group: &str, all: &[Row]) -> Vec<Figure> {
    let runs = || all.iter().filter(|row| row.group() == group);
    let count = |key, is_one: &dyn Fn(&Row) -> bool| {
        figure(key, runs().filter(|row| is_one(row)).count()).shown(key, "", 0)
    };
    let worst = |of: fn(&Row) -> f64| runs().map(of).fold(0.0, f64::max);
    let mut row = vec![figure("kind", group).shown("fault", "", 0), count("runs", &|_| true)];
    for (end, name) in End::ALL {
        let counted = count(name, &|row| row.end == end);
        row.push(if end == End::Unsafe { counted.limit(AtMost(0.0)) } else { counted });
    }
    row.push(count("noticed", &|row| row.noticed));
    row.push(count("harmless", &|row| row.harmless));
    row.push(figure("worst_ms", worst(Row::blind_ms)).shown("worst", "ms", 1));
    let strays: usize = runs().map(|row| row.strays).sum();
    row.push(figure("strays", strays).shown("strays", "", 0));
    let limit_ms = WRONG_LIMIT.as_us_f64() / 1e3;
    let too_long = runs().filter(|row| row.wrong_ms > limit_ms).count();
    row.push(figure("too_long", too_long).shown("wrong too long", "", 0));
    row.push(count("for_ever", &|row| row.for_ever));
    row.push(figure("silent_ms", worst(|row| row.silent_ms)).shown("no pulses", "ms", 0));
    row
}
