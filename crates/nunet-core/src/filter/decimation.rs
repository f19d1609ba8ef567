//! Decimation: each block of pixels of the network's depth map becomes one pixel.

use std::fmt;
use std::num::NonZeroU32;
use std::ops::RangeInclusive;

use nunet_types::ImageSize;

use super::settings::Settings;
use super::{FilterError, check_size};

/// Pixels on each side of a block.
const FACTOR: RangeInclusive<u32> = 2..=8;
const FACTOR_DEFAULT: u32 = 2;

/// From this factor on depth is the mean of a block, not its median, as in librealsense.
const MEAN_FACTOR: usize = 4;

/// Pixels of the largest block.
const MAX_BLOCK: usize = (*FACTOR.end() * *FACTOR.end()) as usize;

/// The options of decimation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecimationOptions {
    factor: NonZeroU32,
}

impl DecimationOptions {
    pub(super) const NAME: &str = "decimation";
    pub(super) const EXAMPLE: &str = "decimation=2";

    /// `factor:2`, or only the number.
    pub(super) fn parse(text: &str) -> Result<Self, FilterError> {
        let settings = Settings::parse(Self::NAME, text, &["factor"], Some("factor"), Self::EXAMPLE)?;
        let factor = settings.number("factor", &FACTOR, FACTOR_DEFAULT)?;
        Ok(Self { factor: NonZeroU32::new(factor).expect("the range begins at 2") })
    }

    /// Pixels on each side of a block.
    #[must_use]
    pub fn factor(self) -> NonZeroU32 {
        self.factor
    }

    /// The number of whole blocks along both sides. Columns at the right and rows at the bottom that do not
    /// fill a block are cut off, because the intrinsics would not hold for the center of a smaller block.
    #[must_use]
    pub fn reduced(self, ImageSize { width, height }: ImageSize) -> ImageSize {
        ImageSize { width: width / self.factor, height: height / self.factor }
    }
}

impl fmt::Display for DecimationOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "factor:{}", self.factor)
    }
}

/// Colors and labels of a depth map, at its size.
#[derive(Debug, Clone, Copy)]
pub struct Appearance<'a> {
    /// `[H, W, 3]`, RGB, rows top to bottom.
    pub rgb: &'a [u8],
    /// `[H, W]`, class indices, if there are any.
    pub labels: Option<&'a [u8]>,
}

/// Decimates depth, labels and colors.
///
/// Depth is, as in librealsense, the median of a block's measurements for factors 2 and 3 and their mean from
/// 4 on; NaN if the block has none. Of an even count of measurements the nearer of the two middle ones is the
/// median, so that no depth appears between two surfaces; a mean has no such guarantee. Labels are the most
/// frequent class of a block, the smallest of equals, and colors the mean.
#[derive(Debug)]
pub struct Decimation {
    factor: usize,
    network_size: ImageSize,
    size: ImageSize,
    network_depth_m: Vec<f32>,
    labels: Vec<u8>,
    rgb: Vec<u8>,
}

impl Decimation {
    /// The name of its stage.
    pub const NAME: &str = DecimationOptions::NAME;

    /// Allocates all buffers for a network's results of `network_size`: width and height.
    ///
    /// # Errors
    /// A size that holds no whole block.
    pub fn new(options: DecimationOptions, network_size: ImageSize) -> Result<Self, FilterError> {
        let size = options.reduced(network_size);
        let factor = options.factor.get();
        if size.width == 0 || size.height == 0 {
            return Err(FilterError::TooSmall {
                width: network_size.width,
                height: network_size.height,
                factor,
            });
        }
        Ok(Self {
            factor: factor as usize,
            network_size,
            size,
            network_depth_m: vec![f32::NAN; network_size.pixel_count()],
            labels: vec![0; size.pixel_count()],
            rgb: vec![0; 3 * size.pixel_count()],
        })
    }

    /// The buffer for the network's own depth map, `[H, W]` at the network's size.
    pub fn network_depth(&mut self) -> &mut [f32] {
        &mut self.network_depth_m
    }

    /// Width and height of the results, pixels.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Decimates a confidence at the network's size: the mean of each block, rounded.
    ///
    /// # Errors
    /// Buffers of another size.
    pub fn mean_of_blocks(&self, large: &[u8], small: &mut [u8]) -> Result<(), FilterError> {
        check_size(Self::NAME, "network's confidence", large.len(), self.network_size.pixel_count())?;
        check_size(Self::NAME, "confidence", small.len(), self.size.pixel_count())?;
        let width = self.network_size.width as usize;
        let blocks = Blocks { factor: self.factor, width, columns: self.size.width as usize };
        blocks.fill(small, large, |block| mean_byte(block));
        Ok(())
    }

