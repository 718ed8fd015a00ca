//! A position servo: from the edges of its pulse to the angle of its horn.
//!
//! ```text
//! pulse ends -> width, whole us -> target -> deadband -> motor's voltage -> motor (load, inertia)
//!            -> gear train position -> backlash -> crank
//! ```
//!
//! The servo measures a pulse and acts on it when the pulse ends; until then the last one counts.
//! Its loop drives the motor in proportion to the error, as far as the supply goes. The motor is a
//! DC motor: with `u` the speed that the drive asks for without load,
//!
//! ```text
//! (rotor + inertia) dw/dt = stall / speed (u - w) + load
//! ```
//!
//! so that it follows late by what it turns, and gives way to a load. A proportional loop holds a
//! load only beside its target ([`ServoModel::droop`]). Within the deadband motor and gears hold
//! still. The potentiometer sits on the gear train, so that the play behind it is not corrected.
//!
//! Figures are those of data sheets for the class of servo, or estimates; thermal limits and gear
//! friction outside the deadband are left out. A supply off its rated voltage scales speed and
//! stall torque.

mod model;

use std::collections::VecDeque;

use crate::drone::Crank;

pub use model::{ServoModel, SignalLoss};

/// Longest step inside the model: short against the motor's lag, so that results do not depend on
/// how the caller divides time.
const INNER_STEP_S: f64 = 0.25e-3;

/// Pulses that may be announced before they end.
const QUEUE: usize = 4;

/// A pulse that has not ended yet.
#[derive(Clone, Copy, Debug)]
struct Pulse {
    end_s: f64,
    width_us: f64,
}

/// What a servo turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Torque on the horn, positive counter-clockwise, in N m.
    pub torque_n_m: f64,
    /// Inertia that the horn feels, in kg m2.
    pub inertia_kg_m2: f64,
}

/// A servo at work. Angles inside are of the gear train, referred to the crank.
#[derive(Clone, Debug)]
pub struct Servo {
    model: ServoModel,
    now_s: f64,
    queue: VecDeque<Pulse>,
    supply: f64,
    last_pulse_s: f64,
    target_rad: f64,
    gear_rad: f64,
    speed_rad_s: f64,
    load: Load,
    crank: Crank,
}

impl Servo {
    /// A servo at rest with its crank at `crank_rad`, in the middle of its play, at time `now_s`.
    /// It stays there until its first pulse has ended.
    pub fn new(model: ServoModel, crank_rad: f64, now_s: f64) -> Self {
        Self {
            model,
            now_s,
            queue: VecDeque::with_capacity(QUEUE),
            supply: 1.0,
            last_pulse_s: now_s,
            target_rad: crank_rad,
            gear_rad: crank_rad,
            speed_rad_s: 0.0,
            load: Load::default(),
            crank: Crank::at_rest(crank_rad),
        }
    }

    /// Announces a pulse by its rising edge (s, on the servo's clock) and its width (us). It takes
    /// effect when it ends, at once if that is past. The announcement may come before the end or
    /// after it, in the order of the pulses; more than four unfinished ones push out the oldest.
    pub fn pulse(&mut self, rising_edge_s: f64, width_us: f64) {
        if self.queue.len() == QUEUE {
            self.queue.pop_front();
        }
        self.queue.push_back(Pulse { end_s: rising_edge_s + 1e-6 * width_us, width_us });
    }

    /// Advances to `until_s` with a load on the crank (see
    /// [`Drone::crank_load`](crate::Drone::crank_load)) and gives the crank there.
    pub fn advance(&mut self, until_s: f64, load: Load) -> Crank {
        self.load = load;
        while self.now_s < until_s {
            self.latch();
            let end = self.queue.front().map_or(until_s, |next| until_s.min(next.end_s));
            let pieces = ((end - self.now_s) / INNER_STEP_S - 1e-9).ceil().max(1.0);
            let dt_s = (end - self.now_s) / pieces;
            let start = self.now_s;
            for piece in 1..=pieces as u32 {
                self.turn(dt_s);
                self.now_s = start + f64::from(piece) * dt_s;
            }
            self.now_s = end;
        }
        self.latch();
        self.crank
    }

    /// Sets the supply from now on, as a share (above zero) of the voltage that the model is for.
    pub fn set_supply(&mut self, share: f64) {
        self.supply = share;
    }

