//! Files that are written on a thread of their own, so that a disk that hangs holds up nobody but who waits for them.

use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow, bail};

use super::patience::Patience;
use crate::exit::WithHint;

/// Files on their way to the disk.
pub(crate) struct Writing {
    /// What is written, in words.
    what: String,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl Writing {
    /// Begins with `write`, which has all that it needs in memory of its own.
    pub(crate) fn start(
        what: String,
        write: impl FnOnce() -> anyhow::Result<()> + Send + 'static,
    ) -> anyhow::Result<Self> {
        let thread = std::thread::Builder::new().name("files".into()).spawn(write);
        let thread = thread.with_context(|| format!("cannot start a thread to write {what}"))?;
        Ok(Self { what, thread })
    }

    /// Waits until they are written, within `patience`; what has not been written by then is left alone.
    ///
    /// # Errors
    /// They could not be written, or not in time.
    pub(crate) fn end(self, patience: &mut Patience<'_>) -> anyhow::Result<()> {
        let Self { what, thread } = self;
        if let Err(why) = patience.wait(&what, || thread.is_finished(), || 0) {
            bail!(WithHint::new(
                format!("cannot write {what}: {why}"),
                "check whether the disk or mount responds"
            ));
        }
        thread.join().map_err(|_| anyhow!("cannot write {what}: see the lines above")).flatten()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_was_written_and_what_could_not_be_is_told_at_the_end() {
        let mut patience = Patience::new(&|| false);
        let well = Writing::start("a file".into(), || Ok(())).unwrap();
        assert!(well.end(&mut patience).is_ok());
        let badly = Writing::start("a file".into(), || bail!("the disk is full")).unwrap();
        assert_eq!(badly.end(&mut patience).unwrap_err().to_string(), "the disk is full");
    }

    #[test]
    fn a_disk_that_hangs_is_left_alone_after_a_stop() {
        let (let_go, hangs) = channel::<()>();
        let writing = Writing::start("the files in `o`".into(), move || Ok(hangs.recv()?)).unwrap();
        let mut patience = Patience::with(&|| true, Duration::ZERO, Duration::from_secs(60));
        let error = writing.end(&mut patience).unwrap_err().to_string();
        assert_eq!(error, "cannot write the files in `o`: timed out 0 s after shutdown was requested");
        drop(let_go);
    }
}
