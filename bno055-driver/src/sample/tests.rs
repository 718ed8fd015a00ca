use std::vec::Vec;

use super::*;
use crate::config::Sensors;
use crate::config::{AccRange, GyrBandwidth, GyrRange};

const REST: [i16; 9] = [3, -2, 981, 320, -90, 640, 1, -4, 2];

fn bytes(words: [i16; 9]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
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
        .map(|(time, burst)| inspector.judge(config, time, &bytes(*burst)).err())
        .collect()
}

fn verdict(burst: [i16; 9]) -> Option<SensorFault> {
    verdicts(&Config::default(), &[burst])[0]
}

#[test]
fn a_sample_by_hand() {
    let judged = Inspector::default()
        .judge(&Config::default(), Micros(5), &bytes(REST))
        .unwrap();
    assert!(judged.fresh);
    let sample = judged.sample;
    assert_eq!((sample.time, sample.acc), (Micros(5), [3, -2, 981]));
    assert_eq!((sample.mag, sample.gyr), ([320, -90, 640], [1, -4, 2]));
    let units = Units::default();
    assert!((sample.acc_m_s2(&units)[2] - 9.81).abs() < 1e-5);
    assert!((sample.gyr_rad_s(&units)[1] + 0.25_f32.to_radians()).abs() < 1e-6);
    assert_eq!(sample.mag_ut(), [20.0, -5.625, 40.0]);
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
    let config = Config {
        mode: Mode::MagGyr,
        ..Config::default()
    };
    let judged = Inspector::default()
        .judge(&config, Micros(0), &bytes(REST)[6..])
        .unwrap();
    assert_eq!(
        (judged.sample.acc, judged.sample.mag),
        ([0; 3], [320, -90, 640])
    );
    assert_eq!(
        Inspector::default().judge(&config, Micros(0), &bytes(REST)),
        Err(SensorFault::Protocol)
    );
}

#[test]
fn zeros_are_a_reset_only_where_all_is_zero() {
    assert_eq!(verdict([0; 9]), Some(SensorFault::AllZero));
    // A magnetometer may hold its last value longer than the others.
    assert_eq!(
        verdict([0, 0, 0, 320, -90, 640, 0, 0, 0]),
        Some(SensorFault::AllZero)
    );
    assert_eq!(verdict(with(&[(6, 0), (7, 0), (8, 0)])), None);
    assert_eq!(verdict(with(&[(0, 0), (1, 0), (2, 0)])), None, "free fall");
    assert_eq!(
        verdict(with(&[(3, 0), (4, 0), (5, 0)])),
        Some(SensorFault::Implausible),
        "no field"
    );
}

#[test]
fn ones_are_told_from_noise_round_zero() {
    assert_eq!(verdict([-1; 9]), Some(SensorFault::AllOnes));
    assert_eq!(
        verdict(with(&[(0, -1), (1, -1), (2, -1)])),
        Some(SensorFault::AllOnes)
    );
    assert_eq!(
        verdict(with(&[(3, -1), (4, -1), (5, -1)])),
        Some(SensorFault::AllOnes)
    );
    // Level and at rest, all five of these are -1 now and then.
    let quiet = with(&[(0, -1), (1, -1), (6, -1), (7, -1), (8, -1)]);
    assert_eq!(verdicts(&Config::default(), &[REST, quiet]), [None, None]);
    // The same burst with a sixth is not chance.
    assert_eq!(
        verdict(with(&[
            (0, -1),
            (1, -1),
            (3, -1),
            (6, -1),
            (7, -1),
            (8, -1)
        ])),
        Some(SensorFault::AllOnes)
    );
}

