//! Files from the field: small inputs that users of this kind of software have, one folder a kind.

use std::path::{Path, PathBuf};

/// Where a case is.
///
/// # Panics
/// If there is none: a missing fixture fails a test, it never skips it.
#[must_use]
pub fn path(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases").join(name);
    assert!(path.exists(), "no case `{name}`");
    path
}

/// The bytes of a case.
///
/// # Panics
/// If it cannot be read.
#[must_use]
pub fn read(name: &str) -> Vec<u8> {
    std::fs::read(path(name)).expect("a case that exists can be read")
}
