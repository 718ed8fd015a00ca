//! Data while sampling: good ones come out as the chip holds them, and wrong ones never do.

mod fake;

use std::cell::Cell;

use bno055_driver::config::{GyrRange, Sensors};
use bno055_driver::{
    BusError, Config, Driver, Imu, Micros, Next, RawSample, SensorFault, Transfer,
};
use fake::{Chip, Rig, TICK_US, flying};

/// The truth that came out must be a truth the chip had at that time.
#[test]
fn samples_are_the_chips_words_with_their_time() {
    let mut chip = Chip::new();
    chip.now = fake::BOOT_US;
    let mut driver = Driver::new(Config::default());
    let mut taken = 0;
    while taken < 10 {
        match driver.next(Micros(chip.now)) {
            Next::Transfer(transfer) => {
                let outcome = chip.perform(&transfer);
                driver.complete(Micros(chip.now), outcome.as_deref().map_err(|error| *error));
            }
            Next::Wait(until) => chip.now = until.0,
            Next::Sample => {
                let time = Micros(chip.now);
                let outcome = chip.perform(&driver.burst());
                let (acc, mag, gyr) = chip.truth();
                let sample = driver.sample(time, outcome.as_deref().map_err(|error| *error));
                assert_eq!(sample.map(|sample| sample.raw), Ok(RawSample { time, acc, mag, gyr }));
                chip.now += 5_000;
                taken += 1;
            }
        }
    }
}

#[test]
fn a_clean_hour_of_samples_has_no_fault() {
    let mut rig = Rig::sampling(Config::default());
    let outcomes = rig.bursts(360_000);
    let bad: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.err()).collect();
    assert_eq!(bad, []);
    let health = rig.driver.health();
    // The chip refreshes 0.3 % more slowly than the ticks come.
    assert!((355_000..359_500).contains(&health.fresh), "{}", health.fresh);
    assert_eq!(health.good, 360_000);
    assert_eq!(health.verified, 359_999);
}

#[test]
fn spikes_never_come_out() {
    let mut rig = flying(Config::default());
    // Bits that no motion within the sensors' ranges of 8 g and 2000 deg/s moves at once.
    let spikes = [(0, 13), (0, 14), (0, 15), (6, 12), (6, 13), (6, 14), (6, 15)];
    for (first, bit) in spikes {
        for word in first..first + 3 {
            let bytes = rig.chip.burst_with(|words| words[word] ^= (1_u16 << bit) as i16);
            let truth = rig.chip.truth();
            let outcome = rig.driver.sample(Micros(rig.chip.now), Ok(&bytes));
            match outcome {
                Ok(sample) => {
                    let rates = sample.raw.gyr.iter().zip(truth.2);
                    let held = rates.clone().all(|(rate, truth)| rate.abs_diff(truth) < 4_000);
                    assert!(first == 6 && held, "word {word} bit {bit}: {outcome:?}");
                }
                Err(fault) => assert_eq!(fault, SensorFault::Implausible),
            }
            assert!(rig.bursts(20).iter().all(Result::is_ok), "the next samples are good again");
        }
    }
    assert_eq!(rig.driver.health().starts, 1);
}

/// A word of 0xFFFF now and then is what a turn shows that passes -1. In every burst it is what a
/// bad wire shows.
#[test]
fn words_of_ones_in_every_burst_are_not_believed() {
    for (every, believed) in [(20, true), (2, false)] {
        let mut rig = flying(Config::default());
        let outcomes: Vec<_> = (0..100)
            .map(|tick| {
                rig.chip.now += TICK_US;
                let bytes = rig.chip.burst_with(|words| {
                    words[6] = 400 + tick as i16;
                    if tick % every == 1 {
                        words[7] = -1;
                    } else {
                        words[7] = 300;
                    }
                });
                rig.driver.sample(Micros(rig.chip.now), Ok(&bytes))
            })
            .collect();
        assert_eq!(outcomes.iter().all(Result::is_ok), believed, "{every}");
        let rates: Vec<_> = outcomes.iter().flatten().map(|sample| sample.raw.gyr[1]).collect();
        assert!(!rates.contains(&-1), "the rates before are held");
    }
}

