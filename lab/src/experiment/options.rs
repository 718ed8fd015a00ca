//! Options of `lab experiment`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use report::kind;

/// The navigation experiments of the thesis, with simulated sensors.
#[derive(Debug, Args)]
pub struct Experiment {
    /// Which of them.
    #[command(subcommand)]
    pub command: ExperimentCommand,
}

/// The experiments.
#[derive(Debug, Subcommand)]
pub enum ExperimentCommand {
    /// Ten minutes at rest: what drifts, and how far.
    Static(Sensing),
    /// Three cycles of +-45 degrees of pitch.
    Motion(Sensing),
}

const HELP: &str = "\
Examples:
  cargo lab experiment static                        write report/experiment-static.html
  cargo lab experiment motion --reference-lag 150    what explains the figures of the thesis
  cargo lab experiment static --gyro-bias typical    a raw chip: +-1 deg/s that nobody calibrated
  cargo lab experiment motion --hard-iron 5,0,0 --json
  cargo lab experiment static --no-noise --gyro-bias 0,0,0.1

All estimators see the same samples of one simulated BNO055, 100 a second. Those of the thesis are set
as in the thesis: no offset learned at rest, every field believed, yaw of the complementary filter from
the gyroscope after the first second.

Mean and standard deviation are of the error, estimate less reference, roll, pitch and yaw in degrees.
The combined RMSE is the root of the sum of the squares of the three. Required of Mahony and VQF: mean
at most 1.5 deg an axis; at rest RMSE at most 0.4 deg combined, in motion at most 0.5 deg an axis.

Exit status: 0 ours meet the requirements, 1 one was missed or something failed, 2 unusable input.";

/// What the simulated sensors suffer from.
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct Sensing {
    /// Seed of the noise and of a typical chip's offsets.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Gyroscope offset in deg/s about the forward, right and down axes, or `typical`: drawn from
    /// +-1. The default is what is left after the calibration in the thesis.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0.0174", allow_hyphen_values = true, value_parser = gyro_bias)]
    pub gyro_bias: GyroBias,

    /// Gyroscope scale error, in percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, allow_hyphen_values = true, value_parser = |text: &str| number(text, 50.0))]
    pub gyro_scale: f64,

    /// Accelerometer offset, in mg.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", allow_hyphen_values = true, value_parser = |text: &str| triple(text, 1000.0))]
    pub acc_offset: Triple,

    /// Hard iron: a field that turns with the sensor, in uT.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", allow_hyphen_values = true, value_parser = |text: &str| triple(text, 1000.0))]
    pub hard_iron: Triple,

    /// Soft iron: what the field along each axis is multiplied with.
    #[arg(long, value_name = "X,Y,Z", default_value = "1,1,1", allow_hyphen_values = true, value_parser = |text: &str| triple(text, 10.0))]
    pub soft_iron: Triple,

    /// Vibration felt by the accelerometer, in m/s2 rms an axis, at 40 Hz.
    #[arg(long, value_name = "M_S2", default_value_t = 0.0, value_parser = |text: &str| amount(text, 100.0))]
    pub vibration: f64,

    /// How late the reference is, in ms.
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = |text: &str| amount(text, 1000.0))]
    pub reference_lag: f64,

    /// Rest before the experiment begins, in s, in which estimators find north and learn the
    /// gyroscope's offset; with 0 their start is part of it.
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = |text: &str| amount(text, 600.0))]
    pub warm_up: f64,

    /// Sensors without noise.
    #[arg(long)]
    pub no_noise: bool,

    /// Print one JSON object on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,

    /// Where to write the HTML report [default: report/experiment-NAME.html].
    #[arg(long, value_name = "FILE.html", value_parser = kind::page)]
    pub report: Option<PathBuf>,
}

/// Three numbers, one for each axis.
pub type Triple = [f64; 3];

/// Offset of the gyroscope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GyroBias {
    /// As the seed draws it.
    Typical,
    /// In deg/s.
    Given(Triple),
}

fn gyro_bias(text: &str) -> Result<GyroBias, String> {
    if text == "typical" {
        return Ok(GyroBias::Typical);
    }
    triple(text, 100.0).map(GyroBias::Given)
}

fn number(text: &str, most: f64) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.abs() <= most => Ok(value),
        Ok(_) => Err(format!("at most {most} in size")),
        Err(_) => Err("not a number".into()),
    }
}

fn amount(text: &str, most: f64) -> Result<f64, String> {
    match number(text, most) {
        Ok(value) if value < 0.0 => Err("not below 0".into()),
        other => other,
    }
}

fn triple(text: &str, most: f64) -> Result<Triple, String> {
    let numbers = text.split(',').map(|part| number(part, most)).collect::<Result<Vec<_>, _>>()?;
    numbers.try_into().map_err(|_| "three numbers, such as 0.1,0,-0.2".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_within_their_range() {
        assert_eq!(triple("1, -2,0.5", 10.0), Ok([1.0, -2.0, 0.5]));
        for bad in ["1,2", "1,2,3,4", "a,b,c", "11,0,0", "nan,0,0", ""] {
            assert!(triple(bad, 10.0).is_err(), "{bad}");
        }
        assert!(amount("-1", 10.0).is_err() && amount("1", 10.0) == Ok(1.0));
        assert_eq!(gyro_bias("typical"), Ok(GyroBias::Typical));
        assert_eq!(gyro_bias("0,0,1"), Ok(GyroBias::Given([0.0, 0.0, 1.0])));
    }
}
