//! Renders the camera's view: first the surface and depth of each pixel, then its color.

use super::intrinsics::RoomIntrinsics;

use super::light::LightMap;
use super::path::Pose;
use super::solid::{FACES, Shape, Solid, meet_cuboid, meet_hollow};
use super::vector::Vec3;

/// Nearer surfaces are ignored, meters.
const NEAREST_M: f32 = 0.05;

/// Where the rays of an image go, in the axes of one solid: `base + column * per_column + row * per_row`.
///
/// A ray's length along the optical axis is 1, so that `t` is the depth.
#[derive(Debug, Clone, Copy)]
struct RayBasis {
    origin: Vec3,
    base: Vec3,
    per_column: Vec3,
    per_row: Vec3,
}

impl RayBasis {
    #[inline]
    fn direction(&self, column: usize, row: usize) -> Vec3 {
        self.base + self.per_column * column as f32 + self.per_row * row as f32
    }
}

/// The buffers of an image, made once.
pub(super) struct Renderer {
    width: usize,
    height: usize,
    intrinsics: RoomIntrinsics,
    rays: Vec<RayBasis>,
    depth_m: Vec<f32>,
    /// Number of the solid times [`FACES`] plus the face.
    surfaces: Vec<u16>,
}

impl Renderer {
    pub(super) fn new(intrinsics: RoomIntrinsics, solids: usize) -> Self {
        let (width, height) = (intrinsics.width as usize, intrinsics.height as usize);
        Self {
            width,
            height,
            intrinsics,
            rays: Vec::with_capacity(solids),
            depth_m: vec![0.0; width * height],
            surfaces: vec![0; width * height],
        }
    }

    /// Depth along the optical axis of the last image, meters.
    pub(super) fn depth_m(&self) -> &[f32] {
        &self.depth_m
    }

    /// Finds the nearest surface at each pixel.
    pub(super) fn trace(&mut self, solids: &[Solid], pose: &Pose) {
        self.depth_m.fill(f32::INFINITY);
        self.rays.clear();
        for (number, solid) in solids.iter().enumerate() {
            let rays = self.rays_in(solid, pose);
            self.rays.push(rays);
            let Some(window) = self.window(solid, pose) else {
                continue;
            };
            // A loop per shape, so that there is no branch per pixel.
            match solid.shape {
                Shape::Cuboid { half } => self.meet(window, &rays, number, |o, d| meet_cuboid(half, o, d)),
                Shape::Hollow { half } => self.meet(window, &rays, number, |o, d| meet_hollow(half, o, d)),
                shape => self.meet(window, &rays, number, |o, d| shape.meet(o, d)),
            }
        }
    }

    #[inline]
    fn meet(
        &mut self,
        window: PixelWindow,
        rays: &RayBasis,
        number: usize,
        meet: impl Fn(Vec3, Vec3) -> (f32, u8),
    ) {
        let PixelWindow { columns: (left, right), rows: (top, bottom) } = window;
        for row in top..bottom {
            let pixels = row * self.width + left..row * self.width + right;
            let depths = &mut self.depth_m[pixels.clone()];
            for ((column, depth), surface) in (left..right).zip(depths).zip(&mut self.surfaces[pixels]) {
                let (t, face) = meet(rays.origin, rays.direction(column, row));
                if t < *depth {
                    *depth = t;
                    *surface = (number * FACES) as u16 + u16::from(face);
                }
            }
        }
    }

