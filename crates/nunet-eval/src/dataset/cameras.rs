//! `intrinsics.csv`: the camera of each image, for datasets of several cameras.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_core::camera::{Camera, Intrinsics};
use serde::Deserialize;

use super::table::rows;
use crate::error::{Cause, EvalError};

/// The file in the dataset's folder.
const FILE: &str = "intrinsics.csv";

/// A row: pixels of an image of this size. Further columns are ignored.
#[derive(Deserialize)]
struct CameraRow {
    id: String,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
}

/// The cameras by the images' ids; none if the dataset has no such file.
pub(super) fn read(root: &Path) -> Result<BTreeMap<String, Camera>, EvalError> {
    let path = root.join(FILE);
    let cameras = rows(&path).and_then(|rows| rows.into_iter().map(camera).collect());
    cameras.map_err(EvalError::read(&path))
}

fn camera(CameraRow { id, fx, fy, cx, cy, width, height }: CameraRow) -> Result<(String, Camera), Cause> {
    let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height);
    let intrinsics = intrinsics.map_err(|error| format!("image `{id}`: {error}"))?;
    Ok((id, Camera::pinhole(intrinsics)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<BTreeMap<String, Camera>, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE), text).unwrap();
        read(folder.path()).map_err(|error| nunet_types::text_with_causes(&error))
    }

    #[test]
    fn each_image_has_its_own_camera() {
        let text = "id,fx,fy,cx,cy,width,height,sensor,scene\na,260,261,160,120,320,240,rendered,s0\n\
                    b,500,500,320,240,640,480,xtion,kitchen\n";
        let cameras = read_text(text).unwrap();
        assert_eq!(
            (cameras.len(), cameras["a"].intrinsics.fy_px, cameras["b"].intrinsics.fx_px),
            (2, 261.0, 500.0)
        );
        assert!(read(tempfile::tempdir().unwrap().path()).unwrap().is_empty());
    }

    #[test]
    fn a_row_that_cannot_be_a_camera_is_named() {
        let head = "id,fx,fy,cx,cy,width,height\n";
        for (text, part) in [
            ("id,fx,fy\na,1,1\n".to_owned(), "cx"),
            (format!("{head}a,1,1,1,far,4,4\n"), "line: 2"),
            (format!("{head}a,-1,1,1,1,4,4\n"), "image `a`"),
        ] {
            let error = read_text(&text).unwrap_err();
            assert!(error.contains("intrinsics.csv") && error.contains(part), "{error}");
        }
    }
}
