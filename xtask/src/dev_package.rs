//! The Debian package `nunet-dev`: what C and C++ programs are built with.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::paths;
use crate::run::{cargo, run, say};

const CRATE: &str = "crates/nunet-c";
const STAGE: &str = "build/deb-dev";
/// The ABI's major version is in the name, so that programs built against another one do not start with it.
const LIBRARY: &str = "libnunet.so.0";

/// Where files go, from the root of the file system.
struct Layout {
    /// Debian's name of this machine, such as `amd64`.
    architecture: &'static str,
    /// `usr/lib/x86_64-linux-gnu`
    libraries: String,
}

impl Layout {
    fn of(machine: &str) -> Self {
        let architecture = if machine == "aarch64" { "arm64" } else { "amd64" };
        Self { architecture, libraries: format!("usr/lib/{machine}-linux-gnu") }
    }

    /// A template with this layout: `@PREFIX@`, `@LIBDIR@` and `@VERSION@`.
    fn filled(&self, template: &str) -> String {
        let libraries = format!("/{}", self.libraries);
        let text = template.replace("${prefix}/lib\n", &format!("{libraries}\n"));
        text.replace("@PREFIX@", "/usr").replace("@LIBDIR@", &libraries).replace("@VERSION@", VERSION)
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
    let layout = Layout::of(std::env::consts::ARCH);
    let stage = paths::root().join(STAGE);
    if stage.exists() {
        fs::remove_dir_all(&stage).with_context(|| format!("cannot empty `{STAGE}`"))?;
    }
    fill(&stage, &layout).with_context(|| format!("cannot fill `{STAGE}`"))?;
    let folder = paths::target()?.join("debian");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create `{}`", folder.display()))?;
    let package = folder.join(format!("nunet-dev_{VERSION}-1_{}.deb", layout.architecture));
    let mut pack = Command::new("dpkg-deb");
    run(pack.args(["--root-owner-group", "--build"]).arg(&stage).arg(&package))?;
    say(&format!("deb: {}", package.display()));
    Ok(())
}

fn fill(stage: &Path, layout: &Layout) -> Result<()> {
    let (source, built) = (paths::root().join(CRATE), paths::target()?.join("release"));
    let libraries = stage.join(&layout.libraries);
    for header in ["nunet.h", "nunet.hpp"] {
        copy(&source.join("include").join(header), &stage.join("usr/include").join(header))?;
    }
    copy(&built.join("libnunet.so"), &libraries.join(LIBRARY))?;
    copy(&built.join("libnunet.a"), &libraries.join("libnunet.a"))?;
    symlink(LIBRARY, libraries.join("libnunet.so"))?;
    write(&libraries.join("pkgconfig/nunet.pc"), &layout.filled(&read(&source.join("nunet.pc.in"))?))?;
    for template in cmake_files(&source.join("cmake"))? {
        let name = template.file_name().unwrap_or_default().to_string_lossy().replace(".in", "");
        write(&libraries.join("cmake/nunet").join(name), &layout.filled(&read(&template)?))?;
    }
    write(&stage.join("DEBIAN/control"), &layout.control())
}

/// The CMake package's files.
fn cmake_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read `{}`", folder.display()))?;
    Ok(entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect())
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    make_parent(to)?;
    fs::copy(from, to).with_context(|| format!("cannot copy `{}`", from.display()))?;
    Ok(())
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read `{}`", path.display()))
}

fn write(path: &Path, text: &str) -> Result<()> {
    make_parent(path)?;
    fs::write(path, text).with_context(|| format!("cannot write `{}`", path.display()))
}

fn make_parent(path: &Path) -> Result<()> {
    let parent = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(parent).with_context(|| format!("cannot create `{}`", parent.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_get_debians_folders_and_the_version() {
        let layout = Layout::of("x86_64");
        let text = layout.filled("prefix=@PREFIX@\nlibdir=${prefix}/lib\nd=@LIBDIR@\nVersion: @VERSION@\n");
        let libraries = "/usr/lib/x86_64-linux-gnu";
        assert_eq!(text, format!("prefix=/usr\nlibdir={libraries}\nd={libraries}\nVersion: {VERSION}\n"));
        assert!(!layout.control().contains('@') || layout.control().contains("nunet@localhost"));
    }

    #[test]
    fn arm_has_its_own_folder_and_name() {
        let layout = Layout::of("aarch64");
        assert_eq!((layout.architecture, layout.libraries.as_str()), ("arm64", "usr/lib/aarch64-linux-gnu"));
        assert!(layout.control().contains("Architecture: arm64\n"));
    }
}
