//! Runs as rows: in words and numbers, and as a table of CSV.

use rig::ServoKind;
use rig::faults::{Alarms, Ending, Kind, Outcome, Phase, Plan};
use serde::{Deserialize, Serialize};

use super::{Flown, named};
use design::vehicle::VehicleKind;
use report::campaign;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum End {
    /// The vehicle goes on with what it did: in flight, in control.
    Recovered,
    /// It does not, with the rudder at neutral.
    Neutral,
    /// The same behind a reset.
    Restarted,
    /// None of these, or too late.
    Unsafe,
    /// The program, as the fault had left it, did what the emulated chip does not model.
    Unmodelled,
    /// Nothing was wrong with the vehicle, and there were alarms.
    Alarmed,
}

impl End {
    /// Those of faults, with the words of the tables.
    pub const ALL: [(Self, &str); 5] = [
        (Self::Recovered, "recovered"),
        (Self::Neutral, "neutral"),
        (Self::Restarted, "restarted"),
        (Self::Unsafe, "unsafe"),
        (Self::Unmodelled, "unmodelled"),
    ];

    /// Whether it fails the campaign.
    pub fn is_bad(self) -> bool {
        matches!(self, Self::Unsafe | Self::Alarmed)
    }
}

/// A run: the campaign that it belongs to, what was drawn, and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Seed of the campaign.
    pub seed: u64,
    /// What the campaign tries.
    #[serde(with = "named")]
    pub campaign: Plan,
    /// The vehicle.
    pub vehicle: VehicleKind,
    /// Its servo.
    #[serde(with = "named")]
    pub servo: ServoKind,
    /// What the vehicle did when the fault began.
    #[serde(with = "named")]
    pub phase: Phase,
    /// What fails.
    #[serde(with = "named")]
    pub kind: Kind,
    /// Number of the run among those of this kind.
    pub number: u32,
    /// When the fault began, s after the release or the phase's begin.
    pub at_s: f64,
    /// How long it lasted, s.
    pub lasted_s: f64,
    /// What was switched on, in words.
    pub fault: String,
    /// How it ended.
    pub end: End,
    /// What was unsafe or is not modelled; empty for any other end.
    pub why: String,
    /// Longest time for which a rudder was off neutral without valid data, ms; 0 beyond the sensor.
    pub unguarded_ms: f64,
    /// Longest time for which a rudder was driven wrongly, ms; 0 for faults of the sensor.
    pub wrong_ms: f64,
    /// Longest time without a pulse behind one that was not neutral, ms; 0 for faults of the
    /// sensor.
    pub silent_ms: f64,
    /// Pulses that were neither neutral nor what the firmware had asked for.
    pub strays: usize,
    /// At the end a rudder was still driven wrongly, or had no pulses.
    pub for_ever: bool,
    /// The firmware has told, or restarted with a reason.
    pub noticed: bool,
    /// Nothing was noticed, and no pulse was another than without the fault.
    pub harmless: bool,
    /// The firmware's last text.
    pub said: String,
    /// Of a sound vehicle: how long it was watched, s.
    #[serde(default)]
    pub flown_s: f64,
    /// Of a sound vehicle: frames that its host sent.
    #[serde(default)]
    pub frames: u64,
    /// Of a sound vehicle: bursts that its sensor was asked for.
    #[serde(default)]
    pub bursts: usize,
    /// Its alarms: resets.
    #[serde(default)]
    pub resets: usize,
    /// Failsafes.
    #[serde(default)]
    pub failsafes: usize,
    /// Latched faults.
    #[serde(default)]
    pub latches: usize,
    /// Other states.
    #[serde(default)]
    pub states: usize,
    /// Orders refused.
    #[serde(default)]
    pub refusals: usize,
    /// Bursts refused.
    #[serde(default)]
    pub refused: usize,
    /// Steps lost.
    #[serde(default)]
    pub lost: usize,
    /// Loops that did not keep their time.
    #[serde(default)]
    pub late: usize,
    /// Parameters lost.
    #[serde(default)]
    pub parameters: usize,
    /// Pulses that nobody asked for.
    #[serde(default)]
    pub pulses: usize,
}

