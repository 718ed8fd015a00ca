//! The waveform extension and the drivers: what is between the channels' waveforms and the pins
//! (data sheet 31.6.3.7).
//!
//! ```text
//! channels -> output matrix -> dead times -> swap -> pattern -> inversion -> WO[0] to WO[7]
//! ```
//!
//! Dead times and swap work on pairs of outputs: WO\[x\] and WO\[x + 4\].

use crate::board::Ticks;
use crate::peripherals::port::Waveforms;

/// WEXCTRL: OTMX.
const OTMX: u32 = 3;
/// WEXCTRL: DTIEN0, the first of four.
const DTIEN0: u32 = 1 << 8;
/// Pairs of outputs.
const PAIRS: usize = 4;

/// The registers of the extension and its dead times.
#[derive(Clone, Debug, Default)]
pub(super) struct Extension {
    pub(super) wexctrl: u32,
    pub(super) drvctrl: u32,
    pub(super) patt: u32,
    pub(super) pattb: u32,
    /// Levels behind the output matrix.
    matrix: u8,
    /// When the dead time of each pair ends, 0 if none runs.
    dead_until: [Ticks; PAIRS],
}

impl Extension {
    /// The end of the next dead time.
    pub(super) fn next(&self) -> Ticks {
        let running = self.dead_until.into_iter();
        let running = running.filter(|until| *until != Ticks::ZERO);
        running.min().unwrap_or(Ticks::NEVER)
    }

    /// Dead times that are over at `now` end.
    pub(super) fn advance(&mut self, now: Ticks) {
        for until in &mut self.dead_until {
            if *until <= now {
                *until = Ticks::ZERO;
            }
        }
    }

    /// The channels' waveforms have these levels from `now` on. An edge of a pair with dead time
    /// begins one, as long as `cycles` says for this many cycles of the timer's clock.
    pub(super) fn follow(
        &mut self,
        now: Ticks,
        levels: u8,
        channels: usize,
        cycles: impl Fn(u64) -> Option<Ticks>,
    ) {
        let matrix = self.distribute(levels, channels);
        let before = std::mem::replace(&mut self.matrix, matrix);
        for (pair, until) in self.dead_until.iter_mut().enumerate() {
            let is_high = self.matrix >> pair & 1 != 0;
            let is_edge = (self.matrix ^ before) >> pair & 1 != 0;
            if is_edge && self.wexctrl & DTIEN0 << pair != 0 {
                // DTLS holds off the low side, which rises now; DTHS the high side.
                let shift = if is_high { 16 } else { 24 };
                let dead = u64::from(self.wexctrl >> shift & 0xFF);
                *until = match cycles(dead) {
                    Some(dead) if dead > Ticks::ZERO => now + dead,
                    _ => Ticks::ZERO,
                };
            }
        }
    }

    /// The output matrix (table 31-4): the channel of each output.
    fn distribute(&self, levels: u8, channels: usize) -> u8 {
        let channel = |output: usize| match self.wexctrl & OTMX {
            0 => output % channels,
            1 => output % (channels / 2),
            2 => 0,
            _ => usize::from(output > 0),
        };
        (0..2 * PAIRS).fold(0, |matrix, output| matrix | (levels >> channel(output) & 1) << output)
    }

    /// What the outputs are driven to; the pairs of `swap` are exchanged.
    pub(super) fn outputs(&self, swap: u32) -> Waveforms {
        let mut levels = self.matrix;
        for (pair, until) in self.dead_until.iter().enumerate() {
            let (low, high) = (1 << pair, 1 << (pair + PAIRS));
            if self.wexctrl & DTIEN0 << pair != 0 {
                let is_high = self.matrix & low != 0;
                levels &= !(low | high);
                if *until == Ticks::ZERO {
                    levels |= if is_high { low } else { high };
                }
            }
            if swap >> pair & 1 != 0 {
                let rest = levels & !(low | high);
                levels = rest | (levels & low) << PAIRS | (levels & high) >> PAIRS;
            }
        }
        let (enabled, values) = (self.patt as u8, (self.patt >> 8) as u8);
        levels = levels & !enabled | values & enabled;
        Waveforms { high: levels ^ (self.drvctrl >> 16) as u8, driven: 0xFF }
    }

    /// What they are driven to in the state of a non-recoverable fault (DRVCTRL.NREx, NRVx).
    pub(super) fn safe_outputs(&self) -> Waveforms {
        let driven = self.drvctrl as u8;
        Waveforms { high: (self.drvctrl >> 8) as u8 & driven, driven }
    }
}
