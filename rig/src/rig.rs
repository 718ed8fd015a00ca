//! The rig: the chip and its environment on one clock, and the bootloader between a reset and the
//! image.

mod ending;

use crate::bench::{BenchConfig, Environment, Hardware};
use crate::bno055::Fault;
use crate::bootloader::{Bootloader, Verdict};
use crate::image::{IMAGE_ADDRESS, Image};
use crate::observe::ground_truth::GroundTruth;
use crate::random::{Stream, generator};
use plant::ParameterError;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use samd21::Chip;
use samd21::board::Ticks;
use samd21::chip::Stop;
use samd21::peripherals::ResetCause;
use std::cell::Cell;
use std::sync::Arc;
use thiserror::Error;
use tvc_nano::{Params, store};

pub use ending::ProgramEnd;

/// The keys of [`Hardware`] that can change while the rig runs.
pub const LIVE_KEYS: [&str; 7] =
    ["stretch", "stretch-rare", "stop-read", "stop-write", "field", "field-age", "usb-loss"];

/// The configuration of a rig.
#[derive(Clone, Debug)]
pub struct RigConfig {
    /// Seed of everything random: the sensor, its bus, the noise in RAM at power-on.
    pub seed: u64,
    /// What stands on the bench; its sensor's seed is replaced by `seed`, and what `hardware` has
    /// too by that.
    pub bench: BenchConfig,
    /// What the parts are like where real ones differ.
    pub hardware: Hardware,
    /// Parameters stored in the image's flash before; none on a new Nano.
    pub stored: Option<Params>,
}

impl Default for RigConfig {
    fn default() -> Self {
        Self { seed: 1, bench: BenchConfig::default(), hardware: Hardware::default(), stored: None }
    }
}

impl RigConfig {
    /// The defaults with the servo's polarity set, as on a vehicle whose rudder has been checked:
    /// on this rig +1 is right.
    pub fn polarity_set() -> Params {
        let mut params = Params::default();
        let row = params.set("SRV_POLARITY", 1.0);
        debug_assert!(row.is_ok(), "{row:?}");
        params
    }
}

/// Why the rig does not run.
#[derive(Debug, Error)]
pub enum RigError {
    /// The drone's parameters are impossible.
    #[error("the drone cannot be built: {0}")]
    Parameters(#[from] ParameterError),
    /// The chip did something that its model does not cover, or hit a breakpoint.
    #[error("the chip stopped after {seconds:.6} s: {stop}{place}")]
    Stopped {
        /// When, s since power-on.
        seconds: f64,
        /// Why.
        stop: Stop,
        /// In which function, as far as the image's symbols tell.
        place: String,
    },
}

/// The chip's supply, and one below the level of its user row, V.
pub(crate) const SUPPLY_V: f64 = 3.3;
const LOW_V: f64 = 1.65;

/// What runs on the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Running {
    Image,
    /// The bootloader starts the image at this time.
    Start(Ticks),
    /// The bootloader waits for a programmer until the next reset.
    Bootloader,
    /// The supply is too low for the chip, which is in reset for this reason.
    Held(ResetCause),
}

/// Whether a run is to end before the instruction at an address.
type Stops<'a> = dyn Fn(u32) -> bool + 'a;

/// A firmware image on the virtual rig. A clone starts from the same state and runs independently.
#[derive(Clone)]
pub struct Rig {
    /// The chip.
    pub chip: Chip,
    /// What is round it: sensor, servos, vehicle, clamp.
    pub environment: Environment,
    image: Arc<Image>,
    hardware: Hardware,
    bootloader: Bootloader,
    running: Running,
    /// When the image was last started.
    started: Ticks,
    resets: Vec<(Ticks, ResetCause)>,
    halts: usize,
    lowest_sp: u32,
    /// Decides whether a read or a write of the port is lost.
    usb_loss: ChaCha8Rng,
}

