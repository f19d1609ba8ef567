//! The Debian package `nunet-dev`: what C and C++ programs are built with.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::paths;
use crate::run::{cargo, run, say};

/// Installs headers, libraries and the files for pkg-config and `CMake`.
const INSTALL: &str = "crates/nunet-c/install.sh";
const STAGE: &str = "build/deb-dev";

/// What differs between machines.
struct DebianLayout {
    /// Debian's name of the machine, such as `amd64`.
    architecture: &'static str,
    /// Below `/usr`: `lib/x86_64-linux-gnu`.
    libraries: String,
}

impl DebianLayout {
    fn of(machine: &str) -> Self {
        let architecture = if machine == "aarch64" { "arm64" } else { "amd64" };
        Self { architecture, libraries: format!("lib/{machine}-linux-gnu") }
    }

    fn control(&self) -> String {
        format!(
            "Package: nunet-dev\nVersion: {VERSION}-1\nArchitecture: {}\nSection: libdevel\nPriority: optional\n\
             Maintainer: The nunet contributors <nunet@localhost>\nDepends: libc6\nSuggests: nunetd\n\
             Description: C and C++ access to nunetd's depth, labels and clouds\n \
             Header files, the shared and the static library, a CMake package and a pkg-config file.\n",
            self.architecture
        )
    }
}

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Builds the library and packs it with `dpkg-deb`.
pub(crate) fn dev_package() -> Result<()> {
    run(&mut cargo(&["build", "--release", "--package", "nunet-c"]))?;
    let layout = DebianLayout::of(std::env::consts::ARCH);
    let stage = paths::root().join(STAGE);
    if stage.exists() {
        fs::remove_dir_all(&stage).with_context(|| format!("cannot empty `{STAGE}`"))?;
    }
    fill(&stage, &layout).with_context(|| format!("cannot fill `{STAGE}`"))?;
    let folder = paths::target()?.join("debian");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create `{}`", folder.display()))?;
    let package = folder.join(format!("nunet-dev_{VERSION}-1_{}.deb", layout.architecture));
    let mut pack = Command::new("dpkg-deb");
    run(pack.args(["--root-owner-group", "-Zgzip", "--build"]).arg(&stage).arg(&package))?;
    say(&format!("deb: {}", package.display()));
    Ok(())
}

fn fill(stage: &Path, layout: &DebianLayout) -> Result<()> {
    let mut install = Command::new("sh");
    install.arg(INSTALL).arg(paths::target()?.join("release")).args(["/usr", &layout.libraries]);
    run(install.env("DESTDIR", stage))?;
    let control = stage.join("DEBIAN/control");
    fs::create_dir_all(stage.join("DEBIAN"))
        .and_then(|()| fs::write(&control, layout.control()))
        .with_context(|| format!("cannot write `{}`", control.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_machine_has_its_own_folder_and_name() {
        for (machine, architecture) in [("x86_64", "amd64"), ("aarch64", "arm64")] {
            let layout = DebianLayout::of(machine);
            assert_eq!(layout.libraries, format!("lib/{machine}-linux-gnu"));
            assert!(layout.control().contains(&format!("\nArchitecture: {architecture}\n")));
        }
    }
}
