//! Point clouds as PLY, which MeshLab, CloudCompare and Open3D read.

use std::io::Write;
use std::path::Path;

use nunet_types::CloudPoint;

use crate::error::FilesError;
use crate::whole::write_result;

/// Writes the points that have a position, in the optical frame; meters where `metric`.
///
/// # Errors
/// The file cannot be written.
pub fn write_cloud(path: &Path, points: &[CloudPoint], metric: bool) -> Result<(), FilesError> {
    write_result(path, |file| Ok(write_to(file, points, metric)?))
}

fn write_to(out: &mut impl Write, points: &[CloudPoint], metric: bool) -> std::io::Result<()> {
    let unit = if metric { "meters" } else { "no unit" };
    let valid = || points.iter().filter(|point| point.z.is_finite());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment optical frame: x right, y down, z forward, {unit}\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty uchar label\nend_header\n",
        valid().count()
    )?;
    for point in valid() {
        for coordinate in [point.x, point.y, point.z] {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        out.write_all(&[point.r, point.g, point.b, point.label])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_valid_points_are_written_and_colors_are_red_green_blue() {
        let valid = CloudPoint { x: 1.0, y: -2.0, z: 3.0, b: 10, g: 20, r: 30, label: 4 };
        let invalid = CloudPoint { x: f32::NAN, y: f32::NAN, z: f32::NAN, b: 1, g: 1, r: 1, label: 1 };
        let mut file = Vec::new();
        write_to(&mut file, &[invalid, valid], true).unwrap();
        let text = String::from_utf8_lossy(&file);
        assert!(text.contains("element vertex 1\n"), "{text}");
        let body = &file[file.len() - 16..];
        let mut expected: Vec<u8> =
            [1.0_f32, -2.0, 3.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        expected.extend([30, 20, 10, 4]);
        assert_eq!(body, expected);
        assert!(file[..file.len() - 16].ends_with(b"end_header\n"));
        assert!(text.contains("z forward, meters\n"), "{text}");
        let mut relative = Vec::new();
        write_to(&mut relative, &[valid], false).unwrap();
        assert!(String::from_utf8_lossy(&relative).contains("z forward, no unit\n"));
    }
}
