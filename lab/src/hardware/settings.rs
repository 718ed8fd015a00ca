//! The settings that are flown, each with how it should end.

use super::row::Ending::{self, Fails, Flies, Late, Refused, Skips, Unsettled};

/// What `--hardware` would be given, and how flights with it should end.
///
/// A sensor that stretches a byte by 180 us on average has that stretch drawn from 170 to 190. The
/// image must not count on one value.
///
/// Where one byte in a hundred is stretched for 500 us, a transfer may reach into the next tick,
/// which then goes without its burst (`src/ticks.rs`). Chance decides whether that happens within a
/// flight.
///
/// Where the bus is so slow that it is read 100 times a second, as often as the sensor is
/// refreshed, nothing tells how old a reading is, up to 10 ms. In one flight of some tens that is
/// enough to overshoot by 5 to 7 %.
pub const SETTINGS: &[(&str, Ending)] = &[
    ("", Flies),
    ("stop-read=0", Flies),
    ("stop-read=180", Flies),
    ("stop-read=300", Flies),
    ("stop-read=500", Unsettled),
    ("stop-write=200", Flies),
    ("stop-write=500", Flies),
    ("stretch=10..30", Flies),
    ("stretch=50..70", Flies),
    ("stretch=90..110", Flies),
    ("stretch=130..150", Flies),
    ("stretch=170..190", Flies),
    ("stretch=210..230", Unsettled),
    ("stretch=230..250", Unsettled),
    ("stretch=250..270", Unsettled),
    ("stretch=290..310", Late),
    ("stretch=340..360", Late),
    ("stretch=20..350", Unsettled),
    ("stretch-rare=500@0.01", Skips),
    ("stretch=360..380", Refused),
    ("stretch=440..460", Refused),
    ("address=0x29", Flies),
    ("clock=-3.1", Flies),
    ("clock=-3.1,clock-drift=50", Flies),
    ("slow-clock=0.87", Flies),
    ("slow-clock=1.25", Flies),
    ("wake=10", Flies),
    ("bridge=4", Flies),
    ("systick=stops", Fails),
    ("synchronise=0", Flies),
    ("synchronise=96", Flies),
    ("host=linux", Flies),
    ("host=windows", Flies),
    ("host=macos", Flies),
    ("refresh=35/35/20", Flies),
    ("refresh=50/50/20", Flies),
    ("refresh=70/70/20", Flies),
    ("refresh=100/100/20", Flies),
    ("refresh=100/35/20", Flies),
    ("refresh=35/100/20", Flies),
    ("field-age=15", Flies),
    ("field-age=50", Flies),
    ("field=dead", Flies),
    ("field=stuck", Flies),
    ("sensor-clock=3", Flies),
    ("noise=0.5", Flies),
    ("noise=3", Flies),
    ("gyro-per-g=0", Flies),
    ("late-registers=5000", Flies),
    ("late-registers=40000", Flies),
    ("lost-within=500", Flies),
    ("lever=30/10/-80", Flies),
    ("bootloader=arduino", Flies),
    ("bootloader=uf2", Flies),
    ("user-row=bootprot", Flies),
    ("address=0x29,field=dead,stretch=20..350,stop-read=500,lost-within=500", Unsettled),
    ("address=0x29,field=dead,stretch=130..230,stop-read=500,lost-within=500", Unsettled),
    (
        "stretch=210..230,stop-read=300,stop-write=200,late-registers=5000,wake=10,clock=-3.1",
        Unsettled,
    ),
    ("host=linux,bootloader=uf2,slow-clock=1.25,user-row=bootprot", Flies),
    ("refresh=100/100/20,field-age=50,lever=30/10/-80,sensor-clock=3", Flies),
];

/// Those that set one of `keys`; all if there are none.
pub fn with(keys: &[String]) -> Vec<(&'static str, Ending)> {
    let sets = |text: &str| {
        let mut set = text.split(',').map(|setting| setting.split('=').next());
        set.any(|key| keys.iter().any(|wanted| key == Some(wanted)))
    };
    let chosen = SETTINGS.iter().filter(|(text, _)| keys.is_empty() || sets(text));
    chosen.copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::bench::Hardware;
    use rig::bench::hardware::keys;
    use std::collections::BTreeSet;

    /// Each is possible, none is there twice, and no key of `--hardware` is forgotten. Some are
    /// for `tvc bringup` alone.
    #[test]
    fn the_settings_are_possible_and_reach_every_key() {
        let mut seen = BTreeSet::new();
        for (text, _) in SETTINGS {
            let parsed: Result<Hardware, String> = text.parse();
            assert!(parsed.is_ok(), "{text}: {parsed:?}");
            assert!(seen.insert(*text), "{text} twice");
        }
        let of_bringup = ["jumper", "flash-time", "crc-cycles", "watchdog", "usb-loss"];
        for key in keys().filter(|key| !of_bringup.contains(&key.name)) {
            assert!(!with(&[key.name.to_owned()]).is_empty(), "{}", key.name);
        }
    }

    #[test]
    fn some_keys_choose_the_settings_that_have_them() {
        let chosen = with(&["wake".into()]);
        assert_eq!(chosen.len(), 2, "{chosen:?}");
        assert!(chosen.iter().all(|(text, _)| text.contains("wake=")));
        assert_eq!(with(&[]).len(), SETTINGS.len());
    }
}
