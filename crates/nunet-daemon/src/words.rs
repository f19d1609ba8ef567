//! What is written in one way everywhere.

/// The coordinate frame of a camera whose user names none.
pub(crate) fn default_frame_id(camera: &str) -> String {
    format!("{camera}_optical_frame")
}

/// A hash as people and files write it.
pub(crate) fn hexadecimal(hash: &[u8]) -> String {
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}
