//! The readings to calibrate from: a whole recording, or what a vehicle sends.

use std::path::Path;

use anyhow::{Result, bail};
use calibration::prompt::Prompt;
use calibration::{Reading, Readings};
use client::request::text_of;
use client::text;
use mavlink::dialects::common::MavMessage;
use nalgebra::Vector3;
use recordings::{Source, bno055};

use flights::log::each_message;
use report::exit::BadInput;
use report::kind::is_log;

/// Fewest samples.
const FEWEST: usize = 100;

/// Reads a telemetry log, CSV of counts or of SI units, or IMUQ16v1.
///
/// # Errors
/// [`BadInput`] naming the file and what is wrong with it.
pub fn read(path: &Path) -> Result<Readings> {
    let mut readings = Readings::default();
    if is_log(path) {
        each_message(path, |entry| {
            if entry.from_vehicle || prompt_in(&entry.message).is_some() {
                take(&mut readings, &entry.message);
            }
        })?;
    } else {
        let mut source = Source::open(path).map_err(BadInput::new)?;
        while let Some(sample) = source.next_sample().map_err(BadInput::new)? {
            readings.push(Reading {
                time_s: sample.time_s,
                gyr: sample.gyr_rad_s.into(),
                acc: sample.acc_m_s2.into(),
                mag: sample.mag_ut.map(Vector3::from),
            });
        }
    }
    let count = readings.samples.len();
    if count < FEWEST {
        bail!(BadInput::new(format!(
            "{} has {count} samples with all of gyroscope and accelerometer, fewer than {FEWEST}",
            path.display(),
        )));
    }
    Ok(readings)
}

/// Takes in a message of the vehicle, or a prompt to whoever holds it.
pub fn take(readings: &mut Readings, message: &MavMessage) {
    match message {
        MavMessage::RAW_IMU(m) => {
            let vector = |x: i16, y: i16, z: i16| Vector3::new(x, y, z).map(f64::from);
            let mag = vector(m.xmag, m.ymag, m.zmag);
            readings.push(Reading {
                time_s: m.time_usec as f64 * 1e-6,
                gyr: vector(m.xgyro, m.ygyro, m.zgyro) * bno055::GYR_RAD_S,
                acc: vector(m.xacc, m.yacc, m.zacc) * bno055::ACC_M_S2,
                mag: (mag.norm() > 0.0).then_some(mag * bno055::MAG_UT),
            });
        }
        MavMessage::PARAM_VALUE(m) => {
            readings.parameters.insert(text(&m.param_id).to_owned(), m.param_value);
        }
        _ if prompt_in(message) == Some(Prompt::Level) => {
            readings.level_from_s = Some(readings.length_s());
        }
        _ => {}
    }
}

/// What a person is asked to do in this message.
fn prompt_in(message: &MavMessage) -> Option<Prompt> {
    text_of(message).and_then(Prompt::from_text)
}
