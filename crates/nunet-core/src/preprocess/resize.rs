//! Resizes images to the network's size in one pass.

use std::fmt;
use std::sync::Arc;

use pic_scale::{BufferStore, ImageSize, ImageStore, ImageStoreMut, Resampling, ResamplingFunction, Scaler};

use crate::frame::ImageView;

/// Weights a pixel by 2|t|^3 - 3t^2 + 1, where t is its distance in pixels of the coarser image. Downsampling
/// skips no pixel, and upsampling does not overshoot.
///
/// `pic-scale`'s `Area` is four target pixels wide, and its `Bilinear` drops the last tap at most ratios,
/// which shifts the image by a fraction of a pixel.
const FILTER: ResamplingFunction = ResamplingFunction::Hermite;

/// Why `pic-scale` cannot fail here.
const FITS: &str = "the view was checked, and plan, scratch and buffer were sized for it";

/// Resizes images of `N` bytes per pixel to one size, with vector instructions if the processor has them.
///
/// Weights and scratch memory are kept for the size of the first image, so that later ones allocate nothing.
/// (`fast_image_resize` is as fast, but computes its weights for each image, in a thousand allocations.)
pub(super) struct Resizer<const N: usize> {
    target: ImageSize,
    plan: Option<Arc<Resampling<u8, N>>>,
    scratch: Vec<u8>,
}

impl<const N: usize> fmt::Debug for Resizer<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Resizer").field("target", &self.target).finish_non_exhaustive()
    }
}

impl<const N: usize> Resizer<N>
where
    Scaler: Plan<N>,
{
    pub(super) fn to_size(width: u32, height: u32) -> Self {
        Self { target: image_size(width, height), plan: None, scratch: Vec::new() }
    }

    /// Resizes `frame`, whose format has `N` bytes per pixel, into `out`, packed and of the target's size.
    pub(super) fn resize(&mut self, frame: &ImageView<'_>, out: &mut [u8]) {
        let source = image_size(frame.width(), frame.height());
        let known = self.plan.take().filter(|plan| plan.source_size() == source);
        let plan = known.unwrap_or_else(|| self.plan_for(source));
        let image = ImageStore::<u8, N> {
            buffer: frame.bytes().into(),
            channels: N,
            width: source.width,
            height: source.height,
            stride: frame.row_stride() as usize,
            bit_depth: u8::BITS as usize,
        };
        let mut out = ImageStoreMut::<u8, N> {
            buffer: BufferStore::Borrowed(out),
            channels: N,
            width: self.target.width,
            height: self.target.height,
            stride: self.target.width * N,
            bit_depth: u8::BITS as usize,
        };
        plan.resample_with_scratch(&image, &mut out, &mut self.scratch).expect(FITS);
        self.plan = Some(plan);
    }

    fn plan_for(&mut self, source: ImageSize) -> Arc<Resampling<u8, N>> {
        let plan = Scaler::new(FILTER).plan(source, self.target);
        self.scratch = plan.alloc_scratch();
        plan
    }
}

/// One name for the planning methods of `pic-scale`, which has one for each number of channels.
pub(super) trait Plan<const N: usize> {
    fn plan(&self, source: ImageSize, target: ImageSize) -> Arc<Resampling<u8, N>>;
}

impl Plan<1> for Scaler {
    fn plan(&self, source: ImageSize, target: ImageSize) -> Arc<Resampling<u8, 1>> {
        self.plan_planar_resampling(source, target).expect(FITS)
    }
}

impl Plan<3> for Scaler {
    fn plan(&self, source: ImageSize, target: ImageSize) -> Arc<Resampling<u8, 3>> {
        self.plan_rgb_resampling(source, target).expect(FITS)
    }
}

fn image_size(width: u32, height: u32) -> ImageSize {
    ImageSize::new(width as usize, height as usize)
}