/// Acceleration 19.62, 5.68, 0 m/s^2, field 0, 320, 240.19 uT, rates of zero: chips were seen to
/// show that around crashes.
#[test]
fn the_pattern_seen_around_crashes_ends_sampling() {
    let mut rig = flying(Config::default());
    rig.bursts(100);
    rig.chip.on_wire(|register, bytes| {
        if register == 8 {
            let words = [1962_i16, 568, 0, 0, 5120, 3843, 0, 0, 0];
            for (at, word) in words.into_iter().enumerate() {
                bytes[2 * at..2 * at + 2].copy_from_slice(&word.to_le_bytes());
            }
        }
    });
    rig.bursts(8);
    assert!(!rig.driver.is_sampling());
}

/// Two bad samples in three end the trust in the third, whose small errors nobody sees. One bad
/// sample in six does not.
#[test]
fn a_bus_that_is_mostly_wrong_is_not_believed_when_it_seems_right() {
    let verdicts = |bad: fn(usize) -> bool| {
        let mut rig = flying(Config::default());
        (0..100)
            .map(|tick| {
                rig.chip.now += TICK_US;
                let bytes = rig.chip.burst_with(|words| {
                    words[6] = tick as i16;
                    if bad(tick) {
                        words[2] = i16::MIN;
                    }
                });
                rig.driver.sample(Micros(rig.chip.now), Ok(&bytes)).err()
            })
            .collect::<Vec<_>>()
    };
    let mostly = verdicts(|tick| tick % 3 != 0);
    let ends = mostly.iter().position(|fault| *fault == Some(SensorFault::Unreliable));
    assert_eq!(ends, Some(2), "{mostly:?}");
    assert!(mostly[2..].iter().all(Option::is_some));
    let seldom = verdicts(|tick| tick % 6 == 0);
    assert_eq!(seldom.iter().flatten().count(), 17);
    assert!(!seldom.contains(&Some(SensorFault::Unreliable)));
}

/// A hundred thousand bursts, of which one in ten is spoilt in one of the ways of a long cable. At
/// most two in a row are. Whatever comes out is what the chip held, to within what no judge can
/// tell from a motion.
#[test]
fn what_comes_out_of_a_bad_cable_is_the_chips_own_to_within_what_a_motion_may_be() {
    let mut rig = flying(Config {
        sensors: Sensors { gyr_range: GyrRange::Dps1000, ..Sensors::default() },
        ..Config::default()
    });
    let mut random = 1_u64;
    let mut dice = |sides: u64| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random % sides
    };
    let (mut spoilt, mut on_end, mut out) = (0, 0, 0);
    for _ in 0..100_000 {
        while rig.driver.next(Micros(rig.chip.now)) != Next::Sample {
            rig.turn();
        }
        rig.chip.now += TICK_US;
        let start = rig.chip.now;
        let mut bytes = rig.chip.perform(&rig.driver.burst()).unwrap();
        let truth = rig.chip.truth();
        on_end = if on_end < 2 && dice(10) == 0 { on_end + 1 } else { 0 };
        if on_end > 0 {
            spoilt += 1;
            let word = dice(9) as usize;
            match dice(4) {
                1 => bytes[2 * word + 1] ^= 0x80,
                2 => bytes[dice(18) as usize] ^= 1 << dice(8),
                3 => bytes.fill(0xFF),
                _ => bytes.fill(0),
            }
        }
        if let Ok(sample) = rig.driver.sample(Micros(start), Ok(&bytes)) {
            out += 1;
            // An error below the accelerometer's range of 8 g cannot be told from a blow. A magnet
            // makes any field.
            let within = |found: [i16; 3], held: [i16; 3], limit| {
                let mut words = found.iter().zip(held);
                words.all(|(found, held)| found.abs_diff(held) <= limit)
            };
            assert!(within(sample.raw.acc, truth.0, 4_096), "{sample:?}");
            assert!(within(sample.raw.gyr, truth.2, 4_000), "{sample:?}");
        }
    }
    assert!(spoilt > 9_000 && out > 85_000, "{spoilt} {out}");
}

