//! Campaigns against the reference's pass rates.

use plant::dispersion::{Campaign, Outcome, Ranges, fly, pass_rate, quantile};
use plant::pitch_loop::{Pd, Timing};
use plant::{ServoModel, Setup};

/// Expected pass rates with 5 %, 2 % and fixed band: analogue servo, kp 1.0, kd 0.30. The
/// reference flew other draws, so that rates agree within their confidence only.
fn compare(ranges: Ranges, expected: [f64; 3]) -> Vec<Outcome> {
    // The reference's servo holds any load.
    let servo = ServoModel { droop: 0.0, ..ServoModel::S3003 };
    let setup = Setup { servo, ..Setup::default() };
    let campaign = Campaign { ranges, ..Campaign::new(1, 300) };
    let linkage = setup.drone.linkage();
    let law = |_: &Timing| {
        let mut law = Pd::new(1.0, 0.30, &linkage, setup.timing.control_s);
        move |m| law.update(m)
    };
    let outcomes = fly(&setup, &campaign, |_| true, law, || ()).unwrap();
    assert_eq!(outcomes.len(), 300);
    let settlings: [fn(&Outcome) -> Option<f64>; 3] =
        [|o| o.settling_5pct_s, |o| o.settling_2pct_s, |o| o.settling_20mrad_s];
    for (settling, expected) in settlings.into_iter().zip(expected) {
        let held_to = |o: &Outcome| Outcome { settling_5pct_s: settling(o), ..*o };
        let found = pass_rate(&outcomes, |o| held_to(o).passes());
        assert!((found.low..=found.high).contains(&expected), "{found:?} {expected}");
    }
    outcomes
}

#[test]
fn reference_campaign() {
    let outcomes = compare(Ranges::REFERENCE, [1.0, 0.912, 1.0]);
    let overshoot = quantile(&outcomes, 0.95, |o| Some(o.overshoot_pct)).unwrap();
    let settling = quantile(&outcomes, 0.95, |o| o.settling_5pct_s).unwrap();
    assert!((overshoot - 6.6).abs() < 2.0, "{overshoot}");
    assert!((settling - 0.925).abs() < 0.05, "{settling}");
}

/// A lateral offset leaves a plain PD with a droop that half of the runs cannot afford.
#[test]
fn reference_campaign_with_lateral_offset() {
    let ranges = Ranges { cm_lateral_m: 5e-3, ..Ranges::REFERENCE };
    let outcomes = compare(ranges, [0.512, 0.148, 0.428]);
    assert_eq!(quantile(&outcomes, 0.95, |o| o.settling_5pct_s), None);
}
