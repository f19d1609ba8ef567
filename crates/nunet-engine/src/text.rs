//! Texts and numbers for users.

/// The ONNX Runtime release that this version was tested with.
pub(crate) const ONNX_RUNTIME_VERSION: &str = "1.31.1";

/// Names ONNX Runtime's library.
pub(crate) const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";

/// Names the folder of the bundled models.
pub(crate) const MODELS_VARIABLE: &str = "NUNET_MODELS";

/// Bytes such as a hash, two hexadecimal digits each.
#[must_use]
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
