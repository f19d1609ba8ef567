//! The floor as depth shows it, regardless of the mount. Distinguishes a wrong mount from an unusual scene.
//!
//! A plane through three floor points is tried many times, and the one that most points agree with is refined
//! by least squares. A point agrees if its depth is off by a small share. It runs only for frames that
//! contradict the mount, so it may take a millisecond.

use std::fmt;

use nalgebra::{Matrix3, Vector3};

use crate::camera::{Mount, RayTable};
use crate::depth::DepthImage;
use crate::label_roles::{Role, Roles};

/// The largest number of points that are used.
const MAX_POINTS: usize = 1000;
const MIN_POINTS: usize = 100;
/// Floor covers at least this part of the image: 1/20. Less is often no floor, but labeled as such.
const MIN_PART: usize = 20;
const TRIALS: usize = 80;
/// A point agrees with a plane if its depth differs by less than this share.
const AGREEMENT: f32 = 0.12;
/// The share of the points that must agree.
const MIN_AGREEING: f32 = 0.6;
/// How far the normal of a floor may be from the image's vertical, as a cosine: 70 degrees. A wall ahead has
/// 90.
const MIN_COSINE: f32 = 0.34;
/// The mount is wrong if the floor of one image is inclined by more than this, radians, or if the heights
/// differ by this factor. Networks are off by less; for some, all depth is twice too far.
const MAX_ANGLE_RAD: f32 = 0.14;
const MAX_FACTOR: f32 = 3.0;
/// The same for many images in a row, whose errors differ: of the pitch (5 degrees), and of the height. The
/// roll of a network's floor is less certain, so the whole angle has the limit of one image.
const STEADY_ANGLE_RAD: f32 = 0.087;
const STEADY_FACTOR: f32 = 1.6;

/// The floor in the camera's view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorView {
    /// How high the camera is above it, meters.
    pub height_m: f32,
    /// The direction straight down in the optical frame (x right, y down, z forward), of length 1.
    down: Vector3<f32>,
}

impl FloorView {
    /// The floor of an image whose pixels have these rays; `None` if it has none, or another size.
    pub(crate) fn of_image(rays: &RayTable, roles: &Roles, image: &DepthImage<'_>) -> Option<Self> {
        let (rays, count) = (rays.rays(), image.depth_m.len());
        let labels = image.labels.filter(|_| roles.has_floor);
        if rays.len() != count || labels.is_some_and(|labels| labels.len() != count) {
            return None;
        }
        let is_floor = |pixel: &usize| match labels {
            Some(labels) => roles.of(labels[*pixel]) == Role::Floor,
            None => *pixel >= count / 2,
        };
        let is_known = |pixel: &usize| image.depth_m[*pixel].is_finite() && rays[*pixel][0].is_finite();
        let pixels: Vec<usize> = (0..count).filter(is_floor).filter(is_known).collect();
        if pixels.len() < count / MIN_PART {
            return None;
        }
        let step = pixels.len().div_ceil(MAX_POINTS).max(1);
        let point = |&pixel: &usize| {
            let ([x, y], depth_m) = (rays[pixel], image.depth_m[pixel]);
            [x * depth_m, y * depth_m, depth_m]
        };
        Self::of(&pixels.iter().step_by(step).map(point).collect::<Vec<_>>())
    }

