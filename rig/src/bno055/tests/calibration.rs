//! CALIB_STAT and the profile as a master sees them.

use super::*;

const GYR_OFFSET: u8 = page0::ACC_OFFSET + 12;
const MAG_OFFSET: u8 = page0::ACC_OFFSET + 6;

/// Offsets that the chip has to find: 2 deg/s, 0.3 m/s^2, 40 uT, on an axis each.
fn errors() -> ImuErrors {
    ImuErrors {
        gyro_bias_rad_s: Some([0.0, 2.0_f64.to_radians(), 0.0]),
        acc_offset_m_s2: [0.3, 0.0, 0.0],
        hard_iron_ut: [0.0, 0.0, 40.0],
        ..ImuErrors::NONE
    }
}

fn fusing(mode: Mode, profile: &[(u8, [u8; 6])]) -> Bus {
    let mut bus = Bus::new(Config { errors: errors(), ..Config::default() });
    bus.wait_ms(700);
    for (register, bytes) in profile {
        bus.write(*register, bytes);
    }
    bus.write(page0::OPR_MODE, &[mode as u8]);
    bus.wait_ms(30);
    bus
}

/// System, gyroscope, accelerometer, magnetometer.
fn levels(bus: &mut Bus) -> [u8; 4] {
    let register = bus.byte(page0::CALIB_STAT);
    [6, 4, 2, 0].map(|shift| register >> shift & 3)
}

/// Turns the sensor so that its axes `up` and `north` point up and north, which happens at once.
fn pose(bus: &mut Bus, up: [f64; 3], north: [f64; 3]) {
    bus.truth.specific_force_m_s2 = up.map(|u| 9.80665 * u);
    bus.truth.field_ut = [0, 1, 2].map(|i| 17.1 * north[i] - 47.0 * up[i]);
}

/// The six faces down in turn, and then the eight corners.
fn poses() -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
    let faces = (0..6).map(|face| {
        let (mut up, mut north) = ([0.0; 3], [0.0; 3]);
        up[face / 2] = if face % 2 == 0 { 1.0 } else { -1.0 };
        north[(face / 2 + 1) % 3] = 1.0;
        (up, north)
    });
    let corners = (0..8).map(|corner| {
        let [x, y, z] = [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { 1.0 } else { -1.0 });
        let up = [x, y, z].map(|u| u / 3_f64.sqrt());
        (up, [y, -x, 0.0].map(|n| n / 2_f64.sqrt()))
    });
    faces.chain(corners)
}

#[test]
fn rest_calibrates_the_gyroscope_and_nothing_else() {
    let mut bus = fusing(Mode::Ndof, &[]);
    assert_eq!(levels(&mut bus), [0; 4]);
    assert_eq!(bus.words(page0::GYR_DATA), [0, 32, 0]);
    bus.wait_ms(700);
    assert_eq!(levels(&mut bus), [0, 1, 0, 0]);
    bus.wait_ms(2000);
    assert_eq!(levels(&mut bus), [0, 3, 0, 0]);
    assert_eq!(bus.words(GYR_OFFSET), [0, 32, 0]);
    assert_eq!(bus.words(page0::GYR_DATA), [0, 0, 0]);
}

#[test]
fn a_turning_sensor_does_not_calibrate_its_gyroscope() {
    let mut bus = fusing(Mode::Ndof, &[]);
    bus.truth.rate_rad_s = [0.0, 0.0, 0.5];
    bus.wait_ms(5000);
    // Half a second may have passed at rest before its mean showed the turn.
    assert!(levels(&mut bus)[1] <= 1);
    assert_eq!(bus.words(GYR_OFFSET), [0; 3]);
}

