//! Every reader of the tool: what it is called, what it reads, and how it is given some bytes.

mod files;
mod image;
mod logs;
mod page;
mod recordings;
mod vehicle;

use super::mutate::Form;
use report::exit::BadInput;

/// What a reader made of an input: nothing of interest, or why it should have done something else.
pub type Outcome = Result<(), String>;

/// A reader.
pub struct Reader {
    /// What `READER` calls it.
    pub name: &'static str,
    /// The folder of its stored inputs.
    pub corpus: &'static str,
    /// What is in them.
    pub form: Form,
    /// Memory that it takes for the shortest input, bytes.
    pub own_bytes: u64,
    /// Memory beyond that, as a multiple of the input's length.
    pub times: u64,
    /// Reads an input, which has this number.
    pub read: fn(&[u8], u64) -> Outcome,
    /// The files of source that it stands for.
    pub sources: &'static [&'static str],
}

impl Reader {
    /// Most memory for an input of this length, bytes.
    pub fn limit(&self, length: usize) -> u64 {
        self.own_bytes + self.times * length as u64
    }
}

const KIB: u64 = 1024;
const MIB: u64 = 1024 * KIB;
/// Bytes of time before a frame of a log.
const STAMP: usize = 8;

/// All of them.
pub const READERS: &[Reader] = &[
    Reader {
        name: "log",
        corpus: "log",
        form: Form::Frames(STAMP),
        own_bytes: MIB,
        times: 300,
        read: logs::report,
        sources: &[
            "flights/src/log.rs",
            "flights/src/log/mcap.rs",
            "flights/src/log/reading.rs",
            "ground/src/logs/inspect/recover.rs",
        ],
    },
    Reader {
        name: "log-parts",
        corpus: "log",
        form: Form::Frames(STAMP),
        own_bytes: MIB,
        times: 300,
        read: logs::parts,
        sources: &["flights/src/log/span.rs", "ground/src/logs/inspect/cut.rs"],
    },
    Reader {
        name: "mcap",
        corpus: "mcap",
        form: Form::Bytes,
        own_bytes: MIB,
        times: 300,
        read: logs::report,
        sources: &["flights/src/log/mcap.rs"],
    },
    Reader {
        name: "table",
        corpus: "table",
        form: Form::Text,
        own_bytes: 512 * KIB,
        times: 100,
        read: recordings::table,
        sources: &["design/src/identify.rs", "ground/src/vehicle/calibrate/readings.rs"],
    },
    Reader {
        name: "recording",
        corpus: "recording",
        form: Form::Bytes,
        own_bytes: 512 * KIB,
        times: 100,
        read: recordings::recording,
        sources: &["recordings/src/source.rs", "recordings/src/imuq.rs"],
    },
    Reader {
        name: "recording-table",
        corpus: "recording-table",
        form: Form::Text,
        own_bytes: 512 * KIB,
        times: 100,
        read: recordings::recording,
        sources: &["recordings/src/table.rs"],
    },
    Reader {
        name: "faults-table",
        corpus: "faults-table",
        form: Form::Text,
        own_bytes: 2 * MIB,
        times: 100,
        read: recordings::faults,
        sources: &["reports/src/campaign.rs"],
    },
    Reader {
        name: "faults-run",
        corpus: "faults-run",
        form: Form::Text,
        own_bytes: 512 * KIB,
        times: 100,
        read: recordings::faults_run,
        sources: &["lab/src/faults/scenario.rs"],
    },
    Reader {
        name: "campaign-table",
        corpus: "campaign-table",
        form: Form::Text,
        own_bytes: MIB,
        times: 100,
        read: recordings::campaign,
        sources: &["reports/src/campaign.rs"],
    },
    Reader {
        name: "parameters",
        corpus: "parameters",
        form: Form::Text,
        own_bytes: 64 * KIB,
        times: 100,
        read: files::parameters,
        sources: &["flights/src/param_file.rs"],
    },
    Reader {
        name: "config",
        corpus: "config",
        form: Form::Text,
        own_bytes: 64 * KIB,
        times: 100,
        read: files::config,
        sources: &["ground/src/config.rs"],
    },
    Reader {
        name: "faults",
        corpus: "faults",
        form: Form::Text,
        own_bytes: 64 * KIB,
        times: 100,
        read: files::faults,
        sources: &["ground/src/flight/fly/faults.rs"],
    },
    Reader {
        name: "scenario",
        corpus: "scenario",
        form: Form::Text,
        own_bytes: 512 * KIB,
        times: 100,
        read: files::scenario,
        sources: &["design/src/model/simulate.rs", "plant/src/scenario/mod.rs"],
    },
    Reader {
        name: "vehicle-file",
        corpus: "vehicle-file",
        form: Form::Text,
        own_bytes: 4 * MIB,
        times: 100,
        read: files::vehicle_file,
        sources: &["plant/src/setup.rs", "plant/src/rocket/motor.rs", "design/src/vehicle.rs"],
    },
    Reader {
        name: "case",
        corpus: "case",
        form: Form::Text,
        own_bytes: 2 * MIB,
        times: 100,
        read: files::case,
        sources: &["design/src/montecarlo/case.rs"],
    },
    Reader {
        name: "action",
        corpus: "action",
        form: Form::Text,
        own_bytes: 64 * KIB,
        times: 100,
        read: files::action,
        sources: &["rig/src/fly/action.rs", "rig/src/fly/control.rs", "rig/src/bench/hardware.rs"],
    },
    Reader {
        name: "answer",
        corpus: "answer",
        form: Form::Text,
        own_bytes: 64 * KIB,
        times: 200,
        read: files::answer,
        sources: &[
            "ground/src/flight/rig.rs",
            "ground/src/flight/rig/tell.rs",
            "ground/src/vehicle/web/rig.rs",
        ],
    },
    Reader {
        name: "key",
        corpus: "key",
        form: Form::Bytes,
        own_bytes: 64 * KIB,
        times: 100,
        read: files::key,
        sources: &["ground/src/vehicle/signing.rs"],
    },
    Reader {
        name: "image",
        corpus: "image",
        form: Form::Bytes,
        own_bytes: 4 * MIB,
        times: 100,
        read: image::image,
        sources: &["rig/src/image/mod.rs", "ground/src/image.rs"],
    },
    Reader {
        name: "vehicle",
        corpus: "vehicle",
        form: Form::Frames(0),
        own_bytes: MIB,
        times: 100,
        read: vehicle::asked,
        sources: &["client/src/wire.rs"],
    },
    Reader {
        name: "vehicle-page",
        corpus: "vehicle",
        form: Form::Frames(0),
        own_bytes: 256 * KIB,
        times: 100,
        read: vehicle::page,
        sources: &[],
    },
    Reader {
        name: "recorder",
        corpus: "recorder",
        form: Form::Bytes,
        own_bytes: 256 * KIB,
        times: 100,
        read: vehicle::recorder,
        sources: &["ground/src/vehicle/recorder.rs"],
    },
    Reader {
        name: "station",
        corpus: "station",
        form: Form::Frames(0),
        own_bytes: MIB,
        times: 100,
        read: vehicle::station,
        sources: &["ground/src/vehicle/forward.rs", "ground/src/vehicle/forward/gate.rs"],
    },
    Reader {
        name: "request",
        corpus: "request",
        form: Form::Text,
        own_bytes: 512 * KIB,
        times: 100,
        read: page::request,
        sources: &["ground/src/vehicle/web/server.rs"],
    },
    Reader {
        name: "order",
        corpus: "order",
        form: Form::Text,
        own_bytes: 256 * KIB,
        times: 100,
        read: page::order,
        sources: &["ground/src/vehicle/web/socket.rs"],
    },
];

/// The value, if the input was not refused as unusable (exit status 2). Any other error is one of
/// the reader.
fn usable<T>(result: anyhow::Result<T>) -> Result<Option<T>, String> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.chain().any(|cause| cause.is::<BadInput>()) => Ok(None),
        Err(error) => Err(format!("not refused as unusable: {error:#}")),
    }
}

/// What must hold.
fn expect(holds: bool, what: &str) -> Outcome {
    if holds { Ok(()) } else { Err(what.to_owned()) }
}

/// A file of this thread that holds the bytes, for a reader that takes a path.
fn with_file<T>(bytes: &[u8], end: &str, read: impl FnOnce(&std::path::Path) -> T) -> T {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().unwrap();
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(format!("input.{end}"));
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    })
}
