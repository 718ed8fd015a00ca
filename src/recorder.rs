//! The steps around the last release, kept in memory: what the link loses can be fetched
//! afterwards.
//!
//! Arming begins a recording in a ring buffer, which holds the last [`STEPS_BEFORE`] steps when the
//! release comes. [`STEPS_AFTER`] steps later it is whole, and it stays until the vehicle is armed
//! again.
//!
//! A step takes [`STEP_BYTES`], little endian, oldest step first:
//!
//! | byte | what |
//! |---|---|
//! | 0 | time of the step, us, lower 32 bits |
//! | 4 | age of its sample at the step, us; 65,535 without a usable one, which leaves the next eighteen bytes at 0 |
//! | 6, 12, 18 | accelerometer, gyroscope, magnetometer: counts as the sensor gave them, x, y, z |
//! | 24 | attitude w, x, y, z in Q14, body to earth |
//! | 32 | rates about x, y, z of the body, 2^-16 rad/s |
//! | 44, 48 | crank angles that control asked for, pitch and roll, 2^-16 rad |
//! | 52, 54 | pulses, us; 0 for an axis that is not steered |
//! | 56 | [`State::code`](crate::State::code), lower 16 bits |

use tvc_fusion::Quaternion;
use tvc_imu::{Micros, RawSample};
use tvc_pid::Q16;

use crate::axis::Axis;
use crate::failsafe::State;
use crate::flight::{Flight, Snapshot};
use crate::servo::PulseUs;

/// Bytes of a step.
pub const STEP_BYTES: usize = 2 * STEP_WORDS;
/// Steps before the one that first sees the release.
pub const STEPS_BEFORE: usize = STEPS - STEPS_AFTER;
/// Steps from the release on: 1.1 s at 150 Hz, in which every servo has brought the drone upright.
pub const STEPS_AFTER: usize = 170;
/// Steps of a whole recording.
pub const STEPS: usize = 190;
/// The age that stands for no sample.
pub const NO_SAMPLE: u16 = u16::MAX;

const STEP_WORDS: usize = 29;
const WORDS: usize = STEPS * STEP_WORDS;

/// How far a recording is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing to record.
    Idle,
    /// Armed: the steps before a release that may come.
    Waiting,
    /// Released: the number of steps that are still to come.
    Running(usize),
    /// Complete, and ready to be fetched.
    Whole,
}

/// The ring buffer and how far its recording is.
#[derive(Clone, Debug)]
pub struct Recorder {
    words: [u16; WORDS],
    /// Where the next step goes, a multiple of [`STEP_WORDS`].
    next: usize,
    /// Words that hold steps of this recording.
    filled: usize,
    phase: Phase,
    /// The step before was under control.
    active: bool,
}

impl Default for Recorder {
    fn default() -> Self {
        Self::new()
    }
}

impl Recorder {
    /// Nothing recorded.
    pub const fn new() -> Self {
        Self { words: [0; WORDS], next: 0, filled: 0, phase: Phase::Idle, active: false }
    }

    /// Take a step.
    pub fn record(&mut self, snapshot: &Snapshot, flight: &Flight) {
        let was_active = core::mem::replace(&mut self.active, snapshot.state.is_active());
        match (snapshot.state, self.phase) {
            (State::Armed, Phase::Waiting) => {}
            (State::Armed, _) => {
                self.filled = 0;
                self.phase = Phase::Waiting;
            }
            (State::Active { .. }, phase) if !was_active => {
                // Armed and released between two steps, there was nothing to wait for.
                if phase != Phase::Waiting {
                    self.filled = 0;
                }
                self.phase = Phase::Running(STEPS_AFTER);
            }
            (_, Phase::Waiting) => self.phase = Phase::Idle,
            _ => {}
        }
        match &mut self.phase {
            Phase::Idle | Phase::Whole => return,
            Phase::Waiting => {}
            Phase::Running(left) => {
                *left -= 1;
                if *left == 0 {
                    self.phase = Phase::Whole;
                }
            }
        }
        let step = words(snapshot, flight);
        if let Some(place) = self.words.get_mut(self.next..self.next + STEP_WORDS) {
            place.copy_from_slice(&step);
        }
        self.next += STEP_WORDS;
        if self.next == WORDS {
            self.next = 0;
        }
        self.filled = (self.filled + STEP_WORDS).min(WORDS);
    }

    /// Length of the recording, bytes; 0 while there is none or it is not whole.
    pub fn len(&self) -> usize {
        match self.phase {
            Phase::Whole => 2 * self.filled,
            _ => 0,
        }
    }

    /// Whether there is nothing to fetch.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Copy the recording from byte `offset` on; says how much of `out` it filled.
    pub fn read(&self, offset: usize, out: &mut [u8]) -> usize {
        let count = self.len().saturating_sub(offset).min(out.len());
        // The oldest step lies where the next would go.
        let mut at = 2 * self.next + 2 * (WORDS - self.filled) + offset;
        for byte in out.iter_mut().take(count) {
            if at >= 2 * WORDS {
                at -= 2 * WORDS;
            }
            let word = self.words.get(at / 2).copied().unwrap_or(0);
            *byte = (word >> (8 * (at % 2))) as u8;
            at += 1;
        }
        count
    }
}

