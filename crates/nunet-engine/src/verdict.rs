//! The result of a model check, stored by the hash of everything it depends on, so that a known file starts
//! without a child process.

use std::path::{Path, PathBuf};

use nunet_core::graph::model_hashes;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use tracing::debug;

use crate::error::EngineError;
use crate::library::{LibraryFile, cache_folder};
use crate::options::EngineOptions;
use crate::text::hexadecimal;

/// The stored result of the child process.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// Loaded, and its self-test passed on this machine.
    Passed,
    /// The child process crashed, and how.
    Crashed(String),
}

/// The inputs of a verdict, and its file.
#[derive(Debug)]
pub(crate) struct VerdictRecord {
    /// `None` if this user has no cache folder: in a shared folder, another user could write a false verdict.
    pub(crate) path: Option<PathBuf>,
    /// SHA-256 of each file of the model.
    pub(crate) files: Vec<[u8; 32]>,
}

impl VerdictRecord {
    /// The record for these model files, this library and these options.
    pub(crate) fn of(
        model: &Path,
        options: &EngineOptions,
        library: &LibraryFile,
    ) -> Result<Self, EngineError> {
        let files = model_hashes(model)?;
        let about = library.path.metadata();
        let about =
            about.map_err(EngineError::system(format!("cannot read `{}`", library.path.display())))?;
        let changed = about.modified().ok();
        let version = env!("CARGO_PKG_VERSION");
        let rest = (version, &library.path, about.len(), changed, options.provider, options.threads);
        let mut hash = Sha256::new_with_prefix(files.as_flattened());
        hash.update(format!("{rest:?}"));
        let name = hexadecimal(hash.finalize().as_slice());
        let path = cache_folder().map(|folder| folder.join("verdicts").join(name + ".json"));
        Ok(Self { path, files })
    }

    /// The stored verdict, if there is a readable one.
    pub(crate) fn stored(&self) -> Option<Verdict> {
        serde_json::from_slice(&std::fs::read(self.path.as_ref()?).ok()?).ok()
    }

    /// Stores a verdict. If that fails, the next start only checks the model again.
    pub(crate) fn store(&self, verdict: &Verdict) {
        let Some(path) = &self.path else { return };
        if let Err(error) = write(path, verdict) {
            debug!("cannot store the verdict in `{}`: {error}", path.display());
        }
    }
}

fn write(path: &Path, verdict: &Verdict) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    // Written to another file and renamed, so that no reader sees half a verdict.
    let temporary = path.with_extension(format!("{}.tmp", std::process::id()));
    std::fs::write(&temporary, serde_json::to_vec(verdict)?)?;
    std::fs::rename(&temporary, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(folder: &Path, model: &[u8], library: &[u8]) -> Option<PathBuf> {
        let (model_path, library_path) = (folder.join("m.onnx"), folder.join("l.so"));
        std::fs::write(&model_path, model).unwrap();
        std::fs::write(&library_path, library).unwrap();
        let library = LibraryFile { path: library_path, place: "test" };
        VerdictRecord::of(&model_path, &EngineOptions::default(), &library).unwrap().path
    }

    #[test]
    fn a_verdict_is_stored_and_read_back_and_a_partial_one_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper/verdict.json");
        let record = VerdictRecord { path: Some(path.clone()), files: Vec::new() };
        assert_eq!(record.stored(), None);
        record.store(&Verdict::Crashed("badly".into()));
        assert_eq!(record.stored(), Some(Verdict::Crashed("badly".into())));
        std::fs::write(&path, b"{\"crash").unwrap();
        assert_eq!(record.stored(), None);
    }

    #[test]
    fn another_model_or_another_library_needs_another_verdict() {
        let folder = tempfile::tempdir().unwrap();
        let first = record(folder.path(), b"model", b"library");
        assert_ne!(record(folder.path(), b"other", b"library"), first);
        assert_ne!(record(folder.path(), b"model", b"another library"), first);
    }
}