    /// The floor of these points of the optical frame, meters; `None` if they show no plane below the camera.
    fn of(points: &[[f32; 3]]) -> Option<Self> {
        let points: Vec<Vector3<f32>> = points.iter().map(|&point| point.into()).collect();
        if points.len() < MIN_POINTS {
            return None;
        }
        // A plane is `inverse . point = 1`, where `inverse` points down and its length is 1 over the height.
        let agreeing = |inverse: &Vector3<f32>| {
            let inverse = *inverse;
            points.iter().filter(move |point| (inverse.dot(point) - 1.0).abs() < AGREEMENT)
        };
        let mut random = 1_u32;
        let mut next = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            points[(random >> 8) as usize % points.len()]
        };
        let trials = (0..TRIALS).filter_map(|_| through([next(), next(), next()]));
        let best = trials.filter(is_below).max_by_key(|plane| agreeing(plane).count())?;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for point in agreeing(&best) {
            normal += point * point.transpose();
            right += point;
        }
        let refined = normal.cholesky()?.solve(&right);
        let share = agreeing(&refined).count() as f32 / points.len() as f32;
        let norm = refined.norm();
        (is_below(&refined) && share >= MIN_AGREEING)
            .then(|| Self { height_m: 1.0 / norm, down: refined / norm })
    }

    /// The floor that the camera would see with this mount.
    #[must_use]
    pub fn of_mount(mount: &Mount) -> Self {
        let [x, y, z] = mount.position_m();
        let down = Vector3::from(mount.to_optical([x, y, z - 1.0])).cast();
        Self { height_m: mount.height_m() as f32, down }
    }

    /// The middle one of many views of one camera, part by part; `None` without any.
    #[must_use]
    pub fn median(views: &[Self]) -> Option<Self> {
        let middle = |part: fn(&Self) -> f32| {
            let mut parts: Vec<f32> = views.iter().map(part).collect();
            parts.sort_unstable_by(f32::total_cmp);
            parts.get(parts.len() / 2).copied()
        };
        let down = [middle(|view| view.down.x)?, middle(|view| view.down.y)?, middle(|view| view.down.z)?];
        Some(Self { height_m: middle(|view| view.height_m)?, down: Vector3::from(down).normalize() })
    }

    /// The roll of a mount with this view, radians: positive if the camera's right side is lower.
    #[must_use]
    pub fn roll_rad(&self) -> f32 {
        self.down.x.atan2(self.down.y)
    }

    /// How far the camera looks down, radians; negative if it looks up.
    #[must_use]
    pub fn pitch_rad(&self) -> f32 {
        self.down.z.clamp(-1.0, 1.0).asin()
    }

    /// Roll and pitch as a text: `a roll of 0.00 rad and a pitch of -0.07 rad`.
    #[must_use]
    pub fn angles_text(&self) -> String {
        let [roll, pitch] = [self.roll_rad(), self.pitch_rad()].map(in_hundredths);
        format!("a roll of {roll:.2} rad and a pitch of {pitch:.2} rad")
    }

    /// Whether both cannot be the same floor: the errors of depth do not explain the difference.
    #[must_use]
    pub fn contradicts(&self, other: &Self) -> bool {
        self.is_inclined_to(other) || self.differs_in_height(other, MAX_FACTOR)
    }

    /// The same for what many images show. Their depth errors differ, so a smaller difference counts.
    #[must_use]
    pub fn contradicts_steadily(&self, other: &Self) -> bool {
        self.points_elsewhere(other) || self.differs_in_height(other, STEADY_FACTOR)
    }

    /// Whether many images show that the directions differ. The heights do not count, so that the scale of
    /// depth may be unknown.
    #[must_use]
    pub fn points_elsewhere(&self, other: &Self) -> bool {
        let pitch_rad = (self.pitch_rad() - other.pitch_rad()).abs();
        self.is_inclined_to(other) || pitch_rad > STEADY_ANGLE_RAD
    }

    fn is_inclined_to(&self, other: &Self) -> bool {
        self.down.angle(&other.down) > MAX_ANGLE_RAD
    }

    fn differs_in_height(&self, other: &Self, factor: f32) -> bool {
        !(1.0 / factor..=factor).contains(&(self.height_m / other.height_m))
    }
}

impl fmt::Display for FloorView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} m below the camera with {}", self.height_m, self.angles_text())
    }
}

/// Rounded to two digits, without the sign of a zero.
fn in_hundredths(value: f32) -> f32 {
    (100.0 * value).round() / 100.0 + 0.0
}

/// The plane through three points; `None` if they are on a line.
fn through([a, b, c]: [Vector3<f32>; 3]) -> Option<Vector3<f32>> {
    let normal = (b - a).cross(&(c - a));
    let distance = normal.dot(&a);
    let inverse = normal / distance;
    inverse.iter().all(|number| number.is_finite()).then_some(inverse)
}

