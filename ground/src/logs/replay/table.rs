//! The runs of a replay side by side as a table.

use super::Pair;

const HEAD: &str = "time_us,comparable,pitch_rad,pitch_rad_replayed,crank_rad,crank_rad_replayed,pulse_us,\
                    pulse_us_replayed,pitch_rad_filter,crank2_rad,crank2_rad_replayed,pulse2_us,pulse2_us_replayed\n";

/// A row a step. `comparable` is 1 where the estimate's past is known; `other` is another filter's
/// time and pitch after each sample, and its column is empty without one.
pub fn text(pairs: &[Pair], other: Option<&[(f64, f64)]>) -> String {
    let mut text = HEAD.to_owned();
    let mut others = other.unwrap_or_default().iter();
    for pair in pairs {
        let (logged, again) = (&pair.logged, &pair.again);
        let crank = |crank: Option<f32>| crank.map_or(String::new(), |crank| crank.to_string());
        let other = logged.sample.and_then(|_| others.next());
        let row = [
            logged.now_us.to_string(),
            u8::from(pair.exact).to_string(),
            logged.pitch_rad().to_string(),
            again.pitch_rad().to_string(),
            crank(logged.cranks_rad[0]),
            crank(again.cranks_rad[0]),
            logged.pulses_us[0].to_string(),
            again.pulses_us[0].to_string(),
            other.map_or(String::new(), |(_, pitch)| pitch.to_string()),
            crank(logged.cranks_rad[1]),
            crank(again.cranks_rad[1]),
            logged.pulses_us[1].to_string(),
            again.pulses_us[1].to_string(),
        ];
        text += &row.join(",");
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use flights::log::Step;
    use tvc_nano::{Micros, RawSample};

    #[test]
    fn another_filters_pitch_stands_where_there_was_a_sample() {
        let missed = Step {
            now_us: 5,
            sample: None,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            rate_rad_s: [0.0; 3],
            cranks_rad: [None; 2],
            pulses_us: [1524, 0],
        };
        let sampled = Step {
            now_us: 6,
            sample: Some(RawSample { time: Micros(1), acc: [0; 3], gyr: [0; 3], mag: [0; 3] }),
            cranks_rad: [Some(0.25), None],
            ..missed
        };
        let pair = |logged: Step, pulse_us, exact| Pair {
            logged,
            again: Step { pulses_us: [pulse_us, 0], ..logged },
            exact,
        };
        let pairs = [pair(missed, 1524, false), pair(sampled, 1600, true)];
        let text = text(&pairs, Some(&[(0.0, 0.5)]));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[1], "5,0,0,0,,,1524,1524,,,,0,0");
        assert_eq!(lines[2], "6,1,0,0,0.25,0.25,1524,1600,0.5,,,0,0");
        assert_eq!(lines[0].split(',').count(), 13);
    }
}