impl Rig {
    /// Power-on, at time zero.
    ///
    /// # Errors
    /// [`RigError::Parameters`].
    pub fn new(image: &Image, config: &RigConfig) -> Result<Self, RigError> {
        let mut bench = config.bench.clone();
        bench.sensor.seed = config.seed;
        config.hardware.fit(&mut bench);
        let mut chip = Chip::new(config.hardware.chip(config.seed));
        chip.load_flash(image.address(), image.bytes());
        if let Some(params) = &config.stored {
            chip.load_flash(store::STORE_ADDRESS, &store::first_slot(params));
        }
        let bootloader = if image.address() == IMAGE_ADDRESS {
            config.hardware.bootloader
        } else {
            // The image is in the bootloader's place.
            Bootloader::None
        };
        bootloader.install(&mut chip);
        let mut rig = Self {
            chip,
            environment: Environment::new(&bench)?,
            lowest_sp: image.stack_top(),
            image: Arc::new(image.clone()),
            hardware: config.hardware.clone(),
            bootloader,
            running: Running::Image,
            started: Ticks::ZERO,
            resets: Vec::new(),
            halts: 0,
            usb_loss: generator(config.seed, Stream::Port),
        };
        rig.enter_bootloader(ResetCause::PowerOn);
        Ok(rig)
    }

    /// The flash in which the image keeps parameters.
    pub fn stored(&self) -> &[u8] {
        let start = store::STORE_ADDRESS as usize;
        &self.chip.memory.flash()[start..start + store::STORE_BYTES]
    }

    /// Puts back what [`stored`](Self::stored) gave, before the image looks at it.
    pub fn load_stored(&mut self, bytes: &[u8; store::STORE_BYTES]) {
        self.chip.load_flash(store::STORE_ADDRESS, bytes);
    }

    /// Time since power-on.
    pub fn now(&self) -> Ticks {
        self.chip.now()
    }

    /// Runs for this time.
    ///
    /// # Errors
    /// [`RigError::Stopped`].
    pub fn run_for(&mut self, time: Ticks) -> Result<(), RigError> {
        self.run_until(self.now() + time)
    }

    /// Runs until `until`, through resets and the bootloader. The last instruction may end some
    /// cycles later.
    ///
    /// # Errors
    /// [`RigError::Stopped`].
    pub fn run_until(&mut self, until: Ticks) -> Result<(), RigError> {
        self.run(until, None).map(|_| ())
    }

    /// The same, more slowly, up to an instruction at whose address `stops` says so. The first one
    /// is executed anyway. Whether it has come to another.
    ///
    /// # Errors
    /// [`RigError::Stopped`].
    pub fn run_watched(
        &mut self,
        until: Ticks,
        stops: &dyn Fn(u32) -> bool,
    ) -> Result<bool, RigError> {
        let is_first = Cell::new(true);
        self.run(until, Some(&|pc| !is_first.replace(false) && stops(pc)))
    }

    fn run(&mut self, until: Ticks, stops: Option<&Stops<'_>>) -> Result<bool, RigError> {
        let mut is_there = false;
        while self.now() < until && !is_there {
            match self.run_some(until, stops) {
                Stop::Reached => {}
                Stop::Breakpoint if stops.is_some() => is_there = true,
                // The core stands still until the watchdog resets it.
                Stop::Lockup => self.halts += 1,
                Stop::Reset(cause) => self.reset(cause),
                stop => {
                    return Err(RigError::Stopped {
                        seconds: self.now().as_secs_f64(),
                        stop,
                        place: self.place(),
                    });
                }
            }
        }
        self.environment.advance(self.now());
        Ok(is_there)
    }

    fn run_some(&mut self, until: Ticks, stops: Option<&Stops<'_>>) -> Stop {
        match self.running {
            Running::Image => {
                let (chip, environment) = (&mut self.chip, &mut self.environment);
                let stop = match stops {
                    Some(stops) => chip.run_watched(until, environment, stops),
                    None => chip.run_until(until, environment),
                };
                self.lowest_sp = self.lowest_sp.min(self.chip.lowest_sp());
                stop
            }
            Running::Start(at) => {
                let stop = self.chip.hold_until(until.min(at), &mut self.environment);
                if stop == Stop::Reached && self.now() >= at {
                    self.start_image();
                }
                stop
            }
            Running::Bootloader | Running::Held(_) => {
                self.chip.hold_until(until, &mut self.environment)
            }
        }
    }

