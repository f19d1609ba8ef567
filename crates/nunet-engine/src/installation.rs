//! The installation of this program: the command that runs a model check, and the folders of models and
//! libraries.
//!
//! `nunetd` finds its files next to its executable. In the Python package the executable is the interpreter,
//! so the package describes where its files are, once, before any lookup.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::error::EngineError;

/// The files that came with this program.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Installation {
    /// The command that starts `nunetd`: a program and the arguments before the subcommand. Empty if there is
    /// none.
    pub command: Vec<OsString>,
    /// Folders with bundled models.
    pub model_folders: Vec<PathBuf>,
    /// Folders with ONNX Runtime's shared library.
    pub library_folders: Vec<PathBuf>,
}

static DESCRIBED: OnceLock<Installation> = OnceLock::new();

impl Installation {
    /// Makes this the installation of the process. The first description counts.
    pub fn describe(self) {
        // A package that is imported twice is the same package.
        let _ = DESCRIBED.set(self);
    }

    /// The installation of `nunetd` itself: this executable and the folders around it.
    #[must_use]
    pub fn of_nunetd() -> Self {
        let executable = std::env::current_exe().unwrap_or_default();
        Self { command: vec![executable.clone().into()], ..Self::around(&executable) }
    }

    /// The folders around an executable, installed or built in a checkout. No command.
    fn around(executable: &Path) -> Self {
        let folder = executable.parent().unwrap_or(Path::new("."));
        let models = [folder.join("models"), folder.with_file_name("share").join("nunet/models")];
        // target/release/nunetd, target/debug/deps/test-0123
        let checkouts = executable.ancestors().skip(2).take(3).map(|folder| folder.join("models"));
        Self {
            command: Vec::new(),
            model_folders: models.into_iter().chain(checkouts).collect(),
            library_folders: vec![folder.to_owned(), folder.with_file_name("lib").join("nunet")],
        }
    }
}

/// The installation of this process: the described one, otherwise the files around the executable, with the
/// `nunetd` beside it or in `PATH`.
pub(crate) fn installation() -> &'static Installation {
    DESCRIBED.get_or_init(|| {
        let executable = std::env::current_exe().unwrap_or_default();
        let beside = executable.parent().map(Path::to_owned);
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders = beside.into_iter().chain(std::env::split_paths(&path));
        Installation { command: nunetd_in(folders), ..Installation::around(&executable) }
    })
}

fn nunetd_in(folders: impl Iterator<Item = PathBuf>) -> Vec<OsString> {
    let programs = folders.filter(|folder| folder.is_absolute()).map(|folder| folder.join("nunetd"));
    programs.filter(|program| program.is_file()).take(1).map(OsString::from).collect()
}

/// A command that starts `nunetd`.
pub(crate) fn nunetd() -> Result<Command, EngineError> {
    command(installation())
}

fn command(installation: &Installation) -> Result<Command, EngineError> {
    let words = installation.command.split_first().filter(|(program, _)| !program.is_empty());
    let (program, arguments) = words.ok_or(EngineError::NoChecker)?;
    let mut command = Command::new(program);
    command.args(arguments);
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_described_command_comes_before_the_subcommand() {
        let words = ["python3", "nunet_py/__main__.py"].map(OsString::from).to_vec();
        let command = command(&Installation { command: words, ..Installation::default() }).unwrap();
        assert_eq!(command.get_program(), "python3");
        assert_eq!(command.get_args().collect::<Vec<_>>(), ["nunet_py/__main__.py"]);
    }

    #[test]
    fn an_installation_without_a_command_cannot_check_models() {
        for words in [vec![], vec![OsString::new()]] {
            let error = command(&Installation { command: words, ..Installation::default() }).unwrap_err();
            assert!(matches!(error, EngineError::NoChecker), "{error}");
        }
    }

    #[test]
    fn nunetd_starts_itself_and_another_program_never_does() {
        let this = std::env::current_exe().unwrap();
        assert_eq!(Installation::of_nunetd().command, [this.clone().into_os_string()]);
        assert!(!installation().command.contains(&this.into_os_string()));
    }

    #[test]
    fn nunetd_is_taken_from_the_first_folder_that_has_it() {
        let folders = [(); 3].map(|()| tempfile::tempdir().unwrap());
        for folder in &folders[1..] {
            std::fs::write(folder.path().join("nunetd"), "").unwrap();
        }
        let found = nunetd_in(folders.iter().map(|folder| folder.path().to_owned()));
        assert_eq!(found, [folders[1].path().join("nunetd").into_os_string()]);
        assert!(nunetd_in(std::iter::once(PathBuf::from("relative"))).is_empty());
    }
}
