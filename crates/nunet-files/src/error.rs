//! The errors of writing results.

use std::borrow::Cow;
use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use nunet_types::{Hint, printable};

/// The error of a library.
pub(crate) type Cause = Box<dyn Error + Send + Sync>;

/// Why files could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilesError {
    /// The folder of the files cannot be created.
    #[error("cannot create the folder `{}`", path.display())]
    CreateFolder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: Cause,
    },
    /// The folder, or the part of its path that exists, is a file.
    #[error("cannot create the folder `{}`: `{}` is not a folder", path.display(), existing.display())]
    NotAFolder {
        /// The folder asked for.
        path: PathBuf,
        /// The part of it that exists.
        existing: PathBuf,
    },
    /// No file can be created in the folder.
    #[error("cannot write into the folder `{}`", path.display())]
    WriteIntoFolder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The folder of a file is missing.
    #[error("cannot write `{}`: there is no folder `{}`", path.display(), folder.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// The missing folder.
        folder: PathBuf,
    },
    /// A file is a named pipe, whose reader would see its end before anything is written.
    #[error("cannot write `{}`: it is a named pipe", path.display())]
    NamedPipe {
        /// The pipe.
        path: PathBuf,
    },
    /// A file cannot be written.
    #[error("cannot write `{}`", path.display())]
    WriteFile {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Cause,
    },
}

/// A kind of [`FilesError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FilesErrorKind {
    /// The folder is missing and cannot be created, or it is read-only.
    Folder,
    /// A file cannot be written.
    File,
}

impl FilesError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> FilesErrorKind {
        match self {
            Self::CreateFolder { .. } | Self::NotAFolder { .. } | Self::WriteIntoFolder { .. } => {
                FilesErrorKind::Folder
            }
            Self::NoFolder { .. } | Self::NamedPipe { .. } | Self::WriteFile { .. } => FilesErrorKind::File,
        }
    }

    /// For `map_err`: `path` cannot be written.
    pub(crate) fn write_file<E: Into<Cause>>(path: &Path) -> impl FnOnce(E) -> Self {
        move |source| Self::WriteFile { path: path.to_owned(), source: source.into() }
    }
}

impl Hint for FilesError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::NotAFolder { .. } => Some("pass another folder".into()),
            Self::NoFolder { folder, .. } => {
                let folder = folder.to_string_lossy();
                Some(format!("make it first: mkdir -p {}", printable::one_line(&folder)).into())
            }
            Self::NamedPipe { .. } => Some("name a regular file".into()),
            _ => None,
        }
    }
}
