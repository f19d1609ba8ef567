//! Textures of surfaces, computed at each point, so that no image files are needed.

use super::noise::{hash, hills, mix, unit};
use super::vector::Vec3;

/// Where a point lies on a surface: meters from the surface's corner.
pub(super) struct OnFace {
    pub(super) u: f32,
    pub(super) v: f32,
}

/// Red, green, blue as x, y, z: the part of the light that comes back, 0 to 1.
pub(super) type Reflectance = Vec3;

const WHITE: Reflectance = Reflectance::new(0.82, 0.81, 0.78);
const DARK: Reflectance = Reflectance::new(0.03, 0.03, 0.04);

/// The texture of a surface; lengths in meters.
#[derive(Debug, Clone, Copy)]
pub(super) enum Material {
    /// One color.
    Paint(Reflectance),
    /// A wall's: one color in soft clouds.
    Plaster(Reflectance),
    /// A floor's boards.
    Boards(Reflectance),
    /// Grained along u.
    Wood(Reflectance),
    Fabric(Reflectance),
    /// Two colors by turns along u.
    Stripes(Reflectance, Reflectance),
    Leaves,
    /// Spines side by side, up to `height`.
    Books {
        height: f32,
        seed: u32,
    },
    /// A landscape in a frame.
    Painting {
        width: f32,
        height: f32,
        seed: u32,
    },
    /// A television that is off.
    Screen {
        width: f32,
        height: f32,
    },
    /// The sky behind bars; shines by itself.
    Window {
        width: f32,
        height: f32,
    },
    /// Shines by itself.
    Glow(Reflectance),
}

impl Material {
    /// Whether the color is the light itself, whatever falls on it.
    pub(super) fn shines(self) -> bool {
        matches!(self, Self::Window { .. } | Self::Glow(_))
    }

    /// The color at a point of a surface.
    pub(super) fn color(self, at: &OnFace) -> Reflectance {
        let OnFace { u, v } = *at;
        match self {
            Self::Paint(color) | Self::Glow(color) => color,
            Self::Plaster(color) => color * mix(0.93, 1.0, hills(u * 3.0, v * 3.0, 11)),
            Self::Boards(color) => boards(color, u, v),
            Self::Wood(color) => color * mix(0.75, 1.1, hills(u * 2.5, v * 34.0, 12)),
            Self::Fabric(color) => color * mix(0.84, 1.08, hills(u * 45.0, v * 45.0, 13)),
            Self::Stripes(one, other) => stripes(one, other, u, v),
            Self::Leaves => Reflectance::new(0.07, 0.24, 0.06) * mix(0.4, 1.6, hills(u * 24.0, v * 24.0, 14)),
            Self::Books { height, seed } => books(height, seed, u, v),
            Self::Painting { width, height, seed } => painting(u / width, v / height, seed),
            Self::Screen { width, height } => screen(u / width, v / height),
            Self::Window { width, height } => window(u, v, width, height),
        }
    }
}

fn boards(color: Reflectance, u: f32, v: f32) -> Reflectance {
    const WIDTH: f32 = 0.14;
    const LENGTH: f32 = 1.3;
    let row = (v / WIDTH) as i32;
    let along = u / LENGTH + unit(row as u32, 21) * 7.0;
    let board = along as i32;
    let (across_seam, along_seam) = (v / WIDTH - row as f32, along - board as f32);
    let tone = mix(0.72, 1.08, unit(row as u32, board as u32));
    let grain = mix(0.85, 1.1, hills(u * 3.0, v * 60.0, 22));
    let seam = if across_seam < 0.03 || along_seam < 0.004 { 0.55 } else { 1.0 };
    color * (tone * grain * seam)
}

fn stripes(one: Reflectance, other: Reflectance, u: f32, v: f32) -> Reflectance {
    let first = (u * 5.0) as i32 % 2 == 0;
    let color = if first { one } else { other };
    color * mix(0.85, 1.05, hills(u * 60.0, v * 60.0, 23))
}

fn books(height: f32, seed: u32, u: f32, v: f32) -> Reflectance {
    const WIDTH: f32 = 0.036;
    let book = (u / WIDTH) as i32;
    let across = u / WIDTH - book as f32;
    let top = height * mix(0.7, 1.0, unit(book as u32, seed));
    if v > top || !(0.06..0.94).contains(&across) {
        return DARK;
    }
    let cover = match hash(book as u32, seed ^ 31) % 6 {
        0 => Reflectance::new(0.42, 0.05, 0.05),
        1 => Reflectance::new(0.05, 0.13, 0.34),
        2 => Reflectance::new(0.09, 0.26, 0.12),
        3 => Reflectance::new(0.55, 0.40, 0.10),
        4 => Reflectance::new(0.55, 0.50, 0.42),
        _ => Reflectance::new(0.22, 0.10, 0.28),
    };
    let title = (0.6..0.8).contains(&(v / top));
    if title { mix_color(cover, WHITE, 0.6) } else { cover }
}

fn painting(u: f32, v: f32, seed: u32) -> Reflectance {
    const FRAME: f32 = 0.06;
    if u.min(v) < FRAME || u.max(v) > 1.0 - FRAME {
        return Reflectance::new(0.13, 0.07, 0.03);
    }
    let (sun_u, sun_v) = (mix(0.6, 0.8, unit(seed, 41)), 0.72);
    let ridge = 0.25 + 0.35 * hills(u * 4.0, 0.0, seed);
    let shore = 0.12 + 0.2 * hills(u * 6.0, 5.0, seed);
    if v < shore {
        Reflectance::new(0.10, 0.22, 0.08)
    } else if v < ridge {
        Reflectance::new(0.20, 0.22, 0.40)
    } else if (u - sun_u) * (u - sun_u) + (v - sun_v) * (v - sun_v) < 0.006 {
        Reflectance::new(0.95, 0.75, 0.25)
    } else {
        mix_color(Reflectance::new(0.85, 0.45, 0.22), Reflectance::new(0.25, 0.35, 0.62), v)
    }
}

fn screen(u: f32, v: f32) -> Reflectance {
    let bezel = u.min(v) < 0.025 || u.max(v) > 0.975;
    // The window's reflection, a slanted band.
    let shine = (1.0 - (u + 0.4 * v - 0.45).abs() * 5.0).max(0.0);
    if bezel { DARK } else { mix_color(DARK, Reflectance::new(0.10, 0.12, 0.16), 0.2 + 0.8 * shine) }
}

fn window(u: f32, v: f32, width: f32, height: f32) -> Reflectance {
    const BAR: f32 = 0.06;
    let from_edge = u.min(width - u).min(v).min(height - v);
    let from_middle = (u - width / 2.0).abs().min((v - height * 0.62).abs());
    if from_edge < BAR || from_middle < BAR / 2.0 {
        return Reflectance::new(0.62, 0.62, 0.60);
    }
    let up = v / height;
    let trees = 0.22 + 0.16 * hills(u * 5.0, 0.0, 51) + 0.05 * hills(u * 25.0, 0.0, 52);
    if up < trees {
        Reflectance::new(0.16, 0.30, 0.12) * mix(0.6, 1.3, hills(u * 30.0, v * 30.0, 53))
    } else {
        mix_color(Reflectance::new(0.92, 0.95, 0.98), Reflectance::new(0.40, 0.64, 0.95), up)
    }
}

fn mix_color(a: Reflectance, b: Reflectance, t: f32) -> Reflectance {
    a + (b - a) * t
}
