//! Driver and flight library at the emulated sensor and drone, without a chip in between.

mod host_loop;

use host_loop::HostLoop;
use plant::response::StepResponse;
use recordings::{Recording, Scorer};
use rig::bench::BenchConfig;
use rig::bno055::{Fault, RefreshRates};
use rig::inertial::{Magnetometer, MagnetometerHealth};
use samd21::board::Ticks;
use std::path::Path;
use std::sync::Arc;
use tvc_nano::{Command, Params, State};

fn bench(seed: u64) -> BenchConfig {
    let mut bench = BenchConfig::default();
    bench.sensor.seed = seed;
    bench
}

fn params() -> Params {
    let mut params = Params::default();
    params.set("DECLINATION_DEG", 4.37).unwrap();
    params.set("SRV_POLARITY", 1.0).unwrap();
    params
}

fn standby(bench: &BenchConfig) -> HostLoop {
    let mut host = HostLoop::new(bench, params());
    host.run(4000, |_, _| {});
    let seed = bench.sensor.seed;
    assert_eq!(host.flight.state(), State::Standby, "seed {seed}");
    host
}

/// Armed and released from a tilt.
fn released(bench: &BenchConfig, start_rad: f64) -> HostLoop {
    let mut host = standby(bench);
    // Rest, in which the gyro's offset is learned: arming waits for it.
    host.run(3000, |_, _| {});
    host.environment.tilt_clamp_to([start_rad, 0.0]);
    host.run(3000, |_, _| {});
    let now = tvc_nano::Micros(host.now.as_us());
    host.flight.command(now, Command::Arm).unwrap();
    host.flight.command(now, Command::Release).unwrap();
    host.environment.release(0.2);
    host
}

#[test]
fn the_driver_brings_the_sensor_up_and_reads_what_is_true() {
    for seed in 0..5 {
        let host = standby(&bench(seed));
        let sample = host.samples.last().unwrap();
        let z = f64::from(sample.acc[2]) * 0.01;
        assert!((z + 9.81).abs() < 0.1, "{sample:?}");
        let bias = host.environment.sensor.gyro_bias_rad_s();
        for (counts, bias) in sample.gyr.iter().zip(bias) {
            let rate = f64::from(*counts) / 16.0;
            assert!((rate - bias.to_degrees()).abs() < 1.0, "{sample:?}");
        }
    }
}

#[test]
fn the_loop_brings_the_drone_upright() {
    for (seed, start_rad) in [(1, 0.2), (2, 0.4), (3, 0.8), (4, -0.4)] {
        comes_upright(&bench(seed), start_rad);
    }
}

fn comes_upright(bench: &BenchConfig, start_rad: f64) {
    let mut host = released(bench, start_rad);
    let begin = host.now;
    host.run(3000, |_, _| {});
    let truth = host.environment.truth.motion_since(begin);
    let response =
        StepResponse::new(truth.iter().map(|m| (m.time.as_secs_f64(), m.tilt_rad[0])), 0.0)
            .unwrap();
    let settling = response.settling_s(0.05).unwrap();
    let overshoot = response.overshoot_pct();
    println!("{start_rad}: settling {settling:.3} s, overshoot {overshoot:.1} %");
    assert!(settling <= 0.9 && overshoot <= 10.0);
}

/// At the other address, beside the pivot, with registers that read back late, 62.5 refreshes a
/// second of each inertial sensor and a field that never changes.
fn unkind() -> BenchConfig {
    let mut bench = bench(5);
    bench.lever_m = [0.03, 0.0, -0.08];
    bench.sensor.address = 0x29;
    bench.sensor.late_registers = Ticks::from_ms(20);
    bench.sensor.refresh = Some(RefreshRates { acc_hz: 62.5, gyr_hz: 62.5, mag_hz: 20.0 });
    bench.sensor.magnetometer =
        Magnetometer { age: Ticks::from_ms(30), health: MagnetometerHealth::Stuck };
    bench
}

