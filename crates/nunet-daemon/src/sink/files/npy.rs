//! NumPy's array file.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

use npyz::WriterBuilder as _;

/// Writes `depth` as float32 `(H, W)`.
pub(super) fn write(path: &Path, depth: &[f32], (width, height): (u32, u32)) -> anyhow::Result<()> {
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
        let file = npyz::NpyFile::new(std::io::BufReader::new(File::open(path).unwrap())).unwrap();
        assert_eq!(file.shape(), [2, 3]);
        let values = file.into_vec::<f32>().unwrap();
        assert!(values[2].is_nan());
        assert_eq!([values[0], values[1], values[3], values[5]], [1.0, 2.0, 4.0, 6.0]);
    }
}
