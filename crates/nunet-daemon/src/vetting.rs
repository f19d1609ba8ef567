//! A model file is untrusted until it has been loaded and self-tested once in a child process with limits:
//! ONNX Runtime has crashed and read out of bounds on hostile files.
//!
//! The verdict is kept by the hash of everything it depends on, so a known file starts without a child.

use std::io::Read as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use nunet_core::graph::{Provider, model_files, model_hashes};
use rustix::process::{Resource, Rlimit, Signal, getrlimit, set_parent_process_death_signal, setrlimit};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use tracing::{debug, info};

use crate::cli::EngineArgs;
use crate::fault::{Fault, Refused};
use crate::installation;
use crate::library::{self, Found};
use crate::stream::Stop;
use crate::words::hexadecimal;

/// Loading and one prediction on a slow board; a file that takes longer is refused.
const TIME_LIMIT: Duration = Duration::from_mins(2);
/// The same where an engine is built for the model and the graphics card first.
const TIME_LIMIT_OF_ENGINES: Duration = Duration::from_mins(30);
/// Address space of the child beside what the file itself asks for, bytes.
const MEMORY_BASE: u64 = 4 << 30;
/// Address space for each byte of the model: optimised and packed copies of the weights.
const MEMORY_PER_MODEL_BYTE: u64 = 8;
/// The most that is read of the child's stderr.
const MAX_MESSAGE_BYTES: u64 = 64 * 1024;
/// How often the child is looked after.
const GLANCE: Duration = Duration::from_millis(5);

/// What the child found, as it is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    /// Loaded, and its numbers are right on this machine.
    Passed,
    /// The child did not survive it.
    Crashed(String),
}

/// Makes sure that `model` can be loaded into this process; returns the hashes of its files, for these alone have been
/// tested.
///
/// # Errors
/// A file that is none; what the child said of it, or how it ended; [`Stopped`](crate::stream::Stopped) where `stop` was
/// requested.
pub(crate) fn vet(
    model: &Path,
    engine: &EngineArgs,
    library: &Found,
    stop: &Stop,
) -> anyhow::Result<Vec<[u8; 32]>> {
    let record = Record::of(model, engine, library)?;
    let verdict = match record.recall() {
        Some(verdict) => verdict,
        None => {
            info!("first use of `{}` on this machine: testing it in a child process", model.display());
            let verdict = try_in_child(model, &record.files, engine, library, stop)?;
            record.keep(&verdict);
            verdict
        }
    };
    match verdict {
        Verdict::Passed => Ok(record.files),
        Verdict::Crashed(how) => bail!(
            "`{}` is refused: loading it in a child process {how}\nhint: the file is damaged or hostile; get it \
             again from a source you trust, or remove `{}` to have it tested again",
            model.display(),
            record.path.as_deref().unwrap_or(Path::new("its verdict")).display()
        ),
    }
}

/// Sets the child's limits (in the child).
///
/// Drivers of graphics cards map address space by the terabyte, so there the memory limit is left out.
///
/// # Errors
/// The model cannot be read, or the system refuses.
pub(crate) fn limit_this_process(model: &Path, provider: Provider) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot tie this process to its parent")?;
    let bytes: u64 =
        model_files(model)?.iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum();
    let limits = [
        (Resource::As, memory_limit(provider, bytes)),
        (Resource::Cpu, 2 * time_limit(provider).as_secs()),
        (Resource::Core, 0),
    ];
    for (resource, limit) in limits {
        let now = getrlimit(resource);
        let limit = now.maximum.map_or(limit, |maximum| maximum.min(limit));
        setrlimit(resource, Rlimit { current: Some(limit), maximum: now.maximum })
            .with_context(|| format!("cannot limit {resource:?}"))?;
    }
    Ok(())
}

fn memory_limit(provider: Provider, model_bytes: u64) -> u64 {
    match provider {
        Provider::Cuda | Provider::TensorRt => u64::MAX,
        Provider::Auto | Provider::Cpu | Provider::OpenVino => {
            MEMORY_BASE + model_bytes.saturating_mul(MEMORY_PER_MODEL_BYTE)
        }
    }
}

fn time_limit(provider: Provider) -> Duration {
    if provider == Provider::TensorRt { TIME_LIMIT_OF_ENGINES } else { TIME_LIMIT }
}