/// A step as it is read back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Time of the step; only its lower 32 bits are kept.
    pub now: Micros,
    /// The untouched sample with its own time, if there was a usable one.
    pub sample: Option<RawSample>,
    /// Attitude, body to earth, within 1e-4.
    pub orientation: Quaternion,
    /// Rates about the body's axes, rad/s.
    pub rate: [f32; 3],
    /// Crank angles that control asked for, rad, before limits.
    pub cranks_rad: [f32; Axis::COUNT],
    /// The pulses commanded.
    pub pulses: [PulseUs; Axis::COUNT],
    /// [`State::code`](crate::State::code), lower 16 bits.
    pub code: u16,
}

impl Step {
    /// A step out of its bytes.
    pub fn decode(bytes: &[u8; STEP_BYTES]) -> Self {
        let byte = |at: usize| bytes.get(at).copied().unwrap_or(0);
        let half = |at: usize| u16::from_le_bytes([at, at + 1].map(byte));
        let long = |at: usize| u32::from(half(at + 2)) << 16 | u32::from(half(at));
        let fixed = |at: usize| f32::from(Q16::from_bits(long(at).cast_signed()));
        let signed = |at: usize| half(at).cast_signed();
        let counts = |at: usize| [at, at + 2, at + 4].map(signed);
        let [w, x, y, z] = [24, 26, 28, 30].map(|at| f32::from(signed(at)) / 16384.0);
        let (now, age) = (long(0), half(4));
        Self {
            now: Micros(now.into()),
            sample: (age != NO_SAMPLE).then(|| RawSample {
                time: Micros(now.wrapping_sub(age.into()).into()),
                acc: counts(6),
                gyr: counts(12),
                mag: counts(18),
            }),
            orientation: Quaternion { w, x, y, z },
            rate: [fixed(32), fixed(36), fixed(40)],
            cranks_rad: [44, 48].map(fixed),
            pulses: [52, 54].map(|at| PulseUs(half(at))),
            code: half(56),
        }
    }
}

/// A step as it is kept.
fn words(snapshot: &Snapshot, flight: &Flight) -> [u16; STEP_WORDS] {
    let (age, [a, b, c], [d, e, f], [g, h, i]) = match &snapshot.sample {
        Some(sample) => (
            snapshot.now.since(sample.time).min(NO_SAMPLE.into()) as u16,
            sample.acc.map(i16::cast_unsigned),
            sample.gyr.map(i16::cast_unsigned),
            sample.mag.map(i16::cast_unsigned),
        ),
        None => (NO_SAMPLE, [0; 3], [0; 3], [0; 3]),
    };
    let [w, x, y, z] = flight.orientation().wxyz_q30.map(|part| (part >> 16) as u16);
    let [now, now_hi] = halves(snapshot.now.0 as u32);
    let fixed = |number: Q16| halves(number.to_bits().cast_unsigned());
    let [roll_rate, pitch_rate, yaw_rate] = snapshot.rates;
    let [roll, roll_hi] = fixed(roll_rate);
    let [pitch, pitch_hi] = fixed(pitch_rate);
    let [yaw, yaw_hi] = fixed(yaw_rate);
    let [[first, first_hi], [second, second_hi]] = snapshot.cranks.map(fixed);
    let [PulseUs(pulse), PulseUs(pulse2)] = snapshot.pulses;
    let code = snapshot.state.code() as u16;
    [
        now, now_hi, age, a, b, c, d, e, f, g, h, i, w, x, y, z, roll, roll_hi, pitch, pitch_hi,
        yaw, yaw_hi, first, first_hi, second, second_hi, pulse, pulse2, code,
    ]
}

