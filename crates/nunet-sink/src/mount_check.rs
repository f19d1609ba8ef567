//! Warns of a mount that the floor contradicts: a pitch with the wrong sign, a height in centimeters.
//!
//! With such a mount the floor is not where it is expected, and most directions are `drop` or `unknown`.

use std::fmt::Display;
use std::time::{Duration, Instant};

use nunet_core::camera::Mount;
use nunet_core::depth::DepthImage;
use nunet_core::obstacle::{FloorMismatch, Ground, ObstacleDetector, Obstacles};
use nunet_types::{Hint as _, counted};
use tracing::warn;

/// What frames add to the suspicion: those in which the floor was not found at its place, and those in which
/// it is not [near the expected one](Ground::is_near_expected). Other frames take [`FOUND`] from it.
const MISSING: u32 = 2;
const TILTED: u32 = 1;
const FOUND: u32 = 4;
/// At this suspicion the floor is measured in the image: after 30 frames without floor.
const SUSPICION: u32 = 60;
/// A camera that never found the floor in this number of frames has a wrong mount, or an unusual place.
const NEVER_FOUND: u32 = 300;
/// If less of the image than this share shows floor, hardly any direction is free.
pub(crate) const LITTLE_FLOOR: f32 = 0.02;
/// One warning per period.
const PERIOD: Duration = Duration::from_secs(60);

