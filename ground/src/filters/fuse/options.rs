//! Options of `tvc fuse`.

use std::path::PathBuf;

use clap::Args;
use recordings::{FilterName, Mode, Scalar, Setting};

use report::kind;

/// Options of `tvc fuse`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tvc fuse walk.imuq --out walk.est.csv         the best filter, with magnetometer
  tvc fuse walk.imuq --filter mahony --score    how far it is from the reference
  tvc fuse *.imuq --scalar fixed --score --json scores of each and their mean, for a script
  tvc fuse *.imuq --mode 6d --out estimates     one CSV for each recording, in a folder
  tvc fuse log.csv --offline --out est.csv      as near to the truth as it can be had later
  tvc fuse log.csv --filter madgwick --set preset=thesis --set rest.rate_rad_s=0 --out e.csv

Recordings
  IMUQ16v1   gyroscope, accelerometer, magnetometer, reference and flags in 16-bit counts.
  CSV        a line of column names, then a line for each sample; any order, other columns are
             ignored:
               t_s, or t_ms, t_us           time
               gx_rad_s gy_rad_s gz_rad_s   rotation rate; or gx_deg_s and so on
               ax_m_s2 ay_m_s2 az_m_s2      specific force, +9.8 upwards at rest; or ax_g and so on
               mx_ut my_ut mz_ut            magnetic field, optional; or mx_gauss and so on
               ref_w ref_x ref_y ref_z      reference, sensor to east-north-up, optional
               movement                     1 where errors count, optional (without it: everywhere)
             or the counts of a BNO055, time in sample_time_us or time_us, as `tvc log convert` writes
             them: gyr_x acc_x mag_x and so on
             An empty field or reference is a sample without it.

Estimates
  t,w,x,y,z for every sample, from the first: time in s as recorded, and the unit quaternion that
  takes sensor axes to east-north-up (magnetic north), v_earth = q v_sensor q*. With --mode 6d, or
  without a magnetometer, north is where the sensor's x axis pointed at the start.

Scores
  Degrees RMSE over the movement against the reference, by the definition of the BROAD benchmark:
  total, heading, inclination; nothing is aligned. With --mode 6d only the inclination means
  something, and only it is given. Of several recordings the mean is given too.

Fixed point
  All filters but gyro and kalman, up to 2000 samples a second, on 16-bit counts: those of an
  IMUQ16v1 file as they are; of a CSV file in SI units, values rounded to 2000/32767 deg/s,
  16/32767 g and 0.05 uT, and saturated. What a clipped gyroscope hides is lost.

Offline
  With --offline the filter runs through the recording forth, back and forth again, and the two
  directions are joined: what comes later counts for each sample, as an offset of the gyroscope
  that only a rest at the end shows. In f32 and f64; the recording is held in memory.

Keys of --set
  every filter   preset=default|thesis, acc_gate, gyro_range_rad_s, recovery_rad2_s, gap_s,
                 start_up_s, declination_rad, rest.rate_rad_s (0: learn no offset), rest.acc_m_s2,
                 rest.time_s, rest.max_bias_rad_s, rest.tau_s, rest.motion_tilt_rad (inf: learn no
                 offset in motion), field.gate, field.tau_s, field.adopt_s, field.adopt_rate_rad_s,
                 field.reject_s,
                 gyr_lag_s (age of the rates), acc_lag_s, mag_lag_s (how late these sensors are
                 behind them), mag_lag_sd_s (0: learn nothing of the field's lag)
  complementary  acc_tau_s, mag_tau_s
  mahony         acc_per_s, mag_per_s, integral_per_s2
  madgwick       beta_per_s
  kalman         gyr_rad2_s, gyr_scale_s, bias_rad2_s3, bias_rad_s, acc_rad2_s, mag_rad2_s
  vqf            acc_tau_s, acc_smoothing_s, mag_tau_s; preset=published|offline (that of --offline)

Exit status: 0 done, 1 something failed, 2 unusable input; then no file is written.")]
pub struct Fuse {
    /// Recordings to run the filter on: IMUQ16v1, or CSV with named columns.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,

    /// The filter.
    #[arg(long, value_enum, value_name = "NAME", default_value_t = FilterName::Vqf)]
    pub filter: FilterName,

    /// With (9d) or without (6d) the magnetometer.
    #[arg(long, value_enum, default_value_t = Mode::NineD)]
    pub mode: Mode,

    /// The arithmetic that it runs in.
    #[arg(long, value_enum, default_value_t = Scalar::F32)]
    pub scalar: Scalar,

    /// Run in both directions of time, with all of the recording known.
    #[arg(long)]
    pub offline: bool,

    /// Another value for a setting of the filter, in SI units; may be repeated (keys below).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<Setting>,

    /// Where to write the estimates. With several recordings a folder, and in it the recordings'
    /// names with the ending .csv.
    #[arg(long, value_name = "EST.csv", required_unless_present_any = ["score", "json"], value_parser = kind::table_or_folder)]
    pub out: Option<PathBuf>,

    /// Score the estimates against the recordings' references.
    #[arg(long)]
    pub score: bool,

    /// Print one JSON object with the scores on standard output and nothing else there.
    #[arg(long)]
    pub json: bool,
}
