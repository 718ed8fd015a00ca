use std::vec::Vec;

use super::*;
use crate::config::{AccRange, AccUnit, Config, GyrBandwidth, GyrRange, Sensors, Units};
use tvc_imu::judge::{Evidence, Judged, STEP_AGE_US};
use tvc_imu::{Micros, RawSample, SensorFault};

const REST: [i16; 9] = [3, -2, 981, 320, -90, 640, 1, -4, 2];

fn bytes(words: [i16; 9]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Judges a burst.
fn judge(
    inspector: &mut Inspector,
    config: &Config,
    time: Micros,
    bytes: &[u8],
    behind_failure: bool,
) -> Result<Sampled, SensorFault> {
    let mut words = Words::default();
    let is_whole = read(&mut words, config, inspector, bytes)?;
    let Judged { fresh, evidence, .. } =
        inspector.judge(&config.rules(), time, &words, is_whole, behind_failure)?;
    Ok(Sampled { sample: inspector.sample().unwrap(), fresh, evidence })
}

#[derive(Debug, PartialEq)]
struct Sampled {
    sample: RawSample,
    fresh: bool,
    evidence: Evidence,
}

fn with(changes: &[(usize, i16)]) -> [i16; 9] {
    let mut words = REST;
    for &(at, value) in changes {
        words[at] = value;
    }
    words
}

/// Verdicts on a sequence of bursts, 10 ms apart.
fn verdicts(config: &Config, bursts: &[[i16; 9]]) -> Vec<Option<SensorFault>> {
    let mut inspector = Inspector::default();
    (0..)
        .map(|tick| Micros(tick * 10_000))
        .zip(bursts)
        .map(|(time, burst)| judge(&mut inspector, config, time, &bytes(*burst), false).err())
        .collect()
}

fn verdict(burst: [i16; 9]) -> Option<SensorFault> {
    verdicts(&Config::default(), &[burst])[0]
}

#[test]
fn a_sample_by_hand() {
    let judged =
        judge(&mut Inspector::default(), &Config::default(), Micros(5), &bytes(REST), false)
            .unwrap();
    assert!(judged.fresh);
    let sample = judged.sample;
    assert_eq!((sample.time, sample.acc), (Micros(5), [3, -2, 981]));
    assert_eq!((sample.mag, sample.gyr), ([320, -90, 640], [1, -4, 2]));
    let scale = Units::default().scale();
    assert!((sample.acc_m_s2(&scale)[2] - 9.81).abs() < 1e-5);
    assert!((sample.gyr_rad_s(&scale)[1] + 0.25_f32.to_radians()).abs() < 1e-6);
    assert_eq!(sample.mag_ut(&scale), [20.0, -5.625, 40.0]);
}

#[test]
fn each_mode_reads_its_sensors_in_one_burst() {
    let spans = [
        (Mode::AccOnly, (0x08, 6)),
        (Mode::MagOnly, (0x0E, 6)),
        (Mode::GyrOnly, (0x14, 6)),
        (Mode::AccMag, (0x08, 12)),
        (Mode::AccGyr, (0x08, 18)),
        (Mode::MagGyr, (0x0E, 12)),
        (Mode::Amg, (0x08, 18)),
        (Mode::Imu, (0x08, 18)),
        (Mode::Compass, (0x08, 12)),
        (Mode::M4g, (0x08, 12)),
        (Mode::NdofFmcOff, (0x08, 18)),
        (Mode::Ndof, (0x08, 18)),
    ];
    for (mode, expected) in spans {
        assert_eq!(span(mode), expected, "{mode:?}");
    }
    let config = Config { mode: Mode::MagGyr, ..Config::default() };
    let judged =
        judge(&mut Inspector::default(), &config, Micros(0), &bytes(REST)[6..], false).unwrap();
    assert_eq!((judged.sample.acc, judged.sample.mag), ([0; 3], [320, -90, 640]));
    assert_eq!(
        judge(&mut Inspector::default(), &config, Micros(0), &bytes(REST), false),
        Err(SensorFault::Protocol)
    );
}

#[test]
fn zeros_are_a_reset_only_where_all_is_zero() {
    assert_eq!(verdict([0; 9]), Some(SensorFault::AllZero));
    // A magnetometer may hold its last value longer than the others.
    assert_eq!(verdict([0, 0, 0, 320, -90, 640, 0, 0, 0]), Some(SensorFault::AllZero));
    assert_eq!(verdict(with(&[(6, 0), (7, 0), (8, 0)])), None);
    assert_eq!(verdict(with(&[(0, 0), (1, 0), (2, 0)])), None, "free fall");
    assert_eq!(
        verdict(with(&[(3, 0), (4, 0), (5, 0)])),
        Some(SensorFault::Implausible),
        "no field"
    );
}

/// Verdicts of a judge that has seen a good burst before.
fn verdict_behind(before: [i16; 9], burst: [i16; 9]) -> Option<SensorFault> {
    let found = verdicts(&Config::default(), &[before, burst]);
    assert_eq!(found[0], None);
    found[1]
}

#[test]
fn a_sensor_does_not_vanish_in_one_refresh() {
    let turning = with(&[(6, 500)]);
    let gone = |first: usize, word: i16| {
        let mut burst = turning;
        burst[first..first + 3].fill(word);
        burst
    };
    let (ones, torn) = (Some(SensorFault::AllOnes), Some(SensorFault::Torn));
    assert_eq!(verdict_behind(turning, gone(0, -1)), ones);
    assert_eq!(verdict_behind(turning, gone(3, -1)), ones);
    assert_eq!(verdict_behind(turning, gone(0, 0)), torn);
    // At rest, rates are 0 or -1 on all axes every few seconds; in free fall, acceleration is.
    assert_eq!(verdict_behind(REST, gone(6, -1)), None);
    assert_eq!(verdict_behind(REST, gone(6, 0)), None);
    let falling = with(&[(2, 150)]);
    assert_eq!(verdict_behind(falling, with(&[(0, -1), (1, -1), (2, -1)])), None);
    // An optional magnetometer may stop measuring.
    let config = Config { needs_mag: false, ..Config::default() };
    assert_eq!(verdicts(&config, &[turning, gone(3, 0)]), [None; 2]);
    // Fusion removes offset and noise.
    let fusion = Config { mode: Mode::Ndof, ..Config::default() };
    for first in [0, 6] {
        assert_eq!(verdicts(&fusion, &[turning, gone(first, 0)]), [None; 2]);
    }
    // After a gap the last value says nothing.
    let mut inspector = Inspector::default();
    let config = Config::default();
    assert!(judge(&mut inspector, &config, Micros(0), &bytes(turning), false).is_ok());
    let later = Micros(STEP_AGE_US + 1);
    assert!(judge(&mut inspector, &config, later, &bytes(gone(6, 0)), false).is_ok());
}

/// Samples of accepted bursts, 10 ms apart: the rates, and whether the burst is suspect.
fn believed(bursts: &[[i16; 9]]) -> Vec<([i16; 3], bool)> {
    let mut inspector = Inspector::default();
    (0..)
        .zip(bursts)
        .map(|(tick, burst)| {
            let time = Micros(tick * 10_000);
            let judged = judge(&mut inspector, &Config::default(), time, &bytes(*burst), false);
            let Sampled { sample, evidence, .. } = judged.unwrap();
            (sample.gyr, evidence == Evidence::Suspect)
        })
        .collect()
}

#[test]
fn behind_a_failure_of_the_bus_rates_that_moved_a_little_are_held_until_they_are_confirmed() {
    let (turning, low) = (with(&[(7, -1_582)]), with(&[(6, -256), (7, 0)]));
    let rates = |burst: [i16; 9]| [burst[6], burst[7], burst[8]];
    let mut inspector = Inspector::default();
    let mut judge = |ms: u64, burst: [i16; 9], behind_failure| {
        let config = Config::default();
        let judged =
            judge(&mut inspector, &config, Micros(1_000 * ms), &bytes(burst), behind_failure);
        let judged = judged.unwrap();
        assert_eq!(judged.evidence, Evidence::Sound);
        judged.sample.gyr
    };
    assert_eq!(judge(0, turning, false), rates(turning));
    assert_eq!(judge(20, low, true), rates(turning));
    // Zeros again, from a line that is pulled low: they do not confirm each other.
    let low_again = with(&[(6, 244), (7, 32)]);
    assert_eq!(judge(80, low_again, true), rates(turning));
    assert_eq!(judge(87, turning, false), rates(turning));
    // A true change is accepted one burst later, or at once without a failed transfer.
    let slower = with(&[(7, -1_200)]);
    assert_eq!(judge(100, slower, true), rates(turning));
    assert_eq!(judge(107, slower, true), rates(slower));
    assert_eq!(judge(114, turning, false), rates(turning));
}

/// Whether bursts are suspect.
fn suspects(bursts: &[[i16; 9]]) -> Vec<bool> {
    let believed = believed(bursts);
    believed.into_iter().map(|(_, suspect)| suspect).collect()
}

#[test]
fn words_of_ones_are_suspect_where_the_sensor_was_elsewhere() {
    for word in [2, 3, 4, 5] {
        let ones = with(&[(word, -1)]);
        // A word that stays at -1 is suspect once.
        assert_eq!(suspects(&[REST, ones, ones, REST]), [false, true, false, false]);
    }
    for (word, near) in [(0, 199), (4, 79), (7, -64)] {
        let burst = |value| with(&[(word, value)]);
        assert_eq!(suspects(&[burst(near), burst(-1)]), [false; 2], "{word}");
    }
}

/// A spike that is refused counts once.
#[test]
fn words_that_go_back_behind_a_refused_burst_are_sound() {
    let beyond = with(&[(0, REST[0] ^ i16::MIN)]);
    let mut inspector = Inspector::default();
    let mut judge = |ms: u64, burst: [i16; 9]| {
        let time = Micros(1_000 * ms);
        judge(&mut inspector, &Config::default(), time, &bytes(burst), false)
            .map(|judged| judged.evidence)
    };
    assert_eq!(judge(0, REST), Ok(Evidence::Sound));
    assert_eq!(judge(7, beyond), Err(SensorFault::Implausible));
    assert_eq!(judge(14, REST), Ok(Evidence::Sound));
}

#[test]
fn a_field_of_which_a_bit_goes_back_is_sound() {
    let (base, flipped) = (with(&[(4, 64)]), with(&[(4, 64 + 1024)]));
    // What stays for two bursts is the field.
    let seen = suspects(&[base, flipped, base, flipped, flipped, base]);
    assert_eq!(seen, [false, true, false, true, false, true]);
}

/// A refresh changes the noise of every word, and a motion changes most.
#[test]
fn single_bits_that_change_while_a_word_stands_still_are_suspect() {
    // Of each sensor: one bit, two words with a bit each; not three words, bits of the noise, or a
    // change of two bits.
    for first in [0, 3, 6] {
        let base = with(&[(first, 32), (first + 1, 64), (first + 2, 128)]);
        let burst = |x, y, z| {
            let mut burst = base;
            (burst[first], burst[first + 1], burst[first + 2]) = (x, y, z);
            burst
        };
        let cases = [
            (burst(48, 64, 128), true),
            (burst(32, 64, 128 + 1024), true),
            (burst(48, 64, 128 + 1), true),
            (burst(32, 65, 128), false),
            (burst(48, 65, 129), false),
            (burst(32, 64 + 24, 128), false),
        ];
        for (after, is_suspect) in cases {
            assert_eq!(suspects(&[base, after]), [false, is_suspect], "{after:?}");
        }
    }
}

/// The magnetometer's z axis measures 2500 uT: a passing magnet shows all of it.
#[test]
fn any_field_is_believed() {
    let burst = |x, z| with(&[(3, x), (5, z)]);
    let past = [burst(320, 0), burst(20_800, 32_767), burst(320, -32_768)];
    assert_eq!(suspects(&past), [false; 3]);
}

#[test]
fn rates_that_jump_are_held_for_a_burst() {
    let burst = |x| with(&[(6, x)]);
    let rates = |x| [x, -4, 2];
    // A spike never comes out, and is suspect once it is over.
    let spike = [burst(10), burst(4_500), burst(12), burst(11)];
    let out = [(rates(10), false), (rates(10), false), (rates(12), true), (rates(11), false)];
    assert_eq!(believed(&spike), out);
    // A real jump comes a burst late; the same words again confirm it, too.
    for next in [4_500, 4_900, 900] {
        let jump = [burst(10), burst(4_500), burst(next)];
        let out = [(rates(10), false), (rates(10), false), (rates(next), false)];
        assert_eq!(believed(&jump), out);
    }
    // Two spikes to different places: neither comes out.
    let spikes = [burst(10), burst(8_200), burst(-8_100), burst(9)];
    let out = [(rates(10), false), (rates(10), false), (rates(10), true), (rates(9), true)];
    assert_eq!(believed(&spikes), out);
    // So is a rate of -1, which 0xFFFF on the wire is.
    let through = [burst(95), burst(-1), burst(-116)];
    let out = [(rates(95), false), (rates(95), true), (rates(-116), false)];
    assert_eq!(believed(&through), out);
}

/// A gyroscope at 35 Hz shows one refresh of a knock. Its board comes to rest with three rates of 0
/// or -1, which three bursts show. A line at 0 or 1 for the end of one burst looks the same.
#[test]
fn a_board_that_comes_to_rest_on_zeros_or_ones_is_believed() {
    let burst = |rates: [i16; 3]| with(&[(6, rates[0]), (7, rates[1]), (8, rates[2])]);
    let (struck, later) = ([-53, -83, 154], [-2, 37, 1]);
    for (word, is_suspect) in [(-1, true), (0, false)] {
        let rest = [word; 3];
        let bursts = [struck, rest, rest, rest, later].map(burst);
        let out = [(struck, false), (struck, is_suspect), (rest, false), (rest, false)];
        assert_eq!(believed(&bursts)[..4], out);
        assert_eq!(believed(&bursts)[4], (later, false));
        let glitch = believed(&[struck, rest, struck].map(burst));
        assert!(glitch.iter().all(|(rates, _)| *rates == struck));
    }
}

/// A board that was struck rattles: its accelerations jump, too. The rates are held as before. At
/// more than 330 deg/s, 5280 counts, they are no rattle.
#[test]
fn rates_that_jump_to_and_fro_on_a_struck_board_are_held_and_not_suspect() {
    let burst = |acc, gyr| with(&[(0, acc), (6, gyr)]);
    let bursts = |acc, gyr: i16| [burst(3, 10), burst(acc, gyr), burst(-acc, -gyr), burst(3, 9)];
    assert_eq!(suspects(&bursts(504, 5_200)), [false; 4]);
    assert_eq!(suspects(&bursts(250, 5_200)), [false, false, true, true]);
    assert_eq!(suspects(&bursts(504, 5_400)), [false, false, true, true]);
    let rates: Vec<_> =
        believed(&bursts(504, 5_200)).into_iter().map(|(rates, _)| rates[0]).collect();
    assert_eq!(rates, [10, 10, 10, 9]);
}

/// A hand that shakes the sensor at 8 Hz, with 490 deg/s about all axes, changes a rate by 370
/// deg/s within a refresh of 13 ms.
#[test]
fn in_a_fast_hand_no_burst_is_suspect() {
    for refresh_ms in [8.0, 10.0, 12.9, 15.6, 20.0] {
        let rate = |tick: i32, phase: f64| {
            let time_s = (f64::from(tick) * 10.0 / refresh_ms).floor() * refresh_ms / 1e3;
            // Even: a rate of -1 is another rule's.
            (7_840.0 * (50.0 * time_s + phase).sin()) as i16 & !1
        };
        let burst =
            |tick| with(&[(6, rate(tick, 0.0)), (7, rate(tick, 2.1)), (8, rate(tick, 4.2))]);
        let bursts: Vec<_> = (0..300).map(burst).collect();
        assert_eq!(suspects(&bursts), [false; 300], "{refresh_ms} ms");
    }
}

/// Bursts every 6.667 ms of an accelerometer with noise, and of rates that change at every refresh
/// of `period_us` until `died_us`, where a rate jumps by `jump`. Gives the time from then to the
/// first refused burst, us.
fn dead_after_us(config: &Config, period_us: u64, died_us: u64, jump: i16) -> Option<u64> {
    let mut inspector = Inspector::default();
    (0..6_000)
        .map(|tick| tick * 6_667)
        .find(|&time| {
            let refresh = time.min(died_us) / period_us;
            let rate = (refresh % 5) as i16 + if time < died_us { 0 } else { jump };
            let burst = with(&[(0, (time % 7) as i16), (7, rate)]);
            let judged = judge(&mut inspector, config, Micros(time), &bytes(burst), false);
            assert!(matches!(judged, Ok(_) | Err(SensorFault::Frozen)));
            judged.is_err()
        })
        .map(|time| time - died_us)
}

#[test]
fn rates_that_stand_still_for_several_refreshes_are_dead() {
    let config = Config::default();
    // 100 Hz, 200 Hz, 35 Hz and 10 Hz. A jump of 20 deg/s comes with the death or does not.
    for (period_us, jump, least_us, most_us) in [
        (10_000, 0, 55_000, 75_000),
        (10_000, 320, 35_000, 50_000),
        (5_000, 0, 55_000, 75_000),
        (5_000, 320, 35_000, 50_000),
        (28_571, 0, 140_000, 185_000),
        (28_571, 320, 95_000, 125_000),
        (100_000, 0, 500_000, 620_000),
        (100_000, 320, 340_000, 420_000),
    ] {
        let after_us = dead_after_us(&config, period_us, 20_000_000, jump).unwrap();
        assert!((least_us..most_us).contains(&after_us), "{after_us}");
        assert_eq!(dead_after_us(&config, period_us, u64::MAX, jump), None);
    }
    let quiet = Config {
        sensors: Sensors { gyr_bandwidth: GyrBandwidth::Hz12, ..Sensors::default() },
        ..Config::default()
    };
    let after_us = dead_after_us(&quiet, 10_000, 20_000_000, 0).unwrap();
    assert!((80_000..100_000).contains(&after_us), "{after_us}");
    // Fusion removes offset and noise, and a rate of zero may stand: all words count.
    let fusion = Config { mode: Mode::Ndof, ..Config::default() };
    assert_eq!(dead_after_us(&fusion, 10_000, 1_000_000, 0), None);
}

/// The refresh rate is not known yet, so 10 Hz are allowed.
#[test]
fn a_chip_that_never_moves_is_frozen_within_a_second() {
    let still = verdicts(&Config::default(), &[REST; 100]);
    let frozen = still.iter().position(Option::is_some);
    assert_eq!(frozen, Some(60));
    assert_eq!(still[60], Some(SensorFault::Frozen));
}

#[test]
fn limits_follow_range_and_unit() {
    let limit = |config: &Config, at: usize, inside: i16| {
        assert_eq!(verdicts(config, &[with(&[(at, inside)])]), [None]);
        assert_eq!(
            verdicts(config, &[with(&[(at, inside + 1)])]),
            [Some(SensorFault::Implausible)]
        );
        assert_eq!(verdicts(config, &[with(&[(at, -inside)])]), [None]);
    };
    // 8 g and 2000 deg/s, each and a sixty-fourth.
    limit(&Config::default(), 2, 7970);
    limit(&Config::default(), 7, 32_500);
    let narrow =
        Sensors { acc_range: AccRange::G2, gyr_range: GyrRange::Dps250, ..Sensors::default() };
    let units = Units { acc: AccUnit::MilliG, ..Units::default() };
    let config = Config { sensors: narrow, units, ..Config::default() };
    limit(&config, 0, 2031);
    limit(&config, 6, 4062);
}

/// Two spikes in a row look like a real jump. 2000 deg/s take nearly the whole word. At 1000 deg/s
/// half of it is spare, so a flip of the highest bit is always noticed.
#[test]
fn with_half_the_range_no_flipped_highest_bit_is_taken_for_a_rate() {
    let config = Config {
        sensors: Sensors { gyr_range: GyrRange::Dps1000, ..Sensors::default() },
        ..Config::default()
    };
    for rate in (-16_000..=16_000).step_by(50) {
        let good = with(&[(7, rate)]);
        let flipped = with(&[(7, rate ^ i16::MIN)]);
        let again = with(&[(0, 9), (7, (rate + 7) ^ i16::MIN)]);
        assert_eq!(
            verdicts(&config, &[good, flipped, again]),
            [None, Some(SensorFault::Implausible), Some(SensorFault::Implausible)],
            "{rate}"
        );
    }
}

/// Bytes of the rates of a burst.
fn rates(words: [i16; 9]) -> Vec<u8> {
    bytes(words).split_off(12)
}

#[test]
fn rates_alone_come_with_the_other_words_of_the_good_burst_before() {
    let mut inspector = Inspector::default();
    let config = Config::default();
    let judge = |inspector: &mut Inspector, tick: u64, bytes: &[u8]| {
        judge(inspector, &config, Micros(tick * 6_667), bytes, false)
    };
    // No good burst yet, so they cannot be judged.
    let first = judge(&mut inspector, 0, &rates(REST));
    assert_eq!(first, Err(SensorFault::Protocol));

    assert!(judge(&mut inspector, 1, &bytes(REST)).unwrap().fresh);
    let turned = with(&[(6, 40), (7, -50), (8, 60)]);
    let alone = judge(&mut inspector, 2, &rates(turned)).unwrap();
    assert!(alone.fresh);
    assert_eq!(alone.sample.time, Micros(2 * 6_667));
    assert_eq!(
        (alone.sample.acc, alone.sample.mag, alone.sample.gyr),
        ([3, -2, 981], [320, -90, 640], [40, -50, 60])
    );

    // They do not need the burst before to be good.
    let torn = judge(&mut inspector, 3, &bytes(with(&[(0, i16::MAX)])));
    assert_eq!(torn, Err(SensorFault::Implausible));
    let alone = judge(&mut inspector, 4, &rates(REST)).unwrap();
    assert_eq!((alone.sample.acc, alone.sample.gyr), ([3, -2, 981], [1, -4, 2]));
    assert_eq!(alone.evidence, Evidence::Little);
}

#[test]
fn rates_alone_are_judged_as_those_of_a_whole_burst() {
    let mut inspector = Inspector::default();
    let config = Config::default();
    assert!(judge(&mut inspector, &config, Micros(0), &bytes(REST), false).is_ok());
    let beyond = with(&[(6, i16::MAX)]);
    let judged = judge(&mut inspector, &config, Micros(6_667), &rates(beyond), false);
    assert_eq!(judged, Err(SensorFault::Implausible));
}
