//! The shapes that the room is made of: where a ray meets them, and where on their surface a point lies.

use super::texture::{Material, OnFace};
use super::vector::Vec3;

/// Surfaces of one solid; curved ones use fewer.
pub(super) const FACES: usize = 6;

/// A shape about its own origin, z up.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// From `-half` to `half`.
    Cuboid {
        half: Vec3,
    },
    /// The same seen from within: the room itself.
    Hollow {
        half: Vec3,
    },
    /// Upright, from `-half_height` to `half_height`.
    Cylinder {
        radius: f32,
        half_height: f32,
    },
    Ball {
        radius: f32,
    },
}

/// What a surface is and looks like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Finish {
    pub(super) label: u8,
    pub(super) material: Material,
}

/// A shape in its place.
#[derive(Debug, Clone)]
pub(super) struct Solid {
    pub(super) shape: Shape,
    pub(super) center: Vec3,
    /// Cosine and sine of the turn about the upright axis.
    pub(super) turn: (f32, f32),
    pub(super) faces: [Finish; FACES],
}

impl Solid {
    /// A direction of the room in the solid's own axes.
    pub(super) fn own_direction(&self, d: Vec3) -> Vec3 {
        let (cos, sin) = self.turn;
        Vec3::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x, d.z)
    }

    /// A point of the room in the solid's own axes.
    pub(super) fn own_point(&self, p: Vec3) -> Vec3 {
        self.own_direction(p - self.center)
    }

    /// A direction in the solid's own axes in the room's.
    pub(super) fn room_direction(&self, d: Vec3) -> Vec3 {
        let (cos, sin) = self.turn;
        Vec3::new(cos * d.x - sin * d.y, cos * d.y + sin * d.x, d.z)
    }

    /// A point in the solid's own axes in the room's.
    pub(super) fn room_point(&self, p: Vec3) -> Vec3 {
        self.room_direction(p) + self.center
    }
}

impl Shape {
    /// Half the sides of the cuboid around the shape.
    pub(super) fn half_extent(self) -> Vec3 {
        match self {
            Self::Cuboid { half } | Self::Hollow { half } => half,
            Self::Cylinder { radius, half_height } => Vec3::new(radius, radius, half_height),
            Self::Ball { radius } => Vec3::new(radius, radius, radius),
        }
    }

    /// Where the ray `o + t * d` first meets the shape from its visible side: t and the face; infinity where
    /// it does not.
    pub(super) fn meet(self, o: Vec3, d: Vec3) -> (f32, u8) {
        match self {
            Self::Cuboid { half } => meet_cuboid(half, o, d),
            Self::Hollow { half } => meet_hollow(half, o, d),
            Self::Cylinder { radius, half_height } => meet_cylinder(radius, half_height, o, d),
            Self::Ball { radius } => (meet_round(d.dot(d), o.dot(d), o.dot(o) - radius * radius), 0),
        }
    }

    /// Where the point `p` of surface `face` lies on it.
    pub(super) fn chart(self, face: u8, p: Vec3) -> OnFace {
        match self {
            Self::Cuboid { half } | Self::Hollow { half } => match face / 2 {
                0 => OnFace { u: p.y + half.y, v: p.z + half.z },
                1 => OnFace { u: p.x + half.x, v: p.z + half.z },
                _ => OnFace { u: p.x + half.x, v: p.y + half.y },
            },
            Self::Cylinder { radius, half_height } if face == 0 => {
                OnFace { u: turns_from_direction(p.x, p.y) * circumference(radius), v: p.z + half_height }
            }
            Self::Cylinder { radius, .. } => OnFace { u: p.x + radius, v: p.y + radius },
            Self::Ball { radius } => {
                OnFace { u: turns_from_direction(p.x, p.y) * circumference(radius), v: p.z + radius }
            }
        }
    }

    /// The lengths of surface `face` along u and v, meters; None where the shape has no such surface.
    pub(super) fn face_size(self, face: u8) -> Option<(f32, f32)> {
        match (self, face) {
            (Self::Cuboid { half } | Self::Hollow { half }, _) => Some(match face / 2 {
                0 => (2.0 * half.y, 2.0 * half.z),
                1 => (2.0 * half.x, 2.0 * half.z),
                _ => (2.0 * half.x, 2.0 * half.y),
            }),
            (Self::Cylinder { radius, half_height }, 0) => Some((circumference(radius), 2.0 * half_height)),
            (Self::Cylinder { radius, .. }, 1 | 2) => Some((2.0 * radius, 2.0 * radius)),
            (Self::Ball { radius }, 0) => Some((circumference(radius), 2.0 * radius)),
            _ => None,
        }
    }