    fn reset(&mut self, cause: ResetCause) {
        self.reset_chip(cause);
        self.leave_reset(cause);
    }

    /// The chip starts, unless its supply is too low.
    fn leave_reset(&mut self, cause: ResetCause) {
        if self.chip.is_held_in_reset() {
            self.running = Running::Held(cause);
        } else {
            self.enter_bootloader(cause);
        }
    }

    fn reset_chip(&mut self, cause: ResetCause) {
        self.resets.push((self.now(), cause));
        self.halts += usize::from(self.chip.is_stopped());
        self.chip.reset(cause);
        self.environment.chip_reset();
    }

    fn enter_bootloader(&mut self, cause: ResetCause) {
        match self.bootloader.enter(cause, self.chip.memory.ram_mut()) {
            Verdict::StartsImage(Ticks::ZERO) => self.start_image(),
            Verdict::StartsImage(after) => self.running = Running::Start(self.now() + after),
            Verdict::Stays => self.running = Running::Bootloader,
        }
    }

    fn start_image(&mut self) {
        self.bootloader.leave(self.chip.memory.ram_mut());
        self.chip.boot(self.image.address());
        self.running = Running::Image;
        self.started = self.now();
    }

    /// Presses the reset button.
    pub fn press_reset(&mut self) {
        self.reset(ResetCause::External);
    }

    /// The chip's supply goes to `volts`, 1.6 to 3.6, which is still enough for the sensor. Below
    /// the level that the firmware has set for its detector, the chip is reset; below that of its
    /// user row it stays so.
    pub fn set_supply(&mut self, volts: f64) {
        if self.chip.set_supply(volts) {
            self.reset(ResetCause::BrownOut33);
        } else if let Running::Held(cause) = self.running {
            self.leave_reset(cause);
        }
    }

    /// The supply dips below the chip's brown-out level for a moment.
    pub fn brown_out(&mut self) {
        self.set_supply(LOW_V);
        self.set_supply(SUPPLY_V);
    }

    /// Flips a bit of a register; `false` if the model has no such bit.
    pub fn flip_register(&mut self, address: u32, bit: u8) -> bool {
        self.chip.flip_register(address, bit, &mut self.environment)
    }

    /// The slow oscillator goes to another rate, relative to 32,768 Hz; one that the hardware's
    /// keys give stays.
    pub fn drift_slow_clock(&mut self, ratio: f64) {
        if self.hardware.slow_clock.is_none() {
            self.chip.set_slow_oscillator(ratio * 32_768.0);
        }
    }

    /// The image that runs.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Cuts the power of chip and sensor for a moment. Flash keeps its contents, RAM does not.
    pub fn power_cycle(&mut self) {
        self.reset_chip(ResetCause::PowerOn);
        self.inject(Fault::PowerDip);
        self.environment.power_on();
        for (index, byte) in self.chip.memory.ram_mut().iter_mut().enumerate() {
            *byte = (index as u8).wrapping_mul(167) ^ 0x5A;
        }
        self.leave_reset(ResetCause::PowerOn);
    }

    /// The bootloader waits for a program.
    pub fn waits_for_program(&self) -> bool {
        self.running == Running::Bootloader
    }

    /// True while the bootloader runs instead of the image.
    pub fn in_bootloader(&self) -> bool {
        self.running != Running::Image
    }

    /// Whether flash holds the image as it is.
    pub fn image_is_whole(&self) -> bool {
        let at = self.image.address() as usize;
        self.chip.memory.flash()[at..].starts_with(self.image.bytes())
    }

    /// When the image was started behind the last reset; `None` while the bootloader runs.
    pub fn started(&self) -> Option<Ticks> {
        (!self.in_bootloader()).then_some(self.started)
    }

