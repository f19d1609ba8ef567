//! The demo scene as a source: a walk through the ray-cast room, 30 pictures a second of its own time.

use nunet_core::camera::Camera;
use nunet_ipc::{Clock, unix_nanos};

use super::demo::DemoScene;
use super::{Capture, Fill, Frame, Source};

const SEED: u64 = 1;
const SIZE: (u32, u32) = (640, 480);
const FRAME_NANOS: u64 = 1_000_000_000 / 30;

/// The walk; it has no end.
pub(crate) struct Scene {
    scene: DemoScene,
    next: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            scene: DemoScene::new(SEED, SIZE.0, SIZE.1).expect("VGA is a size that the scene takes"),
            next: 0,
        }
    }
}

impl Source for Scene {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        frame.sequence = self.next;
        self.scene.render(self.next, frame.rgb_buffer(SIZE), None, None);
        let nanos = i64::try_from(self.next * FRAME_NANOS).unwrap_or(i64::MAX);
        frame.capture = Capture { nanos, clock: Clock::Media, unix_nanos: unix_nanos() };
        frame.camera = Some(Camera::pinhole(self.scene.intrinsics()));
        self.next += 1;
        Fill::Frame
    }
}
