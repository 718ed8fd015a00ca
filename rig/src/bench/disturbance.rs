//! What disturbs a flight besides faults of the sensor: the propeller shakes, the servo's supply sags, the
//! thrust comes up slowly, the sensor warms up. All but the last counts from the moment that the clamp opens.

use std::f64::consts::TAU;

use crate::bno055::{ImuErrors, WarmUp};

/// Supply at which the figures of the rig's servos hold, V.
pub const RATED_SUPPLY_V: f64 = 6.0;
/// Arm over which a shaking mount tilts the sensor, m: half the drone's width, an estimate.
const MOUNT_ARM_M: f64 = 0.1;

/// Disturbances of a flight; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disturbances {
    /// The propeller is out of balance.
    pub vibration: Option<Vibration>,
    /// The servo's supply is not what it should be.
    pub supply: Option<SupplySag>,
    /// The thrust is not there at once.
    pub thrust: Option<ThrustRamp>,
    /// The sensor is not at its temperature yet.
    pub temperature: Option<Temperature>,
}

/// An unbalanced propeller at a constant speed. Its force turns in the plane of the propeller, across
/// the body's z axis; the mount yields, and tilts the sensor at the same frequency.
///
/// The sensor feels it at every step of the physics, before its own filter and its own clock: what
/// lies above half its refresh rate arrives as an alias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vibration {
    /// Amplitude along the body's x and y, m/s^2.
    pub force_m_s2: f64,
    /// Amplitude of the angular rate about the body's x and y, rad/s.
    pub rate_rad_s: f64,
    /// Turns of the propeller a second, at most [`Vibration::HIGHEST_HZ`].
    pub frequency_hz: f64,
}

impl Vibration {
    /// Above this the steps of the physics, 0.5 ms, are too coarse for a sine.
    pub const HIGHEST_HZ: f64 = 400.0;

    /// A vibration of `force_m_s2` whose mount tilts as if it gave way over an arm of 0.1 m:
    /// the rate is the vibration's speed over that.
    pub fn new(force_m_s2: f64, frequency_hz: f64) -> Self {
        Self {
            force_m_s2,
            rate_rad_s: force_m_s2 / (TAU * frequency_hz) / MOUNT_ARM_M,
            frequency_hz,
        }
    }

    /// Specific force (m/s^2) and rate (rad/s) along the body's axes at a time, s.
    pub(crate) fn at(&self, time_s: f64) -> ([f64; 3], [f64; 3]) {
        let (sin, cos) = (TAU * self.frequency_hz * time_s).sin_cos();
        (
            [self.force_m_s2 * cos, self.force_m_s2 * sin, 0.0],
            [self.rate_rad_s * cos, self.rate_rad_s * sin, 0.0],
        )
    }
}

/// The servo's supply is at `volts` for a while, and at 6 V otherwise; meanwhile it gives way to the servo's current.
///
/// Speed without load and stall torque follow the supply in proportion: the data sheet's step from
/// 6 V to 5 V, 0.19 to 0.22 s and 0.40 to 0.33 N m, is that to within 4 %. The current is that of a DC motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupplySag {
    /// Supply meanwhile without current, V.
    pub volts: f64,
    /// Supply meanwhile at the current that the servo draws when it stalls at 6 V, V; `volts` for a stiff one.
    pub stall_volts: f64,
    /// Begin after the release, s.
    pub from_s: f64,
    /// End after the release, s; infinite for the rest of the flight.
    pub until_s: f64,
}

impl SupplySag {
    /// The supply as a share of the rated one at a time after the release, s, while the servo draws this share of its
    /// stall current.
    pub(crate) fn share(&self, since_release_s: f64, current_share: f64) -> f64 {
        if (self.from_s..self.until_s).contains(&since_release_s) {
            let drop = (self.volts - self.stall_volts) * current_share.min(1.0);
            (self.volts - drop) / RATED_SUPPLY_V
        } else {
            1.0
        }
    }
}

/// Thrust that grows evenly to its whole from the release on; in the clamp it is at its beginning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustRamp {
    /// Share of the thrust at release, 0 to 1.
    pub from_share: f64,
    /// Time to the whole thrust, s.
    pub seconds: f64,
}

impl ThrustRamp {
    /// Share of the thrust at a time after the release, s.
    pub(crate) fn share(&self, since_release_s: f64) -> f64 {
        if since_release_s >= self.seconds {
            1.0
        } else {
            self.from_share + (1.0 - self.from_share) * since_release_s / self.seconds
        }
    }
}

