//! What the tests of several crates share: small ONNX files built in memory, and the way to the test library.
//!
//! [`allocations`] counts what a thread takes from the heap; [`hostile`] damages files. Read [`onnx`] for the builder and
//! [`models`] for the ready-made networks whose answers fit in one's head.

pub mod allocations;
pub mod hostile;
pub mod models;
pub mod onnx;

use std::path::PathBuf;

/// The ONNX Runtime that tests load: `ORT_DYLIB_PATH`, else the copy in the cache that `cargo xtask setup` fills.
///
/// # Panics
/// Where there is none: a missing fixture fails a test, it never skips it.
#[must_use]
pub fn runtime_library() -> PathBuf {
    let library = std::env::var_os("ORT_DYLIB_PATH").map_or_else(cached_library, PathBuf::from);
    assert!(
        library.is_file(),
        "no ONNX Runtime at `{}`\nhint: run `cargo xtask setup`, or set ORT_DYLIB_PATH",
        library.display()
    );
    library
}

fn cached_library() -> PathBuf {
    let cache = std::env::var_os("XDG_CACHE_HOME").map_or_else(
        || PathBuf::from(std::env::var_os("HOME").unwrap_or_default()).join(".cache"),
        PathBuf::from,
    );
    cache.join("nunet/onnxruntime-1.31.1/libonnxruntime.so.1.31.1")
}