fn try_in_child(
    model: &Path,
    files: &[[u8; 32]],
    engine: &EngineArgs,
    library: &Found,
    stop: &Stop,
) -> anyhow::Result<Verdict> {
    let mut command = installation::nunetd()?;
    command.arg("vet").arg(model).arg("--onnxruntime").arg(&library.path);
    for hash in files {
        command.arg("--hash").arg(hexadecimal(hash));
    }
    command.arg("--provider").arg(engine.provider.to_string());
    if let Some(threads) = engine.threads {
        command.arg("--threads").arg(threads.to_string());
    }
    // A group of its own: the terminal's Ctrl-C is for this process to handle.
    let child =
        command.process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = child.context("cannot start a child process to test the model in")?;
    let messages = child.stderr.take().map(|stderr| std::thread::spawn(move || read_messages(stderr)));
    let kind = child.stdout.take().map(|stdout| std::thread::spawn(move || read_messages(stdout)));
    let limit = time_limit(engine.provider);
    let Some(status) = wait(&mut child, limit, stop)? else {
        bail!(
            "testing `{}` in a child process took longer than {} s\nhint: try again when the machine is less busy",
            model.display(),
            limit.as_secs()
        );
    };
    let said =
        |thread: Option<JoinHandle<String>>| thread.and_then(|thread| thread.join().ok()).unwrap_or_default();
    judge(status, &said(messages), &said(kind))
}

