//! Writes files on a separate thread, so that a hanging disk blocks only those who wait for the files.

use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow, bail};

use crate::exit::WithHint;
use nunet_telemetry::DrainTimeout;

/// Pending writes.
pub(crate) struct Writing {
    /// What is written, for messages.
    what: String,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl Writing {
    /// Starts `write`, which owns everything it needs.
    pub(crate) fn start(
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
    pub(crate) fn end(self, timeout: &mut DrainTimeout<'_>) -> anyhow::Result<()> {
        let Self { what, thread } = self;
        if let Err(why) = timeout.wait(&what, || thread.is_finished(), || 0) {
            bail!(WithHint::new(
                format!("cannot write {what}: {why}"),
                "check whether the disk or mount responds"
            ));
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
        let well = Writing::start("a file".into(), || Ok(())).unwrap();
        assert!(well.end(&mut timeout).is_ok());
        let badly = Writing::start("a file".into(), || bail!("the disk is full")).unwrap();
        assert_eq!(badly.end(&mut timeout).unwrap_err().to_string(), "the disk is full");
    }

    #[test]
    fn a_disk_that_hangs_is_abandoned_after_a_stop() {
        let (let_go, hangs) = channel::<()>();
        let writing = Writing::start("the files in `o`".into(), move || Ok(hangs.recv()?)).unwrap();
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, Duration::from_secs(60));
        let error = writing.end(&mut timeout).unwrap_err().to_string();
        assert_eq!(error, "cannot write the files in `o`: timed out 0 s after shutdown was requested");
        drop(let_go);
    }
}
