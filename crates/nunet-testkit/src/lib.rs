//! Shared by the tests of several crates: small ONNX files built in memory, and the path of ONNX Runtime.
//!
//! [`allocations`] counts heap allocations of a thread; [`hostile`] damages files; [`onnx`] builds ONNX
//! files; [`models`] has networks whose results can be computed by hand, and [`manifests`] their graphs.

pub mod allocations;
pub mod cases;
pub mod demo;
pub mod hostile;
pub mod manifests;
pub mod models;
pub mod onnx;

use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

/// The ONNX Runtime that tests load: `ORT_DYLIB_PATH`, else the copy in the cache that `cargo xtask setup`
/// fills.
///
/// # Panics
/// If there is none. A missing fixture fails a test; it is never skipped.
#[must_use]
pub fn runtime_library() -> PathBuf {
    let library = std::env::var_os("ORT_DYLIB_PATH").map_or_else(cached_library, PathBuf::from);
    assert!(
        library.is_file(),
        "no ONNX Runtime at `{}`: run `cargo xtask setup`, or set ORT_DYLIB_PATH",
        library.display()
    );
    library
}

/// A root of iceoryx2's files for tests, one per user: `/tmp/iceoryx2` may belong to another user, who then
/// alone can use it. Pass it to `nunet_ipc::use_root` before anything else of nunet-ipc.
#[must_use]
pub fn ipc_root() -> PathBuf {
    let user = std::fs::metadata("/proc/self").map_or(0, |process| process.uid());
    std::env::temp_dir().join(format!("nunet-{user}"))
}

fn cached_library() -> PathBuf {
    let cache = std::env::var_os("XDG_CACHE_HOME").map_or_else(
        || PathBuf::from(std::env::var_os("HOME").unwrap_or_default()).join(".cache"),
        PathBuf::from,
    );
    cache.join("nunet/onnxruntime-1.31.1/libonnxruntime.so.1.31.1")
}