#[test]
fn an_unkind_sensor_costs_no_control() {
    comes_upright(&unkind(), 0.4);
}

#[test]
fn an_unkind_sensor_fails_and_comes_back_like_any() {
    for fault in [Fault::Unplugged, Fault::ConfigReset] {
        leads_to_neutral_and_back(&unkind(), fault);
    }
}

#[test]
fn faults_in_flight_lead_to_neutral_in_time_and_back_to_standby() {
    for fault in [
        Fault::Unplugged,
        Fault::SdaStuck,
        Fault::SclStuck,
        Fault::ConfigReset,
        Fault::PowerDip,
        Fault::AllOnes,
        Fault::Frozen,
        Fault::GyroDead,
        Fault::RevertedAxisMap,
        Fault::FixedPattern,
    ] {
        leads_to_neutral_and_back(&bench(1), fault);
    }
}

fn leads_to_neutral_and_back(bench: &BenchConfig, fault: Fault) {
    let mut host = released(bench, 0.3);
    host.run(200, |_, _| {});
    assert!(host.flight.state().is_active());
    host.environment.inject(host.now, fault);
    let at = host.now;
    let mut neutral: Option<Ticks> = None;
    host.run(1500, |environment, snapshot| {
        if !snapshot.state.is_active() && neutral.is_none() {
            neutral = Some(environment.truth.motion.last().unwrap().time);
        }
    });
    let delay = neutral.map(|time| time.saturating_sub(at).as_us() / 1000);
    println!("{fault:?}: failsafe after {delay:?} ms, {:?}", host.flight.state());
    assert!(matches!(host.flight.state(), State::Failsafe(_)), "{fault:?}");
    // A gyroscope that reads zero differs from one at rest only by its missing noise.
    let allowed = if fault == Fault::GyroDead { 500 } else { 150 };
    assert!(delay.unwrap() <= allowed, "{fault:?}: {delay:?} ms");
    host.environment.clear(host.now, fault);
    host.environment.catch();
    host.environment.tilt_clamp_to([0.0, 0.0]);
    host.run(8000, |_, _| {});
    let now = tvc_nano::Micros(host.now.as_us());
    host.flight.command(now, Command::Disarm).unwrap();
    assert_eq!(host.flight.state(), State::Standby, "{fault:?}");
}

#[test]
fn spikes_and_corrupt_words_are_ridden_out() {
    for fault in [Fault::CorruptWords { probability: 0.01 }, Fault::Spikes { probability: 0.005 }] {
        let mut host = released(&bench(1), 0.3);
        host.environment.inject(host.now, fault);
        host.run(3000, |_, _| {});
        assert!(host.flight.state().is_active(), "{fault:?}: {}", host.flight.state());
        assert!(host.environment.vehicle().pitch_rad().abs() < 0.05, "{fault:?}");
        assert!(!host.faults.is_empty(), "{fault:?}");
    }
}

#[test]
fn a_recording_comes_through_the_sensor() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/broad_11_cut.imuq");
    let recording = Arc::new(Recording::open(&path).unwrap());
    let mut host = HostLoop::new(&bench(1), Params::default());
    host.environment.sensor.play(recording.clone(), Ticks::ZERO);
    let mut scorer = Scorer::default();
    let mut worst = 0.0_f32;
    let length = (recording.duration_s() * 1000.0) as u64;
    host.run(length, |environment, snapshot| {
        let q = snapshot.orientation.parts();
        let norm = (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z).sqrt();
        worst = worst.max((norm - 1.0).abs());
        let shown = environment.sensor.refresh.recorded;
        if let Some(truth) = shown.map(|i| recording.samples()[i])
            && truth.movement
            && let Some(reference) = truth.reference
            && snapshot.sample.is_some()
        {
            scorer.add([q.w, q.x, q.y, q.z].map(f64::from), reference);
        }
    });
    let score = scorer.score().unwrap();
    println!("{score:?}");
    assert!(score.inclination_deg <= 5.0, "{score:?}");
    assert!(worst < 1e-3);
}
