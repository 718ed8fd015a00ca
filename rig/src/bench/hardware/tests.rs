//! Settings reach the parts, and refusals say what is possible.

use super::*;
use crate::bench::BenchConfig;
use crate::bno055::{BusTiming, RareStretch, RefreshRates};
use crate::inertial::MagnetometerHealth;
use samd21::peripherals::UserRow;
use samd21::usb_host::System;

#[test]
fn settings_change_what_they_name_and_nothing_else() {
    let hardware: Hardware =
        "stop-read=160..200,stretch=210,address=0x29,stretch-rare=500@0.01".parse().unwrap();
    let bus = BusTiming {
        stretch_us: 210..=210,
        stretch_rare: Some(RareStretch { us: 500, probability: 0.01 }),
        stop_read_us: 160..=200,
        ..BusTiming::default()
    };
    let sensor = bno055::Config { address: 0x29, bus, ..bno055::Config::default() };
    let expected = Hardware { sensor, ..Hardware::default() };
    assert_eq!(hardware, expected);
}

#[test]
fn the_chip_gets_what_is_set() {
    let hardware =
        "clock=-3.1,clock-drift=20,slow-clock=0.87,wake=7,host=windows,user-row=bootprot".parse();
    let options = hardware.map(|hardware: Hardware| hardware.chip(1));
    let expected = Options {
        dfll_error_ppm: -31_000,
        dfll_drift_ppm_s: 20,
        osculp32k_hz: 28_508,
        osculp32k_phase: Hardware::default().chip(1).osculp32k_phase,
        wake_up: Ticks::from_us(7),
        seed: 1,
        host: System::Windows,
        user_row: UserRow::PROTECTED,
        ..Options::default()
    };
    assert_eq!(options, Ok(expected));
}

#[test]
fn the_slow_oscillator_follows_the_seed() {
    let drawn: Vec<Options> = (0..100).map(|seed| Hardware::default().chip(seed)).collect();
    assert_eq!(drawn[7], Hardware::default().chip(7));
    let spread = |of: fn(&Options) -> f64, least: f64, most: f64| {
        let all = || drawn.iter().map(of);
        let (low, high) = (all().fold(most, f64::min), all().fold(least, f64::max));
        let tenth = (most - least) / 10.0;
        assert!((least..least + tenth).contains(&low), "{low}");
        assert!((most - tenth..=most).contains(&high), "{high}");
    };
    spread(|chip| f64::from(chip.osculp32k_hz), 28_508.0, 40_960.0);
    spread(|chip| chip.osculp32k_phase.as_us_f64(), 0.0, 976.6);
    let ideal = Options {
        osculp32k_hz: 32_768,
        osculp32k_phase: drawn[1].osculp32k_phase,
        wake_up: Ticks::from_us(4),
        seed: 1,
        ..Options::default()
    };
    let given: Hardware = "slow-clock=1".parse().unwrap();
    assert_eq!(given.chip(1), ideal);
}

#[test]
fn a_default_that_is_shown_can_be_given() {
    let default = Hardware::default();
    for key in keys() {
        let shown = key.show(&default);
        let parsed = format!("{}={shown}", key.name).parse();
        assert_eq!(parsed, Ok(default.clone()), "{}", key.name);
    }
}

/// `HARDWARE=overwrite` writes the page's table anew.
#[test]
fn the_page_of_the_documentation_has_the_table() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/hardware.md");
    let page = std::fs::read_to_string(path).unwrap();
    let (text, _) = page.split_once("| key |").unwrap();
    let wanted = text.to_owned() + &Hardware::table();
    if std::env::var_os("HARDWARE").is_some_and(|value| value == "overwrite") {
        std::fs::write(path, &wanted).unwrap();
    } else {
        assert_eq!(page, wanted, "HARDWARE=overwrite cargo test -p rig writes it anew");
    }
}

#[test]
fn refusals_say_what_is_possible() {
    let refused = |text: &str| text.parse::<Hardware>().unwrap_err();
    assert!(refused("strech=3").contains("the keys are address, stretch,"));
    assert!(refused("stretch").starts_with("stretch=US|MIN..MAX: how long"));
    for bad in [
        "stretch=x",
        "stretch=200..160",
        "stretch=20001",
        "stretch-rare=500",
        "stretch-rare=500@2",
        "stretch-rare=500@NaN",
        "address=40",
        "late-registers=-1",
        "refresh=100/100",
        "refresh=100/100/NaN",
        "refresh=5/100/20",
        "field=gone",
        "field-age=201",
        "sensor-clock=11",
        "lever=0/0",
        "lever=0/0/501",
        "bootloader=grub",
    ] {
        let why = refused(bad);
        assert!(why.starts_with(bad.split('=').next().unwrap()), "{why}");
    }
}

#[test]
fn settings_of_the_sensor_reach_the_bench() {
    let hardware: Hardware = "late-registers=20000,lost-within=5000,refresh=62.5/80/20,\
         field-age=30,field=dead,sensor-clock=3,noise=3,gyro-per-g=0.1,lever=20/-5/-130,bootloader=uf2"
        .parse()
        .unwrap();
    assert_eq!(hardware.bootloader, Bootloader::Uf2);
    let mut bench = BenchConfig::default();
    hardware.fit(&mut bench);
    assert_eq!(bench.lever_m, [0.02, -0.005, -0.13]);
    let sensor = bench.sensor;
    assert_eq!(sensor.late_registers, Ticks::from_ms(20));
    assert_eq!(sensor.lost_within, Ticks::from_ms(5));
    let rates = RefreshRates { acc_hz: 62.5, gyr_hz: 80.0, mag_hz: 20.0 };
    assert_eq!(sensor.refresh, Some(rates));
    assert_eq!(sensor.magnetometer.age, Ticks::from_ms(30));
    assert_eq!(sensor.magnetometer.health, MagnetometerHealth::Dead);
    assert_eq!(sensor.clock_error, 0.03);
    let typical = crate::inertial::ImuErrors::TYPICAL;
    assert_eq!(sensor.errors.gyro_noise_density, 3.0 * typical.gyro_noise_density);
    assert_eq!(sensor.errors.mag_noise_ut, 3.0 * typical.mag_noise_ut);
    let per_g = sensor.errors.gyro_per_g_rad_s;
    assert!(per_g.iter().all(|shift| (shift.to_degrees() - 0.1).abs() < 1e-12));
}

/// What nobody sets is as on a bench without any hardware, but for a gyroscope that acceleration
/// shifts.
#[test]
fn the_default_changes_next_to_nothing() {
    let mut bench = BenchConfig::default();
    Hardware::default().fit(&mut bench);
    let mut expected = BenchConfig::default();
    expected.sensor.errors.gyro_per_g_rad_s = [0.1_f64.to_radians(); 3];
    assert_eq!(format!("{bench:?}"), format!("{expected:?}"));
}

#[test]
fn the_parts_get_what_is_set() {
    let hardware: Hardware =
        "jumper=no,flash-time=1.5,crc-cycles=9,watchdog=dead,usb-loss=0.25".parse().unwrap();
    let options = hardware.chip(1);
    assert_eq!((options.flash_time, options.watchdog_bites), (1.5, false));
    assert_eq!(options.crc_word_cycles, 9.0);
    assert_eq!((hardware.jumper, hardware.usb_loss), (false, 0.25));
    assert!("watchdog=slow".parse::<Hardware>().is_err());
}
