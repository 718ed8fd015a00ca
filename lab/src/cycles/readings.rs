//! The input of the control laws: a release that each flies by itself, and readings that are hard
//! on them, all with what the same law on the host puts out.

use ::cycles::{Input, PERIOD_S};
use plant::ServoModel;
use rand::Rng;
use rand::rngs::StdRng;
use tvc_pid::SurfaceConfig;

use super::hard;
use super::laws::Law;

/// Updates of the release: 2 s.
const RELEASE: usize = 300;

/// Where it begins, rad, and what pushes all the time, rad of the servo.
const START_RAD: f64 = 0.4;
const PUSH_RAD: f64 = 0.03;
/// Inertia that the nominal drone's crank feels, kg m2.
const RUDDER_KG_M2: f64 = 6.73e-4;

/// Updates in a frame of the servo.
const UPDATES_A_FRAME: usize = 3;

/// Time between two new rates of the sensor, s: nearly 100 Hz, by a clock of its own.
const REFRESH_S: f64 = 10.1e-3;

/// A count of the sensor's rate, rad/s: 1/16 deg/s.
const COUNT_RAD_S: f64 = 1.0908e-3;

/// Steps of the physics between two updates.
const FINE: usize = 100;

/// Updates of each sort of hard input.
const HARD_UPDATES: usize = 256;

/// One update, and what the law on the host puts out.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// What the update is given.
    pub input: Input,
    /// The output's word.
    pub output: u32,
}

/// A sort of input that follows the release, and that follows the start.
pub struct Hard {
    /// What it is, in words.
    pub name: &'static str,
    /// Updates after the release.
    pub after_release: Vec<Step>,
    /// Updates of a law at rest.
    pub from_rest: Vec<Step>,
}

/// Flies `law` out of a held tilt: a servo with lag and limited speed on a double integrator.
pub fn release(law: &Law) -> Vec<Step> {
    let SurfaceConfig { plant_gain, effect_s, sensor_lag_s, actuator_rate, .. } =
        ::cycles::surface();
    // The servo itself, of which the surface's gains have a model as it is best taken to be.
    let ServoModel { loop_s, .. } = ServoModel::S3003;
    let lag_s = ServoModel::S3003.lag_s(RUDDER_KG_M2);
    let wide = f64::from;
    let speed_limit = wide(actuator_rate);
    let dt = wide(PERIOD_S) / FINE as f64;
    let word = |number: f64| (law.word)(number as f32);
    let mut control = (law.make)();
    let (mut value, mut rate, mut lagged) = (START_RAD, 0.0, 0.0);
    let (mut actuator, mut speed, mut target) = (0.0, 0.0_f64, 0.0);
    // An output on its way to the servo, and the time until it is there.
    let (mut sent, mut effect_in_s) = (0.0, f64::INFINITY);
    let mut reading = (value, 0.0);
    let (mut is_new, mut age_s) = (true, 0.0);
    (0..RELEASE)
        .map(|index| {
            let is_sent = (index + 1).is_multiple_of(UPDATES_A_FRAME);
            let input = Input {
                setpoint: word(0.0),
                value: word(reading.0),
                rate: word(reading.1),
                age: word(age_s / wide(PERIOD_S)),
                value_lead: word(wide(sensor_lag_s) / wide(PERIOD_S)),
                is_new: is_new.into(),
                is_sent: is_sent.into(),
            };
            let output = control.update(&input);
            is_new = false;
            if is_sent {
                (sent, effect_in_s) = (wide((law.number)(output)), wide(effect_s));
            }
            for _ in 0..FINE {
                effect_in_s -= dt;
                if effect_in_s <= 0.0 {
                    (target, effect_in_s) = (sent, f64::INFINITY);
                }
                let asked = (target - actuator) / loop_s;
                let asked = asked.clamp(-speed_limit, speed_limit);
                speed += dt / lag_s * (asked - speed);
                actuator += dt * speed;
                rate += dt * wide(plant_gain) * (actuator + PUSH_RAD);
                value += dt * rate;
                lagged += dt / wide(sensor_lag_s) * (rate - lagged);
                age_s += dt;
                if age_s >= REFRESH_S {
                    let counted = (lagged / COUNT_RAD_S).round() * COUNT_RAD_S;
                    (reading, is_new) = ((value, counted), true);
                    age_s -= REFRESH_S;
                }
            }
            Step { input, output }
        })
        .collect()
}

/// What changes an input of the release into a hard one, by the words of the law's numbers.
type Change = fn(&mut Input, fn(f32) -> u32, &mut StdRng);

