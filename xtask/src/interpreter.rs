//! The Python interpreter of this machine.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use crate::hinted::Hinted;
use crate::run::output;

/// What is asked of an environment's interpreter before it is used again.
pub(crate) const IDENTITY: &str = "import sys; assert sys.version_info >= (3, 10), 'Python 3.10 or newer is needed'; \
                        print(sys.base_prefix, sys.version)";

/// The interpreter that the machine offers.
pub(crate) struct System {
    pub(crate) program: PathBuf,
    /// Installation and version: an environment is of use to this one only.
    pub(crate) identity: String,
}

/// Python 3.11, for which packages of ROS 2 are built: the system's, else `python3.11`.
pub(crate) fn python311() -> Result<System> {
    const IS_311: &str = "import sys; sys.exit(sys.version_info[:2] != (3, 11))";
    let is_311 = |program: &PathBuf| {
        Command::new(program).args(["-c", IS_311]).output().is_ok_and(|output| output.status.success())
    };
    let candidates = [system()?.program, "python3.11".into()];
    let program = candidates.into_iter().find(|program| is_311(program)).ok_or_else(|| {
        let message = "cannot find CPython 3.11, the only one that ROS 2 is packaged for";
        Hinted::new(message, "install python3.11, or set PYTHON to it")
    })?;
    let identity = output(Command::new(&program).args(["-c", IDENTITY]))?;
    Ok(System { program, identity })
}

/// The interpreter: `$PYTHON`, otherwise python3.
pub(crate) fn system() -> Result<System> {
    let named = std::env::var_os("PYTHON").filter(|path| !path.is_empty());
    let program = named.map_or_else(|| "python3".into(), PathBuf::from);
    let identity = output(Command::new(&program).args(["-c", IDENTITY])).map_err(|error| {
        let message = format!("`{}` is not usable", program.display());
        Hinted::new(message, "install python3, or set PYTHON to another interpreter").because(error)
    })?;
    Ok(System { program, identity })
}
