//! `cargo xtask test --ros2`: topics of nunetd, received by ROS 2 from the package index.

use anyhow::Result;

use crate::python;
use crate::run::run_all;

/// Builds nunetd and lets ROS 2 receive from it.
pub(crate) fn test() -> Result<()> {
    let pytest = python::tests_of_nunetd(&python::ros2_environment()?, "tests/ros2")?;
    run_all("test --ros2", &mut [("ROS 2", pytest)])
}