/// The sorts of hard input.
const HARD: [(&str, Change); 11] = [
    ("held", |i, word, _| {
        (i.value, i.rate, i.is_new) = (word(0.3), word(0.0), 1);
    }),
    ("saturated rates", |i, word, rng| {
        let rate = if rng.random() { 35.0 } else { -35.0 };
        (i.value, i.rate) = (word(within(4.0, rng)), word(rate));
    }),
    ("large values", |i, word, rng| {
        (i.value, i.rate) = (word(within(3e4, rng)), word(within(3e4, rng)));
    }),
    ("values of all sizes", |i, word, rng| {
        (i.value, i.rate) = (word(of_any_size(rng)), word(of_any_size(rng)));
    }),
    ("steps of the setpoint", |i, word, rng| {
        i.setpoint = word(within(1.0, rng));
    }),
    ("no new rates", |i, _, _| i.is_new = 0),
    ("old readings", |i, word, rng| {
        (i.age, i.value_lead) = (word(within(100.0, rng)), word(within(100.0, rng)));
        i.is_new = 1;
    }),
    ("random", random),
    ("random with jitter", |i, word, rng| {
        random(i, word, rng);
        i.is_sent = rng.random_range(0..2);
        i.is_new = rng.random_range(0..2);
    }),
    ("no numbers", |i, word, rng| {
        let number = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][rng.random_range(0..3)];
        let place = [&mut i.value, &mut i.rate, &mut i.setpoint];
        *place.into_iter().nth(rng.random_range(0..3)).expect("one of three") = word(number);
    }),
    ("random bits", |i, _, rng| {
        (i.setpoint, i.value, i.rate) = rng.random();
        (i.age, i.value_lead) = rng.random();
        i.is_new = rng.random_range(0..2);
    }),
];

fn random(input: &mut Input, word: fn(f32) -> u32, rng: &mut StdRng) {
    input.value = word(within(4.0, rng));
    input.rate = word(within(40.0, rng));
    input.age = word(rng.random_range(0.0..0.03));
}

fn within(limit: f32, rng: &mut StdRng) -> f32 {
    rng.random_range(-limit..limit)
}

/// From numbers that are lost beside others, subnormal ones included, to those that no law uses.
fn of_any_size(rng: &mut StdRng) -> f32 {
    let exponent_bits = rng.random_range(0..0xff) << 23;
    f32::from_bits(rng.random_range(0..1 << 23) | exponent_bits).copysign(within(1.0, rng))
}

/// All sorts of hard input, and four times as many by turns, made of the inputs of the `release`.
pub fn hard(law: &Law, release: &[Step]) -> Vec<Hard> {
    let plain: Vec<Input> = release.iter().map(|step| step.input).collect();
    let change = |change: Change, input: &mut Input, rng: &mut StdRng| change(input, law.word, rng);
    let sorts = hard::sorts(&plain, &HARD, [HARD_UPDATES, 4 * HARD_UPDATES], change);
    let with_outputs = sorts.into_iter().map(|(name, inputs)| {
        let mut released = (law.make)();
        for input in &plain {
            released.update(input);
        }
        Hard {
            name,
            after_release: steps(released, &inputs),
            from_rest: steps((law.make)(), &inputs),
        }
    });
    with_outputs.collect()
}

fn steps(mut law: Box<dyn ::cycles::Law>, inputs: &[Input]) -> Vec<Step> {
    let mut step = |&input: &Input| Step { input, output: law.update(&input) };
    inputs.iter().map(&mut step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycles::laws;

    /// A law that were given something else than it expects would not come to rest.
    #[test]
    fn every_law_flies_its_release_to_rest() {
        for law in laws::all() {
            let release = release(&law);
            let far = release[200..]
                .iter()
                .map(|step| (law.number)(step.input.value).abs())
                .fold(0.0, f32::max);
            assert!(far < 0.05, "{law}: {far}");
        }
    }

    #[test]
    fn readings_of_the_release_are_as_a_sensor_with_a_clock_of_its_own_gives_them() {
        let law = &laws::all()[0];
        let release = release(law);
        let repeated = release.iter().filter(|s| s.input.is_new == 0).count();
        assert!((90..110).contains(&repeated), "{repeated}");
        let ages = release.iter().map(|s| (law.number)(s.input.age));
        assert!(ages.clone().all(|age| (0.0..1.53).contains(&age)));
        assert!(ages.clone().any(|age| age < 0.075) && ages.clone().any(|age| age > 1.425));
    }

    #[test]
    fn inputs_on_which_a_law_puts_out_a_number_are_most() {
        for law in laws::all() {
            let release = release(&law);
            for sort in hard(&law, &release) {
                let outputs = sort.from_rest.iter().chain(&sort.after_release);
                let numbers = outputs.filter(|step| (law.number)(step.output).is_finite());
                let share = numbers.count() as f64 / (2 * sort.from_rest.len()) as f64;
                assert!(law.name == "pd" || share == 1.0, "{law}, {}: {share}", sort.name);
            }
        }
    }
}
