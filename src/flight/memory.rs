//! What a flight remembers from one step to the next, as words of 32 bits: telemetry tells it once
//! a second, so that a replay can go on behind frames that were lost.

use tvc_imu::RawSample;

use super::Flight;
use crate::axis::Axis;
use crate::channel::Channel;
use crate::launch::Launch;

impl Flight {
    /// Words of [`Flight::memory`].
    pub const MEMORY_WORDS: usize = tvc_fusion::fixed::State::WORDS
        + 14
        + Launch::MEMORY_WORDS
        + Axis::COUNT * Channel::MEMORY_WORDS;

    /// All that the next steps depend on besides parameters, samples and commands, word by word:
    /// each is shown to `each` and becomes what that returns. The first is a digest of the
    /// parameters, which stay. It is whole after a step with a sample, [past
    /// start-up](crate::State::is_past_start_up), but for a test pulse.
    pub fn memory(&mut self, each: &mut impl FnMut(i32) -> i32) {
        each(self.params.digest());
        self.carried.memory(each);
        self.supervisor.memory(each);
        self.navigation.memory(each);
        self.launch.memory(each);
        for channel in &mut self.channels {
            channel.memory(each);
        }
    }

    /// Take over which ticks the pulses carry from another flight's [memory](Flight::memory):
    /// samples do not tell it.
    pub fn follow_frames(&mut self, words: &[i32]) {
        let mut rest = words.iter().skip(1);
        self.carried
            .memory(&mut |word| rest.next().copied().unwrap_or(word));
    }

    /// Go on from the [memory](Flight::memory) of another flight after a step with this sample.
    /// Says whether the next steps give the same bits as there: whether the parameters are the
    /// same.
    pub fn resume(&mut self, sample: &RawSample, words: &[i32]) -> bool {
        let mut rest = words.iter();
        self.memory(&mut |word| rest.next().copied().unwrap_or(word));
        self.navigation.resume(sample);
        let health = self.health();
        self.supervisor.resume(sample.time, health);
        words.first() == Some(&self.params.digest())
    }
}