fn halves(long: u32) -> [u16; 2] {
    [long as u16, (long >> 16) as u16]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failsafe::Command;
    use crate::flight::tests::Desk;
    use std::vec;
    use std::vec::Vec;
    use tvc_imu::{Micros, SensorFault};

    /// Steps, recorded; what each was.
    fn run(recorder: &mut Recorder, desk: &mut Desk, steps: usize) -> Vec<Snapshot> {
        let snapshots: Vec<_> = (0..steps)
            .map(|_| {
                let snapshot = desk.step();
                recorder.record(&snapshot, &desk.flight);
                snapshot
            })
            .collect();
        snapshots
    }

    fn order(desk: &mut Desk, command: Command) {
        desk.flight.command(Micros(desk.now_us), command).unwrap();
    }

    fn bytes(recorder: &Recorder) -> Vec<u8> {
        let mut bytes = vec![0; recorder.len()];
        assert_eq!(recorder.read(0, &mut bytes), bytes.len());
        bytes
    }

    fn times(bytes: &[u8]) -> Vec<u32> {
        let steps = bytes.chunks(STEP_BYTES);
        steps.map(|step| u32::from_le_bytes(step[..4].try_into().unwrap())).collect()
    }

    /// A flight that has been released, whole.
    fn released(before: usize) -> (Recorder, Desk, Vec<Snapshot>) {
        let mut recorder = Recorder::new();
        let mut desk = Desk::in_standby(0.3);
        order(&mut desk, Command::Arm);
        let mut snapshots = run(&mut recorder, &mut desk, before);
        order(&mut desk, Command::Release);
        snapshots.extend(run(&mut recorder, &mut desk, STEPS_AFTER - 1));
        assert!(recorder.is_empty(), "not whole yet");
        snapshots.extend(run(&mut recorder, &mut desk, 1));
        (recorder, desk, snapshots)
    }

    #[test]
    fn a_release_is_kept_with_what_was_before_it() {
        let (mut recorder, mut desk, snapshots) = released(77);
        let kept = bytes(&recorder);
        assert_eq!(kept.len(), STEPS * STEP_BYTES);
        let expected: Vec<u32> = snapshots[snapshots.len() - STEPS..]
            .iter()
            .map(|snapshot| snapshot.now.0 as u32)
            .collect();
        assert_eq!(times(&kept), expected);
        // It stays, whatever follows, until the next arming.
        run(&mut recorder, &mut desk, 50);
        order(&mut desk, Command::Disarm);
        run(&mut recorder, &mut desk, 50);
        assert_eq!(bytes(&recorder), kept);
        order(&mut desk, Command::Arm);
        run(&mut recorder, &mut desk, 1);
        assert!(recorder.is_empty());
    }

    #[test]
    fn an_early_release_has_less_before_it() {
        let (recorder, _, snapshots) = released(5);
        let kept = times(&bytes(&recorder));
        let all: Vec<u32> = snapshots.iter().map(|s| s.now.0 as u32).collect();
        assert_eq!(kept, all);
        assert_eq!(kept.len(), STEPS_AFTER + 5);
    }

    #[test]
    fn a_release_in_the_same_breath_as_the_arming_is_kept_each_time() {
        let mut recorder = Recorder::new();
        let mut desk = Desk::in_standby(0.3);
        for _ in 0..2 {
            order(&mut desk, Command::Arm);
            order(&mut desk, Command::Release);
            let snapshots = run(&mut recorder, &mut desk, STEPS_AFTER + 50);
            let kept = times(&bytes(&recorder));
            assert_eq!(kept.len(), STEPS_AFTER);
            assert_eq!(kept[0], snapshots[0].now.0 as u32);
            order(&mut desk, Command::Disarm);
            run(&mut recorder, &mut desk, 1);
        }
    }

    #[test]
    fn a_disarming_without_a_release_leaves_nothing() {
        let mut recorder = Recorder::new();
        let mut desk = Desk::in_standby(0.3);
        order(&mut desk, Command::Arm);
        run(&mut recorder, &mut desk, 10);
        order(&mut desk, Command::Disarm);
        run(&mut recorder, &mut desk, 2 * STEPS);
        assert!(recorder.is_empty());
    }

    #[test]
    fn a_step_comes_back_as_it_was() {
        let (recorder, _, snapshots) = released(STEPS_BEFORE);
        let kept = bytes(&recorder);
        assert_eq!(snapshots.len(), STEPS);
        for (bytes, snapshot) in kept.chunks(STEP_BYTES).zip(&snapshots) {
            let step = Step::decode(bytes.try_into().unwrap());
            assert_eq!((step.now, step.sample), (snapshot.now, snapshot.sample));
            assert!(step.orientation.angle_to(&snapshot.orientation.quaternion()) < 3e-4);
            assert_eq!(step.rate, snapshot.rates.map(f32::from));
            assert_eq!(
                (step.cranks_rad, step.pulses, u32::from(step.code)),
                (snapshot.cranks.map(f32::from), snapshot.pulses, snapshot.state.code())
            );
        }
        let moved = snapshots.iter().any(|snapshot| snapshot.cranks[0] != Q16::default());
        assert!(moved);
    }

    #[test]
    fn a_missed_sample_is_kept_as_one() {
        let mut desk = Desk::in_standby(0.3);
        let missed = desk.step_with(Err(SensorFault::Nak));
        let words = words(&missed, &desk.flight);
        assert_eq!(words[2..12], [NO_SAMPLE, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let step = Step::decode(bytes[..].try_into().unwrap());
        assert_eq!((step.now, step.sample), (missed.now, None));
    }

    #[test]
    fn any_part_can_be_read() {
        let (recorder, ..) = released(40);
        let whole = bytes(&recorder);
        for (offset, length) in [(0, 90), (1, 3), (51, 90), (10_399, 90), (10_400, 90), (90_000, 5)]
        {
            let mut part = vec![0; length];
            let count = recorder.read(offset, &mut part);
            let expected = whole.get(offset..).unwrap_or_default();
            assert_eq!(count, expected.len().min(length));
            assert_eq!(part[..count], expected[..count]);
        }
    }
}
