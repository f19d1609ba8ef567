//! Where this program is installed: what it is started by, and which folders came with it.
//!
//! The binary asks the system for its own file. Inside another program (the Python package) that file is the
//! interpreter's, so the package says where it lies, once, before anything is looked up.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use anyhow::Context as _;

/// An installation that is not the binary `nunetd` on its own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Installation {
    /// What starts `nunetd`: a program and the words before the verb.
    pub command: Vec<OsString>,
    /// Folders with bundled models.
    pub model_folders: Vec<PathBuf>,
    /// Folders with ONNX Runtime's shared library.
    pub library_folders: Vec<PathBuf>,
}

static DESCRIBED: OnceLock<Installation> = OnceLock::new();

impl Installation {
    /// Makes this the installation of the process; the first one counts.
    pub fn describe(self) {
        // A package that is imported twice is the same package.
        let _ = DESCRIBED.set(self);
    }
}

/// What was described; `None` in the binary.
pub(crate) fn described() -> Option<&'static Installation> {
    DESCRIBED.get()
}

/// A command that starts `nunetd` again.
pub(crate) fn nunetd() -> anyhow::Result<Command> {
    let Some(installation) = described() else {
        let exe = std::env::current_exe().context("cannot find this program's own file")?;
        return Ok(Command::new(exe));
    };
    command(installation)
}

fn command(installation: &Installation) -> anyhow::Result<Command> {
    let (program, words) = installation.command.split_first().filter(|(program, _)| !program.is_empty()).context(
        "this program does not know how to start `nunetd`\nhint: an interpreter that is embedded in another program \
         has no `sys.executable`; set it before `nunet_py` is imported",
    )?;
    let mut command = Command::new(program);
    command.args(words);
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_described_installation_starts_its_program_with_the_words_before_the_verb() {
        let words = ["python3", "nunet_py/__main__.py"].map(OsString::from).to_vec();
        let command = command(&Installation { command: words, ..Installation::default() }).unwrap();
        assert_eq!(command.get_program(), "python3");
        assert_eq!(command.get_args().collect::<Vec<_>>(), ["nunet_py/__main__.py"]);
    }

    #[test]
    fn an_installation_without_a_program_says_so() {
        for words in [vec![], vec![OsString::new()]] {
            let error = command(&Installation { command: words, ..Installation::default() }).unwrap_err();
            assert!(error.to_string().contains("\nhint: "), "{error}");
        }
    }

    #[test]
    fn the_binary_starts_itself() {
        assert_eq!(nunetd().unwrap().get_program(), std::env::current_exe().unwrap());
    }
}
