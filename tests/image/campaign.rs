//! A sample of the campaign of faults; `tvc faults` carries out the whole of it.

use crate::ready;
use rig::ServoKind;
use rig::bno055::FaultKind;
use rig::faults::{Campaign, Case, Ending};

/// Of every kind this many runs.
const RUNS: u32 = 2;

#[test]
fn faults_at_random_instants_end_recovered_or_neutral() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = Campaign::new(&ready(), frame_hz, 1).unwrap();
    let (mut recovered, mut neutral) = (0, 0);
    let sample = FaultKind::ALL
        .into_iter()
        .flat_map(|kind| (0..RUNS).map(move |number| Case { kind, number }));
    // In these two a rate has its highest bit flipped in two bursts on end, which looks like a turn.
    let twice = [7, 27].map(|number| Case {
        kind: FaultKind::Spikes,
        number,
    });
    for case in sample.chain(twice) {
        let outcome = campaign.run(case).unwrap();
        match outcome.ending {
            Ending::Recovered => recovered += 1,
            Ending::Neutral => neutral += 1,
            Ending::Unsafe(why) => panic!("{why}: {outcome:?}"),
        }
    }
    // The sample has faults that are ridden out and faults that end the flight.
    assert!(recovered >= 5 && neutral >= 5, "{recovered}, {neutral}");
}

/// The same case of the same campaign is the same run, whatever was run before it.
#[test]
fn a_run_can_be_repeated() {
    let frame_hz = f64::from(ServoKind::S3003.frame_hz());
    let campaign = || Campaign::new(&ready(), frame_hz, 7).unwrap();
    let case = Case {
        kind: FaultKind::BitFlips,
        number: 3,
    };
    let (one, two) = (campaign(), campaign());
    let _ = two.run(Case {
        kind: FaultKind::Spikes,
        number: 0,
    });
    let (one, two) = (one.run(case).unwrap(), two.run(case).unwrap());
    assert_eq!(format!("{one:?}"), format!("{two:?}"));
}
