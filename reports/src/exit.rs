//! How a command ends: exit status 2 and one line for unusable input, status 1 for a requirement
//! that was missed and for everything else that failed.

use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

use thiserror::Error;

/// Exit status of a command whose input was unusable.
const BAD_INPUT: u8 = 2;
/// Exit status of a command that failed, or whose result missed a requirement.
const FAILED: u8 = 1;

/// Unusable input: a file that is not there, a value out of range, a port that does not exist.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct BadInput(String);

impl BadInput {
    /// An error in one line, which says what was wrong and what would be right.
    pub fn new(what: impl Display) -> Self {
        Self(what.to_string())
    }

    /// What is wrong with a file, behind its name.
    pub fn of(file: &Path, what: impl Display) -> Self {
        Self(format!("{}: {what}", file.display()))
    }
}

/// Whether a command that ran to its end found everything as required.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Every requirement holds.
    Met,
    /// At least one figure missed its requirement; the output says which.
    Missed,
    /// What the command was to examine is not there, or cannot be used; the output says why.
    Unusable,
}

impl Verdict {
    /// Met if `met` holds.
    pub fn of(met: bool) -> Self {
        if met { Self::Met } else { Self::Missed }
    }
}

/// Prints the error, if any, as one line on standard error and gives the exit status.
pub fn exit_code(result: anyhow::Result<Verdict>) -> ExitCode {
    match result {
        Ok(Verdict::Met) => ExitCode::SUCCESS,
        Ok(Verdict::Missed) => ExitCode::from(FAILED),
        Ok(Verdict::Unusable) => ExitCode::from(BAD_INPUT),
        Err(error) => {
            eprintln!("error: {}", one_line(&error));
            let bad_input = error.chain().any(|cause| cause.is::<BadInput>());
            ExitCode::from(if bad_input { BAD_INPUT } else { FAILED })
        }
    }
}

/// The chain of causes as `what: why: why`, line breaks folded.
fn one_line(error: &anyhow::Error) -> String {
    format!("{error:#}").split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn bad_input_keeps_its_status_under_added_context() {
        let result: anyhow::Result<Verdict> =
            Err(BadInput::new("no such file")).context("reading flight.imuq");
        assert_eq!(format!("{:?}", exit_code(result)), format!("{:?}", ExitCode::from(2)));
    }

    #[test]
    fn an_error_of_several_lines_is_folded_into_one() {
        let error = anyhow::anyhow!("first\n  second").context("outer");
        assert_eq!(one_line(&error), "outer: first second");
    }
}