/// The sensor warms up from power-on, and its offsets drift on every axis alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Temperature {
    /// The chip's temperature.
    pub warm_up: WarmUp,
    /// Drift of the gyroscope's bias, rad/s/K.
    pub gyro_rad_s_k: f64,
    /// Drift of the accelerometer's offset, m/s^2/K.
    pub acc_m_s2_k: f64,
}

impl Temperature {
    /// The imperfections of a sensor with these.
    pub(crate) fn of(&self, errors: ImuErrors) -> ImuErrors {
        ImuErrors {
            warm_up: self.warm_up,
            gyro_drift_rad_s_k: [self.gyro_rad_s_k; 3],
            acc_drift_m_s2_k: [self.acc_m_s2_k; 3],
            ..errors
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{BenchConfig, Environment, SERVO_PIN};
    use samd21::board::{Board, Ticks};

    fn environment(disturbances: Disturbances) -> Environment {
        Environment::new(&BenchConfig {
            disturbances,
            ..BenchConfig::default()
        })
        .unwrap()
    }

    /// Pulses of `width_us` for 200 ms from the release on.
    fn steered(mut environment: Environment, width_us: u64) -> Environment {
        environment.release(0.0);
        for frame in 0..10 {
            let rise = Ticks::from_ms(20 * frame);
            environment.pin(rise, SERVO_PIN, true);
            environment.pin(rise + Ticks::from_us(width_us), SERVO_PIN, false);
        }
        environment.advance(Ticks::from_ms(200));
        environment
    }

    /// Crank angle, rad, `ms` after the power came on.
    fn crank_at(environment: &Environment, ms: u64) -> f64 {
        let motion = &environment.truth().motion;
        let at = motion.partition_point(|m| m.time < Ticks::from_ms(ms));
        motion[at].crank_rad
    }

    fn stiff(volts: f64) -> SupplySag {
        SupplySag {
            volts,
            stall_volts: volts,
            from_s: 0.0,
            until_s: f64::INFINITY,
        }
    }

    fn steered_on(supply: Option<SupplySag>) -> Environment {
        let disturbances = Disturbances {
            supply,
            ..Disturbances::default()
        };
        steered(environment(disturbances), 2150)
    }

    fn slew_rad_s(supply: Option<SupplySag>) -> f64 {
        let environment = steered_on(supply);
        (crank_at(&environment, 100) - crank_at(&environment, 60)) / 0.040
    }

    /// The load of the wash takes its part of the speed at either supply, hence more than the ratio
    /// of the voltages.
    #[test]
    fn a_servo_at_4_8_v_slews_at_four_fifths_of_its_speed() {
        let (full, low) = (slew_rad_s(None), slew_rad_s(Some(stiff(4.8))));
        assert!((0.75..=0.82).contains(&(low / full)), "{low} of {full}");
        assert_eq!(slew_rad_s(Some(stiff(RATED_SUPPLY_V))), full);
    }

    /// A motor that starts draws its stall current, and one that turns little: a weak supply costs the start of a move
    /// most, and at full speed only what the load of the wash asks for.
    #[test]
    fn a_weak_supply_gives_way_to_the_servos_current() {
        let weak = SupplySag {
            stall_volts: 3.0,
            ..stiff(6.0)
        };
        // The first pulse ends at 2.15 ms.
        let start = |supply| {
            let environment = steered_on(Some(supply));
            crank_at(&environment, 12) - crank_at(&environment, 1)
        };
        let begun = start(weak) / start(stiff(6.0));
        assert!((0.5..0.8).contains(&begun), "{begun}");
        let fast = slew_rad_s(Some(weak)) / slew_rad_s(None);
        assert!((0.85..0.99).contains(&fast), "{fast}");
    }

    /// 30 K in the end at 0.03 deg/s/K; nothing of it changes the sensor's noise or bias at 25 deg C.
    #[test]
    fn a_sensor_that_warms_up_drifts_from_power_on() {
        let bias_after = |temperature, ms| {
            let mut environment = environment(Disturbances {
                temperature,
                ..Disturbances::default()
            });
            environment.advance(Ticks::from_ms(ms));
            environment.sensor().gyro_bias_rad_s()[1].to_degrees()
        };
        let temperature = Temperature {
            warm_up: WarmUp {
                from_c: 25.0,
                to_c: 55.0,
                time_constant_s: 1.0,
            },
            gyro_rad_s_k: 0.03_f64.to_radians(),
            acc_m_s2_k: 0.0,
        };
        for (ms, share) in [(1, 0.001), (1000, 0.632), (8000, 0.9997)] {
            let drift = bias_after(Some(temperature), ms) - bias_after(None, ms);
            assert!((drift - 0.9 * share).abs() < 1e-3, "{ms} ms: {drift}");
        }
    }

    #[test]
    fn a_sag_begins_and_ends() {
        let sag = SupplySag {
            volts: 4.5,
            stall_volts: 3.0,
            from_s: 0.1,
            until_s: 0.3,
        };
        let shares = [0.0, 0.1, 0.299, 0.3].map(|s| sag.share(s, 0.0));
        assert_eq!(shares, [1.0, 0.75, 0.75, 1.0]);
        let shares = [0.0, 0.5, 1.0, 2.0].map(|current| sag.share(0.2, current));
        assert_eq!(shares, [0.75, 0.625, 0.5, 0.5]);
    }

    /// The rudder's moment is proportional to the thrust: a drone whose rudder is over gains half the
    /// rate under half the thrust. Gravity is off: the tilt does not matter.
    #[test]
    fn half_the_thrust_turns_the_drone_half_as_fast() {
        let rate_after = |thrust: Option<ThrustRamp>| {
            let mut bench = BenchConfig::default();
            bench.parameters.gravity_m_s2 = 0.0;
            bench.disturbances.thrust = thrust;
            let environment = steered(Environment::new(&bench).unwrap(), 1600);
            let last = environment.truth().motion.last().unwrap();
            (last.rate_rad_s, last.rudder_rad)
        };
        let (whole, rudder) = rate_after(None);
        let held = ThrustRamp {
            from_share: 0.5,
            seconds: 1e6,
        };
        let (half, same_rudder) = rate_after(Some(held));
        assert!((rudder - same_rudder).abs() < 0.01);
        assert!((half / whole - 0.5).abs() < 0.03, "{half} of {whole}");
        let ramp = ThrustRamp {
            from_share: 0.5,
            seconds: 0.2,
        };
        let (between, _) = rate_after(Some(ramp));
        assert!((0.6..0.95).contains(&(between / whole)), "{between}");
        let at_once = ThrustRamp {
            from_share: 1.0,
            seconds: 1.0,
        };
        assert_eq!(rate_after(Some(at_once)).0, whole);
    }

    /// 180 Hz past the accelerometer's 62.5 Hz low-pass and its 100 Hz refresh come out at 20 Hz with a
    /// third of their amplitude.
    #[test]
    fn what_the_sensor_is_too_slow_for_arrives_as_an_alias() {
        use crate::bno055::{ImuErrors, Sensors, Stimulus};
        let shaking = Vibration::new(5.0, 180.0);
        let mut sensors = Sensors::new(ImuErrors::NONE, 1);
        let mut sums = [[0.0; 2]; 2];
        let refreshes = 200;
        for step in 1..=refreshes * 20 {
            let now = Ticks::from_us(500 * step);
            let (force, rate_rad_s) = shaking.at(now.as_secs_f64());
            let truth = Stimulus {
                specific_force_m_s2: [force[0], force[1], -9.81],
                rate_rad_s,
                ..Stimulus::REST
            };
            sensors.sense(now, &truth);
            if step % 20 == 0 {
                let acc = f64::from(sensors.refresh(now).unwrap().acc[0]) * 0.01;
                for (sum, hz) in sums.iter_mut().zip([20.0, 30.0]) {
                    let (sin, cos) = (TAU * hz * now.as_secs_f64()).sin_cos();
                    sum[0] += acc * cos;
                    sum[1] += acc * sin;
                }
            }
        }
        let [alias, elsewhere] =
            sums.map(|[cos, sin]| 2.0 * f64::hypot(cos, sin) / refreshes as f64);
        let passed = 5.0 / f64::hypot(1.0, 180.0 / 62.5);
        assert!((alias / passed - 1.0).abs() < 0.15, "{alias} of {passed}");
        assert!(elsewhere < 0.05, "{elsewhere}");
    }

    #[test]
    fn a_vibration_turns_in_the_propellers_plane() {
        let shaking = Vibration::new(5.0, 180.0);
        assert!((shaking.rate_rad_s.to_degrees() - 2.53).abs() < 0.01);
        let (force, rate) = shaking.at(0.25 / 180.0);
        assert!(force[0].abs() < 1e-9 && (force[1] - 5.0).abs() < 1e-9 && force[2] == 0.0);
        assert!((rate[1] - shaking.rate_rad_s).abs() < 1e-9);
    }
}
