//! `cargo xtask paper-models`: the networks of the paper's Table 2, for `nunetd bench`.

use anyhow::Result;

use crate::python;
use crate::run::{run, say};

const FOLDER: &str = "target/paper-models";

/// Export U-Net, W-Net and W-Net Connected with ResNet-34 at 480x640. They are too large for the repository.
pub(crate) fn paper_models() -> Result<()> {
    let interpreter = python::recipe_environment()?;
    run(python::recipe(&interpreter).args(["-m", "nunet_models", "export", "--paper", FOLDER]))?;
    say(&format!("paper-models: in {FOLDER}"));
    Ok(())
}
