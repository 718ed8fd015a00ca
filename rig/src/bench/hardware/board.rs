//! The keys for what `tvc bringup` measures on the board itself: a jumper, flash, the watchdog, the
//! port.

use super::{Key, number, put};

pub(super) const KEYS: &[Key] = &[
    Key {
        name: "jumper",
        value: "yes|no",
        what: "a jumper leads the servo's signal from D3 to D2, where `tvc bringup` times it",
        source: "tvc bringup asks for one",
        set: |hardware, text| put(&mut hardware.jumper, one_of(text, "yes", "no")),
        show: |hardware| if hardware.jumper { "yes" } else { "no" }.into(),
    },
    Key {
        name: "flash-time",
        value: "RATIO",
        what: "how long erasing and writing flash take, relative to the data sheet's longest (0.1 \
               to 3)",
        source: "SAM D21 data sheet, NVM characteristics: 6 ms a row, 2.5 ms a page at most",
        set: |hardware, text| put(&mut hardware.flash_time, number(text, 0.1..=3.0)),
        show: |hardware| hardware.flash_time.to_string(),
    },
    Key {
        name: "watchdog",
        value: "ok|dead",
        what: "whether the watchdog resets the chip",
        source: "to see that tvc bringup finds one that does not",
        set: |hardware, text| put(&mut hardware.watchdog_works, one_of(text, "ok", "dead")),
        show: |hardware| {
            if hardware.watchdog_works {
                "ok"
            } else {
                "dead"
            }
            .into()
        },
    },
    Key {
        name: "usb-loss",
        value: "PROBABILITY",
        what: "the share of reads and writes of the port that are lost on their way (0 to 0.5)",
        source: "drivers and hubs that drop data; USB itself repeats what is damaged",
        set: |hardware, text| put(&mut hardware.usb_loss, number(text, 0.0..=0.5)),
        show: |hardware| hardware.usb_loss.to_string(),
    },
];

fn one_of(text: &str, yes: &str, no: &str) -> Result<bool, String> {
    match text {
        _ if text == yes => Ok(true),
        _ if text == no => Ok(false),
        _ => Err("must be one of these".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Hardware;

    #[test]
    fn the_parts_get_what_is_set() {
        let hardware: Hardware = "jumper=no,flash-time=1.5,watchdog=dead,usb-loss=0.25"
            .parse()
            .unwrap();
        let options = hardware.chip(1);
        assert_eq!(
            (options.flash_time_percent, options.watchdog_bites),
            (150, false)
        );
        assert_eq!((hardware.jumper, hardware.usb_loss), (false, 0.25));
        assert!("watchdog=slow".parse::<Hardware>().is_err());
    }
}
