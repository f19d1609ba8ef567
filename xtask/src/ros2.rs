//! `cargo xtask test --ros2`: topics of nunetd, received by ROS 2 from the package index.

use std::process::Command;

use anyhow::Result;

use crate::run::{cargo, run, run_all};
use crate::{paths, python, setup};

/// Builds nunetd and lets ROS 2 receive from it.
pub(crate) fn test() -> Result<()> {
    let environment = python::ros2_environment()?;
    setup::onnxruntime()?;
    // A test among the targets makes cargo choose the features that `cargo test --workspace` has.
    run(&mut cargo(&["build", "--workspace", "--bins", "--test", "structure"]))?;
    let mut pytest = Command::new(environment);
    pytest.args(["-m", "pytest", "-q", "-rs", "-s", "-p", "no:cacheprovider", "tests/ros2"]);
    pytest.current_dir(paths::root()).env("NUNETD", paths::nunetd("debug")?);
    run_all("test --ros2", &mut [("ROS 2", pytest)])
}