fn is_below(inverse: &Vector3<f32>) -> bool {
    inverse.y > MIN_COSINE * inverse.norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Floor as a camera with this mount sees it, with depth off by up to 5 % and every fifth point on
    /// something else.
    fn floor(mount: &Mount) -> Vec<[f32; 3]> {
        let below = FloorView::of_mount(mount);
        let rays = (0..40).flat_map(|row| {
            (0..40).map(move |column| [column as f32 / 40.0 - 0.5, row as f32 / 40.0 - 0.5, 1.0])
        });
        let points = rays.enumerate().filter_map(|(index, ray)| {
            let toward = Vector3::from(ray).dot(&below.down);
            let noise = 1.0 + 0.1 * ((index * 7919 % 100) as f32 / 100.0 - 0.5);
            let share = if index % 5 == 0 { 0.5 } else { noise };
            let depth = below.height_m / toward * share;
            (toward > 0.05).then(|| ray.map(|side| side * depth))
        });
        points.take(MAX_POINTS).collect()
    }

    #[test]
    fn the_floor_gives_height_and_pitch_whatever_the_mount_says() {
        for (height, roll, pitch) in [(0.25, 0.0, 0.2), (1.4, 0.05, 0.6), (0.3, -0.1, -0.1)] {
            let mount = Mount::new([0.1, 0.0, height], [roll, pitch, 0.3]).unwrap();
            let found = FloorView::of(&floor(&mount)).unwrap();
            assert!((found.height_m / height as f32 - 1.0).abs() < 0.05, "{found:?}");
            assert!((found.pitch_rad() - pitch as f32).abs() < 0.03, "{found:?} {pitch}");
            assert!((found.roll_rad() - roll as f32).abs() < 0.03, "{found:?} {roll}");
            assert!(!found.contradicts(&FloorView::of_mount(&mount)));
            for wrong in [
                Mount::new([0.1, 0.0, height], [roll, -2.0 * pitch, 0.3]),
                Mount::new([0.1, 0.0, 100.0 * height], [roll, pitch, 0.3]),
                Mount::new([0.1, 0.0, height], [roll + std::f64::consts::PI, pitch, 0.3]),
            ] {
                assert!(found.contradicts(&FloorView::of_mount(&wrong.unwrap())), "{found:?}");
            }
        }
    }

    #[test]
    fn an_outlier_does_not_change_the_median_of_views() {
        let view =
            |height, pitch| FloorView::of_mount(&Mount::new([0.0, 0.0, height], [0.02, pitch, 0.0]).unwrap());
        let views = [view(0.25, -0.06), view(0.2, 0.9), view(0.9, -0.09), view(0.3, -0.07), view(0.22, -0.1)];
        let middle = FloorView::median(&views).unwrap();
        assert!((middle.pitch_rad() + 0.07).abs() < 0.01 && middle.height_m == 0.25, "{middle}");
        assert!((middle.roll_rad() - 0.02).abs() < 0.01, "{middle}");
        assert_eq!(FloorView::median(&[]), None);
    }

    #[test]
    fn what_many_images_show_contradicts_a_mount_earlier() {
        let view = |height, roll, pitch| {
            FloorView::of_mount(&Mount::new([0.0, 0.0, height], [roll, pitch, 0.0]).unwrap())
        };
        let seen = view(0.25, 0.0, -0.07);
        // The roll of a network's floor is less certain than its pitch.
        for (other, elsewhere, steadily, at_once) in [
            (view(0.25, 0.1, -0.07), false, false, false),
            (view(0.2, 0.0, -0.02), false, false, false),
            (view(0.1, 0.0, -0.07), false, true, false),
            (view(0.25, 0.0, 0.03), true, true, false),
            (view(0.25, 0.2, -0.07), true, true, true),
        ] {
            assert_eq!(seen.points_elsewhere(&other), elsewhere, "{other}");
            assert_eq!(seen.contradicts_steadily(&other), steadily, "{other}");
            assert_eq!(seen.contradicts(&other), at_once, "{other}");
        }
    }

    #[test]
    fn the_view_of_a_mount_has_its_roll_and_pitch_whatever_the_yaw() {
        for (roll, pitch) in [(0.0, 0.0), (3.1, -0.07), (-1.5, 0.0), (0.3, -0.4), (-0.2, 1.2)] {
            let mount = Mount::new([0.1, 0.0, 0.25], [roll, pitch, -1.57]).unwrap();
            let view = FloorView::of_mount(&mount);
            assert!((view.roll_rad() - roll as f32).abs() < 1e-5, "{view:?} {roll}");
            assert!((view.pitch_rad() - pitch as f32).abs() < 1e-5, "{view:?} {pitch}");
        }
        let level = FloorView::of_mount(&Mount::new([0.0, 0.0, 0.5], [-0.001, 0.0, 0.0]).unwrap());
        let text = "0.50 m below the camera with a roll of 0.00 rad and a pitch of 0.00 rad";
        assert_eq!(level.to_string(), text, "no zero has a sign");
    }

    #[test]
    fn walls_ceilings_few_points_and_chaos_are_no_floor() {
        let grid =
            || (0..30).flat_map(|i| (0..30).map(move |j| (i as f32 / 15.0 - 1.0, j as f32 / 15.0 - 1.0)));
        let wall: Vec<_> = grid().map(|(x, y)| [x, y, 2.0]).collect();
        let ceiling: Vec<_> = grid().map(|(x, z)| [x, -1.5, z + 2.0]).collect();
        let chaos: Vec<_> =
            grid().map(|(x, y)| [x, y * y * 3.0, 1.0 + (37.0 * x * y).sin().abs() * 4.0]).collect();
        for points in [&wall[..], &ceiling, &chaos, &[[0.0, 1.0, 1.0]; 99], &[[f32::NAN; 3]; 500]] {
            assert_eq!(FloorView::of(points), None);
        }
    }
}
