//! Texts and numbers for users.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use sha2::{Digest as _, Sha256};

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

/// The bytes of a SHA-256 in hexadecimal digits; `None` if the text is not one.
#[must_use]
pub fn sha256_bytes(text: &str) -> Option<[u8; 32]> {
    let is_hexadecimal = text.bytes().all(|digit| digit.is_ascii_hexdigit());
    let byte = |index: usize| u8::from_str_radix(text.get(2 * index..2 * index + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..text.len().div_ceil(2)).map(byte).collect();
    bytes.filter(|_| is_hexadecimal)?.try_into().ok()
}

/// The SHA-256 of a file, hexadecimal, as `sha256sum` prints it; `None` if it is not a regular file.
///
/// # Errors
/// The file cannot be read.
pub fn file_sha256(path: &Path) -> io::Result<Option<String>> {
    if !path.metadata()?.is_file() {
        return Ok(None);
    }
    let mut file = File::open(path)?;
    let (mut hash, mut part) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut part)? {
            0 => return Ok(Some(hexadecimal(hash.finalize().as_slice()))),
            bytes => hash.update(part.get(..bytes).unwrap_or_default()),
        }
    }
}