    /// Every reset since power-on, with its time.
    pub fn resets(&self) -> &[(Ticks, ResetCause)] {
        &self.resets
    }

    /// How often the core has come to a halt since power-on that only a reset can end or has
    /// ended: in lock-up, or without a clock.
    pub fn halts(&self) -> usize {
        self.halts
    }

    /// How far the chip's main clock may be off by itself, relative.
    pub fn clock_error(&self) -> f64 {
        let drift = f64::from(self.hardware.chip.dfll_drift_ppm_s) * 1e-6;
        self.hardware.clock_percent.abs() / 100.0 + (drift * self.now().as_secs_f64()).abs()
    }

    /// Opens the clamp; the drone leaves it with a rate, rad/s.
    pub fn release(&mut self, rate_rad_s: f64) {
        self.environment.release(rate_rad_s);
    }

    /// Switches a fault of the sensor or its cable on.
    pub fn inject(&mut self, fault: Fault) {
        self.environment.inject(self.chip.now(), fault);
    }

    /// Switches a fault off.
    pub fn clear(&mut self, fault: Fault) {
        self.environment.clear(self.chip.now(), fault);
    }

    /// Sends bytes to the image over USB.
    pub fn usb_write(&mut self, bytes: &[u8]) {
        if !self.loses() {
            self.chip.usb_host.write(bytes);
        }
    }

    /// Bytes that came from the image over USB since the last call.
    pub fn usb_read(&mut self) -> Vec<u8> {
        let bytes = self.chip.usb_host.read();
        if bytes.is_empty() || !self.loses() { bytes } else { Vec::new() }
    }

    /// Changes what the parts are like while they run, as `KEY=VALUE` says.
    ///
    /// # Errors
    /// As of [`Hardware::set`]; or the key is not in [`LIVE_KEYS`].
    pub fn set_hardware(&mut self, setting: &str) -> Result<(), String> {
        let mut changed = self.hardware.clone();
        changed.set(setting)?;
        let name = setting.split('=').next().unwrap_or_default().trim();
        if !LIVE_KEYS.contains(&name) {
            return Err(format!(
                "{name} is fixed while the rig runs (see --hardware of tvc rig); what can change is {}",
                LIVE_KEYS.join(", ")
            ));
        }
        self.hardware = changed;
        self.environment.sensor.set_parts(&self.hardware.sensor);
        Ok(())
    }

    /// Whether the port loses what passes now.
    fn loses(&mut self) -> bool {
        let probability = self.hardware.usb_loss;
        probability > 0.0 && self.usb_loss.random_bool(probability)
    }

    /// What really happened.
    pub fn truth(&self) -> &GroundTruth {
        &self.environment.truth
    }

    /// Deepest stack since power-on, bytes.
    pub fn stack_high_water(&self) -> u32 {
        self.image.stack_top().saturating_sub(self.lowest_sp)
    }

