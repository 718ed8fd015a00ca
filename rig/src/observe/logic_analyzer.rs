//! A logic analyser on the sensor's bus, the servo's pin and the probe pin: it finds bursts, steps
//! and pulses.

use crate::bno055::registers::page0::{ACC_DATA, GYR_DATA};
use crate::inertial::Refresh;
use crate::lsm6ds3;
use crate::observe::ground_truth::{Asked, Burst, GroundTruth, High, Pulse, Step};
use samd21::board::{I2cEvent, I2cReply, Ticks};
use tvc_nano::sensor::Kind;
use tvc_nano::{Axis, RawSample};

/// Bytes of the longest burst.
const LONGEST: usize = 18;

/// Which of a sample's nine words each word of a burst is.
type Layout = &'static [usize];

/// A whole burst of a BNO055.
const BNO055: Layout = &[0, 1, 2, 3, 4, 5, 6, 7, 8];
/// A whole burst of an LSM6DS3, which begins with the rates.
const LSM6DS3: Layout = &[6, 7, 8, 0, 1, 2];
/// The rates alone, of either.
const RATES: Layout = &[6, 7, 8];

/// The layout of the burst that a pointer begins.
fn layout(sensor: Kind, pointer: u8) -> Option<Layout> {
    match (sensor, pointer) {
        (Kind::Bno055, ACC_DATA) => Some(BNO055),
        (Kind::Bno055, GYR_DATA) => Some(RATES),
        (Kind::Lsm6ds3, lsm6ds3::RATES) => Some(LSM6DS3),
        _ => None,
    }
}

/// Largest harmless errors of a word of accelerometer, magnetometer and gyroscope, counts: 2 m/s^2,
/// 5 uT, 4 deg/s. A single such sample moves the rudder by at most 2 degrees, through the
/// gyroscope; the other two are averaged over seconds.
const VALID_COUNTS: [u16; 3] = [200, 80, 64];

/// What the sensor's registers hold, and what they would hold without a fault.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Registers {
    pub(crate) sensor: Kind,
    pub(crate) refresh: Refresh,
    pub(crate) faultless: [[i16; 3]; 3],
}

/// A transaction under way.
#[derive(Clone, Copy, Debug, Default)]
struct Transaction {
    acknowledged: Ticks,
    /// Clock stretching of the address byte.
    stretch: Ticks,
    start: Option<Ticks>,
    refresh: Option<Refresh>,
    layout: Layout,
    bytes: [u8; LONGEST],
    /// What a faultless sensor would have given; a word is latched at its first byte, as in the
    /// sensor.
    faultless: [i16; 9],
    /// Bytes read so far.
    count: usize,
}

/// The analyser, with the transaction and the step that have begun and not ended.
#[derive(Clone, Debug, Default)]
pub(crate) struct LogicAnalyzer {
    transaction: Option<Transaction>,
    /// Words of the newest whole burst of each sensor, and whether they were valid.
    whole: [Option<([i16; 9], bool)>; 2],
    /// Widths that the program asks for, and asked for when the last pulse rose.
    asked: [Asked; Axis::COUNT],
    step_start: Option<Ticks>,
}

impl LogicAnalyzer {
    /// An event on the bus and the sensor's reply to it, with what its registers hold.
    pub(crate) fn i2c(
        &mut self,
        now: Ticks,
        event: I2cEvent,
        reply: I2cReply,
        registers: Registers,
        truth: &mut GroundTruth,
    ) {
        match (event, &mut self.transaction) {
            (I2cEvent::Start { read: false, .. }, _) => {
                self.transaction = reply.ack.then(|| Transaction {
                    acknowledged: now,
                    stretch: reply.stretch,
                    ..Transaction::default()
                });
            }
            (I2cEvent::Write(pointer), Some(t)) => {
                if let Some(layout) = layout(registers.sensor, pointer)
                    && t.start.is_none()
                    && reply.ack
                {
                    t.layout = layout;
                    let byte = now.saturating_sub(t.acknowledged + t.stretch);
                    t.start = Some(t.acknowledged.saturating_sub(byte));
                } else {
                    self.transaction = None;
                }
            }
            (I2cEvent::Read, Some(t)) => {
                t.refresh.get_or_insert(registers.refresh);
                if t.count.is_multiple_of(2)
                    && let Some(place) = t.layout.get(t.count / 2)
                {
                    t.faultless[*place] = registers.faultless.as_flattened()[*place];
                }
                if let Some(byte) = t.bytes.get_mut(t.count) {
                    *byte = reply.data;
                }
                t.count += 1;
            }
            (I2cEvent::Stop, Some(t)) => {
                if t.layout == LSM6DS3 && t.count == 2 * RATES.len() {
                    t.layout = RATES;
                }
                if let (Some(start), Some(refresh)) = (t.start, t.refresh)
                    && t.count >= 2 * t.layout.len()
                {
                    let alone = t.layout.len() == RATES.len();
                    // The rest of a burst of the rates alone is that of the newest whole one.
                    let whole = &mut self.whole[usize::from(registers.sensor == Kind::Lsm6ds3)];
                    let rest = if alone { *whole } else { None };
                    let (rest, valid) = rest.unwrap_or(([0; 9], !alone));
                    let mut words = [0; 9];
                    for (place, bytes) in t.layout.iter().zip(t.bytes.chunks_exact(2)) {
                        words[*place] = i16::from_le_bytes([bytes[0], bytes[1]]);
                    }
                    words = in_common_units(registers.sensor, words);
                    let mut faultless = in_common_units(registers.sensor, t.faultless);
                    if alone {
                        words[..6].copy_from_slice(&rest[..6]);
                        faultless[..6].copy_from_slice(&rest[..6]);
                    }
                    let valid = valid && close(words, faultless);
                    if !alone {
                        *whole = Some((words, valid));
                    }
                    truth.bursts.push(Burst {
                        sensor: registers.sensor,
                        start,
                        acknowledged: t.acknowledged,
                        end: now,
                        refresh,
                        words,
                        valid,
                        alone,
                    });
                }
                self.transaction = None;
            }
            _ => {}
        }
    }

