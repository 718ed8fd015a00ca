//! The pitch loop against the reference run and the reference table of responses.

use plant::pitch_loop::{Pd, PitchLoop, Timing};
use plant::{Linkage, Parameters, ServoModel};

fn fly(model: ServoModel, timing: Timing, pitch: f64) -> PitchLoop {
    PitchLoop::new(&Parameters::PHYS, model, timing, pitch, 0.2).unwrap()
}

fn pd(kp: f64, kd: f64, timing: Timing) -> Pd {
    Pd::new(kp, kd, &Linkage::new(&Parameters::PHYS), timing.control_s)
}

/// `pd_nominal_S3003_02.csv`: servo A, kp 1.0, kd 0.30, from 0.2 rad, frame phase 10 ms.
#[test]
fn reference_run_to_3_mrad() {
    let mut reader = csv::Reader::from_path(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/data/pd_nominal_S3003_02.csv"
    ))
    .unwrap();
    let timing = Timing::ANALOGUE.with_phase(10e-3);
    let mut law = pd(1.0, 0.30, timing);
    let mut sim = fly(ServoModel::S3003, timing, 0.2);
    let mut sample = sim.sample();
    let mut worst = [0.0_f64; 2];
    let mut rows = 0;
    for row in reader.deserialize::<Vec<f64>>() {
        let row = row.unwrap();
        while sample.time_s < row[0] - 1e-9 {
            sample = sim.step(|m| law.update(m));
        }
        worst[0] = worst[0].max((sample.pitch_rad - row[1]).abs());
        worst[1] = worst[1].max((sample.crank.angle_rad - row[2]).abs());
        rows += 1;
    }
    assert_eq!(rows, 601);
    assert!(
        worst[0] < 3e-3 && worst[1] < 3e-3,
        "pitch and crank: {worst:?}"
    );
}
