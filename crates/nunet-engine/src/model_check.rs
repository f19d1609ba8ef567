//! The model check: a model file is untrusted until it has been loaded and self-tested once in a child
//! process with limits. ONNX Runtime has crashed and read out of bounds on hostile files.
//!
//! The parent starts `nunetd check-model` ([`check`]); the child limits itself and loads the model
//! (`checked_load.rs`). If it refuses the model, it prints one JSON object on stdout.

use std::error::Error;
use std::io::Read as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nunet_core::graph::Provider;
use nunet_types::CAUSE_MARK;
use rustix::process::Signal;
use serde::{Deserialize, Serialize};
use tracing::info;

use crate::error::EngineError;
use crate::error_kind::EngineErrorKind;
use crate::installation;
use crate::library::LibraryFile;
use crate::options::EngineOptions;
use crate::text::hexadecimal;
use crate::verdict::{Verdict, VerdictRecord};

/// Loading and one prediction on a slow board.
const TIME_LIMIT: Duration = Duration::from_mins(2);
/// The time limit if TensorRT first builds an engine for the model.
const TIME_LIMIT_WITH_ENGINE: Duration = Duration::from_mins(30);
/// The largest output of the child that is read.
const MAX_OUTPUT_BYTES: u64 = 64 * 1024;
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// The hidden subcommand of `nunetd` that runs in the child process.
pub const CHECK_SUBCOMMAND: &str = "check-model";

/// What the child process reports about a model that it refuses: the JSON object on its stdout.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// The error's kind, by name.
    kind: String,
    /// The error and its causes, with [`CAUSE_MARK`] between them.
    message: String,
    /// The hint.
    hint: Option<String>,
    /// ONNX Runtime's own message. Absent in reports of older versions.
    #[serde(default)]
    details: Option<String>,
}

impl Refusal {
    /// The report about an error; `message`, with [`CAUSE_MARK`] before each cause, and `hint` are shown to
    /// the user.
    #[must_use]
    pub fn new(kind: EngineErrorKind, message: impl Into<String>, hint: Option<String>) -> Self {
        Self { kind: kind.name().to_owned(), message: message.into(), hint, details: None }
    }

    /// The same with what only a log of details should show.
    #[must_use]
    pub fn with_details(self, details: Option<&str>) -> Self {
        Self { details: details.map(str::to_owned), ..self }
    }

    /// One line of JSON.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    fn into_error(self) -> EngineError {
        let Self { kind, message, hint, details } = self;
        let mut parts = message.split(CAUSE_MARK).map(str::to_owned);
        let message = parts.next().unwrap_or_default();
        let causes: Vec<String> = parts.collect();
        let source = causes.into_iter().rfold(None, |source, message| {
            let cause: Box<dyn Error + Send + Sync> = Box::new(ReportedCause { message, source });
            Some(cause)
        });
        EngineError::Refused { kind: EngineErrorKind::named(&kind), message, source, hint, details }
    }
}

/// A cause that the child process reported.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct ReportedCause {
    message: String,
    source: Option<Box<dyn Error + Send + Sync>>,
}

/// Makes sure that `model` can be loaded into this process. Returns the hashes of its files: only these were
/// checked.
///
/// # Errors
/// A path that is not a model file, what the child process reported or how it ended, and
/// [`EngineError::Stopped`] if `cancel` became true.
pub(crate) fn check(
    model: &Path,
    options: &EngineOptions,
    library: &LibraryFile,
    cancel: &AtomicBool,
) -> Result<Vec<[u8; 32]>, EngineError> {
    let record = VerdictRecord::of(model, options, library)?;
    let verdict = match record.stored() {
        Some(verdict) => verdict,
        None => {
            info!("first use of `{}` on this machine: checking it in a child process", model.display());
            let verdict = check_in_child(model, &record.files, options, library, cancel)?;
            record.store(&verdict);
            verdict
        }
    };
    match verdict {
        Verdict::Passed => Ok(record.files),
        Verdict::Crashed(how) => {
            Err(EngineError::Crashed { path: model.to_owned(), how, verdict: record.path })
        }
    }
}

pub(crate) fn time_limit(provider: Provider) -> Duration {
    if provider == Provider::TensorRt { TIME_LIMIT_WITH_ENGINE } else { TIME_LIMIT }
}

