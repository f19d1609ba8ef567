//! Obstacles as images: from above, and on the camera's image.

use image::{Rgb, RgbImage};
use nunet_types::{ObstacleMap, SectorState};

use crate::color::draw_text;

/// Pixels of one meter from above, at most.
const PX_PER_M: f32 = 80.0;
/// Pixels of the range from above, at most: a longer range is drawn smaller, not on a larger image.
const MAX_RADIUS_PX: f32 = 400.0;
/// Pixels around an obstacle point that are colored, on each side.
const POINT_PX: i64 = 1;

/// Lines of [`BirdsEye::text`].
pub const BIRDS_EYE_ROWS: usize = 14;
/// The characters of [`BirdsEye::text`].
pub const BIRDS_EYE_LEGEND: &str = "· free  █ obstacle  ▒ remembered  ▼ drop  ░ unknown";

const FREE: Rgb<u8> = Rgb([120, 200, 120]);
const UNSEEN: Rgb<u8> = Rgb([150, 150, 150]);
const BEHIND: Rgb<u8> = Rgb([205, 205, 205]);
const OCCUPIED: Rgb<u8> = Rgb([200, 30, 30]);
const REMEMBERED: Rgb<u8> = Rgb([140, 80, 160]);
const DROP: Rgb<u8> = Rgb([240, 150, 30]);
const RING: Rgb<u8> = Rgb([90, 90, 90]);

/// Draws obstacles from above.
#[derive(Debug, Clone, Copy)]
pub struct BirdsEye<'a>(pub ObstacleMap<'a>);

