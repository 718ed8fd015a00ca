//! Free flight: a vehicle without a tether that is launched, burns and coasts (`LAUNCH_*`,
//! `BURN*`, `FUSE_ACC`), and whose gains follow the time since its release (`GS*`).
//!
//! The feature `free-flight`, on by default, brings this module and its parameters. Without the
//! feature `src/tethered.rs` stands in its place.

mod launch;
mod schedule;

use tvc_fusion::GRAVITY;
use tvc_imu::Micros;
use tvc_pid::{Coefficients, Q16};

use crate::failsafe::{self, Command};
use crate::mount::nearest;
use crate::params::Params;
use crate::sensor::{ACC_COUNTS, GYR_COUNTS};
use launch::Event;
pub(crate) use launch::Launch as State;
use schedule::GainSchedule;

/// Fraction bits of [`shift`].
pub(crate) const SHIFT_BITS: u32 = 20;

/// How much a count of acceleration from tail to nose shifts the gyroscope's rates about the body's
/// x and y (`GYR_PER_G_X`, `GYR_PER_G_Y`), 2^-[`SHIFT_BITS`] counts: at most 17,110.
pub(crate) fn shift(params: &Params) -> [i16; 2] {
    const SCALE: f32 = GYR_COUNTS * (1 << SHIFT_BITS) as f32 / (GRAVITY * ACC_COUNTS);
    [params.gyr_per_g_x(), params.gyr_per_g_y()].map(|deg_s| nearest(deg_s * SCALE))
}

/// What the parameters say of free flight.
#[derive(Clone, Debug)]
pub(crate) struct FreeFlight {
    launch: launch::Settings,
    gains: GainSchedule,
}

impl FreeFlight {
    // Not inlined: who calls it needs the stack for more.
    #[inline(never)]
    pub(crate) fn new(params: &Params) -> Self {
        Self { launch: launch::Settings::new(params), gains: GainSchedule::new(params) }
    }

    /// Take over changed parameters. Impossible rows of the schedule leave the old rows in force.
    pub(crate) fn configure(&mut self, params: &Params) {
        self.launch = launch::Settings::new(params);
        self.gains.configure(params);
    }

    /// Whether a vehicle can be flown by the parameters' schedule.
    pub(crate) fn is_possible(&self) -> bool {
        self.gains.is_possible()
    }

    /// Whether [`follow`](Self::follow) is to see the samples.
    pub(crate) fn is_needed(&self) -> bool {
        self.launch.is_needed()
    }

    /// Take a sample of this time, with an acceleration from tail to nose in counts of 0.01 m/s2.
    /// Gives the order of a launch, which releases an armed vehicle, and of the end of the burn,
    /// which disarms it.
    // Not inlined: most vehicles never need it.
    #[inline(never)]
    pub(crate) fn follow(
        &self,
        state: &mut State,
        at: Micros,
        upwards: i32,
        flight: &failsafe::State,
    ) -> Option<Command> {
        let event = state.watch(&self.launch, at, upwards, flight)?;
        Some(match event {
            Event::Launch => Command::Release,
            Event::End => Command::Disarm,
        })
    }

    /// Whether the gyroscope alone turns the attitude.
    pub(crate) fn is_free(&self, state: &State, flight: &failsafe::State) -> bool {
        state.is_free(&self.launch, flight)
    }

    /// Standard deviation of the tilt while the vehicle [is free](Self::is_free), deg.
    pub(crate) fn tilt_sd_deg(&self, state: &State, params: &Params) -> f32 {
        state.tilt_sd_deg(params)
    }

    /// The schedule's gains at the newest sample; `None` where gains are constant.
    pub(crate) fn gains(&self, state: &State) -> Option<Coefficients<Q16>> {
        if self.gains.is_constant() {
            return None;
        }
        self.gains.at(state.seconds())
    }
}