#[test]
fn poses_and_motion_calibrate_the_others() {
    let mut bus = fusing(Mode::Ndof, &[]);
    let mut seen = Vec::new();
    for (up, north) in poses() {
        pose(&mut bus, up, north);
        bus.wait_ms(2500);
        seen.push(levels(&mut bus));
    }
    let of = |sensor: usize| seen.iter().map(|levels| levels[sensor]).collect::<Vec<_>>();
    let acc = of(2);
    assert_eq!(acc[..6], [0, 1, 1, 2, 2, 3]);
    assert!(acc[6..].iter().all(|level| *level == 3), "it stays");
    let mag = of(3);
    assert_eq!(mag[..6], [0, 1, 1, 1, 1, 2]);
    assert!(mag.is_sorted() && mag.last() == Some(&3), "{mag:?}");
    for levels in &seen {
        assert_eq!(levels[0], levels[1].min(levels[3]), "system");
    }
    assert_eq!(bus.words(page0::ACC_OFFSET), [30, 0, 0]);
    assert_eq!(bus.words(MAG_OFFSET), [0, 0, 640]);
    assert_eq!(bus.words(GYR_OFFSET), [0, 32, 0]);
    assert_eq!(bus.read::<4>(0x67), [0; 4], "no radius of its own");
    // The chip forgets it with its power.
    bus.chip.inject(bus.now, Fault::PowerDip);
    bus.wait_ms(700);
    assert_eq!(bus.words(MAG_OFFSET), [0; 3]);
}

#[test]
fn the_slow_calibration_asks_for_more_motion_and_imu_mode_for_none() {
    let moved = |mode| {
        let mut bus = fusing(mode, &[]);
        for (up, north) in poses() {
            pose(&mut bus, up, north);
            bus.wait_ms(2500);
        }
        levels(&mut bus)
    };
    assert_eq!(moved(Mode::Ndof), [3, 3, 3, 3]);
    assert_eq!(moved(Mode::NdofFmcOff), [2, 3, 3, 2]);
    assert_eq!(moved(Mode::Imu), [3, 3, 3, 0]);
    assert_eq!(moved(Mode::Amg), [0; 4]);
}

/// As users report of restored profiles: the magnetometer shows 0 until the first motion, the
/// system 3.
#[test]
fn a_restored_profile_counts_and_is_overwritten() {
    let profile = [
        (page0::ACC_OFFSET, [30, 0, 0, 0, 0, 0]),
        (MAG_OFFSET, [0, 0, 0, 0, 0x80, 0x02]),
        (GYR_OFFSET, [0, 0, 48, 0, 0, 0]),
    ];
    let mut bus = fusing(Mode::Ndof, &profile);
    assert_eq!(levels(&mut bus), [3, 3, 3, 0]);
    assert_eq!(bus.words(page0::GYR_DATA), [0, -16, 0], "as it was written");
    let (up, north) = poses().nth(2).unwrap();
    pose(&mut bus, up, north);
    bus.wait_ms(100);
    assert_eq!(levels(&mut bus), [3, 3, 3, 3]);
    bus.wait_ms(3000);
    assert_eq!(bus.words(GYR_OFFSET), [0, 32, 0], "rest teaches it better");
}

/// As the thesis found: under motion accelerometer and magnetometer lose their calibration, and
/// regain it.
#[test]
fn shaking_and_iron_cost_levels() {
    let mut bus = fusing(Mode::Ndof, &[]);
    for (up, north) in poses() {
        pose(&mut bus, up, north);
        bus.wait_ms(2500);
    }
    assert_eq!(levels(&mut bus), [3, 3, 3, 3]);
    let (up, north) = poses().next().unwrap();
    pose(&mut bus, up, north);
    bus.truth.specific_force_m_s2[0] += 5.0;
    bus.wait_ms(500);
    assert_eq!(levels(&mut bus)[2], 3, "a knock is nothing");
    bus.wait_ms(1000);
    assert_eq!(levels(&mut bus), [3, 3, 2, 3]);
    pose(&mut bus, up, north);
    bus.truth.field_ut = bus.truth.field_ut.map(|f| 1.5 * f);
    bus.wait_ms(1500);
    assert_eq!(levels(&mut bus), [0, 3, 2, 0], "beside iron");
    for (up, north) in poses() {
        pose(&mut bus, up, north);
        bus.truth.field_ut = bus.truth.field_ut.map(|f| 1.5 * f);
        bus.wait_ms(2500);
    }
    assert_eq!(levels(&mut bus), [3, 3, 3, 3], "learned again");
}

#[test]
fn a_refused_profile_calibrates_nothing() {
    let out_of_range = [(MAG_OFFSET, [0, 0, 0, 0, 0x8C, 0x21])];
    let mut bus = fusing(Mode::Ndof, &out_of_range);
    assert_eq!(bus.byte(page0::SYS_ERR), error::FUSION_CONFIG);
    bus.wait_ms(5000);
    assert_eq!(levels(&mut bus), [0; 4]);
}