    /// Decimates the depth in [`Self::network_depth`] into `depth_m`, and the labels of `full`, at the
    /// network's size, into `labels`. The returned colors are valid only if `for_cloud`.
    ///
    /// # Errors
    /// Buffers of another size.
    pub fn reduce<'a>(
        &'a mut self,
        full: Appearance<'_>,
        depth_m: &mut [f32],
        labels: Option<&'a mut [u8]>,
        for_cloud: bool,
    ) -> Result<Appearance<'a>, FilterError> {
        let (large, small) = (self.network_size.pixel_count(), self.size.pixel_count());
        let check = |buffer, got, expected| check_size(Self::NAME, buffer, got, expected);
        check("depth", depth_m.len(), small)?;
        check("labels", labels.as_ref().map_or(small, |labels| labels.len()), small)?;
        check("network's labels", full.labels.map_or(large, <[u8]>::len), large)?;
        check("image", full.rgb.len(), 3 * large)?;

        let (factor, width) = (self.factor, self.network_size.width as usize);
        let blocks = Blocks { factor, width, columns: self.size.width as usize };
        if factor < MEAN_FACTOR {
            blocks.fill(depth_m, &self.network_depth_m, median);
        } else {
            blocks.fill(depth_m, &self.network_depth_m, |block| mean_depth(block));
        }
        let room = match labels {
            None if for_cloud => Some(&mut self.labels[..]),
            wanted => wanted,
        };
        let labels = room.zip(full.labels).map(|(small, large)| {
            let mut votes = [0; 256];
            blocks.fill(small, large, |block| most_frequent(block, &mut votes));
            &*small
        });
        if for_cloud {
            blocks.fill(self.rgb.as_chunks_mut().0, full.rgb.as_chunks().0, |block| mean_color(block));
        }
        Ok(Appearance { rgb: &self.rgb, labels })
    }
}

/// The division of an image into blocks, one for each pixel of the decimated image.
#[derive(Clone, Copy)]
struct Blocks {
    /// Pixels on each side of a block.
    factor: usize,
    /// Width of the large image, pixels.
    width: usize,
    /// Width of the small one, pixels.
    columns: usize,
}

impl Blocks {
    fn fill<T: Copy + Default>(self, small: &mut [T], large: &[T], mut reduce: impl FnMut(&mut [T]) -> T) {
        let mut block = [T::default(); MAX_BLOCK];
        let bands = large.chunks_exact(self.width * self.factor);
        for (band, small_row) in bands.zip(small.chunks_exact_mut(self.columns)) {
            for (column, pixel) in small_row.iter_mut().enumerate() {
                let first = column * self.factor;
                for (part, row) in block.chunks_exact_mut(self.factor).zip(band.chunks_exact(self.width)) {
                    part.copy_from_slice(&row[first..first + self.factor]);
                }
                *pixel = reduce(&mut block[..self.factor * self.factor]);
            }
        }
    }
}

/// The lower median of the measurements.
fn median(block: &mut [f32]) -> f32 {
    let mut count = 0;
    for index in 0..block.len() {
        let depth = block[index];
        block[count] = depth;
        count += usize::from(!depth.is_nan());
    }
    match count {
        0 => f32::NAN,
        _ => *block[..count].select_nth_unstable_by((count - 1) / 2, f32::total_cmp).1,
    }
}

/// The mean of the measurements.
fn mean_depth(block: &[f32]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for &depth in block {
        let is_valid = !depth.is_nan();
        sum += if is_valid { depth } else { 0.0 };
        count += f32::from(u8::from(is_valid));
    }
    // 0 / 0 is NaN.
    sum / count
}

/// The most frequent class, the smallest of equals. `votes` are zeros before and after, because clearing 256
/// counters takes longer than counting a block.
fn most_frequent(block: &[u8], votes: &mut [u8; 256]) -> u8 {
    for &label in block {
        votes[usize::from(label)] += 1;
    }
    let standing = |label: &u8| (votes[usize::from(*label)], std::cmp::Reverse(*label));
    let most = block.iter().copied().max_by_key(standing).unwrap_or_default();
    for &label in block {
        votes[usize::from(label)] = 0;
    }
    most
}

/// The mean, rounded.
fn mean_byte(block: &[u8]) -> u8 {
    let count = block.len() as u32;
    let sum: u32 = block.iter().map(|&value| u32::from(value)).sum();
    ((sum + count / 2) / count) as u8
}

/// The mean color, rounded.
fn mean_color(block: &[[u8; 3]]) -> [u8; 3] {
    let count = block.len() as u32;
    let sum = block.iter().fold([0; 3], |sum: [u32; 3], pixel| {
        std::array::from_fn(|channel| sum[channel] + u32::from(pixel[channel]))
    });
    sum.map(|sum| ((sum + count / 2) / count) as u8)
}
