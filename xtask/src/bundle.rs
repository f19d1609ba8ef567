//! `cargo xtask bundle`: copies the models into the Python package.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};

use crate::hinted::Hinted;
use crate::paths;
use crate::run::say;

const FROM: &str = "models";
const TO: &str = "crates/nunet-py/python/nunet_py/models";

/// Copies the models and the images of the demo that are bundled already, again: maturin packs no file from
/// outside the package's folder, and a link would be packed as one. Git keeps the same bytes once.
pub(crate) fn bundle() -> Result<()> {
    copy_again(Path::new(""))
}

/// Copies what is in a folder below both roots.
fn copy_again(below: &Path) -> Result<()> {
    let (from, to) = (paths::root().join(FROM).join(below), paths::root().join(TO).join(below));
    let entries = fs::read_dir(&to).with_context(|| format!("cannot read `{}`", to.display()))?;
    for entry in entries {
        let name = entry.with_context(|| format!("cannot read `{}`", to.display()))?.file_name();
        let place = below.join(&name);
        if to.join(&name).is_dir() {
            copy_again(&place)?;
            continue;
        }
        fs::copy(from.join(&name), to.join(&name)).map_err(|error| {
            let place = place.display();
            let message = format!("cannot copy `{FROM}/{place}` to `{TO}/{place}`");
            Hinted::new(message, "remove the copy if the model is gone").because(error)
        })?;
        say(&format!("bundle: {}", place.display()));
    }
    Ok(())
}