#[test]
fn a_single_word_of_ones_is_believed_only_near_its_last_value() {
    let turning = with(&[(6, 500)]);
    let torn = with(&[(6, -1)]);
    assert_eq!(
        verdicts(&Config::default(), &[turning, torn, turning]),
        [None, Some(SensorFault::AllOnes), None]
    );
    let slow = with(&[(6, 60)]);
    assert_eq!(verdicts(&Config::default(), &[slow, torn]), [None, None]);
    // Where the turn was about to reverse it is what comes next; where it went on it is not.
    let slowing = [with(&[(6, 800)]), with(&[(6, 430)]), torn];
    assert_eq!(verdicts(&Config::default(), &slowing), [None; 3]);
    let steady = [with(&[(6, 505)]), turning, torn];
    let faster = [with(&[(6, 200)]), with(&[(6, 400)]), torn];
    for turn in [steady, faster] {
        let found = verdicts(&Config::default(), &turn);
        assert_eq!(found, [None, None, Some(SensorFault::AllOnes)]);
    }
    // After a gap the last value says nothing.
    let mut inspector = Inspector::default();
    inspector
        .judge(&Config::default(), Micros(0), &bytes(turning))
        .unwrap();
    let later = Micros(STEP_AGE_US + 1);
    assert!(
        inspector
            .judge(&Config::default(), later, &bytes(torn))
            .is_ok()
    );
}

/// The field is refreshed every 50 ms: until then a word of it that has come to rest on -1 in a
/// turn stays there. With rates of ones as well it was lost on the wire.
#[test]
fn a_field_that_turns_through_minus_one_is_believed_in_the_second_burst() {
    let turning = with(&[(4, 300), (7, 900)]);
    let through = with(&[(4, -1), (7, 900)]);
    let beyond = with(&[(4, -1), (7, 950)]);
    let found = verdicts(&Config::default(), &[turning, through, beyond]);
    assert_eq!(found, [None, Some(SensorFault::AllOnes), None]);
    let level = with(&[(4, 300)]);
    let lost = with(&[(4, -1), (6, -1), (7, -1), (8, -1)]);
    let still = with(&[(0, 3), (4, -1), (6, -1), (7, -1), (8, -1)]);
    let found = verdicts(&Config::default(), &[level, lost, still]);
    let ones = Some(SensorFault::AllOnes);
    assert_eq!(found, [None, ones, ones]);
}

/// Rates that are refreshed 35 times a second are read four times each: a turn that passes -1 when
/// it reverses costs one burst of them.
#[test]
fn a_rate_that_passes_minus_one_is_believed_in_the_second_burst() {
    let turning = with(&[(6, 12), (7, 130), (8, -4)]);
    let through = with(&[(6, 12), (7, -1), (8, -4)]);
    let again = with(&[(0, 3), (6, 12), (7, -1), (8, -4)]);
    let ones = Some(SensorFault::AllOnes);
    let found = verdicts(&Config::default(), &[turning, through, again, again]);
    assert_eq!(found, [None, ones, None, None]);
    // With other rates beside it, it is a second word that is wrong.
    let other = with(&[(6, 14), (7, -1), (8, -5)]);
    let found = verdicts(&Config::default(), &[turning, through, other]);
    assert_eq!(found, [None, ones, ones]);
    let lost = with(&[(6, -1), (7, -1), (8, -1)]);
    let found = verdicts(&Config::default(), &[turning, lost, lost]);
    assert_eq!(found, [None, ones, ones]);
}

#[test]
fn equal_bursts_are_normal_until_they_are_five() {
    let other = with(&[(0, 4)]);
    let five = [REST, REST, REST, REST, REST];
    assert_eq!(
        verdicts(&Config::default(), &five),
        [None, None, None, None, Some(SensorFault::Frozen)]
    );
    assert_eq!(
        verdicts(&Config::default(), &[REST, REST, REST, REST, other, REST]),
        [None; 6]
    );
    let patient = Config {
        frozen_after: 6.try_into().unwrap(),
        ..Config::default()
    };
    assert_eq!(verdicts(&patient, &five), [None; 5]);
}

