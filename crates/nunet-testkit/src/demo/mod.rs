//! A ray-cast room with exactly known depth and classes.
//!
//! For tests against the truth. The room is deliberately asymmetric in color, left to right and top to
//! bottom, so that BGR, mirrored or transposed images cannot pass for it. A frame is a function of seed, size
//! and frame index alone, in arithmetic that every machine does alike.

mod intrinsics;
mod light;
mod noise;
mod path;
mod render;
mod room;
mod solid;
mod texture;
mod vector;

pub use intrinsics::RoomIntrinsics;
use light::LightMap;
use render::Renderer;
use solid::Solid;

/// Names of the classes, index = label.
pub use nunet_types::NYU13_CLASSES as CLASS_NAMES;

/// Labels, as indices into [`CLASS_NAMES`].
mod class {
    pub(super) const BED: u8 = 0;
    pub(super) const BOOKS: u8 = 1;
    pub(super) const CEILING: u8 = 2;
    pub(super) const CHAIR: u8 = 3;
    pub(super) const FLOOR: u8 = 4;
    pub(super) const FURNITURE: u8 = 5;
    pub(super) const OBJECTS: u8 = 6;
    pub(super) const PICTURE: u8 = 7;
    pub(super) const SOFA: u8 = 8;
    pub(super) const TABLE: u8 = 9;
    pub(super) const TV: u8 = 10;
    pub(super) const WALL: u8 = 11;
    pub(super) const WINDOW: u8 = 12;
}

/// A room with a camera in it.
pub struct DemoScene {
    seed: u64,
    intrinsics: RoomIntrinsics,
    solids: Vec<Solid>,
    light: LightMap,
    renderer: Renderer,
}

impl DemoScene {
    /// The room of `seed`, seen in images of `width` x `height` pixels.
    ///
    /// Computes the light on all surfaces, which takes some tenths of a second.
    ///
    /// # Panics
    /// If a side is 0.
    #[must_use]
    pub fn new(seed: u64, width: u32, height: u32) -> Self {
        assert!(width > 0 && height > 0, "an image has pixels");
        let intrinsics = RoomIntrinsics::nyu(width, height);
        let solids = room::furnished(seed);
        let light = LightMap::new(&solids);
        let renderer = Renderer::new(intrinsics, solids.len());
        Self { seed, intrinsics, solids, light, renderer }
    }

    /// The camera's intrinsics, at the size of its images; it has no distortion.
    #[must_use]
    pub fn intrinsics(&self) -> RoomIntrinsics {
        self.intrinsics
    }

    /// Renders one frame without allocating.
    ///
    /// `rgb` is `[height][width][3]`; `depth_m` is `[height][width]`, meters along the optical axis, never
    /// NaN; `labels` is `[height][width]`, indices into [`CLASS_NAMES`].
    ///
    /// # Panics
    /// If a buffer has another size.
    pub fn render(
        &mut self,
        frame_index: u64,
        rgb: &mut [u8],
        depth_m: Option<&mut [f32]>,
        labels: Option<&mut [u8]>,
    ) {
        let pixels = self.renderer.depth_m().len();
        assert_eq!(rgb.len(), 3 * pixels, "three bytes for each pixel");
        self.renderer.trace(&self.solids, &path::pose(self.seed, frame_index));
        self.renderer.paint(&self.solids, &self.light, rgb);
        if let Some(depth_m) = depth_m {
            depth_m.copy_from_slice(self.renderer.depth_m());
        }
        if let Some(labels) = labels {
            assert_eq!(labels.len(), pixels, "a label for each pixel");
            self.renderer.label(&self.solids, labels);
        }
    }
}

#[cfg(test)]
mod tests;
