//! Writes files on a separate thread, so that a hanging disk blocks only those who wait for the files.

use std::borrow::Cow;
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow};
use nunet_telemetry::{DrainTimeout, GivenUp};
use nunet_types::Hint;

use crate::error_kind::SinkErrorKind;

/// Files were not written in time.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {what}: {reason}")]
pub struct FilesLate {
    what: String,
    reason: GivenUp,
}

impl FilesLate {
    /// [`SinkErrorKind::TimedOut`].
    #[must_use]
    pub fn kind(&self) -> SinkErrorKind {
        SinkErrorKind::TimedOut
    }
}

impl Hint for FilesLate {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some("check whether the disk or mount responds".into())
    }
}

/// Pending writes.
pub struct FileWriter {
    /// What is written, for messages.
    what: String,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl FileWriter {
    /// Starts `write`, which owns everything it needs. `what` names the files in messages.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start(
        what: String,
        write: impl FnOnce() -> anyhow::Result<()> + Send + 'static,
    ) -> anyhow::Result<Self> {
        let thread = std::thread::Builder::new().name("files".into()).spawn(write);
        let thread = thread.with_context(|| format!("cannot start a thread to write {what}"))?;
        Ok(Self { what, thread })
    }

    /// Waits up to `timeout` until they are written, and abandons the rest.
    ///
    /// # Errors
    /// The files could not be written, or not in time.
    pub fn end(self, timeout: &mut DrainTimeout<'_>) -> anyhow::Result<()> {
        let Self { what, thread } = self;
        if let Err(reason) = timeout.wait(&what, || thread.is_finished(), || 0) {
            return Err(FilesLate { what, reason }.into());
        }
        thread
            .join()
            .map_err(|_| anyhow!("cannot write {what}: the thread panicked, see the lines above"))
            .flatten()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn success_and_failure_are_reported_at_the_end() {
        let mut timeout = DrainTimeout::new(&|| false);
        let well = FileWriter::start("a file".into(), || Ok(())).unwrap();
        assert!(well.end(&mut timeout).is_ok());
        let badly = FileWriter::start("a file".into(), || anyhow::bail!("the disk is full")).unwrap();
        assert_eq!(badly.end(&mut timeout).unwrap_err().to_string(), "the disk is full");
    }

    #[test]
    fn a_disk_that_hangs_is_abandoned_after_a_stop() {
        let (let_go, hangs) = channel::<()>();
        let writer = FileWriter::start("the files in `o`".into(), move || Ok(hangs.recv()?)).unwrap();
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, Duration::from_secs(60));
        let error = writer.end(&mut timeout).unwrap_err();
        assert_eq!(
            error.to_string(),
            "cannot write the files in `o`: timed out 0 s after shutdown was requested"
        );
        assert_eq!(error.downcast_ref().map(FilesLate::kind), Some(SinkErrorKind::TimedOut));
        drop(let_go);
    }
}