    /// The motor's current as a share of what it draws when it stalls at the model's rated voltage.
    /// As in any DC motor it is proportional to the torque, which holds the load and, over the lag,
    /// brings the motor to the speed asked for.
    pub fn current_share(&self) -> f64 {
        let catching_up = self.speed_asked() - self.speed_rad_s;
        (catching_up / self.model.speed_rad_s - self.load.torque_n_m / self.model.stall_n_m).abs()
    }

    /// The crank as it stands.
    pub fn crank(&self) -> Crank {
        self.crank
    }

    /// Where the last finished pulse wants the crank, within the travel, in rad.
    pub fn target_rad(&self) -> f64 {
        self.target_rad
    }

    /// Time since the last pulse ended, in s (since the start when there was none).
    pub fn signal_age_s(&self) -> f64 {
        self.now_s - self.last_pulse_s
    }

    /// The model.
    pub fn model(&self) -> &ServoModel {
        &self.model
    }

    /// Takes over the pulses that have ended.
    fn latch(&mut self) {
        while let Some(pulse) = self.queue.pop_front_if(|pulse| pulse.end_s <= self.now_s) {
            let model = &self.model;
            let width = (pulse.width_us / model.resolution_us).round() * model.resolution_us;
            self.target_rad = self.within_travel(model.crank_for_width(width));
            self.last_pulse_s = pulse.end_s;
        }
    }

    /// One inner step: the speed asked for is constant, the motor follows it exactly.
    fn turn(&mut self, dt_s: f64) {
        let asked = self.speed_asked();
        let lag_s = self.model.lag_s(self.load.inertia_kg_m2);
        let decay = (-dt_s / lag_s).exp();
        let excess = self.speed_rad_s - asked;
        let moved = self.gear_rad + asked * dt_s + excess * lag_s * (1.0 - decay);
        self.speed_rad_s = asked + excess * decay;
        self.gear_rad = self.within_travel(moved);
        if self.gear_rad != moved {
            self.speed_rad_s = 0.0;
        }
        let half = 0.5 * self.model.backlash_rad;
        let angle_rad = self.crank.angle_rad.clamp(self.gear_rad - half, self.gear_rad + half);
        let engaged = angle_rad != self.crank.angle_rad;
        self.crank = Crank::new(angle_rad, if engaged { self.speed_rad_s } else { 0.0 });
    }

    /// The speed that the motor tends to: that of its drive, less what the load takes.
    fn speed_asked(&self) -> f64 {
        let model = &self.model;
        let yielded = model.yielding() * self.load.torque_n_m;
        if let SignalLoss::Limp { after_s } = model.signal_loss
            && self.signal_age_s() > after_s
        {
            return yielded.clamp(-model.speed_rad_s, model.speed_rad_s);
        }
        let error = self.target_rad - self.gear_rad;
        if error.abs() <= 0.5 * model.deadband_us / model.us_per_rad.abs() {
            return 0.0;
        }
        let limit = model.speed_rad_s * self.supply;
        let made_up = (1.0 - model.droop) * yielded;
        (error / model.loop_s - made_up).clamp(-limit, limit) + yielded
    }