/// The data line of a sensor at rest stays high. Rates of -1 are usual at rest: no burst of them
/// makes up for the bursts of ones alone.
#[test]
fn rates_of_ones_are_none_behind_a_lost_burst() {
    let mut rig = Rig::sampling(Config::default());
    assert!(rig.bursts(3).iter().all(Result::is_ok));
    let rates = rig.driver.rates_burst().expect("a good burst before");
    assert_eq!(rates.answer_len(), 6);
    let now = Micros(rig.chip.now);
    assert!(rig.driver.sample(now, Ok(&[0xFF; 6])).is_ok());
    let whole = rig.driver.burst().answer_len();
    for lost in [Ok(&[0xFF; 18][..whole]), Err(BusError::Nak)] {
        assert!(rig.driver.sample(now, lost).is_err());
        assert!(rig.driver.rates_burst().is_some(), "the next pulse needs one");
        let ones = rig.driver.sample(now, Ok(&[0xFF; 6]));
        assert_eq!(ones, Err(SensorFault::AllOnes));
        assert!(rig.bursts(1).iter().all(Result::is_ok));
    }
}

/// Registers that read wrong once each, and right the second time, are signs of a bus that flips
/// bits. So are bad samples.
#[test]
fn registers_that_read_wrong_count_like_bad_samples() {
    let mut rig = flying(Config::default());
    let again = Cell::new(false);
    rig.chip.on_wire(move |register, bytes| {
        if register != 8 && !again.replace(!again.get()) {
            bytes[0] ^= 1;
        }
    });
    rig.bursts(20);
    assert_eq!(rig.driver.fault(), Some(SensorFault::Unreliable));
    assert_eq!(rig.driver.health().mismatched, 3);
}

/// A rig whose next verification is due, behind a burst with a wrong bit and a good one.
fn in_doubt() -> Rig {
    let mut rig = flying(Config::default());
    let bytes = rig.chip.burst_with(|words| words[2] = i16::MIN);
    let outcome = rig.driver.sample(Micros(rig.chip.now), Ok(&bytes));
    assert_eq!(outcome, Err(SensorFault::Implausible));
    rig.chip.now += TICK_US;
    let burst = rig.chip.burst_with(|_| ());
    assert!(rig.driver.sample(Micros(rig.chip.now), Ok(&burst)).is_ok());
    rig
}

/// The registers of one verification behind each of some bursts, with the number of bytes.
fn verifications(rig: &mut Rig, bursts: usize) -> Vec<(u8, u8)> {
    (0..bursts)
        .map(|_| {
            let Next::Transfer(transfer @ Transfer::Read { register, len }) =
                rig.driver.next(Micros(rig.chip.now))
            else {
                panic!("a verification is due")
            };
            let bytes = rig.chip.perform(&transfer);
            rig.driver.complete(Micros(rig.chip.now), bytes.as_deref().map_err(|e| *e));
            rig.chip.now += TICK_US;
            let burst = rig.chip.burst_with(|_| ());
            assert!(rig.driver.sample(Micros(rig.chip.now), Ok(&burst)).is_ok());
            (register, len)
        })
        .collect()
}

/// Every other verification reads four bytes that never change, until good bursts have emptied the
/// bucket.
#[test]
fn a_bus_in_doubt_is_tried_with_the_identity() {
    let read = verifications(&mut in_doubt(), 8);
    let lengths: Vec<_> = read.iter().map(|(_, len)| *len).collect();
    assert_eq!(lengths, [4, 1, 4, 1, 4, 1, 1, 1], "{read:?}");
    for (register, len) in read {
        assert_eq!(register == 0, len == 4);
    }
}

