//! How much light falls on each surface, computed once: nothing in the room moves but the camera.

use super::room::{LAMP, LAMP_RADIUS, WINDOW, WINDOW_SIZE};
use super::solid::{FACES, Shape, Solid};
use super::texture::OnFace;
use super::vector::Vec3;

/// Distance between two samples on a surface, meters; light changes slowly.
const SAMPLE_M: f32 = 0.1;
/// Samples lie this far inside a surface's border and in front of it, out of what it touches.
const INSET_M: f32 = 0.004;
/// Corners within this distance darken each other.
const CORNER_M: f32 = 0.9;

/// Red, green, blue.
const DAYLIGHT: Vec3 = Vec3::new(3.3, 3.7, 4.3);
const LAMPLIGHT: Vec3 = Vec3::new(1.25, 1.05, 0.78);
const FROM_CEILING: Vec3 = Vec3::new(0.42, 0.42, 0.43);
const FROM_FLOOR: Vec3 = Vec3::new(0.29, 0.25, 0.21);

/// Light on all surfaces of all solids, sampled on a grid on each.
pub(super) struct LightMap {
    patches: Vec<Patch>,
    samples: Vec<Vec3>,
}

/// The grid of one surface.
#[derive(Clone, Copy)]
struct Patch {
    first: usize,
    columns: usize,
    rows: usize,
    columns_per_m: f32,
    rows_per_m: f32,
}

impl LightMap {
    pub(super) fn new(solids: &[Solid]) -> Self {
        let mut map = Self { patches: Vec::with_capacity(solids.len() * FACES), samples: Vec::new() };
        for solid in solids {
            for face in 0..FACES as u8 {
                let size = solid.shape.face_size(face).unwrap_or((0.0, 0.0));
                map.sample(solids, solid, face, size);
            }
        }
        map
    }

    fn sample(&mut self, solids: &[Solid], solid: &Solid, face: u8, (width, height): (f32, f32)) {
        let patch = Patch {
            first: self.samples.len(),
            columns: (width / SAMPLE_M).ceil() as usize + 2,
            rows: (height / SAMPLE_M).ceil() as usize + 2,
            columns_per_m: ((width / SAMPLE_M).ceil() + 1.0) / width.max(SAMPLE_M),
            rows_per_m: ((height / SAMPLE_M).ceil() + 1.0) / height.max(SAMPLE_M),
        };
        self.patches.push(patch);
        if width == 0.0 || solid.faces[face as usize].material.shines() {
            self.samples.resize(patch.first + patch.columns * patch.rows, Vec3::ZERO);
            return;
        }
        for row in 0..patch.rows {
            for column in 0..patch.columns {
                let u = (column as f32 / patch.columns_per_m).min(width - INSET_M).max(INSET_M);
                let v = (row as f32 / patch.rows_per_m).min(height - INSET_M).max(INSET_M);
                let (point, normal) = solid.shape.point(face, OnFace { u, v });
                let normal = solid.room_direction(normal);
                let point = solid.room_point(point) + normal * INSET_M;
                self.samples.push(light_at(solids, point, normal));
            }
        }
    }

    /// The light at a point of a surface (number of the solid times [`FACES`] plus the face), between its
    /// four nearest samples.
    pub(super) fn at(&self, surface: usize, at: &OnFace) -> Vec3 {
        let patch = &self.patches[surface];
        let (x, y) = ((at.u * patch.columns_per_m).max(0.0), (at.v * patch.rows_per_m).max(0.0));
        let column = (x as usize).min(patch.columns - 2);
        let row = (y as usize).min(patch.rows - 2);
        let (fx, fy) = ((x - column as f32).min(1.0), (y - row as f32).min(1.0));
        let top = &self.samples[patch.first + row * patch.columns + column..][..patch.columns + 2];
        let (a, b, c, d) = (top[0], top[1], top[patch.columns], top[patch.columns + 1]);
        let above = a + (b - a) * fx;
        let below = c + (d - c) * fx;
        above + (below - above) * fy
    }
}

