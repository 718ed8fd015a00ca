//! What an estimator remembers from one sample to the next, word by word: see
//! [`Estimator::memory`](super::Estimator::memory).

/// Words of [`Estimator::memory`](super::Estimator::memory).
pub const MEMORY_WORDS: usize = 102;

/// Shows every word to `each`; each becomes what that returns.
// Not inlined: it is called from many places, to write the words down.
#[inline(never)]
pub(super) fn all(words: &mut [i32], each: &mut impl FnMut(i32) -> i32) {
    for word in words {
        *word = each(*word);
    }
}
