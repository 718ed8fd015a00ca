//! Options of `tvc montecarlo`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use plant::dispersion::Ranges;
use rig::ServoKind;

use crate::vehicle::VehicleChoice;
use report::arguments::{number, shard};
use report::campaign::{CampaignOptions, Merge, Output};
use report::kind;

/// Options of `tvc montecarlo`.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Every run draws its own drone, from the seed and its number alone:

  what                                    even within
  thrust                                  +-30 %
  inertia of the body                     +-30 %
  centre of mass, vertical                +-20 mm
  centre of mass, lateral                 +-X mm (--lateral-mm, 0 by default)
  servo speed                             +-20 %
  servo stall torque                      +-20 %
  supply (speed and stall torque)         -15 % to 0
  backlash                                +-50 %
  sensor delay                            +-2 ms
  frame phase                             one frame
  start, either side, with 0.2 rad/s      0.2, 0.4, 0.8 rad in turn
  noise of pitch and rate                 5 mrad, 20 mrad/s rms, white, at every new reading

A run passes with 30 % overshoot or less, and 5 % settling within 1.5 s. Bounds are Wilson's, 95 %.

Drones with two rudders and rockets are flown by the image: `tvc fly --vehicle rocket --dispersed N`.

Examples:
  tvc montecarlo -n 500                         the shipped gains, all cores
  tvc montecarlo -n 500 --lateral-mm 5 --json   figures for a script
  tvc montecarlo -n 2000 --spread servo_speed=0.25,delay_ms=5
  tvc montecarlo -n 100000 --shard 3/16 --out part3.csv
  tvc montecarlo merge part*.csv --out all.csv  one table of many shards
  tvc montecarlo rerun report/montecarlo/worst-1.toml --out path.csv

Exit status: 0 done (and --require met), 1 failed or --require missed, 2 unusable input."
)]
pub struct MonteCarlo {
    /// Another use than flying a campaign.
    #[command(subcommand)]
    pub command: Option<MonteCarloCommand>,

    /// Runs of the whole campaign.
    #[arg(short = 'n', long = "runs", value_name = "N", default_value_t = 500,
          value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub runs: u64,

    /// How they are carried out.
    #[command(flatten)]
    pub campaign: CampaignOptions,

    /// Lateral offset of the centre of mass, to either side, in mm.
    #[arg(long, value_name = "X", default_value_t = 0.0, allow_negative_numbers = true, value_parser = lateral)]
    pub lateral_mm: f64,

    /// Draw a quantity from another range than below, half as wide as the value: thrust, inertia,
    /// servo_speed, stall, supply and backlash as shares, delay_ms, pitch_mrad and rate_mrad_s
    /// (noise, rms). Can be given several times, or several with commas between them.
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',', conflicts_with = "shard", value_parser = spread)]
    pub spread: Vec<Spread>,

    /// The servo, with the frame rate that suits it.
    #[arg(long, value_enum, default_value_t = ServoKind::S3003)]
    pub servo: ServoKind,

    /// The nominal drone: drone, or a FILE.toml (docs/guides/vehicles.md).
    #[arg(long, default_value = "drone")]
    pub vehicle: VehicleChoice,

    /// Firmware parameters in place of the shipped ones, as `tvc tune` and `tvc param dump` write
    /// them.
    #[arg(long, value_name = "FILE.param")]
    pub params: Option<PathBuf>,

    /// Fly only part I of N of the campaign, counted from 1.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(u64, u64)>,

    /// Folder for the worst runs, as files that `rerun` takes.
    #[arg(long, value_name = "FOLDER", default_value = "report/montecarlo")]
    pub worst: PathBuf,

    /// Pass rate below which the command fails, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub require: Option<f64>,

    /// Table, page and figures.
    #[command(flatten)]
    pub output: Output,
}

/// What else can be done with campaigns.
#[derive(Debug, Subcommand)]
pub enum MonteCarloCommand {
    /// Join the tables of shards and say what they add up to.
    Merge(Merge),
    /// Fly one run again from its file.
    Rerun(Rerun),
}

/// Options of `tvc montecarlo rerun`.
#[derive(Debug, Args)]
pub struct Rerun {
    /// A run, as the campaign wrote it.
    #[arg(value_name = "FILE.toml")]
    pub file: PathBuf,

    /// Where to write the motion: time, pitch, rate, crank, rudder, command.
    #[arg(long, value_name = "FILE.csv", value_parser = kind::table)]
    pub out: Option<PathBuf>,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}

/// Largest lateral offset taken, in mm: the drone is some 80 mm wide.
const LARGEST_LATERAL_MM: f64 = 40.0;

fn lateral(text: &str) -> Result<f64, String> {
    let what = format!("an offset is 0 to {LARGEST_LATERAL_MM} mm");
    number(text, 0.0..=LARGEST_LATERAL_MM, &what)
}

/// Where [`Ranges`] have a quantity.
type Quantity = fn(&mut Ranges) -> &mut f64;

/// A quantity with how far it may lie from its nominal value, in the unit of [`Ranges`].
pub type Spread = (Quantity, f64);

/// Quantities by name, with their unit in that of [`Ranges`], and the widest range.
const QUANTITIES: [(&str, f64, f64, Quantity); 9] = [
    ("thrust", 1.0, 0.9, |ranges| &mut ranges.thrust),
    ("inertia", 1.0, 0.9, |ranges| &mut ranges.inertia),
    ("servo_speed", 1.0, 0.9, |ranges| &mut ranges.servo_speed),
    ("stall", 1.0, 0.9, |ranges| &mut ranges.stall),
    ("supply", 1.0, 0.9, |ranges| &mut ranges.supply_loss),
    ("backlash", 1.0, 1.0, |ranges| &mut ranges.backlash),
    ("delay_ms", 1e-3, 100.0, |ranges| &mut ranges.delay_s),
    ("pitch_mrad", 1e-3, 100.0, |ranges| &mut ranges.pitch_noise_rad),
    ("rate_mrad_s", 1e-3, 1000.0, |ranges| &mut ranges.rate_noise_rad_s),
];

fn spread(text: &str) -> Result<Spread, String> {
    let (name, value) = text.split_once('=').ok_or("KEY=VALUE is needed")?;
    let known = QUANTITIES.iter().find(|(known, ..)| *known == name.trim());
    let Some((_, unit, most, quantity)) = known else {
        let names: Vec<&str> = QUANTITIES.iter().map(|(name, ..)| *name).collect();
        return Err(format!("no {name} is drawn; there are {}", names.join(", ")));
    };
    let value = number(value, 0.0..=*most, &format!("{name} is 0 to {most}"))?;
    Ok((*quantity, unit * value))
}

fn share(text: &str) -> Result<f64, String> {
    number(text, 0.0..=1.0, "a share is 0 to 1, such as 0.99")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_takes_the_place_of_a_range() {
        let mut ranges = Ranges::WIDE;
        for text in ["servo_speed=0.25", "delay_ms=5"] {
            let (quantity, value) = spread(text).unwrap();
            *quantity(&mut ranges) = value;
        }
        let expected = Ranges { servo_speed: 0.25, delay_s: 5e-3, ..Ranges::WIDE };
        assert_eq!(ranges, expected);
        for bad in ["thrust", "thrust=2", "thrust=-1", "thrust=x", "lift=0.1"] {
            assert!(spread(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn offsets_and_shares_are_within_reason() {
        assert_eq!(lateral("5"), Ok(5.0));
        assert!(lateral("-1").is_err() && lateral("NaN").is_err() && lateral("400").is_err());
        assert!(share("0.99").is_ok() && share("99").is_err());
    }
}
