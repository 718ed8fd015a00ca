//! The report of a recording, made by a process of its own: what it takes in time and memory is not
//! taken from the process that holds STOP.

use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use report::input;

/// Longest log of a report from the page, bytes: some three hours. Its report takes twice as much
/// memory.
const LONGEST: u64 = 256 << 20;
/// Longest page, bytes.
const PAGE: u64 = 256 << 20;
/// Time for a report.
const PATIENCE: Duration = Duration::from_secs(120);
/// Time between two looks at whether it is made.
const LOOK: Duration = Duration::from_millis(20);

/// Makes the page of `tvc report` of a log by `program`, unless `refusal` says why none is to be
/// made; that is asked again and again until the page is there.
///
/// # Errors
/// The refusal, or why there is no report.
pub fn page(
    program: &Path,
    log: &Path,
    refusal: &dyn Fn() -> Option<&'static str>,
) -> Result<Vec<u8>> {
    if let Some(why) = refusal() {
        bail!(why);
    }
    let length = log.metadata()?.len();
    ensure!(
        length <= LONGEST,
        "a report of a log above {} MiB takes long: `tvc report {}` makes it in a terminal",
        LONGEST >> 20,
        log.display()
    );
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let (page, said) = (folder.path().join("report.html"), folder.path().join("said"));
    let process = Command::new(program)
        .args(["report".as_ref(), log, "--out".as_ref(), &page])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&said)?)
        .spawn();
    let mut process = Running(process.context("starting tvc report")?);
    let begun = Instant::now();
    while process.0.try_wait()?.is_none() {
        if let Some(why) = refusal() {
            bail!(why);
        }
        ensure!(
            begun.elapsed() < PATIENCE,
            "the report was not made within {} s",
            PATIENCE.as_secs()
        );
        std::thread::sleep(LOOK);
    }
    // Its status says whether the requirements of the flight are met.
    if page.is_file() {
        return Ok(input::bytes(&page, PAGE)?);
    }
    let said = input::text(&said)?;
    let why = said.lines().last().unwrap_or("the report broke off");
    bail!("{}", why.trim_start_matches("error: "))
}

/// A process that ends with this.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::script;
    use std::cell::Cell;

    /// A program that does this with LOG and PAGE.
    fn program(folder: &Path, script: &str) -> std::path::PathBuf {
        let path = folder.join("program");
        script::write(&path, &format!("LOG=$2 PAGE=$4\n{script}"));
        path
    }

    #[test]
    fn a_report_is_the_page_whatever_its_status_or_the_last_words() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.tlog");
        std::fs::write(&log, "log").unwrap();
        let made = |script: &str| page(&program(folder.path(), script), &log, &|| None);
        let missed = "cp $LOG $PAGE; echo missed: much >&2; exit 1";
        assert_eq!(made(missed).unwrap(), b"log");
        let why = made("echo missed: a >&2; echo error: no log >&2; exit 2");
        assert_eq!(why.unwrap_err().to_string(), "no log");
        assert!(page(Path::new("/none"), &log, &|| None).is_err());
    }

    #[test]
    fn a_long_log_is_refused_and_what_is_under_way_ends_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.tlog");
        let file = File::create(&log).unwrap();
        let endless = program(folder.path(), "echo $$ > $LOG.pid; exec sleep 60");
        let looks = Cell::new(0);
        let refusal = || {
            looks.set(looks.get() + 1);
            (looks.get() > 10).then_some("armed")
        };
        let begun = Instant::now();
        let why = page(&endless, &log, &refusal).unwrap_err().to_string();
        assert_eq!(why, "armed");
        assert!(begun.elapsed() < PATIENCE / 4);
        let id = std::fs::read_to_string(folder.path().join("a.tlog.pid")).unwrap();
        let is_there = Path::new("/proc").join(id.trim()).exists();
        assert!(!is_there, "it goes on");
        file.set_len(LONGEST + 1).unwrap();
        let why = page(&endless, &log, &|| None).unwrap_err().to_string();
        assert!(why.contains("`tvc report "), "{why}");
    }
}
