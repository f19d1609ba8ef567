//! Images whose planes are in a buffer each, as drivers of boards deliver them.

use nunet_types::ImageSize;

use super::device::FourCc;

/// One plane of an image in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PlaneLayout {
    /// Rows of pixels.
    rows: usize,
    /// Bytes from row to row in the plane's buffer.
    stride: usize,
    /// Bytes from row to row after the planes are joined.
    joined_stride: usize,
}

/// The planes of a format; `None` if they are in one buffer, or the format is unknown.
pub(super) fn layouts(
    format: FourCc,
    size: ImageSize,
    strides: [u32; 3],
    count: usize,
) -> Option<Vec<PlaneLayout>> {
    let (rows, half_rows) = (size.height as usize, size.height.div_ceil(2) as usize);
    let [first, second, third] = strides.map(|stride| stride as usize);
    let plane = |rows, stride, joined_stride| PlaneLayout { rows, stride, joined_stride };
    match (&format.0.to_le_bytes(), count) {
        (b"NM12" | b"NM21", 2) => Some(vec![plane(rows, first, first), plane(half_rows, second, first)]),
        (b"YM12" | b"YM21", 3) => {
            let half = first.div_ceil(2);
            Some(vec![
                plane(rows, first, first),
                plane(half_rows, second, half),
                plane(half_rows, third, half),
            ])
        }
        _ => None,
    }
}

/// Writes the planes one after the other into `joined`. Where bytes are missing, it ends early.
pub(super) fn join<'a>(planes: impl Iterator<Item = (&'a [u8], PlaneLayout)>, joined: &mut Vec<u8>) {
    joined.clear();
    for (bytes, PlaneLayout { rows, stride, joined_stride }) in planes {
        for row in 0..rows {
            let rest = bytes.get(row * stride..).unwrap_or_default();
            let row = &rest[..rest.len().min(stride).min(joined_stride)];
            if row.is_empty() {
                return;
            }
            joined.extend_from_slice(row);
            joined.resize(joined.len() + joined_stride - row.len(), 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(format: &[u8; 4], size: ImageSize, strides: [u32; 3], planes: &[&[u8]]) -> Vec<u8> {
        let layouts = layouts(FourCc::new(format), size, strides, planes.len()).unwrap();
        let mut joined = vec![99];
        join(planes.iter().copied().zip(layouts), &mut joined);
        joined
    }

    #[test]
    fn planes_follow_each_other_with_the_rows_of_the_first() {
        let size = ImageSize::new(2, 3);
        let (luma, chroma) = (&[1, 2, 0, 0, 3, 4, 0, 0, 5, 6][..], &[7, 8, 9, 10][..]);
        let expected = [1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0, 7, 8, 0, 0, 9, 10, 0, 0];
        assert_eq!(joined(b"NM12", size, [4, 2, 0], &[luma, chroma]), expected);
        let (u, v) = (&[7, 0, 0, 8, 0, 0][..], &[9, 10][..]);
        let expected = [1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0, 7, 0, 8, 0, 9, 0, 10, 0];
        assert_eq!(joined(b"YM12", size, [4, 3, 1], &[luma, u, v]), expected);
    }

    #[test]
    fn a_plane_that_is_too_short_ends_the_image() {
        let size = ImageSize::new(2, 2);
        assert_eq!(joined(b"NM12", size, [2, 2, 0], &[&[1, 2], &[7, 8]]), [1, 2]);
        assert_eq!(joined(b"NM21", size, [2, 2, 0], &[&[1, 2, 3, 4], &[]]), [1, 2, 3, 4]);
    }

    #[test]
    fn a_format_in_one_buffer_has_no_planes_to_join() {
        for (format, count) in [(b"NV12", 1), (b"YUYV", 1), (b"NM12", 1), (b"YM12", 2)] {
            assert_eq!(layouts(FourCc::new(format), ImageSize::new(2, 2), [2; 3], count), None);
        }
    }
}