fn light_at(solids: &[Solid], point: Vec3, normal: Vec3) -> Vec3 {
    let skyward = 0.5 - 0.5 * normal.z;
    let around = FROM_CEILING + (FROM_FLOOR - FROM_CEILING) * skyward;
    around * openness(solids, point, normal)
        + daylight(solids, point, normal)
        + lamplight(solids, point, normal)
}

/// The share of directions above the surface that nothing nearby blocks.
fn openness(solids: &[Solid], point: Vec3, normal: Vec3) -> f32 {
    const RING: [(f32, f32); 6] =
        [(1.0, 0.0), (0.5, 0.866), (-0.5, 0.866), (-1.0, 0.0), (-0.5, -0.866), (0.5, -0.866)];
    let aside = if normal.z.abs() < 0.7 { Vec3::new(0.0, 0.0, 1.0) } else { Vec3::new(1.0, 0.0, 0.0) };
    let a = normal.cross(aside).normalized();
    let b = normal.cross(a);
    let directions = RING.into_iter().flat_map(|(x, y)| {
        let aside = a * x + b * y;
        [normal * 0.85 + aside * 0.53, normal * 0.40 + aside * 0.92]
    });
    let open = directions.map(|d| (distance(solids, point, d) / CORNER_M).min(1.0));
    open.sum::<f32>() / (2 * RING.len()) as f32
}

fn daylight(solids: &[Solid], point: Vec3, normal: Vec3) -> Vec3 {
    const PLACES: [(f32, f32); 6] =
        [(-0.3, -0.3), (0.0, -0.3), (0.3, -0.3), (-0.3, 0.3), (0.0, 0.3), (0.3, 0.3)];
    let (width, height) = WINDOW_SIZE;
    let pane = |(across, up): (f32, f32)| WINDOW + Vec3::new(0.06, across * width, up * height);
    let sum: f32 =
        PLACES.into_iter().map(|place| arriving(solids, point, normal, pane(place), |d| -d.x)).sum();
    DAYLIGHT * (sum / PLACES.len() as f32)
}

fn lamplight(solids: &[Solid], point: Vec3, normal: Vec3) -> Vec3 {
    const PLACES: [(f32, f32); 4] = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
    let bulb = |(x, y): (f32, f32)| LAMP + Vec3::new(x, y, -0.4) * (LAMP_RADIUS + 0.02);
    let sum: f32 =
        PLACES.into_iter().map(|place| arriving(solids, point, normal, bulb(place), |_| 1.0)).sum();
    LAMPLIGHT * (sum / PLACES.len() as f32)
}

/// Light from a small source at `source`; `shows` returns its visible share along a direction.
fn arriving(solids: &[Solid], point: Vec3, normal: Vec3, source: Vec3, shows: impl Fn(Vec3) -> f32) -> f32 {
    let to_source = source - point;
    let length = to_source.length();
    let direction = to_source * (1.0 / length);
    let facing = normal.dot(direction) * shows(direction);
    if normal.dot(direction) <= 0.0 || facing <= 0.0 || distance(solids, point, direction) < length {
        return 0.0;
    }
    facing / (length * length + 0.3)
}

/// How far it is to the next surface along a direction of length 1.
fn distance(solids: &[Solid], from: Vec3, direction: Vec3) -> f32 {
    let mut nearest = f32::INFINITY;
    for solid in solids {
        if !may_meet(solid, from, direction) {
            continue;
        }
        let (t, _) = solid.shape.meet(solid.own_point(from), solid.own_direction(direction));
        nearest = nearest.min(t);
    }
    nearest
}

/// Whether the ray comes near the ball around a solid.
fn may_meet(solid: &Solid, from: Vec3, direction: Vec3) -> bool {
    if matches!(solid.shape, Shape::Hollow { .. }) {
        return true;
    }
    let to_center = solid.center - from;
    let along = to_center.dot(direction);
    let extent = solid.shape.half_extent();
    let radius_squared = extent.dot(extent);
    let aside_squared = to_center.dot(to_center) - along * along;
    aside_squared <= radius_squared && (along > 0.0 || to_center.dot(to_center) <= radius_squared)
}
