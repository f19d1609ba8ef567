//! One image file as RGB, for programs that process single images.

use std::path::Path;

use nunet_types::ImageSize;

use crate::bit_depth::{BitDepthCheck, DimImages};
use crate::error::SourceError;
use crate::frame::{Frame, Pixels};
use crate::image_file::decode;

/// A decoded file.
#[derive(Debug)]
pub struct ReadImage {
    /// RGB `[H, W, 3]`, upright.
    pub rgb: Vec<u8>,
    /// Width and height.
    pub size: ImageSize,
    /// A warning: it has 16 bits and uses only the lower ones.
    pub dim: Option<DimImages>,
}

/// Reads a JPEG or PNG file, as `nunetd infer` does.
///
/// # Errors
/// No such file, neither JPEG nor PNG, damaged, cut off, or larger than the limits.
pub fn read_image(path: &Path) -> Result<ReadImage, SourceError> {
    let shown = path.display();
    let mut frame = Frame::default();
    let decoded = decode(path, &mut frame)
        .map_err(|error| error.context(format!("cannot read the image `{shown}`")))?;
    let dim = BitDepthCheck::default().find(|| decoded.maximum_16_bit, format_args!("`{shown}`"));
    let rgb = match frame.pixels {
        Pixels::Owned(rgb) => rgb,
        Pixels::Shared(message) => message.bytes().to_vec(),
    };
    Ok(ReadImage { rgb, size: frame.size, dim })
}

#[cfg(test)]
mod tests {
    use std::error::Error as _;
    use std::io;

    use image::{ImageBuffer, Luma, Rgb, RgbImage};

    use super::*;
    use crate::error::SourceErrorKind;

    #[test]
    fn a_file_is_read_as_rgb_and_a_dim_one_has_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        RgbImage::from_pixel(3, 2, Rgb([7, 8, 9])).save(&path).unwrap();
        let image = read_image(&path).unwrap();
        assert_eq!((image.size, image.rgb), ((3, 2).into(), [7, 8, 9].repeat(6)));
        assert_eq!(image.dim, None);
        ImageBuffer::from_pixel(3, 2, Luma([1023_u16])).save(&path).unwrap();
        let image = read_image(&path).unwrap();
        assert_eq!(image.rgb.len(), 18);
        let warning = image.dim.unwrap().to_string();
        assert!(warning.contains(&format!("`{}`", path.display())), "{warning}");
    }

    #[test]
    fn an_error_names_the_file_and_keeps_its_cause() {
        let error = read_image(Path::new("missing.png")).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::BadFrame);
        insta::assert_snapshot!(error, @"cannot read the image `missing.png`");
        let cause = error.source().and_then(|cause| cause.source()).unwrap();
        assert_eq!(cause.downcast_ref::<io::Error>().unwrap().kind(), io::ErrorKind::NotFound);
    }
}
