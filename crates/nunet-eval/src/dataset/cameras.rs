//! The cameras that a dataset states: `camera.json` for all images, `intrinsics.csv` for each image.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_core::camera::{Camera, Intrinsics};
use nunet_core::plain_file;
use nunet_source::CameraFile;
use nunet_types::counted;
use serde::Deserialize;

use super::table::{by_id, rows};
use crate::error::{Cause, EvalError};
use crate::event::{Event, OnEvent};

/// The file for each image, in the dataset's folder.
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

/// The camera of all images, as rendered clips state it.
pub(super) fn of_all(root: &Path) -> Result<Option<Camera>, EvalError> {
    let path = root.join("camera.json");
    if !path.is_file() {
        return Ok(None);
    }
    let text = plain_file::read_text(&path, CameraFile::MAX_BYTES).map_err(EvalError::read(&path))?;
    let file: CameraFile = serde_json::from_str(&text).map_err(EvalError::read(&path))?;
    Ok(Some(file.camera().map_err(EvalError::read(&path))?))
}

/// The cameras by the images' ids; none if the dataset has no such file.
pub(super) fn read(root: &Path) -> Result<BTreeMap<String, Camera>, EvalError> {
    let path = root.join(FILE);
    let cameras = rows(&path).and_then(|rows| by_id(rows.into_iter().map(camera)));
    cameras.map_err(EvalError::read(&path))
}

/// Warns of images without a row in a file that the dataset has: without a camera, the meters may be wrong.
pub(super) fn report_missing(cameras: &BTreeMap<String, Camera>, ids: &[String], on_event: OnEvent<'_>) {
    let mut missing = ids.iter().filter(|id| !cameras.contains_key(*id));
    let Some(first) = missing.next().filter(|_| !cameras.is_empty()) else { return };
    let (count, all) = (1 + missing.count(), ids.len());
    on_event(Event::Warning(&format!(
        "no row in `{FILE}` for {count} of {}, such as `{first:.60}`: the camera is unknown",
        counted(all, "image")
    )));
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
    fn images_without_a_row_are_counted_and_one_is_named() {
        let cameras = read_text("id,fx,fy,cx,cy,width,height\na.png,2,2,1,1,4,4\nb,2,2,1,1,4,4\n").unwrap();
        let ids = ["a", "b"].map(str::to_owned);
        let mut warnings = Vec::new();
        report_missing(&cameras, &ids, &mut |event| warnings.push(format!("{event:?}")));
        report_missing(&BTreeMap::new(), &ids, &mut |event| warnings.push(format!("{event:?}")));
        report_missing(&cameras, &ids[1..], &mut |event| warnings.push(format!("{event:?}")));
        let expected = "no row in `intrinsics.csv` for 1 of 2 images, such as `a`";
        assert!(warnings.len() == 1 && warnings[0].contains(expected), "{warnings:?}");
    }

    #[test]
    fn a_row_that_cannot_be_a_camera_is_named() {
        let head = "id,fx,fy,cx,cy,width,height\n";
        for (text, part) in [
            ("id,fx,fy\na,1,1\n".to_owned(), "cx"),
            (format!("{head}a,1,1,1,far,4,4\n"), "line: 2"),
            (format!("{head}a,-1,1,1,1,4,4\n"), "image `a`"),
            (format!("{head}a,2,2,1,1,4,4\na,4,4,1,1,4,4\n"), "`a` twice"),
        ] {
            let error = read_text(&text).unwrap_err();
            assert!(error.contains("intrinsics.csv") && error.contains(part), "{error}");
        }
    }
}
