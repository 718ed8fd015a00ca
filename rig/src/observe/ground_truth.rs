//! What really happened on the rig: motion, pulses, bursts and control steps.

use crate::inertial::Refresh;
use crate::observe::waves::Waves;
use samd21::board::Ticks;
use tvc_nano::Axis;
use tvc_nano::sensor::Kind;

/// The vehicle and its servos at one instant. Lists name pitch first, then roll, which is 0
/// throughout where the drone only pitches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// When.
    pub time: Ticks,
    /// Pitch, nose up positive, and roll, right side down positive, rad. Of a drone that spins they
    /// are the parts of its tilt in axes with the heading of the bench, and the rates those about
    /// its own axes.
    pub tilt_rad: [f64; Axis::COUNT],
    /// Rates, rad/s.
    pub rates_rad_s: [f64; Axis::COUNT],
    /// Rudder angles, rad.
    pub rudders_rad: [f64; Axis::COUNT],
    /// Crank angles, rad.
    pub cranks_rad: [f64; Axis::COUNT],
    /// Crank angles that the last finished pulses ask for, rad.
    pub targets_rad: [f64; Axis::COUNT],
}

/// A servo pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// Rising edge.
    pub rise: Ticks,
    /// Falling edge.
    pub fall: Ticks,
    /// What was asked for.
    pub asked: Asked,
}

impl Pulse {
    /// Width, us.
    pub fn width_us(&self) -> f64 {
        (self.fall - self.rise).as_us_f64()
    }

    /// Whether it is as wide as the program had asked for, by a clock that is this far off,
    /// relative.
    pub fn is_as_asked(&self, clock_error: f64) -> bool {
        let width_us = self.width_us();
        let slack = (1.0 + CLOCK_JITTER) / (1.0 - clock_error.abs());
        let near = |asked: Ticks| {
            let (least, most) = (asked.as_us_f64() / slack, asked.as_us_f64() * slack);
            (least - 1.0..=most + 1.0).contains(&width_us)
        };
        self.asked.0.into_iter().any(near)
    }
}

/// How far the main clock is off while start-of-frame corrects it, relative.
const CLOCK_JITTER: f64 = 0.002;

/// The widths that the program had given its timer when a pulse rose and when the one before did,
/// which is sent again if the timer was not to take another; zero is no pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asked(pub [Ticks; 2]);

/// A servo's pin is high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct High {
    /// Rising edge.
    pub rise: Ticks,
    /// What was asked for.
    pub asked: Asked,
}

/// A burst that read all data of the sensor, or the rates alone, seen on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Burst {
    /// The sensor.
    pub sensor: Kind,
    /// START condition: one byte before the acknowledge, with the length of the byte after it.
    pub start: Ticks,
    /// Acknowledge of the address, the burst's most precise time.
    pub acknowledged: Ticks,
    /// STOP.
    pub end: Ticks,
    /// What the sensor's registers held when the first byte was read.
    pub refresh: Refresh,
    /// The nine words: accelerometer, magnetometer, gyroscope. Beside rates that were read alone
    /// stand those of the newest whole burst.
    pub words: [i16; 9],
    /// True if the words are those that a faultless sensor and cable would have given, to within
    /// 2 m/s^2, 5 uT and 4 deg/s: an error that small does no harm.
    pub valid: bool,
    /// It read the rates alone.
    pub alone: bool,
}

/// A control step, from the probe pin D4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Begin of the step.
    pub start: Ticks,
    /// End of the step: its pulse has been written.
    pub end: Ticks,
}

/// Longest time from the end of a burst to the step that works on it.
const HAND_OVER: Ticks = Ticks::from_us(1000);

/// Everything that was recorded, in order of time.
#[derive(Clone, Debug, Default)]
pub struct GroundTruth {
    /// The motion, once a millisecond.
    pub motion: Vec<Motion>,
    /// Finished pulses of each axis' servo.
    pub pulses: [Vec<Pulse>; Axis::COUNT],
    /// Bursts that read all 18 bytes of data, or the 6 of the rates.
    pub bursts: Vec<Burst>,
    /// Control steps.
    pub steps: Vec<Step>,
    /// The pulses that have begun and not ended, by axis.
    pub high: [Option<High>; Axis::COUNT],
    /// The edges of bus and pins, where they are recorded.
    pub waves: Option<Waves>,
}

impl GroundTruth {
    /// Forgets all that is over, as at the start of a measurement.
    pub fn clear(&mut self) {
        let waves = self.waves.take();
        *self = Self { high: self.high, waves, ..Self::default() };
    }

    /// Finished pulses of an axis' servo.
    pub fn pulses_of(&self, axis: Axis) -> &[Pulse] {
        &self.pulses[axis.index()]
    }

    /// The burst that a step works on: the newest one that had ended when the step began, unless
    /// that was too long ago.
    pub(crate) fn burst_of(&self, step: &Step) -> Option<&Burst> {
        let ended = self.bursts.partition_point(|burst| burst.end <= step.start);
        let burst = self.bursts.get(ended.checked_sub(1)?)?;
        (step.start - burst.end <= HAND_OVER).then_some(burst)
    }

    /// The motion from `from` on.
    pub fn motion_since(&self, from: Ticks) -> &[Motion] {
        &self.motion[self.motion.partition_point(|m| m.time < from)..]
    }

    /// Pulses of an axis' servo that rose at `from` or later.
    pub fn pulses_since(&self, axis: Axis, from: Ticks) -> &[Pulse] {
        let pulses = self.pulses_of(axis);
        &pulses[pulses.partition_point(|p| p.rise < from)..]
    }
}