/// How often it is refreshed is not known yet, and a slow one is allowed for.
#[test]
fn a_gyroscope_without_noise_is_dead_at_the_nineteenth_burst() {
    let bursts: Vec<_> = (0..20).map(|tick| with(&[(0, tick)])).collect();
    let verdicts = verdicts(&Config::default(), &bursts);
    assert_eq!(verdicts[..18], [None; 18]);
    assert_eq!(verdicts[18], Some(SensorFault::Frozen));
    // Bursts that come twice, as at a tick of twice the chip's rate, count once.
    let twice: Vec<_> = bursts.iter().flat_map(|burst| [*burst; 2]).collect();
    let verdicts = self::verdicts(&Config::default(), &twice);
    assert_eq!(verdicts[..36], [None; 36]);
    assert_eq!(verdicts[36], Some(SensorFault::Frozen));
    // Fusion removes the bias, and a rate of zero may stand.
    let fusion = Config {
        mode: Mode::Ndof,
        ..Config::default()
    };
    assert_eq!(self::verdicts(&fusion, &bursts), [None; 20]);
}

#[test]
fn rates_that_become_zero_in_a_turn_are_none_until_the_last_bit_moves() {
    let bursts = |rates: &[[i16; 3]]| -> Vec<[i16; 9]> {
        let burst =
            |(tick, [x, y, z]): (i16, &[i16; 3])| with(&[(0, tick), (6, *x), (7, *y), (8, *z)]);
        (0..).zip(rates).map(burst).collect()
    };
    let dead = [
        [2, -65, 3],
        [0; 3],
        [0; 3],
        [0; 3],
        [0; 3],
        [0; 3],
        [1, 0, 0],
        [0; 3],
    ];
    let torn = Some(SensorFault::Torn);
    // Though the turn is no longer recent.
    let mut expected = [torn; 8];
    (expected[0], expected[6], expected[7]) = (None, None, None);
    assert_eq!(verdicts(&Config::default(), &bursts(&dead)), expected);
    let slow = bursts(&[[2, -64, 3], [0; 3]]);
    assert_eq!(verdicts(&Config::default(), &slow), [None; 2]);
    // Fusion removes noise and bias.
    let fusion = Config {
        mode: Mode::Ndof,
        ..Config::default()
    };
    assert_eq!(verdicts(&fusion, &bursts(&dead)), [None; 8]);
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
    limit(&Config::default(), 3, 21_125);
    let narrow = Sensors {
        acc_range: AccRange::G2,
        gyr_range: GyrRange::Dps250,
        ..Sensors::default()
    };
    let units = Units {
        acc: AccUnit::MilliG,
        ..Units::default()
    };
    let config = Config {
        sensors: narrow,
        units,
        ..Config::default()
    };
    limit(&config, 0, 2031);
    limit(&config, 6, 4062);
}

#[test]
fn a_spike_is_held_back_and_a_real_jump_costs_one_sample() {
    let spike = with(&[(8, 5000)]);
    let near = with(&[(8, 5300)]);
    assert_eq!(
        verdicts(&Config::default(), &[REST, spike, REST]),
        [None, Some(SensorFault::Torn), None]
    );
    assert_eq!(
        verdicts(&Config::default(), &[REST, spike, near, near]),
        [None, Some(SensorFault::Torn), None, None]
    );
    // The same bytes again are no confirmation.
    let repeated = verdicts(&Config::default(), &[REST, spike, spike, near]);
    assert_eq!(
        repeated,
        [None, Some(SensorFault::Torn), Some(SensorFault::Torn), None]
    );
    let off = Config {
        step_limit: None,
        ..Config::default()
    };
    assert_eq!(verdicts(&off, &[REST, spike, REST]), [None; 3]);
}

/// Two spikes in a row look like a real jump. 2000 deg/s are nearly the whole word, half of which
/// is spare at 1000 deg/s, which leaves no rate whose highest bit could flip without being noticed.
#[test]
fn with_half_the_range_no_flipped_highest_bit_is_taken_for_a_rate() {
    let config = Config {
        sensors: Sensors {
            gyr_range: GyrRange::Dps1000,
            ..Sensors::default()
        },
        ..Config::default()
    };
    for rate in (-16_000..=16_000).step_by(50) {
        let good = with(&[(7, rate)]);
        let flipped = with(&[(7, rate ^ i16::MIN)]);
        let again = with(&[(0, 9), (7, (rate + 7) ^ i16::MIN)]);
        assert_eq!(
            verdicts(&config, &[good, flipped, again]),
            [
                None,
                Some(SensorFault::Implausible),
                Some(SensorFault::Implausible)
            ],
            "{rate}"
        );
    }
}

