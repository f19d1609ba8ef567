//! `cargo xtask deb`: the Debian packages. `nunetd` needs no network when it is installed; `nunet-dev` is for
//! C and C++.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, bail};

use crate::hinted::Hinted;
use crate::run::{cargo, output, run, say};
use crate::{dev_package, paths, setup};

/// What cargo-deb takes besides the repository's own files (`package.metadata.deb` in the daemon's manifest).
const FOLDER: &str = "build/deb";

/// Builds and packs both.
pub(crate) fn deb() -> Result<()> {
    dev_package::dev_package()?;
    nunetd()
}

/// Fetches ONNX Runtime, writes the manual, builds, packs.
fn nunetd() -> Result<()> {
    if output(&mut cargo(&["deb", "--version"])).is_err() {
        bail!(Hinted::new("cargo-deb is not installed", "run `cargo install cargo-deb --locked`"));
    }
    let folder = paths::root().join(FOLDER);
    // What an earlier release left there would be packed too.
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot empty `{FOLDER}`"))?;
    }
    let library = setup::onnxruntime()?;
    copy(&library, &folder.join("lib"), None)?;
    for (member, name) in
        [("LICENSE", "onnxruntime-LICENSE"), ("ThirdPartyNotices.txt", "onnxruntime-ThirdPartyNotices.txt")]
    {
        copy(&setup::onnxruntime_text(member)?, &folder.join("doc"), Some(name))?;
    }
    run(&mut cargo(&["run", "--package", "nunet-daemon", "--example", "manual", "--", FOLDER]))?;
    run(&mut cargo(&["deb", "--package", "nunet-daemon", "--strip"]))?;
    say("deb: apt install ./FILE.deb installs it, the service stays off: see dist/README.md");
    Ok(())
}

fn copy(from: &Path, folder: &Path, name: Option<&str>) -> Result<()> {
    let name = name.map_or_else(|| from.file_name().unwrap_or_default(), str::as_ref);
    let to = folder.join(name);
    fs::create_dir_all(folder).with_context(|| format!("cannot create `{}`", folder.display()))?;
    fs::copy(from, &to).with_context(|| format!("cannot copy `{}` to `{}`", from.display(), to.display()))?;
    Ok(())
}
