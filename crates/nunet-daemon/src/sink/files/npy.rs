//! NumPy's array file.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::Path;

use anyhow::{Context as _, bail};
use npyz::{NpyFile, Order, WriterBuilder as _};
use nunet_core::plain_file;

/// A depth map of 8192x8192 pixels.
const MAX_BYTES: u64 = 256 << 20;

/// Reads float32 `(H, W)`, and gives it with width and height.
pub(crate) fn read(path: &Path) -> anyhow::Result<(Vec<f32>, (u32, u32))> {
    let file = plain_file::open(path, MAX_BYTES)?.context("it is no plain file")?;
    let file = NpyFile::new(BufReader::new(file))?;
    let (shape, order) = (file.shape().to_vec(), file.order());
    let &[height, width] = &shape[..] else { bail!("an array of shape {shape:?}") };
    if order != Order::C || height.saturating_mul(width) > MAX_BYTES / 4 {
        bail!("an array of shape {shape:?}, {order:?} order");
    }
    Ok((file.into_vec()?, (width.try_into()?, height.try_into()?)))
}

/// Writes `depth` as float32 `(H, W)`.
pub(crate) fn write(path: &Path, depth: &[f32], (width, height): (u32, u32)) -> anyhow::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let options = npyz::WriteOptions::new().default_dtype().shape(&[height.into(), width.into()]);
    let mut writer = options.writer(&mut file).begin_nd()?;
    writer.extend(depth.iter().copied())?;
    writer.finish()?;
    Ok(file.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_columns_and_nan_survive() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.npy");
        write(&path, &[1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0], (3, 2)).unwrap();
        let (values, size) = read(&path).unwrap();
        assert_eq!(size, (3, 2));
        assert!(values[2].is_nan());
        assert_eq!([values[0], values[1], values[3], values[5]], [1.0, 2.0, 4.0, 6.0]);
    }
}