impl BirdsEye<'_> {
    /// The robot's surroundings from above: forward is up, left is left, the robot is in the middle of the
    /// lower edge (of the image, if it sees behind itself). Green is free, gray unknown, red an obstacle,
    /// orange a drop, purple remembered. The image is at most 800 pixels wide. Rings are 1 m apart, 5 m if
    /// the range is more than 10 m, 10 m if it is more than 30 m.
    #[must_use]
    pub fn draw(&self) -> RgbImage {
        let px_per_m = self.px_per_m();
        let radius = (self.0.max_range_m * px_per_m).round().clamp(1.0, MAX_RADIUS_PX) as u32;
        let end_rad = self.0.angle_min_rad + self.0.angle_step_rad * self.0.sectors.len() as f32;
        let sees_behind =
            self.0.angle_min_rad < -std::f32::consts::FRAC_PI_2 || end_rad > std::f32::consts::FRAC_PI_2;
        let height = if sees_behind { 2 * radius } else { radius };
        let mut image = RgbImage::from_fn(2 * radius, height, |column, row| {
            let x = (radius as f32 - row as f32 - 0.5) / px_per_m;
            let y = (radius as f32 - column as f32 - 0.5) / px_per_m;
            self.color(x, y)
        });
        for point in self.0.points {
            let column = (radius as f32 - point.y * px_per_m) as i64;
            let row = (radius as f32 - point.x * px_per_m) as i64;
            mark(&mut image, column, row, 0, Rgb([60, 0, 0]));
        }
        let rings = (self.0.max_range_m / self.ring_m()) as u32;
        for meters in (1..=rings).map(|ring| ring as f32 * self.ring_m()) {
            let above = (meters * px_per_m) as u32;
            draw_text(&mut image, &format!("{meters} m"), radius + 2, radius.saturating_sub(above) + 2);
        }
        image
    }

    fn px_per_m(&self) -> f32 {
        PX_PER_M.min(MAX_RADIUS_PX / self.0.max_range_m)
    }

    /// Meters from ring to ring.
    fn ring_m(&self) -> f32 {
        if self.0.max_range_m > 30.0 {
            10.0
        } else if self.0.max_range_m > 10.0 {
            5.0
        } else {
            1.0
        }
    }

    /// The same as text for a terminal, [`BIRDS_EYE_ROWS`] lines. A cell is twice as high as wide; only the
    /// field of view is shown. [`BIRDS_EYE_LEGEND`] explains the characters.
    #[must_use]
    pub fn text(&self) -> String {
        let cell_m = self.0.max_range_m / BIRDS_EYE_ROWS as f32;
        let half_columns = (2.0 * BIRDS_EYE_ROWS as f32 * self.half_width()).ceil() as i32;
        let mut text = String::new();
        for row in (0..BIRDS_EYE_ROWS).rev() {
            let x = (row as f32 + 0.5) * cell_m;
            let line = (-half_columns..half_columns).rev().map(|column| {
                let y = (column as f32 + 0.5) * cell_m / 2.0;
                self.place(x, y, cell_m / 2.0).character()
            });
            text += line.collect::<String>().trim_end();
            text.push('\n');
        }
        text
    }

    /// Half of the width of the field of view, as a share of the range.
    fn half_width(&self) -> f32 {
        let end_rad = self.0.angle_min_rad + self.0.angle_step_rad * self.0.sectors.len() as f32;
        let reaches_side = self.0.angle_min_rad.abs().max(end_rad.abs()) > std::f32::consts::FRAC_PI_2;
        if reaches_side { 1.0 } else { self.0.angle_min_rad.sin().abs().max(end_rad.sin().abs()) }
    }

    /// The color of a place on the floor, meters forward and to the left.
    fn color(&self, x: f32, y: f32) -> Rgb<u8> {
        let range_m = x.hypot(y);
        let (half_pixel, ring_m) = (0.5 / self.px_per_m(), self.ring_m());
        let from_ring_m = (range_m - (range_m / ring_m).round() * ring_m).abs();
        let is_ring = range_m > 0.5 * ring_m && from_ring_m < half_pixel;
        match self.place(x, y, 3.0 * half_pixel) {
            MapCell::TooFar => Rgb([255, 255, 255]),
            _ if is_ring => RING,
            MapCell::OutsideView => BEHIND,
            MapCell::Free => FREE,
            MapCell::Unknown => UNSEEN,
            MapCell::Occupied => OCCUPIED,
            MapCell::Remembered => REMEMBERED,
            MapCell::Drop => DROP,
        }
    }

    /// The state of a position on the floor, meters forward and to the left; the end of a sector is `end_m`
    /// thick on each side.
    fn place(&self, x: f32, y: f32, end_m: f32) -> MapCell {
        let range_m = x.hypot(y);
        if range_m > self.0.max_range_m {
            return MapCell::TooFar;
        }
        let turned = (y.atan2(x) - self.0.angle_min_rad).rem_euclid(std::f32::consts::TAU);
        let Some(sector) = self.0.sectors.get((turned / self.0.angle_step_rad) as usize) else {
            return MapCell::OutsideView;
        };
        let at_end = (range_m - sector.range_m).abs() < end_m;
        match sector.state() {
            SectorState::Occupied if at_end && sector.remembered != 0 => MapCell::Remembered,
            SectorState::Occupied if at_end => MapCell::Occupied,
            SectorState::Drop if at_end => MapCell::Drop,
            _ if range_m < sector.range_m => MapCell::Free,
            _ => MapCell::Unknown,
        }
    }
}

/// The state of a position in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MapCell {
    TooFar,
    OutsideView,
    Free,
    Unknown,
    Occupied,
    Remembered,
    Drop,
}

impl MapCell {
    fn character(self) -> char {
        match self {
            Self::TooFar | Self::OutsideView => ' ',
            Self::Free => '·',
            Self::Unknown => '░',
            Self::Occupied => '█',
            Self::Remembered => '▒',
            Self::Drop => '▼',
        }
    }
}

/// Draws points of obstacles into an image: red near, yellow at `max_range_m`. Each is its column, its row,
/// and its distance in meters.
pub fn draw_obstacle_points(
    image: &mut RgbImage,
    points: impl IntoIterator<Item = ([f64; 2], f32)>,
    max_range_m: f32,
) {
    for ([column, row], range_m) in points {
        let share = (range_m / max_range_m).clamp(0.0, 1.0);
        let color = Rgb([255, (220.0 * share) as u8, 0]);
        mark(image, column.round() as i64, row.round() as i64, POINT_PX, color);
    }
}

