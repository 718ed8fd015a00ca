//! Options of `tvc fly`.

use crate::flight::hardware::HardwareChoice;
use crate::flight::sensor::SensorOption;
use crate::image::ImageOption;
use ::rig::ServoKind;
use ::rig::disturbance::Disturbances;
use clap::Args;
use design::vehicle::VehicleChoice;
use report::arguments::number;
use report::kind;
use std::num::NonZeroU32;
use std::path::PathBuf;
use tvc_nano::Params;
use tvc_nano::params::FilterKind;

/// Options of `tvc fly`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc fly                                fly from 0.2, 0.4 and 0.8 rad, write report/fly.html
  tvc fly --servo digital --start 0.4    one start, a fast servo at a 300 Hz frame
  tvc fly --gains 0.9,0.25 --seed 7      other gains, other noise and frame phase
  tvc fly --params tuned.param           what `tvc tune` found
  tvc fly --seeds 48                     48 seeds: mean, 95 % and worst
  tvc fly --filter madgwick              another attitude filter
  tvc fly --sensor lsm6ds3               the sensor on the Nano's board, without a BNO055
  tvc fly --vehicle drone2 --seeds 12    two rudders: pitch and roll, with and without spin
  tvc fly --vehicle drone2 --dispersed 500   vehicles that are not as their parameters say
  tvc fly --vehicle rocket --seeds 12    a rocket through its burn: schedule, constant gains, cascade
  tvc fly --vehicle heavy.toml           another drone, another servo; or another rocket
  tvc fly --json > flight.json           figures for a script, nothing else on standard output
  tvc fly --vibration 5,180 --servo-supply 5.5 --thrust-ramp 90,0.5
                                         an unbalanced propeller, a weak battery, a slow motor
  tvc fly --faults scenarios/faults.toml     faults of the sensor at times of the flight
  tvc fly --start 0.4 --vcd flight.vcd   bus and pins of the flight for sigrok or GTKWave
  tvc fly --recording walk.imuq          feed a real recording to the emulated BNO055

Exit status: 0 every requirement met, 1 one missed or something failed, 2 unusable input.")]
pub struct Fly {
    /// Servo: s3003 (analog, 50 Hz frame) or digital (300 Hz).
    #[arg(long, value_enum, default_value_t = ServoKind::S3003, hide_possible_values = true)]
    pub servo: ServoKind,

    /// Vehicle: drone (one rudder), drone2 (two), rocket or FILE.toml.
    #[arg(long, default_value = "drone", conflicts_with = "recording")]
    pub vehicle: VehicleChoice,

    /// Seed of sensor noise and bias, and of clock phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Fly N seeds from --seed on, to either side in turn; shows distributions.
    #[arg(long, value_name = "N", conflicts_with = "recording")]
    pub seeds: Option<NonZeroU32>,

    /// Fly N vehicles that differ from their parameters; 99 % must pass.
    #[arg(long, value_name = "N", conflicts_with_all = ["recording", "seeds"])]
    pub dispersed: Option<NonZeroU32>,

    /// Start from this tilt only, rad (-0.87 to 0.87).
    #[arg(long, value_name = "RAD", allow_negative_numbers = true, value_parser = start_angle)]
    pub start: Option<f64>,

    /// PID gains, rad of servo per rad and per rad/s [default: the servo's].
    #[arg(long, value_name = "KP,KD", allow_negative_numbers = true, value_parser = gains)]
    pub gains: Option<(f32, f32)>,

    /// Firmware parameters, as `tvc tune` and `tvc param dump` write them.
    #[arg(long, value_name = "FILE.param", conflicts_with = "gains")]
    pub params: Option<PathBuf>,

    /// Attitude filter: vqf, mahony, madgwick or complementary [default: vqf].
    #[arg(long, value_name = "NAME", conflicts_with = "params", value_parser = filter)]
    pub filter: Option<FilterKind>,

    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOption,

    /// Play a recording through the emulated BNO055 and score the attitude.
    #[arg(long, value_name = "FILE.imuq", conflicts_with_all = ["start", "gains", "params", "sensor", "Disturbances"])]
    pub recording: Option<PathBuf>,

    /// Faults and disturbances by time (docs/reference/faults.md).
    #[arg(long, value_name = "FILE.toml", conflicts_with = "recording")]
    pub faults: Option<PathBuf>,

    /// Which image.
    #[command(flatten)]
    pub image: ImageOption,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Where to write the HTML report.
    #[arg(long, value_name = "FILE.html", default_value = "report/fly.html", value_parser = kind::page)]
    pub report: PathBuf,

    /// Write bus and pins of the first flight for sigrok or GTKWave.
    #[arg(long, value_name = "FILE.vcd", conflicts_with_all = ["seeds", "dispersed", "recording"], value_parser = kind::waves)]
    pub vcd: Option<PathBuf>,

    /// What disturbs the flight.
    #[command(flatten)]
    pub disturb: Disturbances,

    /// What the emulated parts are like.
    #[command(flatten)]
    pub hardware: HardwareChoice,
}

/// Largest tilt that the firmware arms at: 50 degrees, in rad, rounded down.
const LARGEST_START_RAD: f64 = 0.87;

pub fn tilt_angle(text: &str) -> Result<f64, String> {
    number(text, -LARGEST_START_RAD..=LARGEST_START_RAD, "a tilt is -0.87 to 0.87 rad")
}

pub fn start_angle(text: &str) -> Result<f64, String> {
    match tilt_angle(text)? {
        0.0 => Err("a start angle is not 0".into()),
        rad => Ok(rad),
    }
}

fn filter(text: &str) -> Result<FilterKind, String> {
    let mut all = FilterKind::ALL.into_iter();
    let found = all.find(|(_, name)| *name == text);
    found.map(|(kind, _)| kind).ok_or_else(|| {
        let names = FilterKind::ALL.map(|(_, name)| name).join(", ");
        format!("the image has the filters {names}")
    })
}

fn gains(text: &str) -> Result<(f32, f32), String> {
    let parsed = text
        .split_once(',')
        .and_then(|(kp, kd)| Some((kp.trim().parse().ok()?, kd.trim().parse().ok()?)));
    let (kp, kd) = parsed.ok_or("gains are two numbers, such as 1.0,0.3")?;
    // The firmware's own parameter table has the ranges.
    let mut params = Params::default();
    let set = params.set("PID_KP", kp).and_then(|_| params.set("PID_KD", kd));
    set.map_err(|error| error.to_string())?;
    Ok((kp, kd))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn start_angles_are_within_what_arming_allows() {
        assert_eq!(start_angle("0.4"), Ok(0.4));
        assert_eq!(start_angle("-0.2"), Ok(-0.2));
        for bad in ["-1.2", "0", "1.2", "NaN", "inf", "a"] {
            assert!(start_angle(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn gains_are_two_numbers() {
        assert_eq!(gains("0.9, 0.25"), Ok((0.9, 0.25)));
        for bad in ["1", "1,", "1,x", "-1,0.3", "1,NaN", "1,2,3"] {
            assert!(gains(bad).is_err(), "{bad}");
        }
    }
}