fn check_in_child(
    model: &Path,
    files: &[[u8; 32]],
    options: &EngineOptions,
    library: &LibraryFile,
    cancel: &AtomicBool,
) -> Result<Verdict, EngineError> {
    let mut child = start_child(model, files, options, library)?;
    let (stdout, stderr) = start_readers(&mut child).inspect_err(|_| {
        // Whether it has ended already does not matter.
        let _ = child.kill();
        let _ = child.wait();
    })?;
    let limit = time_limit(options.provider);
    let Some(status) = wait(&mut child, limit, cancel)? else {
        return Err(EngineError::CheckTimedOut { path: PathBuf::from(model), seconds: limit.as_secs() });
    };
    let text = |reader: Option<JoinHandle<String>>| reader.and_then(|thread| thread.join().ok());
    judge(status, &text(stdout).unwrap_or_default(), &text(stderr).unwrap_or_default())
}

fn start_child(
    model: &Path,
    files: &[[u8; 32]],
    options: &EngineOptions,
    library: &LibraryFile,
) -> Result<Child, EngineError> {
    let mut command = installation::nunetd()?;
    command.arg(CHECK_SUBCOMMAND).arg(model).arg("--onnxruntime").arg(&library.path);
    for hash in files {
        command.arg("--hash").arg(hexadecimal(hash));
    }
    command.arg("--provider").arg(options.provider.to_string());
    if let Some(threads) = options.threads {
        command.arg("--threads").arg(threads.to_string());
    }
    // A process group of its own, so that Ctrl-C in a terminal reaches this process only.
    command.process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().map_err(EngineError::system("cannot start the child process of the model check"))
}

/// The threads that read the outputs of the child.
type Readers = (Option<JoinHandle<String>>, Option<JoinHandle<String>>);

fn start_readers(child: &mut Child) -> Result<Readers, EngineError> {
    Ok((reader(child.stdout.take())?, reader(child.stderr.take())?))
}

fn reader(
    pipe: Option<impl std::io::Read + Send + 'static>,
) -> Result<Option<JoinHandle<String>>, EngineError> {
    let start =
        |pipe| std::thread::Builder::new().name("model check".into()).spawn(move || read_output(pipe));
    pipe.map(start).transpose().map_err(EngineError::system("cannot start a thread of the model check"))
}

