//! The control steps of a log as a table for spreadsheets, PlotJuggler and scripts.

use std::path::Path;

use anyhow::Result;
use client::state::state_name;

use super::{Event, Flight};
use report::file::write_whole;

const HEAD: &str = "time_us,state,lost_before,sample_time_us,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z,\
                    q_w,q_x,q_y,q_z,roll_rate_rad_s,pitch_rate_rad_s,yaw_rate_rad_s,crank_rad,pulse_us,\
                    pitch_rad,roll_rad,set_rad,\
                    crank2_rad,pulse2_us\n";

/// The set point of pitch, deg.
const SET_POINT: &str = "PITCH_SET_DEG";

/// Writes a row a step. Counts are the sensor's own; they and their time are empty where a sample
/// was missed.
///
/// # Errors
/// The file cannot be written.
pub fn write_csv(flight: &Flight, path: &Path) -> Result<()> {
    write_whole(path, text(flight).as_bytes())
}

fn text(flight: &Flight) -> String {
    let mut text = HEAD.to_owned();
    let (mut state, mut lost) = (String::new(), 0);
    let mut set_rad = flight.parameters().pitch_set_deg().to_radians();
    for event in &flight.events {
        match event {
            Event::State(code) => state = state_name(*code),
            Event::Gap(frames) => lost += frames,
            Event::Parameter(name, value) if name == SET_POINT => set_rad = value.to_radians(),
            Event::Step(step) => {
                let mut row = vec![step.now_us.to_string(), state.clone(), lost.to_string()];
                match &step.sample {
                    Some(sample) => {
                        row.push(sample.time.0.to_string());
                        let counts = [sample.acc, sample.gyr, sample.mag];
                        row.extend(counts.as_flattened().iter().map(i16::to_string));
                    }
                    None => row.extend(std::iter::repeat_n(String::new(), 10)),
                }
                // Rust prints the shortest text that reads back as the same bits.
                row.extend(step.quaternion.iter().map(f32::to_string));
                row.extend(step.rate_rad_s.iter().map(f32::to_string));
                let crank = |axis: usize| {
                    step.cranks_rad[axis].map_or(String::new(), |crank| crank.to_string())
                };
                row.push(crank(0));
                row.push(step.pulses_us[0].to_string());
                // The vehicle tells no more than the quaternion's seven digits.
                let angles = [step.pitch_rad(), step.roll_rad()].map(|angle| angle as f32);
                row.extend(angles.iter().chain([&set_rad]).map(f32::to_string));
                row.push(crank(1));
                row.push(step.pulses_us[1].to_string());
                text += &row.join(",");
                text.push('\n');
                lost = 0;
            }
            _ => {}
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Step;
    use tvc_nano::{Micros, RawSample};

    #[test]
    fn every_row_has_every_column() {
        let step = Step {
            now_us: 5,
            sample: None,
            quaternion: [0.1, 0.0, 0.0, 1.0],
            rate_rad_s: [0.0; 3],
            cranks_rad: [None; 2],
            pulses_us: [1524, 0],
        };
        let sample = RawSample { time: Micros(1), acc: [1, 2, 3], gyr: [4, 5, 6], mag: [7, 8, -9] };
        let flight = Flight {
            events: vec![
                Event::State(2),
                Event::Step(step),
                Event::Parameter(SET_POINT.into(), 10.0),
                Event::Gap(3),
                Event::Step(Step { sample: Some(sample), ..step }),
            ],
            ..Flight::default()
        };
        let text = text(&flight);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        let columns = |line: &str| line.split(',').count();
        assert!(lines.iter().all(|line| columns(line) == columns(HEAD)));
        assert_eq!(lines[1], "5,standby,0,,,,,,,,,,,0.1,0,0,1,0,0,0,,1524,0,0,0.17453292,,0");
        assert!(lines[2].starts_with("5,standby,3,1,1,2,3,4,5,6,7,8,-9,0.1,"));
    }
}