    /// An edge at the pin of an axis' servo; the pulse that it ends.
    pub(crate) fn servo(
        &mut self,
        now: Ticks,
        axis: Axis,
        level: bool,
        truth: &mut GroundTruth,
    ) -> Option<Pulse> {
        let high = &mut truth.high[axis.index()];
        if level {
            let asked = &mut self.asked[axis.index()];
            *high = Some(High { rise: now, asked: *asked });
            let [newest, _] = asked.0;
            asked.0 = [newest; 2];
            return None;
        }
        let High { rise, asked } = high.take()?;
        let pulse = Pulse { rise, fall: now, asked };
        truth.pulses[axis.index()].push(pulse);
        Some(pulse)
    }

    /// The program asks for pulses of this width.
    pub(crate) fn asked(&mut self, axis: Axis, width: Ticks) {
        let Asked([newest, _]) = &mut self.asked[axis.index()];
        *newest = width;
    }

    /// An edge at the probe pin.
    pub(crate) fn probe(&mut self, now: Ticks, level: bool, truth: &mut GroundTruth) {
        if level {
            self.step_start = Some(now);
        } else if let Some(start) = self.step_start.take() {
            truth.steps.push(Step { start, end: now });
        }
    }
}

/// The words of a sensor in the units that the firmware gives all sensors' samples.
fn in_common_units(sensor: Kind, [ax, ay, az, mx, my, mz, gx, gy, gz]: [i16; 9]) -> [i16; 9] {
    let raw = RawSample { acc: [ax, ay, az], gyr: [gx, gy, gz], ..RawSample::default() };
    let RawSample { acc: [ax, ay, az], gyr: [gx, gy, gz], .. } = sensor.in_common_units(raw);
    [ax, ay, az, mx, my, mz, gx, gy, gz]
}

