//! What an estimator remembers.

use bytemuck::{Pod, Zeroable};

use super::field::CompassState;
use super::filters::FilterState;
use super::quality::{Due, UncertaintyState};
use super::rest::RestState;
use super::rotation::Rotation;
use super::start_up::{Gains, ScheduleState};

/// All that an estimator remembers from one step to the next, and nothing that follows from its
/// configuration: plain words of 32 bits, the same for every filter. Whoever holds it can copy,
/// compare, store and restore it, and seal it by a checksum of [`State::words`].
///
/// [`Estimator::start`](super::Estimator::start) makes one. Words from elsewhere may be any;
/// [`Estimator::accepts`](super::Estimator::accepts) tells whether an update can take them.
///
/// First what every step touches: it lies within reach of the core's short offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct State {
    pub(super) rotation: Rotation,
    /// What the half angle per count was cut by in the last step, its low `DT_BITS` bits: added in
    /// the next.
    pub(super) dt_remainder: u32,
    pub(super) gains: Gains,
    /// Sample number of the last field that has corrected the heading.
    pub(super) heading_tick: u32,
    /// Jobs of the deviations that are to come.
    pub(super) due: Due,
    pub(super) compass: CompassState,
    pub(super) rest: RestState,
    pub(super) filter: FilterState,
    pub(super) schedule: ScheduleState,
    pub(super) uncertainty: UncertaintyState,
    /// There was a step of more than 1.25 periods since the last block began: 1, else 0.
    pub(super) gap: u32,
    pub(super) last_field: LastField,
    /// Rates of the last step less their offset, counts, if a sensor is late.
    pub(super) rates: [i32; 3],
}

/// The last field while accelerations are limited: it stands for those that a slow magnetometer
/// leaves out.
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
