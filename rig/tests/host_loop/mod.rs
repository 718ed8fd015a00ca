//! The flight library and the sensor's driver at the environment's pins, without a chip between
//! them. The bus master has ideal timing. Ticks come every 10 ms, locked to a servo frame of 20 ms,
//! as they do with a bus of 100 kHz.

use bno055_driver::{BusError, Imu, Micros, Next, TRANSFER_DEADLINE_US, Transfer};
use rig::bench::{BenchConfig, Environment, Wiring};
use samd21::board::{Board, I2cEvent, Ticks};
use tvc_nano::failsafe::BootReport;
use tvc_nano::sensor::Sensor;
use tvc_nano::{Flight, Params, RawSample, SensorFault, Snapshot};

/// A byte and its acknowledge: nine bits at 400 kHz.
const BYTE: Ticks = Ticks::from_us(23);
const TICK_US: u64 = 10_000;
const FRAME_US: u64 = 20_000;
/// Time from the last tick of a frame to the frame's end.
const LEAD_US: u64 = 7_940;

/// Driver and flight in front of the environment.
pub(crate) struct HostLoop {
    pub(crate) environment: Environment,
    pub(crate) driver: Sensor,
    pub(crate) flight: Flight,
    pub(crate) now: Ticks,
    pub(crate) samples: Vec<RawSample>,
    pub(crate) faults: Vec<(Ticks, SensorFault)>,
    next_tick_us: u64,
    next_frame_us: u64,
    pulse_us: u16,
}

impl HostLoop {
    pub(crate) fn new(bench: &BenchConfig, mut params: Params) -> Self {
        params.set("I2C_KHZ", 100.0).unwrap();
        assert_eq!(u64::from(params.control_period_us()), TICK_US);
        Self {
            environment: Environment::new(bench).unwrap(),
            driver: Sensor::new(&params),
            flight: Flight::new(params, BootReport::default()).unwrap(),
            now: Ticks::ZERO,
            samples: Vec::new(),
            faults: Vec::new(),
            next_tick_us: FRAME_US - LEAD_US,
            next_frame_us: FRAME_US,
            pulse_us: 1524,
        }
    }

    fn micros(&self) -> Micros {
        Micros(self.now.as_us())
    }

    /// Runs for a while; the snapshot of every step goes to `watch`.
    pub(crate) fn run(&mut self, ms: u64, mut watch: impl FnMut(&Environment, &Snapshot)) {
        let end = self.now + Ticks::from_ms(ms);
        while self.now < end {
            self.between_ticks();
            self.now = self.now.max(Ticks::from_us(self.next_tick_us));
            self.next_tick_us += TICK_US;
            let time = self.micros();
            if (time.0 + LEAD_US).is_multiple_of(FRAME_US) {
                self.flight.carried_tick(time);
            }
            let bytes = self.driver.bursts().whole.map(|burst| self.transfer(burst));
            let reading = match &bytes {
                Some(outcome) => {
                    self.driver.sample(time, outcome.as_deref().map_err(|error| *error))
                }
                None => Err(self.driver.missed()),
            };
            match reading {
                Ok(sample) => self.samples.push(sample.raw),
                Err(fault) => self.faults.push((self.now, fault)),
            }
            self.now += Ticks::from_us(600);
            let outputs = self.flight.step(self.micros(), reading);
            self.pulse_us = outputs.pulses[0].0;
            self.frames();
            self.environment.advance(self.now);
            watch(&self.environment, &outputs);
        }
    }

    /// Carries out the driver's transfers before the next tick, while time is left.
    fn between_ticks(&mut self) {
        loop {
            let left = self.next_tick_us.saturating_sub(self.now.as_us());
            match self.driver.next(self.micros()) {
                Next::Transfer(transfer) if left > 3_000 => {
                    let outcome = self.transfer(transfer);
                    let time = self.micros();
                    let outcome = outcome.as_deref().map_err(|error| *error);
                    self.driver.complete(time, outcome);
                }
                _ => return,
            }
        }
    }

    /// Sends the pulses whose rising edge is due.
    fn frames(&mut self) {
        while self.next_frame_us <= self.now.as_us() {
            let rise = Ticks::from_us(self.next_frame_us);
            self.next_frame_us += FRAME_US;
            self.environment.pin(rise, Wiring::NANO_33_IOT.servos[0], true);
            let fall = rise + Ticks::from_us(u64::from(self.pulse_us));
            self.environment.pin(fall, Wiring::NANO_33_IOT.servos[0], false);
        }
    }

    fn event(&mut self, event: I2cEvent) -> (bool, u8) {
        self.now += BYTE;
        let reply = self.environment.i2c(self.now, event);
        self.now += reply.stretch;
        (reply.ack, reply.data)
    }

    fn transfer(&mut self, transfer: Transfer) -> Result<Vec<u8>, BusError> {
        let begin = self.now;
        let held = self.environment.i2c_held_low(self.now);
        if held.sda || held.scl {
            self.now += Ticks::from_us(TRANSFER_DEADLINE_US);
            return Err(BusError::Stuck);
        }
        let outcome = self.bytes(transfer);
        self.event(I2cEvent::Stop);
        if (self.now - begin).as_us() > TRANSFER_DEADLINE_US {
            return Err(BusError::Timeout);
        }
        outcome
    }

    fn bytes(&mut self, transfer: Transfer) -> Result<Vec<u8>, BusError> {
        let address = self.driver.bursts().address;
        let start = |read| I2cEvent::Start { address, read };
        let check = |ack: bool| if ack { Ok(()) } else { Err(BusError::Nak) };
        check(self.event(start(false)).0)?;
        match transfer {
            Transfer::Read { register, len } => {
                check(self.event(I2cEvent::Write(register)).0)?;
                check(self.event(start(true)).0)?;
                Ok((0..len).map(|_| self.event(I2cEvent::Read).1).collect())
            }
            Transfer::Write { register, bytes } => {
                check(self.event(I2cEvent::Write(register)).0)?;
                for &byte in bytes.as_slice() {
                    check(self.event(I2cEvent::Write(byte)).0)?;
                }
                Ok(Vec::new())
            }
        }
    }
}
