//! What `lab faults` takes.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use rig::ServoKind;
use rig::faults::{Kind, Phase, Plan};

use super::Flown;
use design::vehicle::VehicleKind;
use ground::flight::hardware::HardwareChoice;
use ground::flight::sensor::SensorOption;
use ground::image::ImageOption;
use report::arguments::shard;
use report::campaign::{CampaignOptions, Merge, Output};
use report::exit::BadInput;
use report::kind;

/// Options of `lab faults`.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  cargo lab faults                                    every fault, 50 instants each
  cargo lab faults --runs 10000 --json > faults.json  the long campaign, for a script
  cargo lab faults --kind sda-stuck --kind ram-stack  two of them
  cargo lab faults --glitches                         short ones of the cable: all but 1 % ridden out
  cargo lab faults --resets                           every reset by the firmware, two servos, two drones
  cargo lab faults --timer-bits                       every bit of the servo timer, 20 instants each
  cargo lab faults --sound                            no fault: what is done to sound vehicles
  cargo lab faults --vehicle drone2                   both rudders of the two-axis drone
  cargo lab faults --sensor both                      faults of either of two sensors
  cargo lab faults --phase saving                     chip, program and host, while parameters are stored
  cargo lab faults --runs 10000 --shard 3/16 --out part3.csv
  cargo lab faults merge part*.csv                    what many shards add up to
  cargo lab faults rerun report/faults/RUN.toml        one unsafe run again

The same seed gives the same runs. docs/reference/campaigns.md says what is safe, what is unsafe,
and what of a sound vehicle is an alarm.

Exit status: 0 no unsafe run and no alarm (and 99 % of glitches ridden out), 1 at least one or
something failed, 2 unusable input."
)]
pub struct Faults {
    /// What else can be done with campaigns.
    #[command(subcommand)]
    pub command: Option<FaultsCommand>,

    /// Runs in all, as many of each fault [default: 50 of each].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub runs: Option<u32>,

    /// What hangs on the rig [default: drone; with --resets and --sound both drones].
    #[arg(long, value_enum)]
    pub vehicle: Option<VehicleKind>,

    /// The servo on the rig, at a 50 or a 300 Hz frame [default: s3003; with --resets and --sound
    /// both, the digital one at 200 and 333 Hz, too].
    #[arg(long, value_enum)]
    pub servo: Option<ServoKind>,

    /// Which sensors.
    #[command(flatten)]
    pub sensor: SensorOption,

    /// What the vehicle does when the fault begins: start, standby, saving (its parameters), armed,
    /// flight or failsafe. In another phase than the flight, only what fails beyond the sensor
    /// [default: flight; with --resets flight, armed and standby; with --sound all but saving].
    #[arg(long)]
    pub phase: Option<Phase>,

    /// Only this fault; can be given several times [default: all].
    #[arg(long, value_name = "KIND", num_args = 1..)]
    pub kind: Vec<Kind>,

    /// Glitches of the cable instead: 4 to 40 ms without acknowledge, with a line held, all ones or
    /// a stretched clock. At least 99 % must be ridden out with control active.
    #[arg(long, conflicts_with = "kind", group = "plan")]
    pub glitches: bool,

    /// Resets by the firmware instead: a hung program or interrupt, a hard fault, failed
    /// self-checks, a reboot by order, at any phase of the servo frame, with the watchdog's
    /// oscillator at 0.87 to 1.4 times its rate. No pulse may be cut.
    #[arg(long, group = "plan")]
    pub resets: bool,

    /// Each bit of the servo timer's registers instead; --runs is the number in all [default: 20
    /// instants each].
    #[arg(long, conflicts_with = "kind", group = "plan")]
    pub timer_bits: bool,

    /// Sound vehicles instead: no fault, but parts that differ, knocks, hands, magnets, vibration,
    /// warmth, and hosts that ask, order, save and flood. There may be no alarm [default: 2 of
    /// each kind, vehicle, servo and phase].
    #[arg(long, group = "plan")]
    pub sound: bool,

    /// Length of each run of a sound vehicle, s (1 to 600) [default: 20 in flight, 9 for a start, 6
    /// in any other phase].
    #[arg(long, value_name = "S", requires = "sound", value_parser = clap::value_parser!(u16).range(1..=600))]
    pub seconds: Option<u16>,

    /// How runs are carried out.
    #[command(flatten)]
    pub campaign: CampaignOptions,

    /// What the emulated parts are like.
    #[command(flatten)]
    pub hardware: HardwareChoice,

    /// Carry out only part I of N of the campaign, counted from 1.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(u64, u64)>,

    /// Folder for the unsafe runs, as files that `rerun` takes.
    #[arg(long, value_name = "FOLDER", default_value = "report/faults")]
    pub unsafe_runs: PathBuf,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Table, page and figures.
    #[command(flatten)]
    pub output: Output,
}

impl Faults {
    /// What is tried.
    fn plan(&self) -> Plan {
        let plans = [
            (self.glitches, Plan::Glitches),
            (self.resets, Plan::Resets),
            (self.timer_bits, Plan::TimerBits),
            (self.sound, Plan::Sound),
        ];
        let chosen = plans.into_iter().find(|(is_chosen, _)| *is_chosen);
        chosen.map_or(Plan::Faults, |(_, plan)| plan)
    }

    /// What is flown, one after the other.
    ///
    /// # Errors
    /// What does not go together.
    pub fn flown(&self) -> Result<Vec<Flown>, BadInput> {
        let plan = self.plan();
        self.hardware.hardware()?;
        if self.vehicle == Some(VehicleKind::Rocket) {
            return Err(BadInput::new(
                "--vehicle rocket: the campaign's flights are those of a drone; take drone or drone2",
            ));
        }
        let phases = self.phase.map_or_else(|| plan.phases(), |phase| vec![phase]);
        if let Some(phase) = phases.iter().find(|phase| plan.kinds(**phase).is_empty()) {
            let why = format!("--phase {phase}: the campaign of {plan} has none of that");
            return Err(BadInput::new(why));
        }
        if plan == Plan::Glitches && phases != [Phase::Flight] {
            return Err(BadInput::new("--phase: glitches are flown, in phase flight"));
        }
        let all = match plan {
            Plan::Resets | Plan::Sound => 2,
            _ => 1,
        };
        let servos = [ServoKind::S3003, ServoKind::Digital];
        let servos = self.servo.map_or(servos[..all].to_vec(), |servo| vec![servo]);
        let vehicles = VehicleKind::DRONES;
        let vehicles = self.vehicle.map_or(vehicles[..all].to_vec(), |vehicle| vec![vehicle]);
        let mut flown = Vec::new();
        for servo in servos {
            for vehicle in &vehicles {
                flown.extend(phases.iter().map(|phase| Flown {
                    plan,
                    vehicle: *vehicle,
                    servo,
                    phase: *phase,
                    hardware: self.hardware.text(),
                    sensor: self.sensor.sensor.unwrap_or_default().name().to_owned(),
                    seed: self.campaign.seed,
                    seconds: self.seconds,
                }));
            }
        }
        Ok(flown)
    }
}

/// What else can be done with campaigns.
#[derive(Debug, Subcommand)]
pub enum FaultsCommand {
    /// Join the tables of shards and say what they add up to.
    Merge(Merge),
    /// Carry out one run again from its file.
    #[command(alias = "replay")]
    Rerun(Rerun),
}

/// Options of `lab faults rerun`.
#[derive(Debug, Args)]
pub struct Rerun {
    /// A run, as the campaign wrote it.
    #[arg(value_name = "FILE.toml")]
    pub file: PathBuf,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Where to write its row.
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