impl Row {
    /// The row of a run.
    pub fn new(flown: &Flown, outcome: &Outcome) -> Self {
        let verdict = &outcome.verdict;
        let (end, why) = match verdict.ending {
            Ending::Recovered => (End::Recovered, String::new()),
            Ending::Neutral => (End::Neutral, String::new()),
            Ending::Restarted => (End::Restarted, String::new()),
            Ending::Unmodelled(ref what) => (End::Unmodelled, what.clone()),
            Ending::Unsafe(why) => (End::Unsafe, why.to_string()),
            Ending::Alarmed(ref alarms) => (End::Alarmed, alarms.to_string()),
        };
        let none = Alarms::default();
        let alarms = match &verdict.ending {
            Ending::Alarmed(alarms) => alarms,
            _ => &none,
        };
        Self {
            seed: flown.seed,
            campaign: flown.plan,
            vehicle: flown.vehicle,
            servo: flown.servo,
            phase: flown.phase,
            kind: outcome.case.kind,
            number: outcome.case.number,
            at_s: outcome.at_s,
            lasted_s: outcome.lasted_s,
            fault: outcome.fault.clone(),
            end,
            why,
            unguarded_ms: verdict.unguarded.as_us_f64() / 1e3,
            wrong_ms: verdict.wrong.as_us_f64() / 1e3,
            silent_ms: verdict.silent.as_us_f64() / 1e3,
            strays: verdict.strays,
            for_ever: verdict.for_ever,
            noticed: verdict.noticed,
            harmless: verdict.harmless,
            said: outcome.said.clone(),
            flown_s: outcome.watched.flown_s,
            frames: outcome.watched.frames,
            bursts: outcome.watched.bursts,
            resets: alarms.resets,
            failsafes: alarms.failsafes,
            latches: alarms.latches,
            states: alarms.states,
            refusals: alarms.refusals,
            refused: alarms.refused,
            lost: alarms.lost,
            late: alarms.late,
            parameters: alarms.parameters,
            pulses: alarms.pulses,
        }
    }

    /// What runs have in common that can be added up: those of one flight, all resets, or all of
    /// sound vehicles.
    fn in_common(&self) -> (Plan, Option<(VehicleKind, ServoKind, Phase)>) {
        let is_one_flight = !matches!(self.campaign, Plan::Resets | Plan::Sound);
        (self.campaign, is_one_flight.then_some((self.vehicle, self.servo, self.phase)))
    }

    /// The runs that it is counted with: of its kind; of resets with the same frame and drone, too;
    /// of sound vehicles those in the same phase; of bits those of the same register.
    pub fn group(&self) -> String {
        let Self { kind, phase, .. } = self;
        match self.campaign {
            Plan::Resets => {
                format!("{kind}, {phase}, {}, {}", self.vehicle.name(), self.servo.name())
            }
            Plan::Sound => format!("{kind}, {phase}"),
            Plan::TimerBits => self.fault.rsplit(' ').next().unwrap_or_default().to_owned(),
            Plan::Faults | Plan::Glitches => kind.to_string(),
        }
    }

    /// The run in words.
    pub fn story(&self) -> String {
        let Self { kind, number, fault, at_s, said, .. } = self;
        let lasted_ms = self.lasted_s * 1e3;
        if self.end == End::Alarmed {
            return format!("{} run {number}, {fault}", self.group());
        }
        format!(
            "{kind} run {number}, {fault} at {at_s:.3} s for {lasted_ms:.0} ms, said last \"{said}\""
        )
    }

    /// The longest time for which a rudder was off neutral that was not under control, ms.
    pub fn blind_ms(&self) -> f64 {
        self.unguarded_ms.max(self.wrong_ms)
    }

    /// Whether its times are times of a flight.
    fn is_plausible(&self) -> bool {
        let ms = [self.unguarded_ms, self.wrong_ms, self.silent_ms];
        (0.0..=60.0).contains(&self.at_s)
            // The page has it on a logarithmic axis.
            && (1e-3..=600.0).contains(&self.lasted_s)
            && (0.0..=700.0).contains(&self.flown_s)
            && ms.iter().all(|ms| (0.0..=60e3).contains(ms))
    }
}

impl campaign::Row for Row {
    fn check(&self, first: &Self) -> Result<(), String> {
        if !self.is_plausible() {
            return Err(format!("run {} of {} has an impossible time", self.number, self.kind));
        }
        if (first.seed, first.in_common()) != (self.seed, self.in_common()) {
            let differs = "seed, campaign, vehicle, servo or phase differs";
            return Err(format!("of another campaign: {differs}"));
        }
        Ok(())
    }

    fn place(&self) -> impl Ord {
        let Self { kind, number, .. } = *self;
        (kind, self.vehicle.name(), self.servo.name(), self.phase.name(), number)
    }
}
