//! When the sensor is sampled: ticks that are locked to the servo frame.
//!
//! The BNO055 refreshes its registers by a clock of its own, at about 100 Hz. Sampled at that rate too, it would give
//! now and then a sample twice or leave one out, and with it the rotation of 10 ms, once a second in the middle of a
//! beat: up to 20 mrad of attitude in a flight from 0.8 rad. At half as often again every sample is seen, some twice,
//! and what one is too long the next is too short.

/// Shortest time between two ticks, us: the burst, a short transfer to look after the sensor, and some reserve. The bus
/// at 100 kHz takes 1.4 ms longer for both.
const fn shortest_us(i2c_khz: u32) -> u32 {
    if i2c_khz < 400 { 9_000 } else { 6_500 }
}

/// Ticks for a frame rate and a bus speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Ticks in a frame, evenly spaced: 1 to [`Schedule::MOST_TICKS`].
    pub ticks_per_frame: u8,
    /// Frames from tick to tick, where there is one or less in a frame.
    pub frames_per_tick: u8,
}

impl Schedule {
    /// Most ticks in a frame.
    pub const MOST_TICKS: u8 = 3;

    /// As many ticks as there is time for.
    ///
    /// | servo frame | ticks at 400 kHz | at 100 kHz |
    /// |---|---|---|
    /// | 50 Hz | three a frame, 150 Hz | two, 100 Hz |
    /// | 100 Hz | one a frame, 100 Hz | the same |
    /// | 200 Hz | one in two frames, 100 Hz | the same |
    /// | 300 Hz | one in two frames, 150 Hz | one in three, 100 Hz |
    /// | 333 Hz | one in three frames, 111 Hz | the same |
    pub const fn new(frame_hz: u32, i2c_khz: u32) -> Self {
        let (frame_us, shortest_us) = (1_000_000 / frame_hz, shortest_us(i2c_khz));
        let ticks = frame_us / shortest_us;
        Self {
            ticks_per_frame: if ticks == 0 {
                1
            } else if ticks > Self::MOST_TICKS as u32 {
                Self::MOST_TICKS
            } else {
                ticks as u8
            },
            frames_per_tick: shortest_us.div_ceil(frame_us) as u8,
        }
    }

    /// Time from tick to tick, us, rounded down.
    pub const fn period_us(&self, frame_hz: u32) -> u32 {
        1_000_000 * self.frames_per_tick as u32 / (frame_hz * self.ticks_per_frame as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_ticks_as_the_table_says() {
        for (frame_hz, fast, slow) in [
            (50, (3, 1, 6_666), (2, 1, 10_000)),
            (100, (1, 1, 10_000), (1, 1, 10_000)),
            (200, (1, 2, 10_000), (1, 2, 10_000)),
            (300, (1, 2, 6_666), (1, 3, 10_000)),
            (333, (1, 3, 9_009), (1, 3, 9_009)),
        ] {
            for (i2c_khz, expected) in [(400, fast), (100, slow)] {
                let schedule = Schedule::new(frame_hz, i2c_khz);
                let found = (
                    schedule.ticks_per_frame,
                    schedule.frames_per_tick,
                    schedule.period_us(frame_hz),
                );
                assert_eq!(found, expected, "{frame_hz} Hz, {i2c_khz} kHz");
            }
        }
    }
}
