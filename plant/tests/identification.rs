//! Identification recovers a drone from records of the model's own flight, noise added.

use plant::Setup;
use plant::identify::{Estimate, IdentifyError, Reading, Record, identify, likeliest};
use plant::pitch_loop::{Measurement, Pd, PitchLoop};
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

/// A drone and servo that differ from the nominal ones.
fn truth() -> Setup {
    let mut setup = Setup::default();
    setup.drone.thrust_n *= 0.85;
    setup.drone.body_inertia_kg_m2 *= 1.15;
    setup.servo.speed_rad_s *= 0.88;
    setup.servo.horn_rad += 0.006;
    setup.timing.delay_s = 8e-3;
    setup
}

/// A release from `start` under a PD law with a chirp on top, as the firmware would log it.
fn record(setup: &Setup, start: f64, seconds: f64, seed: u64) -> Record {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    // The law knows the nominal drone only.
    let nominal = Setup::default();
    let mut law = Pd::new(1.0, 0.3, &nominal.drone.linkage(), setup.timing.control_s);
    let mut sim = PitchLoop::new(&setup.drone, setup.servo, setup.timing, start, 0.2).unwrap();
    let mut record = Record::default();
    let mut command = nominal.servo.width_for_crank(sim.sample().crank.angle_rad);
    let mut next_edge = 0.0;
    while sim.sample().time_s < seconds {
        sim.step(|m: Measurement| {
            let mut normal = || -> f64 { rng.sample(StandardNormal) };
            record.readings.push(Reading {
                time_s: m.time_s,
                pitch_rad: m.pitch_rad + 2e-3 * normal(),
                rate_rad_s: m.rate_rad_s + 10e-3 * normal(),
            });
            let chirp = 0.15 * ((6.0 + 4.0 * m.time_s) * m.time_s).sin();
            let crank = law.update(m) + chirp;
            command = nominal.servo.width_for_crank(crank);
            // The loop sends the width that its own servo needs: undo the horn's difference.
            crank + setup.servo.horn_rad
        });
        let now = sim.sample().time_s;
        if next_edge < now - 1e-9 {
            record.pulses.push((next_edge, command));
            next_edge += setup.timing.frame_s;
        }
    }
    record
}

fn near(estimate: &Estimate, truth: f64, most: f64) {
    let error = (estimate.value - truth).abs();
    assert!(error < most, "{estimate:?}, truth {truth}");
    assert!(error < 4.0 * estimate.deviation, "{estimate:?}, truth {truth}");
}

#[test]
fn a_release_with_a_chirp_gives_the_drone_back() {
    let truth = truth();
    let found = identify(&Setup::default(), &[record(&truth, 0.8, 2.5, 3)]).unwrap();
    let [thrust, inertia, speed, delay, horn] = found.estimates[..] else {
        panic!("five estimates, not {:?}", found.estimates);
    };
    let (drone, nominal) = (truth.drone, Setup::default().drone);
    near(&thrust, drone.thrust_n, 0.05 * drone.thrust_n);
    near(&inertia, drone.body_inertia_kg_m2, 0.05 * drone.body_inertia_kg_m2);
    near(&speed, truth.servo.speed_rad_s, 0.03 * truth.servo.speed_rad_s);
    near(&delay, truth.timing.delay_s, 1e-3);
    near(&horn, truth.servo.horn_rad, 1e-3);
    // Thrust over inertia is known best: 4.01 N m/rad over 0.127 kg m2, scaled as the truth was.
    let total = 0.12699 + drone.body_inertia_kg_m2 - nominal.body_inertia_kg_m2;
    let gain = 31.615 * 0.85 * 0.12699 / total;
    near(&found.pitch_gain, gain, 0.01 * gain);
    assert!(found.pitch_gain.deviation / gain < 0.2 * thrust.deviation / thrust.value);
    assert!(found.explains());
    assert_eq!(found.alike, [["thrust_n", "body_inertia_kg_m2"]]);
    // The noise that was put in is what is left over.
    assert!((found.pitch_rms_rad - 2e-3).abs() < 2e-4, "{}", found.pitch_rms_rad);
    assert_eq!(Setup::parse(&found.setup.to_toml()).unwrap(), found.setup);
}

#[test]
fn two_records_tell_more_than_one() {
    let truth = truth();
    let [first, second] =
        [(0.4, 5), (0.6, 6)].map(|(start, seed)| record(&truth, start, 1.0, seed));
    let of = |records: &[Record]| identify(&Setup::default(), records).unwrap();
    let (alone, both) = (of(std::slice::from_ref(&first)), of(&[first, second]));
    assert!(both.pitch_gain.deviation < alone.pitch_gain.deviation);
    assert!(both.explains());
    near(&both.estimates[2], truth.servo.speed_rad_s, 0.03 * truth.servo.speed_rad_s);
}

#[test]
fn of_two_timings_of_the_pulses_the_right_one_is_found() {
    let right = record(&truth(), 0.8, 1.0, 7);
    let mut wrong = right.clone();
    wrong.pulses.iter_mut().for_each(|(edge_s, _)| *edge_s -= 13e-3);
    let ways = vec![wrong.clone(), right.clone()];
    assert_eq!(likeliest(&Setup::default(), ways).unwrap(), right);
    assert_eq!(likeliest(&Setup::default(), vec![right.clone(), wrong]).unwrap(), right);
}

#[test]
fn records_that_say_nothing_are_refused() {
    let nominal = Setup::default();
    let good = record(&nominal, 0.4, 1.0, 1);
    let spoil = |f: fn(&mut Record)| {
        let mut record = good.clone();
        f(&mut record);
        identify(&nominal, &[record]).unwrap_err()
    };
    assert!(matches!(spoil(|r| r.readings.truncate(10)), IdentifyError::TooShort { .. }));
    assert_eq!(spoil(|r| r.readings[7].pitch_rad = f64::NAN), IdentifyError::BadSample(7));
    assert_eq!(spoil(|r| r.pulses.swap(3, 4)), IdentifyError::BadSample(4));
    let still = spoil(|r| r.readings.iter_mut().for_each(|r| r.pitch_rad = 0.1));
    assert_eq!(still, IdentifyError::NoMotion);
}