/// True if every word is within [`VALID_COUNTS`] of what it should be.
fn close(words: [i16; 9], should_be: [i16; 9]) -> bool {
    let limits = VALID_COUNTS.iter().flat_map(|limit| [*limit; 3]);
    let pairs = words.iter().zip(should_be);
    pairs.zip(limits).all(|((word, should_be), limit)| word.abs_diff(should_be) <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(
        analyzer: &mut LogicAnalyzer,
        truth: &mut GroundTruth,
        us: u64,
        event: I2cEvent,
        reply: I2cReply,
    ) {
        let registers = Registers {
            sensor: Kind::Bno055,
            refresh: Refresh { at: Ticks::from_us(500), recorded: None },
            faultless: [
                [0x0100, 0x0302, 0x0504],
                [0x0706, 0x0908, 0x0B0A],
                [0x0D0C, 0x0F0E, 0x1110],
            ],
        };
        analyzer.i2c(Ticks::from_us(us), event, reply, registers, truth);
    }

    #[test]
    fn a_burst_starts_one_byte_before_its_address_is_acknowledged() {
        let (mut analyzer, mut truth) = (LogicAnalyzer::default(), GroundTruth::default());
        let start = |read| I2cEvent::Start { address: 0x28, read };
        let ack = I2cReply::ACK.stretched(Ticks::from_us(180));
        event(&mut analyzer, &mut truth, 1000, start(false), ack);
        event(&mut analyzer, &mut truth, 1203, I2cEvent::Write(ACC_DATA), ack);
        event(&mut analyzer, &mut truth, 1410, start(true), ack);
        for i in 0..18u8 {
            let reply = I2cReply::data(i).stretched(Ticks::from_us(180));
            let at = 1600 + 200 * u64::from(i);
            event(&mut analyzer, &mut truth, at, I2cEvent::Read, reply);
        }
        event(&mut analyzer, &mut truth, 5300, I2cEvent::Stop, I2cReply::NAK);
        let burst = truth.bursts[0];
        assert_eq!(burst.start, Ticks::from_us(977));
        assert_eq!(burst.end, Ticks::from_us(5300));
        assert_eq!(burst.words[0], 0x0100);
        assert_eq!(burst.words[8], 0x1110);
        assert_eq!(burst.refresh.at, Ticks::from_us(500));
        assert!(burst.valid);
    }

    #[test]
    fn a_word_may_be_a_little_wrong() {
        let should_be = [1, 2, 981, 320, -90, 640, 1, -4, 2];
        assert!(close(should_be, should_be));
        for (word, limit) in [(2, 200), (4, 80), (7, 64)] {
            let mut words = should_be;
            words[word] += limit;
            assert!(close(words, should_be));
            words[word] += 1;
            assert!(!close(words, should_be));
        }
    }

    #[test]
    fn other_reads_and_broken_bursts_do_not_count() {
        let (mut analyzer, mut truth) = (LogicAnalyzer::default(), GroundTruth::default());
        let start = I2cEvent::Start { address: 0x28, read: false };
        for (pointer, bytes) in [(0x3D, 18), (ACC_DATA, 17)] {
            event(&mut analyzer, &mut truth, 0, start, I2cReply::ACK);
            event(&mut analyzer, &mut truth, 1, I2cEvent::Write(pointer), I2cReply::ACK);
            for _ in 0..bytes {
                event(&mut analyzer, &mut truth, 2, I2cEvent::Read, I2cReply::ACK);
            }
            event(&mut analyzer, &mut truth, 3, I2cEvent::Stop, I2cReply::NAK);
        }
        event(&mut analyzer, &mut truth, 4, start, I2cReply::NAK);
        event(&mut analyzer, &mut truth, 5, I2cEvent::Stop, I2cReply::NAK);
        assert!(truth.bursts.is_empty());
    }

    #[test]
    fn pulses_and_steps_need_both_edges() {
        let (mut analyzer, mut truth) = (LogicAnalyzer::default(), GroundTruth::default());
        assert_eq!(analyzer.servo(Ticks::from_us(5), Axis::Pitch, false, &mut truth), None);
        analyzer.servo(Ticks::from_us(10), Axis::Pitch, true, &mut truth);
        let pulse = analyzer.servo(Ticks::from_us(1533), Axis::Pitch, false, &mut truth).unwrap();
        assert_eq!(pulse.width_us(), 1523.0);
        assert!(!pulse.is_as_asked(0.0));
        analyzer.probe(Ticks::from_us(1), true, &mut truth);
        analyzer = LogicAnalyzer::default();
        analyzer.probe(Ticks::from_us(2), false, &mut truth);
        assert_eq!((truth.pulses[0].len(), truth.steps.len()), (1, 0));
    }

    #[test]
    fn a_pulse_is_held_against_what_was_asked_for_when_it_rose() {
        let (mut analyzer, mut truth) = (LogicAnalyzer::default(), GroundTruth::default());
        let us = Ticks::from_us;
        let mut pulse = |at: u64, width: u64, next: Option<u64>| {
            analyzer.servo(us(at), Axis::Pitch, true, &mut truth);
            if let Some(next) = next {
                analyzer.asked(Axis::Pitch, us(next));
            }
            let pulse = analyzer.servo(us(at + width), Axis::Pitch, false, &mut truth);
            pulse.unwrap().is_as_asked(0.0)
        };
        assert!(!pulse(0, 1500, Some(1500)), "asked for while it was high");
        assert!(pulse(20_000, 1500, Some(1600)));
        // The timer takes the next one, or the one before again.
        assert!(pulse(40_000, 1600, None) && pulse(60_000, 1600, Some(1700)));
        assert!(pulse(80_000, 1600, None) && !pulse(100_000, 1600, None));
        // Cut; and by a clock that is a tenth slow.
        assert!(!pulse(120_000, 900, None));
        let slow = Pulse { rise: us(0), fall: us(1666), asked: Asked([us(1500), Ticks::ZERO]) };
        assert!(!slow.is_as_asked(-0.09) && slow.is_as_asked(-0.1));
    }

    #[test]
    fn a_reset_ends_a_pulse_and_a_new_measurement_does_not() {
        let (mut analyzer, mut truth) = (LogicAnalyzer::default(), GroundTruth::default());
        analyzer.asked(Axis::Roll, Ticks::from_us(1500));
        analyzer.servo(Ticks::from_us(10), Axis::Roll, true, &mut truth);
        truth.clear();
        analyzer = LogicAnalyzer::default();
        analyzer.servo(Ticks::from_us(700), Axis::Roll, false, &mut truth);
        let [pulse] = truth.pulses[1][..] else {
            panic!("{:?}", truth.pulses[1]);
        };
        assert_eq!(pulse.width_us(), 690.0);
        assert!(!pulse.is_as_asked(0.0));
    }
}
