//! The text of `nunetd --version`: this program, the contract, and the ONNX Runtime that it finds.

use std::path::PathBuf;

use nunet_engine::LibraryFile;

/// The commit that this program was built from; see `build.rs`.
const COMMIT: &str = env!("NUNET_COMMIT");

/// Everything after the program's name. The library is loaded, because its file name need not contain its
/// version.
pub(crate) fn long() -> String {
    let version = env!("CARGO_PKG_VERSION");
    let contract = nunet_types::CONTRACT_VERSION;
    format!("{version} ({COMMIT})\ncontract {contract}\n{}", onnx_runtime())
}

fn onnx_runtime() -> String {
    let named = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    let found = LibraryFile::find(named.as_deref());
    match found.and_then(|library| Ok((library.version()?, library))) {
        Ok((version, library)) => {
            format!("ONNX Runtime {version} at {} ({})", library.path.display(), library.place)
        }
        Err(error) => format!("ONNX Runtime: {}", error.to_string().lines().next().unwrap_or_default()),
    }
}