/// Colors a square; what is outside the image is skipped.
fn mark(image: &mut RgbImage, column: i64, row: i64, around: i64, color: Rgb<u8>) {
    for y in row - around..=row + around {
        for x in column - around..=column + around {
            if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                && let Some(pixel) = image.get_pixel_mut_checked(x, y)
            {
                *pixel = color;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::ObstacleSector;

    use super::*;

    #[test]
    fn from_above_left_is_left_and_each_state_has_its_color() {
        let sector = |state: SectorState, range_m| ObstacleSector {
            state: state.into(),
            range_m,
            ..ObstacleSector::UNKNOWN
        };
        let sectors = [
            sector(SectorState::Occupied, 1.5),
            sector(SectorState::Free, 4.0),
            sector(SectorState::Unknown, 0.0),
        ];
        let view = BirdsEye(ObstacleMap {
            sectors: &sectors,
            points: &[],
            angle_min_rad: -0.6,
            angle_step_rad: 0.4,
            max_range_m: 4.0,
        });
        let at = |angle: f32, range_m: f32| view.color(range_m * angle.cos(), range_m * angle.sin());
        assert_eq!((at(-0.4, 1.2), at(-0.4, 1.5), at(-0.4, 1.8)), (FREE, OCCUPIED, UNSEEN));
        assert_eq!((at(0.0, 3.8), at(0.4, 0.7), at(1.0, 0.7)), (FREE, UNSEEN, BEHIND));
        let image = view.draw();
        assert_eq!(image.dimensions(), (640, 320));
        let pixel = |angle: f32, range_m: f32| {
            let (x, y) = (range_m * angle.cos() * PX_PER_M, range_m * angle.sin() * PX_PER_M);
            *image.get_pixel((320.0 - y) as u32, (320.0 - x) as u32)
        };
        assert_eq!((pixel(-0.4, 1.2), pixel(0.4, 0.7)), (FREE, UNSEEN), "the obstacle is on the right");
    }

    #[test]
    fn a_long_range_is_drawn_smaller_with_rings_farther_apart() {
        let free = |range_m| {
            [ObstacleSector { state: SectorState::Free.into(), range_m, ..ObstacleSector::UNKNOWN }]
        };
        // The range, the size of the image, a distance with a ring and one without.
        for (max_range_m, size, ring_m, no_ring_m) in [
            (5.0, (800, 400), 3.0, 3.5),
            (10.0, (800, 400), 3.0, 3.5),
            (20.0, (800, 400), 15.0, 3.0),
            (50.0, (800, 400), 30.0, 15.0),
        ] {
            let sectors = free(max_range_m);
            let view = BirdsEye(ObstacleMap {
                sectors: &sectors,
                points: &[],
                angle_min_rad: -0.4,
                angle_step_rad: 0.8,
                max_range_m,
            });
            assert_eq!(view.draw().dimensions(), size, "{max_range_m}");
            assert_eq!((view.color(ring_m, 0.0), view.color(no_ring_m, 0.0)), (RING, FREE), "{max_range_m}");
        }
    }

    #[test]
    fn as_text_the_robot_is_below_the_middle_and_only_the_field_of_view_is_shown() {
        let occupied =
            ObstacleSector { state: SectorState::Occupied.into(), range_m: 2.0, ..ObstacleSector::UNKNOWN };
        let free =
            ObstacleSector { state: SectorState::Free.into(), range_m: 4.0, ..ObstacleSector::UNKNOWN };
        let view = BirdsEye(ObstacleMap {
            sectors: &[occupied, free, ObstacleSector::UNKNOWN],
            points: &[],
            angle_min_rad: -0.6,
            angle_step_rad: 0.4,
            max_range_m: 4.0,
        });
        let text = view.text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), BIRDS_EYE_ROWS);
        // At half of the range, from left to right: unknown, free, the obstacle.
        let middle = lines[BIRDS_EYE_ROWS / 2].trim();
        assert!(middle.starts_with('░') && middle.contains("·█"), "{text}");
        assert!(!lines[0].contains('█') && lines[0].contains('·'), "{text}");
    }

    #[test]
    fn points_outside_the_image_are_skipped() {
        let mut image = RgbImage::new(4, 4);
        draw_obstacle_points(
            &mut image,
            [([-1.0, 0.0], 1.0), ([3.0, 3.0], 4.0), ([1e9, f64::NAN], 1.0)],
            4.0,
        );
        assert_eq!((image.get_pixel(0, 0).0, image.get_pixel(3, 3).0), ([255, 55, 0], [255, 220, 0]));
    }
}
