//! Fewer, larger pixels: each block of the network's picture becomes one.

use std::fmt;
use std::num::NonZeroU32;
use std::ops::RangeInclusive;

use super::settings::Settings;
use super::{FilterError, check_size, pixels};

/// Pixels on each side of a block.
const FACTOR: RangeInclusive<u32> = 2..=8;
const FACTOR_DEFAULT: u32 = 2;

/// Pixels of the largest block.
const MAX_BLOCK: usize = (*FACTOR.end() * *FACTOR.end()) as usize;

/// How much smaller a depth map becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecimationOptions {
    factor: NonZeroU32,
}

impl DecimationOptions {
    pub(super) const NAME: &str = "decimation";
    pub(super) const EXAMPLE: &str = "decimation=2";

    /// `factor:2`, or the number alone.
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

    /// Whole blocks of a picture, from left to right and from top to bottom. Columns and rows at the right and at the
    /// bottom that fill no block are left out: a pixel made of fewer would lie elsewhere than the camera says.
    #[must_use]
    pub fn reduced(self, (width, height): (u32, u32)) -> (u32, u32) {
        (width / self.factor, height / self.factor)
    }
}

impl fmt::Display for DecimationOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "factor:{}", self.factor)
    }
}

/// What a picture shows beside depth, at one size.
#[derive(Debug, Clone, Copy)]
pub struct Look<'a> {
    /// `[H, W, 3]`, RGB, rows top to bottom.
    pub rgb: &'a [u8],
    /// `[H, W]`, class indices, where there are any.
    pub labels: Option<&'a [u8]>,
}

/// Makes depth, labels and colours smaller.
///
/// Depth becomes the median of the block's measurements, the nearer of both middle ones where their count is even, so
/// that no depth appears between two surfaces; NaN where the block has none. (librealsense takes the mean from 4x4 on,
/// for speed.) Labels become the block's most frequent class, the smallest of equals, and colours the mean.
#[derive(Debug)]
pub struct Decimation {
    factor: usize,
    network_size: (u32, u32),
    size: (u32, u32),
    network_depth_m: Vec<f32>,
    labels: Vec<u8>,
    rgb: Vec<u8>,
}

impl Decimation {
    /// The name of its stage.
    pub const NAME: &str = DecimationOptions::NAME;

    /// Makes all buffers for a network's results of `network_size`: width and height.
    ///
    /// # Errors
    /// A size that holds no whole block.
    pub fn new(options: DecimationOptions, network_size: (u32, u32)) -> Result<Self, FilterError> {
        let size = options.reduced(network_size);
        let factor = options.factor.get();
        if size.0 == 0 || size.1 == 0 {
            return Err(FilterError::TooSmall { width: network_size.0, height: network_size.1, factor });
        }
        Ok(Self {
            factor: factor as usize,
            network_size,
            size,
            network_depth_m: vec![f32::NAN; pixels(network_size)],
            labels: vec![0; pixels(size)],
            rgb: vec![0; 3 * pixels(size)],
        })
    }

    /// Where the network's own depth map goes, `[H, W]` at the network's size, before it is made smaller.
    pub fn network_depth(&mut self) -> &mut [f32] {
        &mut self.network_depth_m
    }

    /// Makes everything that is wanted smaller: the depth in [`Self::network_depth`] into `depth_m`, and the labels of
    /// `full`, at the network's size, into `labels`. The look of the result means nothing where no cloud is wanted.
    ///
    /// # Errors
    /// Buffers of another size.
    pub fn reduce<'a>(
        &'a mut self,
        full: Look<'_>,
        depth_m: &mut [f32],
        labels: Option<&'a mut [u8]>,
        for_cloud: bool,
    ) -> Result<Look<'a>, FilterError> {
        let (large, small) = (pixels(self.network_size), pixels(self.size));
        let check = |buffer, got, expected| check_size(Self::NAME, buffer, got, expected);
        check("depth", depth_m.len(), small)?;
        check("labels", labels.as_ref().map_or(small, |labels| labels.len()), small)?;
        check("network's labels", full.labels.map_or(large, <[u8]>::len), large)?;
        check("picture", full.rgb.len(), 3 * large)?;

        let (factor, width) = (self.factor, self.network_size.0 as usize);
        let blocks = Blocks { factor, width, columns: self.size.0 as usize };
        blocks.fill(depth_m, &self.network_depth_m, median);
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
            blocks.fill(self.rgb.as_chunks_mut().0, full.rgb.as_chunks().0, |block| mean(block));
        }
        Ok(Look { rgb: &self.rgb, labels })
    }
}

/// How a large picture is cut into blocks, one for each pixel of the small one.
#[derive(Clone, Copy)]
struct Blocks {
    /// Pixels on each side of a block.
    factor: usize,
    /// Pixels of the large picture from left to right.
    width: usize,
    /// Pixels of the small one.
    columns: usize,
}

impl Blocks {
    fn fill<T: Copy + Default>(self, small: &mut [T], large: &[T], mut made_of: impl FnMut(&mut [T]) -> T) {
        let mut block = [T::default(); MAX_BLOCK];
        let bands = large.chunks_exact(self.width * self.factor);
        for (band, small_row) in bands.zip(small.chunks_exact_mut(self.columns)) {
            for (column, pixel) in small_row.iter_mut().enumerate() {
                let first = column * self.factor;
                for (part, row) in block.chunks_exact_mut(self.factor).zip(band.chunks_exact(self.width)) {
                    part.copy_from_slice(&row[first..first + self.factor]);
                }
                *pixel = made_of(&mut block[..self.factor * self.factor]);
            }
        }
    }
}

/// The lower median of what is measured.
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

/// The most frequent class, the smallest of equals. `votes` are zeros before and after: clearing 256 counters would
/// take longer than counting a block.
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

/// The mean colour, rounded.
fn mean(block: &[[u8; 3]]) -> [u8; 3] {
    let count = block.len() as u32;
    let sum = block.iter().fold([0; 3], |sum: [u32; 3], pixel| {
        std::array::from_fn(|channel| sum[channel] + u32::from(pixel[channel]))
    });
    sum.map(|sum| ((sum + count / 2) / count) as u8)
}
