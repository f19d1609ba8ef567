//! Randomness that is a function of its arguments: the same on every machine, at every call.

/// 32 bits that look random for each pair of numbers.
#[inline]
pub(super) fn hash(a: u32, b: u32) -> u32 {
    // Half of MurmurHash3's finaliser over a mix of both: cheap enough for each pixel, and without visible
    // patterns.
    let mix = a.wrapping_mul(0x9E37_79B1) ^ b.wrapping_mul(0x85EB_CA77).rotate_left(15);
    let mix = (mix ^ (mix >> 15)).wrapping_mul(0x2C1B_3C6D);
    mix ^ (mix >> 13)
}

/// 0 to 1 for each pair of numbers.
#[inline]
pub(super) fn unit(a: u32, b: u32) -> f32 {
    (hash(a, b) >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Smooth hills between 0 and 1, one to each unit of `u` and `v`, which are not negative.
#[inline]
pub(super) fn hills(u: f32, v: f32, seed: u32) -> f32 {
    // By way of i32: the conversion that processors have.
    let (left, bottom) = (u as i32, v as i32);
    let (fu, fv) = (smooth(u - left as f32), smooth(v - bottom as f32));
    let (column, row) = (left as u32, bottom as u32);
    let corner = |x: u32, y: u32| unit(column.wrapping_add(x) ^ seed, row.wrapping_add(y));
    let below = mix(corner(0, 0), corner(1, 0), fu);
    let above = mix(corner(0, 1), corner(1, 1), fu);
    mix(below, above, fv)
}

/// From `a` at 0 to `b` at 1.
pub(super) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}
