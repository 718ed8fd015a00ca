//! The memory of an estimator.

use bytemuck::{Pod, Zeroable};

use super::field::CompassState;
use super::filters::FilterState;
use super::quality::UncertaintyState;
use super::rest::RestState;
use super::rotation::Rotation;
use super::start_up::{Gains, ScheduleState};

/// The memory of an estimator from one step to the next: plain words of 32 bits, the same for every
/// filter, without the constants of the configuration. A program can copy, compare, store and
/// restore it, and seal it by a checksum of [`State::words`].
///
/// [`Estimator::start`](super::Estimator::start) makes one.
/// [`Estimator::accepts`](super::Estimator::accepts) tells whether an update can take words from
/// elsewhere.
///
/// The fields that every step touches come first, within reach of the core's short offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct State {
    pub(super) rotation: Rotation,
    /// Low `DT_BITS` bits of the half angle per count in the last step, for the next step.
    pub(super) dt_remainder: u32,
    pub(super) gains: Gains,
    /// Sample number of the last field that has corrected the heading.
    pub(super) heading_tick: u32,
    /// The next job of the deviations; 0 once all of a block are done.
    pub(super) due: u32,
    pub(super) filter: FilterState,
    pub(super) rest: RestState,
    pub(super) compass: CompassState,
    pub(super) schedule: ScheduleState,
    pub(super) uncertainty: UncertaintyState,
    /// A step since the last block's start took more than 1.25 periods: 1, else 0.
    pub(super) gap: u32,
    pub(super) last_field: LastField,
    /// Rates of the last step less their offset, counts, if a sensor is late.
    pub(super) rates: [i32; 3],
    /// Blocks in a row with less than gravity along the estimated vertical.
    pub(super) low_blocks: u32,
}

/// The last field while accelerations are limited. It stands for the fields between a slow
/// magnetometer's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct LastField {
    /// There was one: 1, else 0.
    pub(super) is_known: u32,
    /// Counts.
    pub(super) mag: [i32; 3],
}

impl State {
    /// Number of its words.
    pub const WORDS: usize = size_of::<Self>() / 4;

    /// The words.
    pub fn words(&self) -> &[u32; Self::WORDS] {
        bytemuck::must_cast_ref(self)
    }

    /// The state with these words; see [`Estimator::accepts`](super::Estimator::accepts).
    pub fn from_words(words: &[u32; Self::WORDS]) -> Self {
        bytemuck::must_cast(*words)
    }
}