/// Compares the mount with the floor of frames in which it was not found.
#[derive(Debug, Default)]
pub(crate) struct MountCheck {
    suspicion: u32,
    /// Whether any frame showed the floor at its place.
    has_found: bool,
    /// The frames before the first of these.
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
        self.count(&detector.last().ground);
        if self.suspicion >= SUSPICION {
            self.suspicion = 0;
            let found = self.is_due(now).then(|| detector.floor_view(image)).flatten();
            self.warn(found.and_then(|seen| FloorMismatch::of_frames(seen, mount)), now);
        }
        if !self.has_found && self.without_floor == NEVER_FOUND && self.warned.is_none() {
            self.warn_of_no_floor(detector, now);
        }
    }

    /// Warns if the floor of one image contradicts the mount, at most once per period: the image is one of
    /// many that belong to different places. Without labels of floor, a table would be taken for it.
    pub(crate) fn check_alone(
        &mut self,
        detector: &ObstacleDetector,
        mount: &Mount,
        image: &DepthImage<'_>,
        name: &dyn Display,
        now: Instant,
    ) {
        let Obstacles { ground, used_labels, .. } = detector.last();
        let is_elsewhere = !(ground.is_refined && ground.is_near_expected());
        if *used_labels && is_elsewhere && self.is_due(now) {
            let found = detector.floor_view(image).and_then(|seen| FloorMismatch::of_image(seen, mount));
            if let Some(found) = found {
                self.warned = Some(now);
                warn!(hint = found.hint().as_deref(), "{name}: {found}");
            }
        }
    }

    fn count(&mut self, ground: &Ground) {
        let (more, less) = match ground {
            Ground { is_refined: false, .. } => (MISSING, 0),
            tilted if !tilted.is_near_expected() => (TILTED, 0),
            _ => (0, FOUND),
        };
        self.suspicion = (self.suspicion + more).saturating_sub(less);
        self.has_found |= less > 0;
        self.without_floor = self.without_floor.saturating_add(u32::from(!self.has_found));
    }

    fn is_due(&self, now: Instant) -> bool {
        self.warned.is_none_or(|warned| now.duration_since(warned) >= PERIOD)
    }

    fn warn(&mut self, found: Option<FloorMismatch>, now: Instant) {
        if let Some(found) = found {
            self.warned = Some(now);
            warn!(hint = found.hint().as_deref(), "{found}");
        }
    }

    /// Without a plane in the image that looks like floor, nothing can be compared.
    fn warn_of_no_floor(&mut self, detector: &ObstacleDetector, now: Instant) {
        if detector.floor_in_view() >= LITTLE_FLOOR {
            self.warned = Some(now);
            let hint =
                "check the mount, and that images are upright, if the camera has seen floor since the start";
            let frames = counted(NEVER_FOUND, "frame");
            warn!(hint, "the floor was not found where the mount expects it in the first {frames}");
        }
    }
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
        warnings_of(given, &[&floor(real)[..]], frames)
    }

    /// The same for these depth maps, again and again.
    fn warnings_of(given: &Mount, maps: &[&[f32]], frames: u32) -> Vec<u32> {
        let options = ObstacleOptions::default();
        let mut detector = ObstacleDetector::new(&camera(), *given, &[], options).unwrap();
        let (mut check, start, mut warned) = (MountCheck::default(), Instant::now(), Vec::new());
        for (frame, depth_m) in (0..frames).zip(maps.iter().copied().cycle()) {
            let image = DepthImage { depth_m, labels: None, confidence: None };
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
    fn a_height_off_by_two_and_a_half_and_a_small_pitch_of_the_wrong_sign_are_reported() {
        let mount = |height, pitch| Mount::new([0.0, 0.0, height], [0.0, pitch, 0.0]).unwrap();
        let real = mount(0.25, -0.07);
        assert_eq!(warnings(&mount(0.1, -0.07), &real, 50), [29], "the floor is not found");
        assert_eq!(warnings(&mount(0.25, 0.07), &real, 70), [59], "it is found, but tilted by 8 degrees");
        for near in [real, mount(0.2, -0.07), mount(0.25, 0.0), mount(0.25, -0.14)] {
            assert!(warnings(&near, &real, 400).is_empty(), "{near:?}");
        }
    }

    #[test]
    fn a_camera_that_never_finds_the_floor_is_reported_once() {
        let given = Mount::new([0.0, 0.0, 0.3], [0.0, 0.25, 0.0]).unwrap();
        let wall = vec![0.2; (SIZE.0 * SIZE.1) as usize];
        assert_eq!(warnings_of(&given, &[&wall[..]], 700), [299]);
        let (real, looks_up) = (floor(&given), Mount::new([0.0, 0.0, 0.3], [0.0, -0.6, 0.0]).unwrap());
        let seen_before = [&[&real[..]][..], &[&wall[..]; 400]].concat();
        assert!(warnings_of(&given, &seen_before, 400).is_empty(), "it found the floor before");
        assert!(warnings_of(&looks_up, &[&wall[..]], 400).is_empty(), "it expects none");
    }

    #[test]
    fn one_image_is_enough_if_its_floor_is_labeled() {
        let mount = |height, roll, pitch| Mount::new([0.0, 0.0, height], [roll, pitch, 0.0]).unwrap();
        let real = mount(0.25, 0.0, -0.07);
        let floor = floor(&real);
        let labels: Vec<u8> = floor.iter().map(|depth| u8::from(!depth.is_finite())).collect();
        let classes = ["floor", "wall"].map(str::to_owned);
        let is_warned = |given: Mount, depth_m: &[f32], labels: Option<&[u8]>| {
            let options = ObstacleOptions::default();
            let mut detector = ObstacleDetector::new(&camera(), given, &classes, options).unwrap();
            let image = DepthImage { depth_m, labels, confidence: None };
            detector.detect(&image, 0).unwrap();
            let mut check = MountCheck::default();
            check.check_alone(&detector, &given, &image, &"`a.jpg`", Instant::now());
            check.warned.is_some()
        };
        for wrong in [mount(0.25, 3.1, -0.07), mount(0.25, 0.0, 1.57), mount(25.0, 0.0, -0.07)] {
            assert!(is_warned(wrong, &floor, Some(&labels)), "{wrong:?}");
            assert!(!is_warned(wrong, &floor, None), "what looks like floor may be a table");
        }
        assert!(!is_warned(real, &floor, Some(&labels)));
        let (wall, no_floor) = (vec![0.4; floor.len()], vec![1; floor.len()]);
        assert!(!is_warned(real, &wall, Some(&no_floor)), "an image without floor");
        assert!(!is_warned(real, &wall, Some(&labels)), "a wall that is labeled floor");
    }

    #[test]
    fn the_text_names_what_is_seen_and_what_was_given() {
        let [real, given] =
            [0.25, -0.25].map(|pitch| Mount::new([0.0, 0.0, 0.3], [0.0, pitch, 0.0]).unwrap());
        let depth_m = floor(&real);
        let image = DepthImage { depth_m: &depth_m, labels: None, confidence: None };
        let detector = ObstacleDetector::new(&camera(), given, &[], ObstacleOptions::default()).unwrap();
        assert_eq!(
            FloorMismatch::of_frames(detector.floor_view(&image).unwrap(), &given).unwrap().to_string(),
            "the floor in the images is 0.30 m below the camera with a roll of 0.00 rad and a pitch of 0.25 rad, but \
             with the mount it is 0.30 m below the camera with a roll of 0.00 rad and a pitch of -0.25 rad"
        );
    }
}
