//! Flights of the image with a sensor that fails, replayed.

use super::*;
use client::Wire;
use client::request::{self, Order};
use flights::log::{Flight as Logged, Log};
use rig::bench::VehicleConfig;
use rig::bno055::Fault;
use rig::rocket::{self, Airframe, RocketLaw};
use rig::{Image, Rig, RigConfig, Ticks, image};
use std::sync::OnceLock;

fn firmware() -> &'static Image {
    static IMAGE: OnceLock<Image> = OnceLock::new();
    IMAGE.get_or_init(|| image::build(&mut |line| eprintln!("{line}")).unwrap())
}

/// The rig with somebody who keeps every byte, as a `.tlog` has it.
struct Bench {
    rig: Rig,
    station: Wire,
    vehicle: Wire,
    log: Vec<u8>,
}

impl Bench {
    fn new() -> Self {
        Self::with(&RigConfig { stored: Some(RigConfig::polarity_set()), ..RigConfig::default() })
    }

    fn with(config: &RigConfig) -> Self {
        Self {
            rig: Rig::new(firmware(), config).unwrap(),
            station: Wire::default(),
            vehicle: Wire::default(),
            log: Vec::new(),
        }
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.rig.run_for(Ticks::from_ms(1)).unwrap();
            let bytes = self.rig.usb_read();
            for frame in self.vehicle.receive_frames(&bytes) {
                self.log.extend(self.rig.now().as_us().to_be_bytes());
                self.log.extend(frame.bytes);
            }
        }
    }

    fn order(&mut self, order: Order) {
        let bytes = self.station.frame(&order.message());
        self.rig.usb_write(&bytes);
        self.run(20);
    }

    /// Released from a tilt, some samples bad for a second and a half, then the cable out until the
    /// flight gives up.
    fn fly(&mut self) {
        self.rig.environment.tilt_clamp_to([0.3, 0.0]);
        self.run(6_000);
        self.order(request::ARM);
        self.order(request::RELEASE);
        self.rig.release(0.2);
        self.run(300);
        let faults =
            [Fault::Spikes { probability: 0.004 }, Fault::CorruptWords { probability: 0.004 }];
        faults.into_iter().for_each(|fault| self.rig.inject(fault));
        self.run(1_500);
        faults.into_iter().for_each(|fault| self.rig.clear(fault));
        self.rig.inject(Fault::Unplugged);
        self.run(200);
        self.rig.clear(Fault::Unplugged);
        self.run(1_500);
        self.order(request::DISARM);
        self.run(200);
    }
}

#[test]
fn a_flight_with_missed_samples_and_a_failsafe_comes_out_bit_for_bit() {
    let mut bench = Bench::new();
    bench.fly();
    let flight = Logged::of(&Log::parse(&bench.log));
    let states: Vec<_> = flight
        .events
        .iter()
        .filter_map(|event| match event {
            Event::State(code) => state_of(*code),
            _ => None,
        })
        .collect();
    assert!(states.contains(&StateKind::Active) && states.contains(&StateKind::Failsafe));
    assert_eq!(flight.lost(), 0);
    let (pairs, refused) = replay(&flight, &BTreeMap::new()).unwrap();
    assert_eq!(refused, Vec::<String>::new());
    let figures = compare(&pairs);
    let missed = flight.missed();
    assert!(missed > 30, "{missed}");
    assert!(figures.compared > 1_200, "{figures:?}");
    assert_eq!(figures.equal, figures.compared, "{figures:?}");
}

/// A rocket with a burn of four seconds: nobody orders its release and the end of its control.
#[test]
fn a_rocket_comes_out_bit_for_bit_from_launch_to_burnout() {
    let mut on_pad = Airframe::stable().on_pad(3);
    on_pad.parameters.rocket.burn_s = 4.0;
    let mut config = RigConfig { stored: Some(RigConfig::polarity_set()), ..RigConfig::default() };
    config.bench.vehicle = VehicleConfig::Rocket(Box::new(on_pad));
    let parameters = rocket::parameters(&Airframe::stable(), RocketLaw::Scheduled);
    for (name, value) in &parameters {
        config.stored.as_mut().unwrap().set(name, *value).unwrap();
    }
    let mut bench = Bench::with(&config);
    bench.run(9_000);
    bench.order(request::ARM);
    bench.rig.release(0.0);
    bench.run(5_500);
    let mut flight = Logged::of(&Log::parse(&bench.log));
    let polarity = ("SRV_POLARITY".to_owned(), 1.0);
    let told = parameters.into_iter().chain([polarity]);
    let told = told.map(|(name, value)| Event::Parameter(name, value));
    flight.events = told.chain(flight.events).collect();
    let (pairs, refused) = replay(&flight, &BTreeMap::new()).unwrap();
    assert_eq!(refused, Vec::<String>::new());
    let figures = compare(&pairs);
    assert!(figures.compared > 1_800, "{figures:?}");
    assert_eq!(figures.equal, figures.compared, "{figures:?}");
    let steered = |pair: &&Pair| pair.logged.cranks_rad.iter().flatten().any(|rad| *rad != 0.0);
    let steered = pairs.iter().filter(steered).count();
    assert!((550..700).contains(&steered), "{steered}");
}