/// A wrong bit in any byte of the identity counts like a wrong register: the second answer decides.
#[test]
fn an_identity_that_reads_wrong_is_read_again() {
    for (byte, wrong) in (0..4).flat_map(|byte| [(byte, 1), (byte, 2)]) {
        let mut rig = in_doubt();
        let left = Cell::new(wrong);
        rig.chip.on_wire(move |register, bytes| {
            if register == 0 && left.get() > 0 {
                left.set(left.get() - 1);
                bytes[byte] ^= 0x10;
            }
        });
        rig.bursts(3);
        assert_eq!(rig.driver.health().mismatched, wrong, "byte {byte}");
        assert_eq!(rig.driver.is_sampling(), wrong == 1, "byte {byte}");
    }
}

/// A line that comes free in the midst of the identity is a fault of the bus, not a wrong register.
#[test]
fn an_identity_with_ones_does_not_count() {
    for byte in 0..4 {
        let mut rig = in_doubt();
        let torn = Cell::new(true);
        rig.chip.on_wire(move |register, bytes| {
            if register == 0 && torn.take() {
                bytes[byte..].fill(0xFF);
            }
        });
        rig.bursts(3);
        assert_eq!(rig.driver.health().mismatched, 0, "byte {byte}");
        assert!(rig.driver.is_sampling(), "byte {byte}");
    }
}

/// A line that nobody drives for 15 ms spoils three bursts, the first and the last in part. The
/// sensor is no worse for it.
#[test]
fn bursts_of_ones_in_part_are_a_gap() {
    let mut rig = flying(Config::default());
    // In motion the words are far from -1.
    let torn = |chip: &Chip, ones: std::ops::Range<usize>| {
        chip.burst_with(|words| {
            words.fill(900);
            words[ones].fill(-1);
        })
    };
    let rates_alone = vec![0xFF; 6];
    for bytes in [torn(&rig.chip, 3..9), rates_alone, torn(&rig.chip, 0..7)] {
        rig.chip.now += TICK_US;
        let outcome = rig.driver.sample(Micros(rig.chip.now), Ok(&bytes));
        assert_eq!(outcome, Err(SensorFault::AllOnes));
    }
    assert!(rig.bursts(100).iter().all(Result::is_ok));
    assert_eq!(rig.driver.health().starts, 1);
}

/// A dead magnetometer that the configuration does without is no reason to doubt the bus.
#[test]
fn an_identity_without_a_magnetometer_is_right() {
    let mut rig = flying(Config { needs_mag: false, ..Config::default() });
    rig.chip.pages[0][2] = 0;
    let bytes = rig.chip.burst_with(|words| words[2] = i16::MIN);
    let outcome = rig.driver.sample(Micros(rig.chip.now), Ok(&bytes));
    assert_eq!(outcome, Err(SensorFault::Implausible));
    assert!(verifications(&mut rig, 4).contains(&(0, 4)));
    assert_eq!(rig.driver.health().mismatched, 0);
}

/// A vibration may cross -1 at every other burst; a wire makes a word of -1 and gives the old word
/// back.
#[test]
fn words_of_ones_between_both_sides_are_motion() {
    for (other, believed) in [(-300, true), (-20, true), (300, false)] {
        let mut rig = flying(Config::default());
        let tick = Cell::new(0);
        rig.chip.on_wire(move |register, bytes| {
            if register == 8 {
                tick.set(tick.get() + 1);
                let acc: i16 = [300, -1, other, -1][tick.get() % 4];
                bytes[..2].copy_from_slice(&acc.to_le_bytes());
            }
        });
        rig.bursts(60);
        assert_eq!(rig.driver.is_sampling(), believed, "300, -1, {other}");
    }
}

/// The gap between two bursts may be too short for the identity. A shorter verification then comes
/// behind the next burst.
#[test]
fn an_identity_that_is_not_read_gives_way() {
    let mut rig = in_doubt();
    let verification = rig.driver.next(Micros(rig.chip.now));
    assert!(matches!(verification, Next::Transfer(Transfer::Read { len: 4, .. })));
    rig.chip.now += TICK_US;
    let bytes = rig.chip.burst_with(|_| ());
    assert!(rig.driver.sample(Micros(rig.chip.now), Ok(&bytes)).is_ok());
    let next = rig.driver.next(Micros(rig.chip.now));
    assert!(matches!(next, Next::Transfer(Transfer::Read { len: 1, .. })));
}
