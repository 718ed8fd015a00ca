//! A real recording through the emulated sensor and the whole image.

use crate::firmware;
use recordings::Recording;
use rig::RigConfig;
use rig::replay::replay;
use std::path::Path;
use std::sync::Arc;

#[test]
fn attitude_from_a_real_recording() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/broad_11_cut.imuq");
    let recording = Arc::new(Recording::open(&path).unwrap());
    let config = RigConfig::default();
    let record = replay(firmware(), &recording, &config, f64::INFINITY, &mut |_| {}).unwrap();
    let score = record.score.unwrap();
    assert!(score.inclination_deg <= 5.0, "{score:?}");
    assert!(score.samples > 5000, "{score:?}");
    assert_eq!(record.unmatched, 0);
    assert!(record.parity.compared > 6000, "{:?}", record.parity);
    assert_eq!(record.parity.equal, record.parity.compared, "{:?}", record.parity);
    assert_eq!((record.link.lost, record.link.crc_errors), (0, 0));
}
