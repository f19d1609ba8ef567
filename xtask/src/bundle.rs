//! `cargo xtask bundle`: the models that the Python package brings along.

use std::fs;

use anyhow::{Context as _, Result};

use crate::paths;
use crate::run::say;

const FROM: &str = "models";
const TO: &str = "crates/nunet-py/python/nunet_py/models";

/// Copies the models that are bundled already, again: maturin packs no file from outside the package's folder, and a
/// link would be packed as one. Git keeps the same bytes once.
pub(crate) fn bundle() -> Result<()> {
    let folder = paths::root().join(TO);
    let entries = fs::read_dir(&folder).with_context(|| format!("cannot read `{TO}`"))?;
    for entry in entries {
        let name = entry.with_context(|| format!("cannot read `{TO}`"))?.file_name();
        let name = name.to_string_lossy();
        let from = paths::root().join(FROM).join(&*name);
        fs::copy(&from, folder.join(&*name)).with_context(|| {
            format!("cannot copy `{FROM}/{name}` to `{TO}`\nhint: remove the copy if the model is gone")
        })?;
        say(&format!("bundle: {name}"));
    }
    Ok(())
}
