//! `tvc rig`: the virtual rig in real time, for every program that opens a serial port.

use anyhow::Result;

use crate::cli::Rig;
use crate::failure::Verdict;

/// Pitch rate at which the drone leaves the clamp, rad/s, as in `tvc fly`.
#[cfg(unix)]
const RELEASE_RATE_RAD_S: f64 = 0.2;

/// Faults may begin until then after a release, s.
#[cfg(unix)]
const LONGEST_S: f64 = 3600.0;

/// Runs the rig until it is told to end.
#[cfg(unix)]
pub fn run(options: &Rig) -> Result<Verdict> {
    use std::io::Write;
    use std::time::Duration;

    use anyhow::Context;
    use rig::hand::Hand;
    use rig::pty::Pty;
    use rig::real_time::RealTime;

    let scenario = options.faults.as_deref();
    let scenario = scenario
        .map(|path| crate::fly::faults::read(path, options.seed, LONGEST_S))
        .transpose()?
        .unwrap_or_default();
    let stop = crate::stop::on_signal()?;
    let link = options.link.as_deref().map(Link::claim).transpose()?;
    let image = rig::image::build(&mut |line| eprintln!("{line}")).context("the image")?;
    let mut config = rig::RigConfig {
        seed: options.seed,
        stored: (!options.blank).then(rig::RigConfig::set_up),
        ..rig::RigConfig::default()
    };
    config.bench.servo = options.servo.kind().model();
    config.bench.sensor.errors = options.sensor.errors();
    config.bench.start_rad = options.tilt;
    let drone = config.bench.parameters;
    config.bench.parameters = drone.with_lateral_offset(options.cm_offset * 1e-3);
    config.bench.disturbances = options.disturb.over(scenario.disturbances);
    config.bench.faults = scenario.faults;
    let rig = rig::Rig::new(&image, &config)?;
    let pty = Pty::open().context("making a pseudo-terminal")?;
    if let Some(link) = &link {
        link.point_to(pty.path())?;
    }
    println!("{}", pty.path().display());
    std::io::stdout().flush()?;
    eprintln!(
        "the rig runs in real time: servo {}, seed {}, tilt {} rad; Ctrl-C ends it",
        options.servo.name(),
        options.seed,
        options.tilt
    );
    let hand = Hand::new(options.tilt, RELEASE_RATE_RAD_S).with_manner(options.hand.manner());
    let longest = options.seconds.map(Duration::from_secs_f64);
    let summary = RealTime::new(rig, hand, pty)
        .at_speed(options.speed)
        .run(longest, stop, &mut |at_s, line| {
            eprintln!("{at_s:9.3} s  {line}");
        })
        .context("the rig")?;
    eprintln!(
        "ran for {:.1} s: {} control steps, control jitter at most {:.1} us",
        summary.seconds, summary.steps, summary.jitter_us_max
    );
    if summary.lost_s > 0.0 {
        eprintln!(
            "this machine was too slow for real time: the rig's clock lost {:.1} s",
            summary.lost_s
        );
    }
    Ok(Verdict::Met)
}

/// Pseudo-terminals are Unix's.
#[cfg(not(unix))]
pub fn run(_options: &Rig) -> Result<Verdict> {
    Err(crate::failure::BadInput::new(
        "pseudo-terminals need Linux or macOS; `tvc fly` runs the rig everywhere",
    )
    .into())
}

/// A symbolic link that goes when the rig goes.
#[cfg(unix)]
struct Link(std::path::PathBuf);

#[cfg(unix)]
impl Link {
    /// Takes the path for the link. Only an old link may be in its place.
    fn claim(path: &std::path::Path) -> Result<Self> {
        use crate::failure::BadInput;

        match std::fs::symlink_metadata(path) {
            Ok(there) if !there.is_symlink() => Err(BadInput::new(format!(
                "{} is there already and is no link; give --link another path",
                path.display()
            ))
            .into()),
            _ => Ok(Self(path.to_owned())),
        }
    }

    fn point_to(&self, target: &std::path::Path) -> Result<()> {
        use crate::failure::BadInput;

        let _ = std::fs::remove_file(&self.0);
        std::os::unix::fs::symlink(target, &self.0).map_err(|error| {
            BadInput::new(format!(
                "cannot make the link {}: {error}",
                self.0.display()
            ))
            .into()
        })
    }
}

#[cfg(unix)]
impl Drop for Link {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}
