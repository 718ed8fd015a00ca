use super::*;
use std::vec::Vec;

/// A launch by 15 m/s2 for 0.1 s, a burnout below 5 m/s2, and the end after 3 s.
fn launch(changes: &[(&str, f32)]) -> Watcher {
    let mut params = Params::default();
    let given = [
        ("LAUNCH_ACC", 15.0),
        ("LAUNCH_S", 0.1),
        ("BURNOUT_ACC", 5.0),
        ("BURN_S", 3.0),
        ("FUSE_ACC", 0.0),
    ];
    for (name, value) in given.iter().chain(changes) {
        params.set(name, *value).unwrap();
    }
    Watcher { settings: Settings::new(&params), launch: Launch::default() }
}

struct Watcher {
    settings: Settings,
    launch: Launch,
}

impl Watcher {
    fn watch(&mut self, at: Micros, acceleration: i32, state: &State) -> Option<Event> {
        self.launch.watch(&self.settings, at, acceleration, state)
    }

    fn is_free(&self, state: &State) -> bool {
        self.launch.is_free(&self.settings, state)
    }
}

const ACTIVE: State = State::Active { over_tilt_since: None };

/// Takes samples every 10 ms from a time (ms) on, as a vehicle that obeys; what happened, and when.
fn fly(launch: &mut Watcher, from_ms: u64, accelerations: &[(usize, i32)]) -> Vec<(u64, Event)> {
    let mut state = State::Armed;
    let mut events = Vec::new();
    let counts =
        accelerations.iter().flat_map(|(samples, counts)| std::iter::repeat_n(*counts, *samples));
    for (index, counts) in counts.enumerate() {
        let at_ms = from_ms + 10 * index as u64;
        if let Some(event) = launch.watch(Micros(1_000 * at_ms), counts, &state) {
            state = match event {
                Event::Launch => ACTIVE,
                Event::End => State::Standby,
            };
            events.push((at_ms, event));
        }
    }
    events
}

#[test]
fn thrust_that_lasts_is_a_launch_and_its_end_the_burnout() {
    let mut launch = launch(&[]);
    // On the pad, a knock of 50 ms, the pad again, a burn of a second, and free fall.
    let burn = [(100, 981), (5, 4_000), (50, 981), (100, 2_500), (50, 0)];
    assert_eq!(
        fly(&mut launch, 500, &burn),
        [(500 + 1_550 + 100, Event::Launch), (500 + 2_550 + 200, Event::End)]
    );
}

#[test]
fn control_ends_by_time_where_the_engine_burns_on() {
    let mut launch = launch(&[]);
    let burn = [(10, 981), (500, 2_500)];
    // The time counts from the first thrust.
    assert_eq!(fly(&mut launch, 0, &burn), [(200, Event::Launch), (100 + 3_000, Event::End)]);
}

#[test]
fn nothing_happens_where_no_parameter_asks_for_it() {
    let mut launch =
        launch(&[("LAUNCH_ACC", 0.0), ("BURNOUT_ACC", 0.0), ("BURN_S", 0.0), ("FUSE_ACC", 1.0)]);
    assert!(!launch.settings.is_needed());
    assert_eq!(fly(&mut launch, 0, &[(300, 4_000), (300, 0)]), []);
    assert!(!launch.is_free(&ACTIVE));
}

#[test]
fn an_engine_that_never_burned_has_no_burnout() {
    let mut launch = launch(&[("LAUNCH_ACC", 0.0), ("BURN_S", 0.0)]);
    for index in 0..100 {
        assert_eq!(launch.watch(Micros(10_000 * index), 0, &ACTIVE), None);
    }
}

/// Released by an order, the time counts from the first sample in control.
#[test]
fn the_time_counts_from_the_release() {
    let mut launch = launch(&[("LAUNCH_ACC", 0.0)]);
    launch.watch(Micros(1_000_000), 981, &State::Armed);
    assert_eq!(launch.launch.seconds(), Q16::from(0.0));
    for at_ms in [1_010, 1_020, 2_510] {
        launch.watch(Micros(1_000 * at_ms), 2_500, &ACTIVE);
    }
    let seconds = f32::from(launch.launch.seconds());
    assert!((seconds - 1.5).abs() < 1e-4, "{seconds}");
    launch.watch(Micros(3_000_000), 0, &State::Standby);
    assert_eq!(launch.launch.seconds(), Q16::from(0.0));
}

#[test]
fn the_attitude_is_free_from_the_first_thrust_to_the_end_of_control() {
    let mut launch = launch(&[]);
    assert!(launch.is_free(&ACTIVE));
    assert!(!launch.is_free(&State::Armed));
    assert!(!launch.is_free(&State::Standby));
    launch.watch(Micros(1_000), 2_000, &State::Armed);
    assert!(launch.is_free(&State::Armed));
    launch.watch(Micros(2_000), 981, &State::Armed);
    assert!(!launch.is_free(&State::Armed));
}

/// After 20 s at 2 g, with 0.1 deg/s for each g: 4 deg, 0.2 of the offset and 0.3 of the pad.
#[test]
fn the_tilt_is_the_less_certain_the_longer_and_harder_the_flight() {
    let mut launch = launch(&[]);
    launch.watch(Micros(10_000), 1_961, &State::Armed);
    for index in 2..2_002 {
        launch.watch(Micros(10_000 * index), 1_961, &ACTIVE);
    }
    let mut params = Params::default();
    let mut sd_deg = |per_g| {
        params.set("GYR_PER_G", per_g).unwrap();
        launch.launch.tilt_sd_deg(&params)
    };
    let (bent, steady) = (sd_deg(0.1), sd_deg(0.0));
    assert!((bent - 4.02).abs() < 0.02, "{bent}");
    let expected = (0.09_f32 + 0.04 + 0.014 * 0.014 * 20.0).sqrt();
    assert!((steady - expected).abs() < 1e-3, "{steady} {expected}");
}

#[test]
fn roots_are_those_of_the_library() {
    for square in [0.01_f32, 0.09, 1.0, 2.0, 50.0, 1e4, 1e6] {
        assert!((root(square) / square.sqrt() - 1.0).abs() < 1e-4, "{square}");
    }
}
