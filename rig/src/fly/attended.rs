//! A rig with the person at it: the [`Pilot`] does what the image and the ground station ask for,
//! and what other programs order by hand.

use samd21::board::Ticks;
use serde_json::json;

use crate::fly::action::Action;
use crate::fly::gdb::Debug;
use crate::fly::pilot::Pilot;
use crate::rig::{Rig, RigError};

/// Time after which a chip in its bootloader is power-cycled; nothing here can program it.
const BOOTLOADER: Ticks = Ticks::from_ms(2000);

/// A rig and the person at it.
pub struct Attended {
    /// The rig.
    pub rig: Rig,
    /// The person.
    pub pilot: Pilot,
    /// When the bootloader was first seen to run, while it does.
    bootloader: Option<Ticks>,
    /// What a debugger has set.
    pub(super) debug: Debug,
}

impl Attended {
    /// A rig and its pilot.
    pub fn new(rig: Rig, pilot: Pilot) -> Self {
        Self { rig, pilot, bootloader: None, debug: Debug::default() }
    }

    /// Runs for `time`, after the station has sent `typed`. Gives the bytes that the image has
    /// sent; `report` gets lines to show to a person, with the rig's time, s.
    ///
    /// # Errors
    /// The rig stopped.
    pub fn run_for(
        &mut self,
        time: Ticks,
        typed: &[u8],
        report: &mut dyn FnMut(f64, &str),
    ) -> Result<Vec<u8>, RigError> {
        self.rig.usb_write(typed);
        self.pilot.on_station_bytes(&mut self.rig, typed);
        self.debug.run(&mut self.rig, time)?;
        let sent = self.rig.usb_read();
        let now_s = self.rig.now().as_secs_f64();
        for line in self.pilot.on_image_bytes(&mut self.rig, &sent) {
            report(now_s, &line);
        }
        self.leave_bootloader(report);
        Ok(sent)
    }

    /// Does what a line orders ([`Action`]); how the rig is then, or why not, as a line of JSON.
    pub fn act(&mut self, line: &str, report: &mut dyn FnMut(f64, &str)) -> String {
        let (rig, pilot) = (&mut self.rig, &mut self.pilot);
        let done = line.parse().and_then(|action: Action| {
            if action != Action::Look {
                report(rig.now().as_secs_f64(), &format!("by hand: {line}"));
            }
            pilot.act(rig, &action)
        });
        match done {
            Ok(()) => json!(pilot.look(rig)).to_string(),
            Err(error) => json!({ "error": error }).to_string(),
        }
    }

    /// Power-cycles a chip that has been in its bootloader for [`BOOTLOADER`].
    fn leave_bootloader(&mut self, report: &mut dyn FnMut(f64, &str)) {
        if !self.rig.waits_for_program() {
            self.bootloader = None;
            return;
        }
        let now = self.rig.now();
        if now - *self.bootloader.get_or_insert(now) >= BOOTLOADER {
            report(
                now.as_secs_f64(),
                "in its bootloader, with nothing to program it: power-cycled",
            );
            self.rig.power_cycle();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RigConfig;
    use crate::bootloader::Bootloader;
    use crate::fly::pilot::Manner;
    use crate::rig::tests::counter;

    /// What is reported within some seconds of what was done by hand.
    fn reported(config: &RigConfig, actions: &[&str], seconds: u32) -> (Attended, Vec<String>) {
        let rig = Rig::new(&counter(), config).unwrap();
        let pilot = Pilot::new([0.0; 2], 0.0, Manner::Steady);
        let (mut attended, mut lines) = (Attended::new(rig, pilot), Vec::new());
        let mut report = |_: f64, line: &str| lines.push(line.to_owned());
        for action in actions {
            attended.act(action, &mut report);
            attended.run_for(Ticks::from_ms(100), &[], &mut report).unwrap();
        }
        for _ in 0..1000 * seconds {
            attended.run_for(Ticks::from_ms(1), &[], &mut report).unwrap();
        }
        lines.retain(|line| line.contains("power-cycled"));
        (attended, lines)
    }

    #[test]
    fn a_chip_that_stays_in_its_bootloader_is_power_cycled_once() {
        let mut config = RigConfig::default();
        config.hardware.bootloader = Bootloader::Arduino;
        let (attended, lines) = reported(&config, &["reset", "reset"], 4);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(!attended.rig.in_bootloader());
    }

    #[test]
    fn a_chip_without_supply_waits_for_it() {
        let actions = ["supply 1.65", "power-cycle"];
        let (mut attended, lines) = reported(&RigConfig::default(), &actions, 4);
        assert!(lines.is_empty() && attended.rig.in_bootloader(), "{lines:?}");
        attended.act("supply 3.3", &mut |_, _| ());
        attended.run_for(Ticks::from_ms(5), &[], &mut |_, _| ()).unwrap();
        assert!(!attended.rig.in_bootloader());
    }
}
