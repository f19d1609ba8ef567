//! Where things are: the checkout, what cargo builds, and the cache that outlives a clone.

use std::env;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use crate::hinted::Hinted;

/// The checkout.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask is a folder of the checkout")
}

/// `$XDG_CACHE_HOME/nunet`, else `~/.cache/nunet`: outside the checkout, so that a fresh clone need not
/// download again.
pub(crate) fn cache() -> Result<PathBuf> {
    let named = env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
    // The XDG specification: a relative path is to be ignored.
    let cache = match named.filter(|path| path.is_absolute()) {
        Some(path) => path,
        None => env::home_dir()
            .filter(|home| !home.as_os_str().is_empty())
            .ok_or_else(|| {
                Hinted::new("there is no home folder to keep downloads in", "set HOME or XDG_CACHE_HOME")
            })?
            .join(".cache"),
    };
    Ok(cache.join("nunet"))
}

/// The target folder that this program was built into: cargo's settings may have moved it out of the
/// checkout.
pub(crate) fn target() -> Result<PathBuf> {
    let this = env::current_exe().context("cannot find the path of this program")?;
    Ok(this.ancestors().nth(2).context("this program lies outside a target folder")?.to_owned())
}

/// The binary `nunetd` of a profile (`debug`, `release`).
pub(crate) fn nunetd(profile: &str) -> Result<PathBuf> {
    Ok(target()?.join(profile).join(format!("nunetd{}", env::consts::EXE_SUFFIX)))
}

/// The right to change the cache, until it is dropped: two clones may be set up at the same time.
pub(crate) fn lock() -> Result<File> {
    let cache = cache()?;
    fs::create_dir_all(&cache).map_err(|error| {
        Hinted::new(format!("cannot create `{}`", cache.display()), "set XDG_CACHE_HOME").because(error)
    })?;
    let path = cache.join("lock");
    let file = File::create(&path).with_context(|| format!("cannot create `{}`", path.display()))?;
    file.lock().with_context(|| format!("cannot lock `{}`", path.display()))?;
    Ok(file)
}