    /// The point at `(u, v)` of surface `face` and the direction away from the visible side: [`Shape::chart`]
    /// undone.
    pub(super) fn point(self, face: u8, at: OnFace) -> (Vec3, Vec3) {
        let OnFace { u, v } = at;
        let side = if face.is_multiple_of(2) { -1.0 } else { 1.0 };
        match self {
            Self::Cuboid { half } | Self::Hollow { half } => {
                let outwards = if matches!(self, Self::Hollow { .. }) { -side } else { side };
                match face / 2 {
                    0 => (Vec3::new(side * half.x, u - half.y, v - half.z), Vec3::new(outwards, 0.0, 0.0)),
                    1 => (Vec3::new(u - half.x, side * half.y, v - half.z), Vec3::new(0.0, outwards, 0.0)),
                    _ => (Vec3::new(u - half.x, v - half.y, side * half.z), Vec3::new(0.0, 0.0, outwards)),
                }
            }
            Self::Cylinder { radius, half_height } if face == 0 => {
                let (x, y) = direction_from_turns(u / circumference(radius));
                (Vec3::new(x * radius, y * radius, v - half_height), Vec3::new(x, y, 0.0))
            }
            Self::Cylinder { radius, half_height } => {
                (Vec3::new(u - radius, v - radius, side * half_height), Vec3::new(0.0, 0.0, side))
            }
            Self::Ball { radius } => {
                let (x, y) = direction_from_turns(u / circumference(radius));
                let z = v - radius;
                let ring = (radius * radius - z * z).max(0.0).sqrt();
                let p = Vec3::new(x * ring, y * ring, z);
                (p, p * (1.0 / radius))
            }
        }
    }
}

#[inline]
pub(super) fn meet_cuboid(half: Vec3, o: Vec3, d: Vec3) -> (f32, u8) {
    let (x_in, x_out) = slab(half.x, o.x, d.x);
    let (y_in, y_out) = slab(half.y, o.y, d.y);
    let (z_in, z_out) = slab(half.z, o.z, d.z);
    let t_in = x_in.max(y_in).max(z_in);
    let t_out = x_out.min(y_out).min(z_out);
    if t_in > t_out || t_in <= 0.0 {
        return (f32::INFINITY, 0);
    }
    let (axis, along) = if t_in == x_in {
        (0, d.x)
    } else if t_in == y_in {
        (2, d.y)
    } else {
        (4, d.z)
    };
    (t_in, axis + u8::from(along < 0.0))
}

/// Where a ray enters and leaves the space between two parallel planes.
#[inline]
fn slab(half: f32, o: f32, d: f32) -> (f32, f32) {
    let inverse = 1.0 / d;
    let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
    (a.min(b), a.max(b))
}

#[inline]
pub(super) fn meet_hollow(half: Vec3, o: Vec3, d: Vec3) -> (f32, u8) {
    let leave = |half: f32, o: f32, d: f32| (half.copysign(d) - o) / d;
    let (x, y, z) = (leave(half.x, o.x, d.x), leave(half.y, o.y, d.y), leave(half.z, o.z, d.z));
    let (t, axis, along) = if x < y { (x, 0, d.x) } else { (y, 2, d.y) };
    let (t, axis, along) = if t < z { (t, axis, along) } else { (z, 4, d.z) };
    (t, axis + u8::from(along > 0.0))
}

fn meet_cylinder(radius: f32, half_height: f32, o: Vec3, d: Vec3) -> (f32, u8) {
    let cap = half_height.copysign(-d.z);
    let t = (cap - o.z) / d.z;
    let (x, y) = (o.x + t * d.x, o.y + t * d.y);
    if t > 0.0 && x * x + y * y <= radius * radius {
        return (t, 1 + u8::from(cap < 0.0));
    }
    let t = meet_round(d.x * d.x + d.y * d.y, o.x * d.x + o.y * d.y, o.x * o.x + o.y * o.y - radius * radius);
    if (o.z + t * d.z).abs() <= half_height { (t, 0) } else { (f32::INFINITY, 0) }
}

/// The smaller root of `a t^2 + 2 b t + c`, if there is one in front; infinity else.
fn meet_round(a: f32, b: f32, c: f32) -> f32 {
    let root = b * b - a * c;
    let t = (-b - root.max(0.0).sqrt()) / a;
    if root > 0.0 && t > 0.0 { t } else { f32::INFINITY }
}

fn circumference(radius: f32) -> f32 {
    std::f32::consts::TAU * radius
}

/// 0 to 1 once around, measured along a diamond instead of a circle: no arctangent, which differs between
/// machines.
fn turns_from_direction(x: f32, y: f32) -> f32 {
    let along = y / (x.abs() + y.abs()).max(f32::MIN_POSITIVE);
    let quarters = if x < 0.0 {
        2.0 - along
    } else if along < 0.0 {
        4.0 + along
    } else {
        along
    };
    quarters * 0.25
}

/// [`turns_from_direction`] undone, with length 1.
fn direction_from_turns(turns: f32) -> (f32, f32) {
    let quarters = turns * 4.0;
    let y = 1.0 - (quarters - 1.0).abs();
    let y = if quarters > 3.0 { quarters - 4.0 } else { y };
    let x = (1.0 - y.abs()).copysign(if (1.0..3.0).contains(&quarters) { -1.0 } else { 1.0 });
    let length = (x * x + y * y).sqrt();
    (x / length, y / length)
}
