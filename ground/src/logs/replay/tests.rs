//! Flights of the image with a sensor that fails, replayed.

use super::*;
use crate::logs::log::{Flight as Logged, Log};
use client::Wire;
use client::request::{self, Order};
use rig::bno055::Fault;
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
        let config = RigConfig {
            stored: Some(RigConfig::polarity_set()),
            ..RigConfig::default()
        };
        Self {
            rig: Rig::new(firmware(), &config).unwrap(),
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
        self.rig.environment_mut().tilt_clamp(0.3);
        self.run(6_000);
        self.order(request::ARM);
        self.order(request::RELEASE);
        self.rig.release(0.2);
        self.run(300);
        let faults = [
            Fault::Spikes { probability: 0.004 },
            Fault::CorruptWords { probability: 0.004 },
        ];
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

#[test]
fn parameters_are_known_and_in_range() {
    assert_eq!(parameter("PID_KD=0.2"), Ok(("PID_KD".into(), 0.2)));
    for bad in ["PID_KD", "PID_KD=", "PID_KD=9", "PID_KQ=1"] {
        assert!(parameter(bad).is_err(), "{bad}");
    }
}