/// What the child says, up to a bound; read while it runs, so that a full pipe cannot stop it.
fn read_messages(stderr: impl std::io::Read) -> String {
    let mut bytes = Vec::new();
    // A broken pipe ends the messages, nothing else: the exit code is what counts.
    let _ = stderr.take(MAX_MESSAGE_BYTES).read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// `None` of a child that took too long. It is ended then, and by a stop.
fn wait(child: &mut std::process::Child, limit: Duration, stop: &Stop) -> anyhow::Result<Option<ExitStatus>> {
    let start = Instant::now();
    while start.elapsed() < limit && !stop.requested() {
        if let Some(status) = child.try_wait().context("cannot wait for the child process")? {
            return Ok(Some(status));
        }
        std::thread::sleep(GLANCE);
    }
    child.kill().context("cannot end the child process")?;
    child.wait().context("cannot wait for the child process")?;
    stop.check()?;
    Ok(None)
}

/// Signals that say something of the file: the child did what no program should.
const FAULTS: [Signal; 5] = [Signal::SEGV, Signal::BUS, Signal::ABORT, Signal::ILL, Signal::FPE];

/// Only a fault convicts the file. An orderly refusal may be this machine's (memory, library), and another signal came
/// from outside (somebody stopped it, or the system ran out of memory): neither is kept.
fn judge(status: ExitStatus, messages: &str, kind: &str) -> anyhow::Result<Verdict> {
    match (status.code(), status.signal()) {
        (Some(0), _) => Ok(Verdict::Passed),
        (Some(1 | 2), _) => {
            bail!(Refused { fault: Fault::named(kind), message: refusal(messages).to_owned() })
        }
        (_, Some(signal)) if FAULTS.iter().any(|fault| fault.as_raw() == signal) => {
            Ok(Verdict::Crashed(format!("ended with signal {signal}")))
        }
        (code, signal) => bail!(
            "the child process that tests the model was ended from outside ({})\nhint: start again; if it happens \
             again, look for the system's out-of-memory messages",
            code.or(signal).unwrap_or_default()
        ),
    }
}

/// The error that the child printed, without what else stands on its stderr.
fn refusal(messages: &str) -> &str {
    let start = messages.find("error: ").map_or(0, |at| at + "error: ".len());
    messages[start..].trim_end()
}

/// What a verdict depends on, and where it is kept.
#[derive(Debug)]
struct Record {
    /// `None` where there is no folder of this user's own: in a common one anybody could plant a verdict.
    path: Option<PathBuf>,
    /// SHA-256 of each file of the model.
    files: Vec<[u8; 32]>,
}

impl Record {
    fn of(model: &Path, engine: &EngineArgs, library: &Found) -> anyhow::Result<Self> {
        let files = model_hashes(model)?;
        let mut hash = Sha256::new_with_prefix(files.as_flattened());
        let about =
            library.path.metadata().with_context(|| format!("cannot read `{}`", library.path.display()))?;
        let changed = about.modified().ok();
        let rest =
            (env!("CARGO_PKG_VERSION"), &library.path, about.len(), changed, engine.provider, engine.threads);
        hash.update(format!("{rest:?}"));
        let name = hexadecimal(hash.finalize().as_slice());
        let path = library::cache_folder().map(|folder| folder.join("verdicts").join(name + ".json"));
        Ok(Self { path, files })
    }

    fn recall(&self) -> Option<Verdict> {
        serde_json::from_slice(&std::fs::read(self.path.as_ref()?).ok()?).ok()
    }

    /// A verdict that cannot be kept costs a child at the next start, nothing more.
    fn keep(&self, verdict: &Verdict) {
        let Some(path) = &self.path else { return };
        if let Err(error) = try_keep(path, verdict) {
            debug!("the verdict is not kept in `{}`: {error}", path.display());
        }
    }
}

fn try_keep(path: &Path, verdict: &Verdict) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    // Written aside and moved: a reader never sees half a verdict.
    let aside = path.with_extension(format!("{}.tmp", std::process::id()));
    std::fs::write(&aside, serde_json::to_vec(verdict)?)?;
    std::fs::rename(&aside, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEGMENTATION_FAULT: i32 = 11;

    fn engine() -> EngineArgs {
        EngineArgs { provider: Provider::Cpu, threads: None, onnxruntime: None }
    }

    fn record(folder: &Path, model: &[u8], library: &[u8]) -> Option<PathBuf> {
        let (model_path, library_path) = (folder.join("m.onnx"), folder.join("l.so"));
        std::fs::write(&model_path, model).unwrap();
        std::fs::write(&library_path, library).unwrap();
        Record::of(&model_path, &engine(), &Found { path: library_path, place: "test" }).unwrap().path
    }

    #[test]
    fn a_child_that_crashes_convicts_the_file_and_one_that_refuses_does_not() {
        let crashed = judge(ExitStatus::from_raw(SEGMENTATION_FAULT), "", "").unwrap();
        assert_eq!(crashed, Verdict::Crashed("ended with signal 11".into()));
        let refused = ExitStatus::from_raw(1 << 8);
        let error =
            judge(refused, "INFO something\nerror: `m.onnx` is empty\nhint: fill it\n", "model").unwrap_err();
        assert_eq!(error.to_string(), "`m.onnx` is empty\nhint: fill it");
        assert_eq!(Fault::of(&error), Fault::Model);
        assert_eq!(judge(ExitStatus::from_raw(0), "", "").unwrap(), Verdict::Passed);
    }

    #[test]
    fn a_child_that_was_stopped_from_outside_convicts_nobody() {
        for signal in [2, 15, 9, 1] {
            let error = judge(ExitStatus::from_raw(signal), "", "").unwrap_err().to_string();
            assert!(error.contains("ended from outside"), "signal {signal}: {error}");
        }
    }

    #[test]
    fn a_verdict_is_kept_and_recalled_and_half_of_one_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper/verdict.json");
        let record = Record { path: Some(path.clone()), files: Vec::new() };
        assert_eq!(record.recall(), None);
        record.keep(&Verdict::Crashed("badly".into()));
        assert_eq!(record.recall(), Some(Verdict::Crashed("badly".into())));
        std::fs::write(&path, b"{\"crash").unwrap();
        assert_eq!(record.recall(), None);
    }

    #[test]
    fn another_model_or_another_library_needs_another_verdict() {
        let folder = tempfile::tempdir().unwrap();
        let first = record(folder.path(), b"model", b"library");
        assert_ne!(record(folder.path(), b"other", b"library"), first);
        assert_ne!(record(folder.path(), b"model", b"another library"), first);
    }

    #[test]
    fn a_child_that_takes_too_long_is_ended() {
        let mut child = std::process::Command::new("sleep").arg("300").spawn().unwrap();
        assert_eq!(wait(&mut child, Duration::ZERO, &Stop::default()).unwrap(), None);
        assert!(child.try_wait().unwrap().is_some(), "the child goes on");
    }

    #[test]
    fn graphics_cards_have_no_limit_of_addresses_and_engines_have_time_to_be_built() {
        for provider in [Provider::Cuda, Provider::TensorRt] {
            assert_eq!(memory_limit(provider, 1), u64::MAX);
        }
        assert_eq!(memory_limit(Provider::Cpu, 1 << 20), MEMORY_BASE + (8 << 20));
        assert!(time_limit(Provider::TensorRt) > time_limit(Provider::Cuda));
    }

    #[test]
    fn a_stop_ends_the_child_and_says_nothing_of_the_file() {
        let stop = Stop::default();
        let mut child = std::process::Command::new("sleep").arg("300").spawn().unwrap();
        stop.request();
        let error = wait(&mut child, TIME_LIMIT, &stop).unwrap_err();
        assert!(error.is::<crate::stream::Stopped>(), "{error:#}");
        assert!(child.try_wait().unwrap().is_some(), "the child goes on");
    }

    #[test]
    fn the_childs_messages_are_read_up_to_a_bound() {
        let flood = std::io::repeat(b'x');
        assert_eq!(read_messages(flood).len() as u64, MAX_MESSAGE_BYTES);
    }
}
