//! What a flight remembers, taken over by another.

use super::*;

fn words(flight: &Flight) -> Vec<i32> {
    let mut words = Vec::new();
    flight.tell(&mut |word| words.push(word));
    words
}

/// A sample with noise, and now and then none.
fn shaken(desk: &Desk, step: usize) -> Result<RawSample, SensorFault> {
    let noise = |prime: usize| (step * prime % 13) as i16 - 6;
    let mut sample = reading(desk.now_us, desk.pitch, desk.rate);
    (sample.gyr[0], sample.gyr[2]) = (noise(7), noise(11));
    (sample.acc[1], sample.mag[1]) = (noise(3), noise(5));
    if step.is_multiple_of(37) { Err(SensorFault::Nak) } else { Ok(sample) }
}

/// Both are given the same, and must remember the same after every step.
#[test]
fn another_flight_goes_on_from_it_with_the_same_bits() {
    for before in [1, 130, 255, 411] {
        for start in [Desk::in_standby as fn(f64) -> Desk, Desk::active] {
            let mut desk = start(0.8);
            let taken = |desk: &mut Desk, step| {
                let sample = shaken(desk, step);
                desk.step_with(sample)
            };
            for step in 1..before {
                taken(&mut desk, step);
            }
            let snapshot = taken(&mut desk, before);
            let remembered = words(&desk.flight);
            assert_eq!(remembered.len(), Flight::WORDS);
            let mut other = Flight::new(params(), BootReport::default()).unwrap();
            assert!(other.resume(&snapshot.sample.unwrap(), &remembered));
            let mut refresh = desk.refresh;
            for step in before..before + 600 {
                let now = Micros(desk.now_us);
                let sample = shaken(&desk, step);
                let again = sample.map(|raw| refresh.read(raw));
                let (here, there) = (desk.step_with(sample), other.step(now, again));
                assert_eq!(here.pulses[0], there.pulses[0], "{before}, {step}");
                assert_eq!(here.state, there.state, "{before}, {step}");
                assert_eq!(words(&desk.flight), words(&other), "{before}, {step}");
                let bits = |flight: &Flight| {
                    let Attitude { orientation: q, rate, .. } = flight.attitude();
                    [q.w, q.x, q.y, q.z, rate[0], rate[1], rate[2]].map(f32::to_bits)
                };
                assert_eq!(bits(&desk.flight), bits(&other), "{before}, {step}");
            }
        }
    }
}

#[test]
fn a_failsafe_is_taken_over_and_acknowledged() {
    let mut desk = Desk::active(0.4);
    desk.run(5);
    for _ in 0..20 {
        desk.step_with(Err(SensorFault::Nak));
    }
    let snapshot = desk.run(200);
    assert!(matches!(snapshot.state, State::Failsafe(_)));
    let mut other = Flight::new(params(), BootReport::default()).unwrap();
    assert!(other.resume(&snapshot.sample.unwrap(), &words(&desk.flight)));
    assert_eq!(other.state().code(), snapshot.state.code());
    let now = Micros(desk.now_us);
    assert_eq!(other.command(now, Command::Disarm), desk.command(Command::Disarm));
    assert_eq!(other.state(), desk.flight.state());
}

#[test]
fn other_parameters_and_words_that_mean_nothing_are_told() {
    let mut desk = Desk::in_standby(0.1);
    let sample = desk.run(1).sample.unwrap();
    let remembered = words(&desk.flight);
    let mut other = Flight::new(params(), BootReport::default()).unwrap();
    other.set_param("PID_KP", 0.7).unwrap();
    assert!(!other.resume(&sample, &remembered));
    assert!(!other.resume(&sample, &[]));
}