/// The log without the vehicle's frames of these stretches of its clock, s.
fn without(log: &[u8], stretches: &[[f64; 2]]) -> Vec<u8> {
    let mut rest = log;
    let mut kept = Vec::new();
    while let Some(length) = rest.get(9) {
        let (frame, next) = rest.split_at(8 + 12 + usize::from(*length));
        let time_us = u64::from_be_bytes(frame[..8].try_into().unwrap());
        let time_s = time_us as f64 * 1e-6;
        if !stretches.iter().any(|[from, to]| (*from..*to).contains(&time_s)) {
            kept.extend_from_slice(frame);
        }
        rest = next;
    }
    kept
}

/// Half a second is lost before arming, a moment of the release, and the end of the failsafe. Each
/// time the steps are compared again within a second, and all of them are equal.
#[test]
fn behind_a_gap_steps_are_compared_again_within_a_second() {
    let mut bench = Bench::new();
    bench.fly();
    let lost = [[4.0, 4.5], [6.3, 6.35], [8.5, 8.6]];
    let flight = Logged::of(&Log::parse(&without(&bench.log, &lost)));
    assert!(flight.lost() > 0);
    let (pairs, refused) = replay(&flight, &BTreeMap::new()).unwrap();
    assert_eq!(refused, Vec::<String>::new());
    let mut figures = compare(&pairs);
    figures.lost = flight.lost();
    figures.gaps_s = gaps_s(&flight);
    assert_eq!(figures.equal, figures.compared, "{figures:?}");
    let begins: Vec<_> = figures.compared_s.iter().map(|stretch| stretch[0]).collect();
    assert_eq!((figures.gaps_s.len(), begins.len()), (3, 4), "{figures:?}");
    for (gap, begin) in figures.gaps_s.iter().zip(&begins[1..]) {
        assert!((0.0..1.1).contains(&(begin - gap)), "{figures:?}");
    }
    let words = figures.figures().text();
    for [from, to] in &figures.compared_s {
        let stretch = format!("{from:.3} to {to:.3} s");
        assert!(words.contains(&stretch), "{stretch}: {words}");
    }
}

/// A log that begins in mid-flight, with the parameters, as `tvc record` asks for them first.
fn from_mid_flight() -> Logged {
    let mut bench = Bench::new();
    bench.fly();
    let whole = Logged::of(&Log::parse(&bench.log));
    let mut flight = Logged::of(&Log::parse(&without(&bench.log, &[[0.0, 6.4]])));
    let told = whole.events.into_iter();
    let told = told.filter(|event| matches!(event, Event::Parameter(..)));
    flight.events = told.chain(flight.events).collect();
    flight
}

#[test]
fn a_log_without_the_estimates_beginning_is_compared_from_a_full_state_on() {
    let (pairs, _) = replay(&from_mid_flight(), &BTreeMap::new()).unwrap();
    let figures = compare(&pairs);
    assert!(figures.compared > 300, "{figures:?}");
    assert_eq!(figures.equal, figures.compared, "{figures:?}");
}

/// What the log says of the parameters is not what the vehicle flies: a difference would mean
/// nothing.
#[test]
fn a_full_state_under_other_parameters_is_not_compared() {
    let mut flight = from_mid_flight();
    let other = Event::Parameter("PID_KP".into(), 0.7);
    flight.events.insert(0, other);
    let (pairs, _) = replay(&flight, &BTreeMap::new()).unwrap();
    assert_eq!(compare(&pairs).compared, 0);
}
