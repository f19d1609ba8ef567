//! The wheels pinned in `wheels.lock`, and fetching them.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::hinted::Hinted;
use crate::interpreter;
use crate::run::run;

const LOCK: &str = include_str!("../wheels.lock");

/// One line of `wheels.lock`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Wheel {
    pub(crate) project: &'static str,
    pub(crate) version: &'static str,
    pub(crate) file: &'static str,
    pub(crate) sha256: &'static str,
}

/// The wheel pinned under `name` for this machine.
pub(crate) fn pinned(name: &str) -> Result<Wheel> {
    find(LOCK, name, std::env::consts::ARCH)
}

fn find(lock: &'static str, name: &str, arch: &str) -> Result<Wheel> {
    let keys = [format!("{name}/{arch}"), format!("{name}/any")];
    for line in lock.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty()) {
        let words: Vec<&'static str> = line.split_whitespace().collect();
        let [key, project, version, file, sha256] = words.as_slice() else {
            bail!("xtask/wheels.lock: expected five words, got `{line}`");
        };
        if keys.iter().any(|wanted| wanted == key) {
            return Ok(Wheel { project, version, file, sha256 });
        }
    }
    bail!(Hinted::new(
        format!("xtask/wheels.lock pins no `{name}` for `{arch}`"),
        "use a machine of x86_64 or aarch64"
    ))
}

/// Put the wheel, or one member of it, at `to`, unless something is there: only checked files ever get there.
pub(crate) fn fetch(wheel: &Wheel, member: Option<&str>, to: &Path) -> Result<()> {
    if to.is_file() {
        return Ok(());
    }
    let mut fetcher = Command::new(interpreter::system()?.program);
    fetcher.arg("xtask/fetch_wheel.py");
    fetcher.args(["--project", wheel.project, "--file", wheel.file, "--sha256", wheel.sha256]);
    fetcher.arg("--to").arg(to);
    if let Some(member) = member {
        fetcher.args(["--member", member]);
    }
    run(&mut fetcher).with_context(|| format!("cannot fetch {} {}", wheel.project, wheel.version))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_architectures_have_the_same_release_of_onnx_runtime_and_full_hashes() {
        let wheels = ["x86_64", "aarch64"].map(|arch| find(LOCK, "onnxruntime", arch).unwrap());
        assert_eq!(wheels[0].version, wheels[1].version);
        for (wheel, arch) in wheels.iter().zip(["x86_64", "aarch64"]) {
            assert!(wheel.file.contains(wheel.version) && wheel.file.contains(arch));
            assert_eq!(wheel.sha256.len(), 64);
            assert!(wheel.sha256.bytes().all(|byte| byte.is_ascii_hexdigit()));
        }
    }

    #[test]
    fn an_architecture_without_a_wheel_is_an_error_with_a_hint() {
        let error = find(LOCK, "onnxruntime", "sparc64").unwrap_err();
        assert!(error.to_string().contains("`sparc64`") && error.is::<Hinted>(), "{error}");
    }

    #[test]
    fn a_line_with_a_missing_word_is_shown() {
        let error = find("onnxruntime/x86_64 onnxruntime 1.0 file.whl", "onnxruntime", "x86_64").unwrap_err();
        assert!(error.to_string().contains("got `onnxruntime/x86_64 onnxruntime 1.0 file.whl`"));
    }
}
