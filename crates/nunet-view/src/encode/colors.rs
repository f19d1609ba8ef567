//! Depth in colors, by table.

use std::sync::OnceLock;

use nunet_types::{ImageSize, Units};

use super::{stride_for, subsample};
use crate::frame::ViewFrame;

/// Colors of the table.
const COLORS: usize = 256;
/// No measurement: a gray that is not in the color map, the same as in `nunet-files`.
const NONE: [u8; 3] = [150, 150, 150];
/// The color range is taken from about so many columns of the map.
const RANGE_COLUMNS: u32 = 160;

/// The color map from near (red) to far (blue): the one of `depth.png`, as a table.
pub(crate) fn palette() -> &'static [[u8; 3]; COLORS] {
    static PALETTE: OnceLock<[[u8; 3]; COLORS]> = OnceLock::new();
    PALETTE.get_or_init(|| {
        let last = (COLORS - 1) as f32;
        let ramp: [f32; COLORS] = std::array::from_fn(|index| index as f32);
        let image = nunet_files::colorize(&ramp, ImageSize::new(COLORS as u32, 1), (0.0, last));
        let mut colors = image.pixels();
        std::array::from_fn(|_| colors.next().map_or(NONE, |pixel| pixel.0))
    })
}

/// The first and the last percentile of a frame's depth, from every n-th pixel. Relative depth is treated the
/// same, because it is also larger for farther points.
pub(crate) fn auto_range(frame: &ViewFrame) -> (f32, f32) {
    let Some((info, depth)) = frame.depth() else { return (0.0, 1.0) };
    let stride = stride_for(info.size.width, RANGE_COLUMNS);
    let (near, far) = nunet_files::color_range(&subsample(depth, info.size, stride), None, None);
    // A wall at one distance must not be stretched to all colors.
    let least = if info.units == Units::Metre { 0.1 } else { f32::EPSILON };
    (near, far.max(near + least))
}

/// Every n-th pixel of the depth map in colors: packed RGB and its size. `None` without depth.
pub(crate) fn colorize(
    frame: &ViewFrame,
    stride: u32,
    (near, far): (f32, f32),
) -> Option<(Vec<u8>, ImageSize)> {
    let (info, depth) = frame.depth()?;
    let scale = (COLORS - 1) as f32 / (far - near).max(f32::EPSILON);
    let palette = palette();
    let color = |depth: f32| {
        // A float beyond the range of `usize` becomes its nearest end.
        let index = ((depth - near) * scale + 0.5) as usize;
        if depth.is_finite() { palette[index.min(COLORS - 1)] } else { NONE }
    };
    let depth = subsample(depth, info.size, stride);
    let size = super::subsampled(info.size, stride);
    Some((depth.into_iter().flat_map(color).collect(), size))
}

#[cfg(test)]
mod tests {
    use nunet_types::ScaleSource;

    use super::*;
    use crate::frame::DepthInfo;

    fn frame(depth: &[f32]) -> ViewFrame {
        let size = ImageSize::new(depth.len() as u32, 1);
        let mut frame = ViewFrame::default();
        frame.set_depth(
            depth,
            DepthInfo {
                size,
                units: Units::Metre,
                scale_source: ScaleSource::Metric,
                view: [0.0, 0.0, 1.0, 1.0],
            },
        );
        frame
    }

    #[test]
    fn the_table_has_the_colors_of_depth_png() {
        let depth = [-5.0, 1.0, 2.0, 3.0, 9.0, f32::NAN];
        let (rgb, size) = colorize(&frame(&depth), 1, (1.0, 3.0)).unwrap();
        assert_eq!(size, ImageSize::new(6, 1));
        let expected = nunet_files::colorize(&depth, size, (1.0, 3.0));
        for (got, expected) in rgb.iter().zip(expected.as_raw()) {
            assert!(got.abs_diff(*expected) <= 2, "{rgb:?} instead of {expected:?}");
        }
    }

    #[test]
    fn a_flat_wall_does_not_use_all_colors() {
        let (near, far) = auto_range(&frame(&[2.0; 100]));
        assert!(near == 2.0 && far >= 2.1, "{near} to {far}");
        assert_eq!(auto_range(&ViewFrame::default()), (0.0, 1.0));
    }
}