    /// Writes the color of what [`Renderer::trace`] found, `[height][width][3]`.
    pub(super) fn paint(&self, solids: &[Solid], light: &LightMap, rgb: &mut [u8]) {
        let mut pixels = rgb.as_chunks_mut().0.iter_mut();
        for row in 0..self.height {
            for column in 0..self.width {
                let pixel = row * self.width + column;
                let surface = self.surfaces[pixel] as usize;
                let (solid, face) = (&solids[surface / FACES], (surface % FACES) as u8);
                let rays = &self.rays[surface / FACES];
                let point = rays.origin + rays.direction(column, row) * self.depth_m[pixel];
                let at = solid.shape.chart(face, point);
                let material = solid.faces[face as usize].material;
                let color = material.color(&at);
                let seen = if material.shines() { color } else { lit(color, light.at(surface, &at)) };
                if let Some(out) = pixels.next() {
                    *out = bytes(seen);
                }
            }
        }
    }

    /// Writes the class of what [`Renderer::trace`] found, `[height][width]`.
    pub(super) fn label(&self, solids: &[Solid], labels: &mut [u8]) {
        for (label, surface) in labels.iter_mut().zip(&self.surfaces) {
            let surface = usize::from(*surface);
            *label = solids[surface / FACES].faces[surface % FACES].label;
        }
    }

    fn rays_in(&self, solid: &Solid, pose: &Pose) -> RayBasis {
        let RoomIntrinsics { fx_px, fy_px, cx_px, cy_px, .. } = self.intrinsics;
        let per_column = pose.right * (1.0 / fx_px) as f32;
        let per_row = pose.down * (1.0 / fy_px) as f32;
        let base = pose.forward - per_column * cx_px as f32 - per_row * cy_px as f32;
        RayBasis {
            origin: solid.own_point(pose.position),
            base: solid.own_direction(base),
            per_column: solid.own_direction(per_column),
            per_row: solid.own_direction(per_row),
        }
    }

    /// The pixels that may show a solid: the rectangle around the corners of the cuboid around it.
    fn window(&self, solid: &Solid, pose: &Pose) -> Option<PixelWindow> {
        let whole = PixelWindow { columns: (0, self.width), rows: (0, self.height) };
        if matches!(solid.shape, Shape::Hollow { .. }) {
            return Some(whole);
        }
        let half = solid.shape.half_extent();
        let (mut left, mut right, mut top, mut bottom) = (f32::MAX, f32::MIN, f32::MAX, f32::MIN);
        let mut behind = 0;
        for corner in 0..8u8 {
            let sign = |bit: u8| if corner & bit == 0 { -1.0 } else { 1.0 };
            let p = Vec3::new(half.x * sign(1), half.y * sign(2), half.z * sign(4));
            let p = solid.room_point(p) - pose.position;
            let z = p.dot(pose.forward);
            behind += u8::from(z < NEAREST_M);
            let column = p.dot(pose.right) / z * self.intrinsics.fx_px as f32 + self.intrinsics.cx_px as f32;
            let row = p.dot(pose.down) / z * self.intrinsics.fy_px as f32 + self.intrinsics.cy_px as f32;
            (left, right) = (left.min(column), right.max(column));
            (top, bottom) = (top.min(row), bottom.max(row));
        }
        match behind {
            0 => Some(PixelWindow {
                columns: pixels_between(left, right, self.width),
                rows: pixels_between(top, bottom, self.height),
            }),
            8 => None,
            _ => Some(whole),
        }
    }
}

/// First and one past the last of columns and rows.
#[derive(Clone, Copy)]
struct PixelWindow {
    columns: (usize, usize),
    rows: (usize, usize),
}

/// Conversion from float saturates, so coordinates outside the image are clamped to its border.
fn pixels_between(low: f32, high: f32, side: usize) -> (usize, usize) {
    let end = (high.ceil() as usize).saturating_add(1).min(side);
    ((low.floor() as usize).min(end), end)
}

fn lit(color: Vec3, light: Vec3) -> Vec3 {
    Vec3::new(color.x * light.x, color.y * light.y, color.z * light.z)
}

/// From light to bytes: a gamma of 2, whose square root is the same everywhere.
fn bytes(light: Vec3) -> [u8; 3] {
    [light.x, light.y, light.z].map(|value| (value.sqrt() * 255.0 + 0.5) as u8)
}