/// An output of the child up to a bound. Read while the child runs, so that a full pipe cannot stop it.
fn read_output(pipe: impl std::io::Read) -> String {
    let mut bytes = Vec::new();
    // A broken pipe only ends the text; the exit code decides.
    let _ = pipe.take(MAX_OUTPUT_BYTES).read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Waits for the child to end. Past the limit, or if `cancel` becomes true, the child is killed; `None` past
/// the limit.
fn wait(child: &mut Child, limit: Duration, cancel: &AtomicBool) -> Result<Option<ExitStatus>, EngineError> {
    let failed = || EngineError::system("cannot wait for the child process of the model check");
    let start = Instant::now();
    while start.elapsed() < limit && !cancel.load(Ordering::Relaxed) {
        if let Some(status) = child.try_wait().map_err(failed())? {
            return Ok(Some(status));
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    child.kill().map_err(failed())?;
    child.wait().map_err(failed())?;
    if cancel.load(Ordering::Relaxed) { Err(EngineError::Stopped) } else { Ok(None) }
}

/// The signals of a crash.
const CRASHES: [Signal; 5] = [Signal::SEGV, Signal::BUS, Signal::ABORT, Signal::ILL, Signal::FPE];

/// The exit code of a Rust program that panicked.
const PANIC: i32 = 101;

/// Only a crash counts against the file and is stored. A reported refusal may be due to this machine
/// (memory, library), and any other signal came from outside (a user, or the system when memory ran out).
fn judge(status: ExitStatus, stdout: &str, stderr: &str) -> Result<Verdict, EngineError> {
    match (status.code(), status.signal()) {
        (Some(0), _) => Ok(Verdict::Passed),
        (Some(1 | 2 | PANIC), _) => Err(refusal(stdout, stderr).into_error()),
        (_, Some(signal)) if CRASHES.iter().any(|crash| crash.as_raw() == signal) => {
            Ok(Verdict::Crashed(format!("ended with signal {signal}")))
        }
        (code, signal) => Err(EngineError::CheckInterrupted { status: code.or(signal).unwrap_or_default() }),
    }
}

/// The report of the child, or its stderr if it reported nothing (another version, bad arguments).
fn refusal(stdout: &str, stderr: &str) -> Refusal {
    let report = stdout.lines().rev().find_map(|line| serde_json::from_str(line).ok());
    report.unwrap_or_else(|| {
        let message = format!("the model check failed: {}", stderr.trim_end());
        Refusal::new(EngineErrorKind::Other, message, None)
    })
}

#[cfg(test)]
mod tests {
    use nunet_types::{Hint as _, text_with_causes};

    use super::*;

    fn sleeping() -> Child {
        std::process::Command::new("sleep").arg("300").spawn().unwrap()
    }

    #[test]
    fn a_crash_refuses_the_file() {
        let crashed = judge(ExitStatus::from_raw(Signal::SEGV.as_raw()), "", "").unwrap();
        assert_eq!(crashed, Verdict::Crashed("ended with signal 11".into()));
        assert_eq!(judge(ExitStatus::from_raw(0), "", "").unwrap(), Verdict::Passed);
    }

    #[test]
    fn a_refusal_keeps_its_kind_its_message_and_its_hint() {
        let report = Refusal::new(EngineErrorKind::Wiring, "stages do not fit", Some("export again".into()))
            .with_details(Some("/a/b.cc:1 f() stages do not fit"));
        let stdout = format!("{}\n", report.to_json());
        let error = judge(ExitStatus::from_raw(1 << 8), &stdout, "WARN something\n").unwrap_err();
        assert_eq!(error.kind(), EngineErrorKind::Wiring);
        assert_eq!(
            (error.to_string().as_str(), error.hint().as_deref()),
            ("stages do not fit", Some("export again"))
        );
        assert_eq!(error.details(), Some("/a/b.cc:1 f() stages do not fit"));
    }

    #[test]
    fn the_causes_in_a_refusal_are_causes_of_the_error() {
        let message = format!("cannot use `a`{CAUSE_MARK}stages do not fit{CAUSE_MARK}`b` is too large");
        let error = Refusal::new(EngineErrorKind::Wiring, message, None).into_error();
        assert_eq!(error.to_string(), "cannot use `a`");
        assert_eq!(text_with_causes(&error), "cannot use `a`: stages do not fit: `b` is too large");
    }

    #[test]
    fn a_child_that_reports_nothing_is_quoted() {
        let error = judge(ExitStatus::from_raw(2 << 8), "", "error: unexpected argument\n").unwrap_err();
        assert_eq!(error.kind(), EngineErrorKind::Other);
        assert!(error.to_string().ends_with("error: unexpected argument"), "{error}");
    }

    #[test]
    fn a_child_that_panicked_is_quoted() {
        let error = judge(ExitStatus::from_raw(PANIC << 8), "", "thread 'main' panicked\n").unwrap_err();
        assert_eq!(error.kind(), EngineErrorKind::Other);
        assert!(error.to_string().ends_with("thread 'main' panicked"), "{error}");
    }

    #[test]
    fn a_child_that_was_killed_from_outside_gives_no_verdict() {
        for signal in [Signal::INT, Signal::TERM, Signal::KILL, Signal::HUP] {
            let error = judge(ExitStatus::from_raw(signal.as_raw()), "", "").unwrap_err();
            assert!(matches!(error, EngineError::CheckInterrupted { .. }), "{signal:?}: {error}");
        }
    }

    #[test]
    fn a_child_that_takes_too_long_is_killed() {
        let mut child = sleeping();
        assert_eq!(wait(&mut child, Duration::ZERO, &AtomicBool::new(false)).unwrap(), None);
        assert!(child.try_wait().unwrap().is_some(), "the child goes on");
    }

    #[test]
    fn a_shutdown_kills_the_child_and_gives_no_verdict() {
        let mut child = sleeping();
        let error = wait(&mut child, TIME_LIMIT, &AtomicBool::new(true)).unwrap_err();
        assert_eq!(error.kind(), EngineErrorKind::Stopped);
        assert!(child.try_wait().unwrap().is_some(), "the child goes on");
    }

    #[test]
    fn the_childs_output_is_read_up_to_a_bound() {
        assert_eq!(read_output(std::io::repeat(b'x')).len() as u64, MAX_OUTPUT_BYTES);
    }
}
