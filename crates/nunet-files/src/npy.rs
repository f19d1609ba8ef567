//! NumPy's array file.

use std::io::Read;
use std::path::Path;

use npyz::{NpyFile, Order, WriterBuilder as _};
use nunet_types::ImageSize;

use crate::error::FilesError;
use crate::png::check_count;
use crate::whole::write_result;

/// The longest array that [`read_npy`] accepts: a depth map of 8192x8192 pixels.
pub const MAX_NPY_BYTES: u64 = 256 << 20;

/// Reads a float32 `(H, W)` array.
///
/// # Errors
/// Another type, shape or order, more than [`MAX_NPY_BYTES`], cut off, or not an array at all.
pub fn read_npy(file: impl Read) -> Result<(Vec<f32>, ImageSize), Box<dyn std::error::Error + Send + Sync>> {
    let file = NpyFile::new(file)?;
    let (shape, order) = (file.shape().to_vec(), file.order());
    let &[height, width] = &shape[..] else {
        return Err(format!("an array of shape {shape:?}, expected (H, W)").into());
    };
    if order != Order::C || height.saturating_mul(width) > MAX_NPY_BYTES / 4 {
        return Err(format!("an array of shape {shape:?}, {order:?} order").into());
    }
    Ok((file.into_vec()?, ImageSize::new(width.try_into()?, height.try_into()?)))
}

/// Writes `depth` as float32 `(H, W)`.
///
/// # Errors
/// The file cannot be written, or `depth` has another number of pixels than `size`.
pub fn write_npy(path: &Path, depth: &[f32], size: ImageSize) -> Result<(), FilesError> {
    write_result(path, |file| {
        check_count(depth.len(), size)?;
        let shape = [size.height.into(), size.width.into()];
        let options = npyz::WriteOptions::new().default_dtype().shape(&shape);
        let mut writer = options.writer(file).begin_nd()?;
        writer.extend(depth.iter().copied())?;
        Ok(writer.finish()?)
    })
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn rows_columns_and_nan_are_preserved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.npy");
        write_npy(&path, &[1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0], ImageSize::new(3, 2)).unwrap();
        let (values, size) = read_npy(File::open(&path).unwrap()).unwrap();
        assert_eq!(size, ImageSize::new(3, 2));
        assert!(values[2].is_nan());
        assert_eq!([values[0], values[1], values[3], values[5]], [1.0, 2.0, 4.0, 6.0]);
    }

    #[test]
    fn what_is_not_a_depth_map_is_refused() {
        assert!(read_npy(&b"no array"[..]).is_err());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("row.npy");
        let mut file = File::create(&path).unwrap();
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&[2]).writer(&mut file).begin_nd().unwrap();
        writer.extend([1.0_f32, 2.0]).unwrap();
        writer.finish().unwrap();
        let error = read_npy(File::open(&path).unwrap()).unwrap_err();
        assert_eq!(error.to_string(), "an array of shape [2], expected (H, W)");
    }
}
