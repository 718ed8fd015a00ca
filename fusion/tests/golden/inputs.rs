//! A motion with every trouble, and the recording that the repository has.

use tvc_fusion::fixed::{Counts, Scale};
use tvc_fusion::{GRAVITY, Quaternion};

/// What counts are worth, of both inputs.
pub(crate) const SCALE: Scale = Scale::BNO055;

/// A sample, and how long after the one before, us.
pub(crate) struct Input {
    pub(crate) dt_us: u32,
    pub(crate) counts: Counts,
}

/// Counts of a value.
fn counts(v: [f64; 3], unit: f32) -> [i16; 3] {
    v.map(|part| libm::round(part / f64::from(unit)) as i16)
}

/// 100 s of samples at 100 Hz, by arithmetic that is the same on every machine: rest, motion, a
/// magnet, another place, a clipped gyroscope, free fall, gaps, and counts that make no sense.
pub(crate) fn generated() -> Vec<Input> {
    let mut seed = 1_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        seed >> 16
    };
    let mut truth = Quaternion::<f64>::normalised(0.3, 0.9, -0.2, 0.1);
    let wave = |t: f64| [1.3, 0.7, 0.9].map(|rate| libm::sin(rate * t));
    (0..10_000_u32)
        .map(|k| {
            let t = f64::from(k) * 0.01;
            let speed = match k {
                0..400 | 2_000..2_500 | 9_000.. => 0.0,
                400..2_000 => 2.0,
                2_500..5_000 => 0.7,
                5_000..6_000 => 9.0,
                _ => 1.5,
            };
            let rate = wave(t).map(|part| part * speed);
            truth = truth.mul(&Quaternion::from_rotation_vector(&rate.map(|part| part * 0.01)));
            let back = |v: [f64; 3]| -> [f64; 3] { truth.conj().rotate(&v) };
            let shake = wave(7.0 * t).map(|part| part * speed);
            let mut acc = back([shake[0], shake[1], shake[2] - f64::from(GRAVITY)]);
            if (6_200..6_260).contains(&k) {
                acc = [0.01, -0.02, 0.0];
            }
            let mut field = match k {
                2_600..3_200 => [17.0 + 30.0 * libm::sin(t), 12.0, 47.0],
                3_200..4_600 => [25.0, 0.0, 30.0],
                _ => [17.0, 0.0, 47.0],
            };
            for part in &mut field {
                *part += f64::from(random()) / 65_536.0 - 0.5;
            }
            let noise = || f64::from(k.wrapping_mul(2_654_435_761) >> 24) / 256.0 - 0.5;
            let gyr = [rate[0] + 0.02, rate[1] - 0.01, rate[2] + 0.03]
                .map(|part| (part + 2e-3 * noise()).clamp(-7.0, 7.0));
            let mut counts = Counts {
                gyr: counts(gyr, SCALE.gyr_rad_s),
                acc: counts(acc, SCALE.acc_m_s2),
                mag: (k % 3 != 1).then(|| counts(back(field), SCALE.mag_ut)),
            };
            if (8_000..8_300).contains(&k) {
                let mut any = |_| random() as u16 as i16;
                counts = Counts {
                    gyr: [0; 3].map(&mut any),
                    acc: [0; 3].map(&mut any),
                    mag: Some([0; 3].map(&mut any)),
                };
            }
            let dt_us = match k {
                1_000 | 7_500 => 400_000,
                1_200 | 5_500 => 20_000,
                1_300..1_350 => 9_700 + random() % 700,
                1_400 => 0,
                1_500 => 95_000,
                _ => 10_000,
            };
            Input { dt_us, counts }
        })
        .collect()
}

/// The recording, in counts of the same worth.
pub(crate) fn recorded() -> Vec<Input> {
    const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/broad_11_cut.imuq");
    let bytes = std::fs::read(PATH).expect("it is in the repository");
    let scale = |at: usize| {
        let word = [0, 1, 2, 3].map(|i| bytes[at + i]);
        f64::from(f32::from_le_bytes(word))
    };
    let scales = [16, 20, 24].map(scale);
    bytes[64..]
        .chunks_exact(28)
        .map(|record| {
            let axes = |sensor: usize, unit: f32| {
                let part = [0, 2, 4].map(|at| {
                    let bytes = [record[6 * sensor + at], record[6 * sensor + at + 1]];
                    f64::from(i16::from_le_bytes(bytes)) * scales[sensor]
                });
                counts(part, unit)
            };
            Input {
                dt_us: 3_500,
                counts: Counts {
                    gyr: axes(0, SCALE.gyr_rad_s),
                    acc: axes(1, SCALE.acc_m_s2),
                    mag: Some(axes(2, SCALE.mag_ut)),
                },
            }
        })
        .collect()
}
