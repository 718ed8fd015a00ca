//! What a flight remembers from one step to the next, as words of 32 bits: telemetry tells it once
//! a second, so that a replay can go on behind frames that were lost.

use tvc_imu::RawSample;

use super::Flight;
use crate::axis::Axis;
use crate::channel::ChannelState;
use crate::failsafe::Supervisor;
use crate::free_flight;
use crate::navigation;
use crate::ticks::CarriedTicks;
use crate::words::Words;

impl Flight {
    /// Words that are [told](Flight::tell).
    pub const WORDS: usize = 1
        + CarriedTicks::WORDS
        + navigation::State::WORDS
        + free_flight::State::WORDS
        + Axis::COUNT * ChannelState::WORDS
        + Supervisor::WORDS;

    /// Shows all that the next steps depend on besides parameters, samples and orders, word by
    /// word. The first is a digest of the parameters. It is whole after a step with a sample, [past
    /// start-up](crate::State::is_past_start_up), but for a test pulse.
    pub fn tell(&self, each: &mut dyn FnMut(i32)) {
        each(self.settings.params.digest());
        self.state.carried.tell(each);
        self.state.navigation.tell(each);
        self.state.free_flight.tell(each);
        for channel in &self.state.channels {
            channel.tell(each);
        }
        self.state.supervisor.tell(each);
    }

    /// Take over which ticks the pulses carry from the words that another flight
    /// [told](Flight::tell): samples do not tell it.
    pub fn follow_frames(&mut self, words: &[i32]) {
        if words.len() >= Self::WORDS {
            self.state.carried = Words::told(&mut following(words));
        }
    }

    /// Go on from the words that another flight [told](Flight::tell) after a step with this sample.
    /// Says whether the next steps give the same bits as there: whether the parameters are the
    /// same.
    pub fn resume(&mut self, sample: &RawSample, words: &[i32]) -> bool {
        if words.len() != Self::WORDS {
            return false;
        }
        let next = &mut following(words);
        self.state.carried = Words::told(next);
        let Self { settings, state } = self;
        settings.navigation.resume(&mut state.navigation, sample, next);
        state.free_flight = Words::told(next);
        for channel in &mut state.channels {
            channel.resume(next);
        }
        let health = self.health();
        self.state.supervisor.resume(sample.time, health, next);
        words.first() == Some(&self.settings.params.digest())
    }
}

/// The words behind the digest, one by one.
fn following(words: &[i32]) -> impl FnMut() -> i32 {
    let mut rest = words.iter().skip(1);
    move || rest.next().copied().unwrap_or(0)
}
