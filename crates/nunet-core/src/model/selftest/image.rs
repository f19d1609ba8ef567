//! The procedural image.

/// The image `nunet-selftest-1`: `[height][width][3]`, RGB, rows top to bottom. No side may be 0.
///
/// Computed with integers, so that every language draws the same. No symmetry in color, left to right or top
/// to bottom, so that swapped channels or a mirrored image give another answer.
#[must_use]
pub fn image(width: u32, height: u32) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(3 * width as usize * height as usize);
    for y in 0..u64::from(height) {
        for x in 0..u64::from(width) {
            let u = 256 * x / u64::from(width);
            let v = 256 * y / u64::from(height);
            rgb.extend(pixel(u as i32, v as i32).map(|value| value as u8));
        }
    }
    rgb
}

/// The color at (u, v), both 0 to 255.
fn pixel(u: i32, v: i32) -> [i32; 3] {
    let fine = (7 * u + 13 * v + u * v / 32) % 23;
    let in_disc = (u - 140).pow(2) + (v - 180).pow(2) < 28 * 28;
    if in_disc {
        [30 + fine, 150 - u / 4, 40 + v / 4]
    } else if (168..232).contains(&u) && (24..104).contains(&v) {
        [60 + fine, 140 + v / 5, 200 + u / 8]
    } else if (24..92).contains(&u) && (88..208).contains(&v) {
        [170 - v / 4 + fine, 40 + u / 4, 40 + fine]
    } else if v >= 168 {
        let check = ((u + v) / 24 + (v - 168) / 12) % 2;
        [90 + 40 * check + fine, 70 + 30 * check + fine, 50 + 10 * check + v / 8]
    } else {
        [150 - u / 4 + fine, 130 - v / 4 + fine, 100 + u / 8 + fine]
    }
}

#[cfg(test)]
mod tests {
    use sha2::Digest;

    use super::*;

    #[test]
    fn the_image_is_the_documented_one_to_the_byte() {
        let rgb = image(640, 480);
        let first = [150, 130, 100, 150, 130, 100, 150, 130, 100, 157, 137, 107, 157, 137, 107, 164];
        assert_eq!(rgb[..16], first);
        let digest: String =
            { sha2::Sha256::digest(&rgb).iter().map(|byte| format!("{byte:02x}")).collect() };
        assert_eq!(digest, "f13ba5a29ec76e875ed3a4cebc8c294e8be9e184d3485a166b7446ac8cd72536");
    }
}
