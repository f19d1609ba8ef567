//! `cargo xtask setup`: the shared library that nunetd loads at run time.

use std::path::PathBuf;

use anyhow::Result;

use crate::run::say;
use crate::{paths, wheels};

/// Texts that must accompany the library in packages.
const TEXTS: [&str; 2] = ["LICENSE", "ThirdPartyNotices.txt"];

/// Fetch ONNX Runtime's library and its license, if the cache does not have them.
pub(crate) fn setup() -> Result<()> {
    TEXTS.iter().try_for_each(|text| onnxruntime_text(text).map(drop))?;
    say(&format!("setup: ONNX Runtime is at {}", onnxruntime()?.display()));
    Ok(())
}

/// A text that belongs to the library, such as its license, for packages that contain the library.
pub(crate) fn onnxruntime_text(name: &str) -> Result<PathBuf> {
    let wheel = wheels::pinned("onnxruntime")?;
    let text = paths::cache()?.join(format!("onnxruntime-{}", wheel.version)).join(name);
    let _lock = paths::lock()?;
    wheels::fetch(&wheel, Some(&format!("onnxruntime/{name}")), &text)?;
    Ok(text)
}

/// The path of the library in the cache, where nunetd and the tests look for it too.
pub(crate) fn onnxruntime() -> Result<PathBuf> {
    let wheel = wheels::pinned("onnxruntime")?;
    let name = format!("libonnxruntime.so.{}", wheel.version);
    let library = paths::cache()?.join(format!("onnxruntime-{}", wheel.version)).join(&name);
    let _lock = paths::lock()?;
    wheels::fetch(&wheel, Some(&format!("onnxruntime/capi/{name}")), &library)?;
    Ok(library)
}
