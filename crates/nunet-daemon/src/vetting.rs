//! A model file is untrusted until it has been loaded and self-tested once in a child process with limits:
//! ONNX Runtime has crashed and read out of bounds on hostile files.
//!
//! The verdict is kept by the hash of everything it depends on, so a known file starts without a child.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use nunet_core::graph::{Provider, model_files};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use tracing::{debug, info};

use crate::cli::EngineArgs;
use crate::library::{self, Found};

/// Loading and one prediction on a slow board; a file that takes longer is refused.
const TIME_LIMIT: Duration = Duration::from_secs(120);
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

/// Makes sure that `model` can be loaded into this process.
///
/// # Errors
/// What the child said of the file, or how it ended.
pub(crate) fn vet(model: &Path, engine: &EngineArgs, library: &Found) -> anyhow::Result<()> {
    let record = Record::of(model, engine, library)?;
    let verdict = match record.recall() {
        Some(verdict) => verdict,
        None => {
            info!("first use of `{}` on this machine: testing it in a child process", model.display());
            let verdict = try_in_child(model, engine, library)?;
            record.keep(&verdict);
            verdict
        }
    };
    match verdict {
        Verdict::Passed => Ok(()),
        Verdict::Crashed(how) => bail!(
            "`{}` is refused: loading it in a child process {how}\nhint: the file is damaged or hostile; get it \
             again from a source you trust (the verdict is kept in `{}`)",
            model.display(),
            record.path.display()
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
    let bytes: u64 =
        model_files(model)?.iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum();
    let memory = match provider {
        Provider::Cuda | Provider::TensorRt => u64::MAX,
        Provider::Auto | Provider::Cpu | Provider::OpenVino => {
            MEMORY_BASE + bytes.saturating_mul(MEMORY_PER_MODEL_BYTE)
        }
    };
    for (resource, limit) in
        [(Resource::As, memory), (Resource::Cpu, 2 * TIME_LIMIT.as_secs()), (Resource::Core, 0)]
    {
        let now = getrlimit(resource);
        let limit = now.maximum.map_or(limit, |maximum| maximum.min(limit));
        setrlimit(resource, Rlimit { current: Some(limit), maximum: now.maximum })
            .with_context(|| format!("cannot limit {resource:?}"))?;
    }
    Ok(())
}

fn try_in_child(model: &Path, engine: &EngineArgs, library: &Found) -> anyhow::Result<Verdict> {
    let exe = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new(exe);
    command.arg("vet").arg(model).arg("--onnxruntime").arg(&library.path);
    command.arg("--provider").arg(engine.provider.to_string());
    if let Some(threads) = engine.threads {
        command.arg("--threads").arg(threads.to_string());
    }
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut child = child.context("cannot start a child process to test the model in")?;
    let messages = child.stderr.take().map(|stderr| std::thread::spawn(move || read_messages(stderr)));
    let Some(status) = wait(&mut child)? else {
        return Ok(Verdict::Crashed(format!("took longer than {} s", TIME_LIMIT.as_secs())));
    };
    let messages = messages.and_then(|thread| thread.join().ok()).unwrap_or_default();
    judge(status, &messages)
}

/// What the child says, up to a bound; read while it runs, so that a full pipe cannot stop it.
fn read_messages(stderr: impl std::io::Read) -> String {
    let mut bytes = Vec::new();
    // A broken pipe ends the messages, nothing else: the exit code is what counts.
    let _ = stderr.take(MAX_MESSAGE_BYTES).read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn wait(child: &mut std::process::Child) -> anyhow::Result<Option<ExitStatus>> {
    let start = Instant::now();
    while start.elapsed() < TIME_LIMIT {
        if let Some(status) = child.try_wait().context("cannot wait for the child process")? {
            return Ok(Some(status));
        }
        std::thread::sleep(GLANCE);
    }
    child.kill().context("cannot end the child process")?;
    child.wait().context("cannot wait for the child process")?;
    Ok(None)
}

/// An orderly refusal is an error and is not kept: it may be this machine's (memory, library) and not the file's.
fn judge(status: ExitStatus, messages: &str) -> anyhow::Result<Verdict> {
    use std::os::unix::process::ExitStatusExt as _;
    match (status.code(), status.signal()) {
        (Some(0), _) => Ok(Verdict::Passed),
        (Some(1 | 2), _) => bail!("{}", refusal(messages)),
        (Some(code), _) => Ok(Verdict::Crashed(format!("ended with exit code {code}"))),
        (None, signal) => Ok(Verdict::Crashed(format!("ended with signal {}", signal.unwrap_or_default()))),
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
    path: PathBuf,
}

impl Record {
    fn of(model: &Path, engine: &EngineArgs, library: &Found) -> anyhow::Result<Self> {
        let mut hash = Sha256::new();
        for file in model_files(model)? {
            let bytes = std::fs::read(&file).with_context(|| format!("cannot read `{}`", file.display()))?;
            hash.update((bytes.len() as u64).to_le_bytes());
            hash.update(&bytes);
        }
        let about =
            library.path.metadata().with_context(|| format!("cannot read `{}`", library.path.display()))?;
        let changed = about.modified().ok();
        let rest =
            (env!("CARGO_PKG_VERSION"), &library.path, about.len(), changed, engine.provider, engine.threads);
        hash.update(format!("{rest:?}"));
        let name: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        let folder = library::cache_folder().unwrap_or_else(std::env::temp_dir).join("verdicts");
        Ok(Self { path: folder.join(name + ".json") })
    }

    fn recall(&self) -> Option<Verdict> {
        serde_json::from_slice(&std::fs::read(&self.path).ok()?).ok()
    }

    /// A verdict that cannot be kept costs a child at the next start, nothing more.
    fn keep(&self, verdict: &Verdict) {
        if let Err(error) = self.try_keep(verdict) {
            debug!("the verdict is not kept in `{}`: {error}", self.path.display());
        }
    }

    fn try_keep(&self, verdict: &Verdict) -> std::io::Result<()> {
        if let Some(folder) = self.path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        // Written aside and moved: a reader never sees half a verdict.
        let aside = self.path.with_extension(format!("{}.tmp", std::process::id()));
        std::fs::write(&aside, serde_json::to_vec(verdict)?)?;
        std::fs::rename(&aside, &self.path)
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;

    use super::*;

    const SEGMENTATION_FAULT: i32 = 11;

    fn engine() -> EngineArgs {
        EngineArgs { provider: Provider::Cpu, threads: None, onnxruntime: None }
    }

    fn record(folder: &Path, model: &[u8], library: &[u8]) -> PathBuf {
        let (model_path, library_path) = (folder.join("m.onnx"), folder.join("l.so"));
        std::fs::write(&model_path, model).unwrap();
        std::fs::write(&library_path, library).unwrap();
        Record::of(&model_path, &engine(), &Found { path: library_path, place: "test" }).unwrap().path
    }

    #[test]
    fn a_child_that_crashes_convicts_the_file_and_one_that_refuses_does_not() {
        let crashed = judge(ExitStatus::from_raw(SEGMENTATION_FAULT), "").unwrap();
        assert_eq!(crashed, Verdict::Crashed("ended with signal 11".into()));
        let refused = ExitStatus::from_raw(1 << 8);
        let error = judge(refused, "INFO something\nerror: `m.onnx` is empty\nhint: fill it\n").unwrap_err();
        assert_eq!(error.to_string(), "`m.onnx` is empty\nhint: fill it");
        assert_eq!(judge(ExitStatus::from_raw(0), "").unwrap(), Verdict::Passed);
    }

    #[test]
    fn a_verdict_is_kept_and_recalled_and_half_of_one_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let record = Record { path: folder.path().join("deeper/verdict.json") };
        assert_eq!(record.recall(), None);
        record.keep(&Verdict::Crashed("badly".into()));
        assert_eq!(record.recall(), Some(Verdict::Crashed("badly".into())));
        std::fs::write(&record.path, b"{\"crash").unwrap();
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
    fn the_childs_messages_are_read_up_to_a_bound() {
        let flood = std::io::repeat(b'x');
        assert_eq!(read_messages(flood).len() as u64, MAX_MESSAGE_BYTES);
    }
}
