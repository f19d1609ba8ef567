//! Warns of a mount that the floor contradicts: a pitch with the wrong sign, a height in centimeters.
//!
//! With such a mount the floor is not where it is expected, and most directions are `drop` or `unknown`.

use std::time::{Duration, Instant};

use nunet_core::camera::Mount;
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{FloorMismatch, ObstacleDetector};
use nunet_types::Hint as _;
use tracing::warn;

/// The floor is measured in the image after this number of frames without floor where the mount expects it.
const FRAMES: u32 = 30;
/// One warning per period.
const PERIOD: Duration = Duration::from_secs(60);

/// Compares the mount with the floor of frames in which it was not found.
#[derive(Debug, Default)]
pub(crate) struct MountCheck {
    without_floor: u32,
    warned: Option<Instant>,
}

impl MountCheck {
    /// Counts a frame that `detector` has processed, and warns if the mount is wrong.
    pub(crate) fn check(
        &mut self,
        detector: &ObstacleDetector,
        mount: &Mount,
        image: &DepthImage<'_>,
        now: Instant,
    ) {
        self.without_floor = if detector.last().ground.is_refined { 0 } else { self.without_floor + 1 };
        if self.without_floor < FRAMES {
            return;
        }
        self.without_floor = 0;
        let is_due = self.warned.is_none_or(|warned| now.duration_since(warned) >= PERIOD);
        if let Some(found) = is_due.then(|| contradiction(detector, mount, image)).flatten() {
            self.warned = Some(now);
            warn!(hint = found.hint().as_deref(), "{found}");
        }
    }
}

/// The mismatch if the floor of a frame contradicts the mount.
fn contradiction(
    detector: &ObstacleDetector,
    mount: &Mount,
    image: &DepthImage<'_>,
) -> Option<FloorMismatch> {
    FloorMismatch::of_image(detector.floor_view(image)?, mount)
}

#[cfg(test)]
mod tests {
    use nunet_core::camera::{Camera, Intrinsics};
    use nunet_core::obstacle::ObstacleOptions;

    use super::*;

    const SIZE: (u32, u32) = (64, 48);

    fn camera() -> Camera {
        Camera::pinhole(Intrinsics::new(50.0, 50.0, 31.5, 23.5, SIZE.0, SIZE.1).unwrap())
    }

    /// The depth of level floor for a camera with this mount.
    fn floor(mount: &Mount) -> Vec<f32> {
        let depth = |pixel: u32| {
            let (column, row) = (f64::from(pixel % SIZE.0), f64::from(pixel / SIZE.0));
            let ray = [(column - 31.5) / 50.0, (row - 23.5) / 50.0, 1.0];
            let slope = mount.to_base(ray)[2] - mount.height_m();
            if slope < -0.02 { (-mount.height_m() / slope) as f32 } else { f32::NAN }
        };
        (0..SIZE.0 * SIZE.1).map(depth).collect()
    }

    /// In which of these frames of the floor of `real` there is a warning about `given`; a frame per second.
    fn warnings(given: &Mount, real: &Mount, frames: u32) -> Vec<u32> {
        let depth_m = floor(real);
        let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
        let options = ObstacleOptions::default();
        let mut detector = ObstacleDetector::new(&camera(), *given, &[], options).unwrap();
        let (mut check, start, mut warned) = (MountCheck::default(), Instant::now(), Vec::new());
        for frame in 0..frames {
            detector.detect(&image, 0).unwrap();
            let before = check.warned;
            check.check(&detector, given, &image, start + Duration::from_secs(frame.into()));
            warned.extend((check.warned != before).then_some(frame));
        }
        warned
    }

    #[test]
    fn a_wrong_pitch_or_unit_is_reported_once_a_minute_and_a_right_mount_never() {
        let mount = |height, pitch| Mount::new([0.1, 0.0, height], [0.0, pitch, 0.0]).unwrap();
        let real = mount(0.3, 0.25);
        for wrong in [mount(0.3, -0.25), mount(30.0, 0.25)] {
            assert_eq!(warnings(&wrong, &real, 100), [29, 89], "{wrong:?}");
        }
        assert!(warnings(&real, &real, 100).is_empty());
        assert!(warnings(&mount(0.31, 0.27), &real, 100).is_empty());
    }

    #[test]
    fn the_text_names_what_is_seen_and_what_was_given() {
        let [real, given] =
            [0.25, -0.25].map(|pitch| Mount::new([0.0, 0.0, 0.3], [0.0, pitch, 0.0]).unwrap());
        let depth_m = floor(&real);
        let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
        let detector = ObstacleDetector::new(&camera(), given, &[], ObstacleOptions::default()).unwrap();
        assert_eq!(
            contradiction(&detector, &given, &image).unwrap().to_string(),
            "the floor in the images is 0.30 m below the camera with a roll of 0.00 rad and a pitch of 0.25 rad, but \
             with the mount it is 0.30 m below the camera with a roll of 0.00 rad and a pitch of -0.25 rad"
        );
    }
}