    fn place(&self) -> String {
        match self.image.symbol_at(self.chip.pc()) {
            Some(symbol) => format!(" in {symbol}"),
            None => String::new(),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use samd21::usb_host::System;

    /// Counts at 0x2000_7800, and at 0x2000_0000, how often it was started; then sleeps for ever.
    pub(crate) fn counter() -> Image {
        let words: [u32; 2] = [0x2000_7800, 0x2009];
        let code: [u16; 12] = [
            0x4805, // ldr r0, =0x2000_7800
            0x6801, // ldr r1, [r0]
            0x3101, // adds r1, #1
            0x6001, // str r1, [r0]
            0x4804, // ldr r0, =0x2000_0000
            0x6801, // ldr r1, [r0]
            0x3101, // adds r1, #1
            0x6001, // str r1, [r0]
            0xBF30, // wfi
            0xE7FD, // b to the wfi
            0x46C0, 0x46C0, // nop
        ];
        let pool: [u32; 2] = [0x2000_7800, 0x2000_0000];
        let bytes = words
            .iter()
            .flat_map(|w| w.to_le_bytes())
            .chain(code.iter().flat_map(|h| h.to_le_bytes()))
            .chain(pool.iter().flat_map(|w| w.to_le_bytes()))
            .collect();
        Image::from_raw("counter", bytes).unwrap()
    }

    fn ms(ms: u64) -> Ticks {
        Ticks::from_ms(ms)
    }

    pub(crate) fn word(rig: &Rig, at: usize) -> u32 {
        let ram = rig.chip.memory.ram();
        u32::from_le_bytes([0, 1, 2, 3].map(|i| ram[at + i]))
    }

    #[test]
    fn a_reset_costs_half_a_second_and_spares_the_crash_record() {
        let mut rig = Rig::new(&counter(), &RigConfig::default()).unwrap();
        rig.run_for(ms(10)).unwrap();
        let (kept, low) = (word(&rig, 0x7800), word(&rig, 0));
        rig.press_reset();
        rig.run_for(ms(499)).unwrap();
        assert!(rig.in_bootloader());
        assert_eq!(word(&rig, 0x7FFC), 0x0773_8135);
        assert_eq!(word(&rig, 0x7800), kept);
        rig.run_for(ms(2)).unwrap();
        assert!(!rig.in_bootloader());
        assert_eq!(word(&rig, 0x7FFC), 0);
        assert_eq!(word(&rig, 0x7800), kept.wrapping_add(1));
        assert_ne!(word(&rig, 0), low.wrapping_add(1), "low RAM is the bootloader's");
        assert_eq!(rig.resets()[0].1, ResetCause::External);
    }

    /// The user row's level is 1.75 V, without hysteresis.
    #[test]
    fn a_low_supply_holds_the_chip_in_reset() {
        let mut rig = Rig::new(&counter(), &RigConfig::default()).unwrap();
        rig.run_for(ms(10)).unwrap();
        rig.set_supply(1.80);
        assert!(rig.resets().is_empty());
        rig.set_supply(1.65);
        rig.run_for(ms(700)).unwrap();
        assert!(rig.in_bootloader());
        rig.set_supply(3.3);
        rig.run_for(ms(501)).unwrap();
        assert!(!rig.in_bootloader());
        assert_eq!(rig.resets().len(), 1);
    }

    /// A later setting that can change would bring the refused address along.
    #[test]
    fn a_refused_setting_of_the_hardware_changes_nothing() {
        let mut rig = Rig::new(&counter(), &RigConfig::default()).unwrap();
        let before = rig.hardware.clone();
        assert!(rig.set_hardware("address=0x29").unwrap_err().contains("address is fixed"));
        assert!(rig.hardware == before);
        rig.set_hardware("usb-loss=0.25").unwrap();
        assert_eq!(rig.hardware.usb_loss, 0.25);
    }

    #[test]
    fn the_hardware_reaches_sensor_chip_and_host() {
        let config = RigConfig {
            hardware: "address=0x29,host=linux,slow-clock=1.25,user-row=erased".parse().unwrap(),
            ..RigConfig::default()
        };
        let mut rig = Rig::new(&counter(), &config).unwrap();
        assert_eq!(rig.environment.sensor.address(), 0x29);
        assert_eq!(rig.chip.usb_host.system(), System::Linux);
        // The watchdog of an erased user row: 32,768 cycles of the fast slow oscillator.
        rig.run_for(ms(799)).unwrap();
        assert_eq!(rig.resets(), []);
        rig.run_for(ms(2)).unwrap();
        assert_eq!(rig.resets()[0].1, ResetCause::Watchdog);
    }

    #[test]
    fn a_fork_lives_its_own_life() {
        let mut rig = Rig::new(&counter(), &RigConfig::default()).unwrap();
        rig.run_for(ms(100)).unwrap();
        let mut fork = rig.clone();
        fork.release(0.5);
        fork.run_for(ms(100)).unwrap();
        rig.run_for(ms(100)).unwrap();
        assert!(fork.environment.vehicle().pitch_rad() > 0.04);
        assert_eq!(rig.environment.vehicle().pitch_rad(), 0.0);
    }
}