    fn within_travel(&self, crank_rad: f64) -> f64 {
        let (middle, travel) = (self.model.horn_rad, self.model.travel_rad);
        crank_rad.clamp(middle - travel, middle + travel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rudder of the nominal drone at zero, without a load.
    const RUDDER: Load = Load { torque_n_m: 0.0, inertia_kg_m2: 6.73e-4 };

    fn loaded(torque_n_m: f64) -> Load {
        Load { torque_n_m, ..RUDDER }
    }

    fn settle(servo: &mut Servo, width_us: f64, seconds: f64) -> f64 {
        let start = servo.now_s;
        let frames = (seconds / 0.02).round() as u32;
        for i in 0..frames {
            servo.pulse(start + 0.02 * f64::from(i), width_us);
            servo.advance(start + 0.02 * f64::from(i + 1), RUDDER);
        }
        servo.crank().angle_rad
    }

    #[test]
    fn a_pulse_takes_effect_when_it_ends() {
        let mut servo = Servo::new(ServoModel::S3003, 0.0, 0.0);
        servo.pulse(0.0100, 1720.0);
        servo.advance(0.01171, RUDDER);
        assert_eq!(servo.target_rad(), 0.0);
        servo.advance(0.01173, RUDDER);
        assert!((servo.target_rad().to_degrees() - 20.0).abs() < 1e-9);
    }

    /// The caller's step does not matter, nor whether a pulse is announced early or late.
    #[test]
    fn division_of_time_does_not_matter() {
        let run = |steps: u32, late: bool| {
            let mut servo = Servo::new(ServoModel::S3003, 0.0, 0.0);
            if !late {
                servo.pulse(0.0, 2000.0);
            }
            for i in 1..=steps {
                if late && i == 1 {
                    servo.advance(0.002, RUDDER);
                    servo.pulse(0.0, 2000.0);
                }
                servo.advance(0.1 * f64::from(i) / f64::from(steps), RUDDER);
            }
            servo.crank().angle_rad
        };
        let fine = run(800, false);
        assert!((run(50, false) - fine).abs() < 1e-3);
        assert!((run(50, true) - fine).abs() < 1e-3);
        assert!(fine > 0.3);
    }

    /// 60 deg at full speed take 0.19 s; lag and approach come on top. A load of a quarter of the
    /// stall torque takes or gives a quarter of the speed, and the stall torque all of it.
    #[test]
    fn slew_is_that_of_the_data_sheet() {
        for (torque_n_m, share) in [(0.0, 1.0), (-0.1, 0.75), (0.1, 1.25), (-0.4, 0.0)] {
            let mut servo = Servo::new(ServoModel::S3003, -0.7, 0.0);
            servo.pulse(0.0, 2170.0);
            servo.advance(0.1, loaded(torque_n_m));
            let from = servo.gear_rad;
            servo.advance(0.15, loaded(torque_n_m));
            let speed = (servo.gear_rad - from) / 0.05;
            assert!((speed - share * 5.5116).abs() < 2e-3, "{speed} rad/s with {torque_n_m} N m");
        }
    }

    /// The motor's torque at a stand against all that it turns: 0.40 N m for 7.26e-4 kg m2 are
    /// 551 rad/s2, so that 5.51 rad/s are reached with a time constant of 10 ms.
    #[test]
    fn the_lag_follows_from_what_is_turned() {
        assert!((ServoModel::S3003.lag_s(RUDDER.inertia_kg_m2) - 0.010).abs() < 1e-5);
        assert!((ServoModel::DIGITAL.lag_s(RUDDER.inertia_kg_m2) - 0.0079).abs() < 5e-5);
        let speed_with = |inertia_kg_m2| {
            let mut servo = Servo::new(ServoModel::S3003, -0.7, 0.0);
            servo.pulse(0.0, 2170.0);
            servo.advance(0.00217 + 0.010, Load { torque_n_m: 0.0, inertia_kg_m2 });
            servo.speed_rad_s / 5.5116
        };
        let light = speed_with(RUDDER.inertia_kg_m2);
        assert!((light - (1.0 - (-1.0_f64).exp())).abs() < 2e-3, "{light}");
        let heavy = speed_with(2.0 * 7.26e-4 - 5.3e-5);
        assert!((heavy - (1.0 - (-0.5_f64).exp())).abs() < 2e-3, "{heavy}");
    }

    /// It holds a load with the part of its drive that an error makes: a quarter of the stall
    /// torque takes a quarter of the error that asks for full speed, 165 mrad.
    #[test]
    fn a_load_turns_the_servo_from_its_target() {
        let mut servo = Servo::new(ServoModel::S3003, 0.0, 0.0);
        for (until, torque_n_m) in [(1.0, -0.1), (2.0, 0.1)] {
            servo.pulse(servo.now_s, 1720.0);
            servo.advance(until, loaded(torque_n_m));
            let off = servo.gear_rad - servo.target_rad();
            assert!((off - 0.413 * torque_n_m).abs() < 4e-4, "{off} rad at {torque_n_m} N m");
        }
    }

    /// The data sheet's figures at 5 V are those at 6 V, scaled, to within 4 %.
    #[test]
    fn supply_scales_speed_and_torque_as_the_data_sheet_says() {
        let (rated, sheet) = (ServoModel::S3003, ServoModel::S3003_5V);
        assert!((5.0 / 6.0 * rated.speed_rad_s / sheet.speed_rad_s - 1.0).abs() < 0.04);
        assert!((5.0 / 6.0 * rated.stall_n_m / sheet.stall_n_m - 1.0).abs() < 0.02);
        let turned = |share: f64| {
            let mut servo = Servo::new(ServoModel::S3003, -0.7, 0.0);
            servo.set_supply(share);
            servo.pulse(0.0, 2170.0);
            servo.advance(0.1, RUDDER);
            let from = servo.crank().angle_rad;
            servo.advance(0.15, RUDDER);
            servo.crank().angle_rad - from
        };
        assert!((turned(0.8) / turned(1.0) - 0.8).abs() < 1e-3);
    }

    /// All of it at the start of a fast move, none in an idle one, and the load's share where it
    /// holds one.
    #[test]
    fn current_follows_the_motors_torque() {
        let mut servo = Servo::new(ServoModel::S3003, -0.7, 0.0);
        assert_eq!(servo.current_share(), 0.0);
        servo.pulse(0.0, 2170.0);
        servo.advance(0.00218, RUDDER);
        assert!((servo.current_share() - 1.0).abs() < 0.01);
        servo.advance(0.1, RUDDER);
        assert!(servo.current_share() < 0.01, "at full speed");
        servo.advance(2.0, RUDDER);
        servo.advance(2.1, loaded(0.1));
        assert!((servo.current_share() - 0.25).abs() < 0.01);
        servo.advance(2.2, loaded(-0.1));
        assert!((servo.current_share() - 0.25).abs() < 0.01);
    }

    #[test]
    fn pulses_are_counted_in_whole_microseconds() {
        let mut servo = Servo::new(ServoModel::S3003, 0.0, 0.0);
        servo.pulse(0.0, 1600.4);
        servo.advance(0.01, RUDDER);
        assert!((servo.target_rad().to_degrees() - 8.0).abs() < 1e-9);
    }

    #[test]
    fn the_deadband_leaves_small_errors_alone() {
        let mut servo = Servo::new(ServoModel { backlash_rad: 0.0, ..ServoModel::S3003 }, 0.0, 0.0);
        assert_eq!(settle(&mut servo, 1521.0, 1.0), 0.0);
        assert_eq!(settle(&mut servo, 1518.0, 1.0), 0.0);
        assert!(settle(&mut servo, 1524.0, 1.0) > 0.0);
    }

    /// Coming from either side, the crank rests half the play short of the gear train.
    #[test]
    fn backlash_is_a_play_operator() {
        // A slow position loop creeps up to its target and never passes it.
        let model = ServoModel { deadband_us: 0.0, loop_s: 0.060, ..ServoModel::S3003 };
        let mut servo = Servo::new(model, 0.0, 0.0);
        let from_below = settle(&mut servo, 1720.0, 2.0);
        settle(&mut servo, 1900.0, 2.0);
        let from_above = settle(&mut servo, 1720.0, 2.0);
        assert!((from_below.to_degrees() - 19.75).abs() < 1e-6);
        assert!((from_above.to_degrees() - 20.25).abs() < 1e-6);
    }

    #[test]
    fn travel_ends_at_65_deg_of_the_shaft() {
        let model = ServoModel::S3003.fitted(1523.6, -0.0191);
        assert!((model.crank_for_width(1523.6) + 0.0191).abs() < 1e-12);
        assert!((model.width_for_crank(-0.0191) - 1523.6).abs() < 1e-9);
        let mut servo = Servo::new(model, -0.0191, 0.0);
        let end = settle(&mut servo, 2400.0, 1.0);
        let shaft = (end - model.horn_rad).to_degrees();
        assert!((64.7..=65.0).contains(&shaft), "{shaft}");
    }

    #[test]
    fn without_pulses_the_servo_holds_or_goes_limp() {
        let mut hold = Servo::new(ServoModel::S3003, 0.0, 0.0);
        settle(&mut hold, 1620.0, 0.5);
        let held = hold.crank().angle_rad;
        hold.advance(2.0, loaded(0.1));
        assert_eq!(hold.crank().angle_rad, held);

        let signal_loss = SignalLoss::Limp { after_s: 0.1 };
        let mut limp = Servo::new(ServoModel { signal_loss, ..ServoModel::S3003 }, 0.0, 0.0);
        settle(&mut limp, 1620.0, 0.5);
        limp.advance(0.55, loaded(-0.1));
        assert!((limp.crank().angle_rad - held).abs() < 1e-12);
        limp.advance(0.9, loaded(-0.1));
        assert!(limp.crank().angle_rad < held - 0.2);
    }
}
