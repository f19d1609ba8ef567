//! Depth maps that the user names as `.npy` files.

use std::io::BufReader;
use std::path::Path;

use nunet_core::plain_file;
use nunet_files::{MAX_NPY_BYTES, read_npy};
use nunet_types::ImageSize;

use crate::error::Cause;

/// Reads a float32 `(H, W)` array.
pub(crate) fn read(path: &Path) -> Result<(Vec<f32>, ImageSize), Cause> {
    let file = plain_file::open(path, MAX_NPY_BYTES)?.ok_or("it is not a regular file")?;
    read_npy(BufReader::new(file))
}