/// Bursts of an accelerometer that is refreshed in each, with rates that change every `every`th
/// until `died`: which of them is the first to be refused.
fn first_frozen(config: &Config, every: usize, died: usize) -> Option<usize> {
    let bursts: Vec<_> = (0..200)
        .map(|index| {
            let refresh = index.min(died) / every;
            with(&[(0, (index % 7) as i16), (7, (refresh % 5) as i16)])
        })
        .collect();
    let verdicts = verdicts(config, &bursts);
    assert!(
        verdicts
            .iter()
            .flatten()
            .all(|it| *it == SensorFault::Frozen)
    );
    verdicts.iter().position(Option::is_some)
}

/// The seventh burst with the rates of the last that were measured; of a refresh every third, the
/// fifteenth. A quiet gyroscope is allowed one more.
#[test]
fn a_gyroscope_has_died_after_several_of_its_own_refreshes() {
    let config = Config::default();
    assert_eq!(first_frozen(&config, 1, 100), Some(106));
    assert_eq!(first_frozen(&config, 3, 99), Some(99 + 14));
    assert_eq!(first_frozen(&config, 3, 200), None);
    let quiet = Config {
        sensors: Sensors {
            gyr_bandwidth: GyrBandwidth::Hz12,
            ..Sensors::default()
        },
        ..Config::default()
    };
    assert_eq!(first_frozen(&quiet, 1, 100), Some(107));
}

/// A quiet gyroscope at 35 Hz has three times running the same rates now and then: nine bursts.
#[test]
fn slow_rates_that_are_equal_by_chance_are_no_dead_gyroscope() {
    let rate = |index: usize| match index / 3 {
        20..=22 => 9,
        refresh => (refresh % 5 + 1) as i16,
    };
    let bursts: Vec<_> = (0..150)
        .map(|index| with(&[(0, (index % 7) as i16), (7, rate(index))]))
        .collect();
    assert_eq!(verdicts(&Config::default(), &bursts), [None; 150]);
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
        inspector.judge(&config, Micros(tick * 6_667), bytes)
    };
    // There is nothing yet to judge them by.
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

    // The rest of the same refresh is not another one.
    let mut rest = turned;
    rest[2] = 990;
    assert!(!judge(&mut inspector, 3, &bytes(rest)).unwrap().fresh);
    rest[6] = 41;
    assert!(judge(&mut inspector, 4, &bytes(rest)).unwrap().fresh);
}

#[test]
fn rates_alone_are_judged_as_those_of_a_whole_burst() {
    let cases = [
        // A line that is high to the end, where the body turned.
        (with(&[(8, 500)]), [40, -50, -1], SensorFault::AllOnes),
        (with(&[(8, 500)]), [0, 0, 0], SensorFault::Torn),
        (REST, [1, -4, 32_767], SensorFault::Implausible),
        (REST, [1, -4, 16_000], SensorFault::Torn),
    ];
    for (before, [x, y, z], fault) in cases {
        let mut inspector = Inspector::default();
        let config = Config::default();
        assert!(inspector.judge(&config, Micros(0), &bytes(before)).is_ok());
        let mut after = before;
        (after[6], after[7], after[8]) = (x, y, z);
        let judged = inspector.judge(&config, Micros(6_667), &rates(after));
        assert_eq!(judged, Err(fault), "{after:?}");
        // Behind a bad burst comes a whole one.
        let again = inspector.judge(&config, Micros(13_333), &rates(before));
        assert_eq!(again, Err(SensorFault::Protocol));
    }
}
