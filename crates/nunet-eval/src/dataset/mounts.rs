//! `mounts.csv`: the camera's mount for each image.

use std::collections::BTreeMap;
use std::path::Path;

use nunet_core::camera::Mount;
use serde::Deserialize;

use super::table::{by_id, rows};
use crate::error::{Cause, EvalError};

/// The file in the dataset's folder.
const FILE: &str = "mounts.csv";

/// A row: meters and radians, as in `--mount`.
#[derive(Deserialize)]
struct MountRow {
    id: String,
    x: f64,
    y: f64,
    z: f64,
    roll: f64,
    pitch: f64,
    yaw: f64,
}

/// The camera's mounts by the images' ids.
#[derive(Debug, Default)]
pub(crate) struct ImageMounts(BTreeMap<String, Mount>);

impl ImageMounts {
    /// Reads the mounts of the dataset in `root`. Without any it is an error only if they are required.
    pub(crate) fn read(root: &Path, are_required: bool) -> Result<Self, EvalError> {
        let by_id = read(root)?;
        if are_required && by_id.is_empty() {
            return Err(EvalError::NoMount { path: root.to_owned() });
        }
        Ok(Self(by_id))
    }

    /// The mount for an image; `all` is that of images without a row.
    pub(crate) fn of(&self, id: &str, all: Option<Mount>) -> Result<Mount, EvalError> {
        let mount = self.0.get(id).copied().or(all);
        mount.ok_or_else(|| EvalError::NoMountOfImage { id: id.to_owned() })
    }
}

/// The mounts by the images' ids; none if the dataset has no such file.
fn read(root: &Path) -> Result<BTreeMap<String, Mount>, EvalError> {
    let path = root.join(FILE);
    let mounts = rows(&path).and_then(|rows| by_id(rows.into_iter().map(mount)));
    mounts.map_err(|error| EvalError::Mounts { path, reason: error.to_string() })
}

fn mount(MountRow { id, x, y, z, roll, pitch, yaw }: MountRow) -> Result<(String, Mount), Cause> {
    let mount = Mount::new([x, y, z], [roll, pitch, yaw]);
    Ok((id.clone(), mount.map_err(|error| format!("image `{id}`: {error}"))?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<BTreeMap<String, Mount>, EvalError> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE), text).unwrap();
        read(folder.path())
    }

    #[test]
    fn each_image_has_its_own_mount() {
        let mounts =
            read_text("id,x,y,z,roll,pitch,yaw\na,0,0,0.25,0,-0.07,0\n b , 0, 0, 1.2, 0.1, 0, 0\n").unwrap();
        assert_eq!((mounts.len(), mounts["b"].height_m()), (2, 1.2));
        assert!(read(tempfile::tempdir().unwrap().path()).unwrap().is_empty());
    }

    #[test]
    fn the_mount_of_all_images_is_for_those_without_a_row() {
        let mount = |height_m| Mount::new([0.0, 0.0, height_m], [0.0; 3]).unwrap();
        let mounts = ImageMounts(BTreeMap::from([("a".to_owned(), mount(0.25))]));
        for all in [None, Some(mount(1.0))] {
            assert_eq!(mounts.of("a", all).unwrap(), mount(0.25));
        }
        assert_eq!(mounts.of("b", Some(mount(1.0))).unwrap(), mount(1.0));
        let error = mounts.of("b", None).unwrap_err();
        assert!(matches!(&error, EvalError::NoMountOfImage { id } if id == "b"), "{error}");
    }

    #[test]
    fn a_dataset_without_mounts_is_refused_only_if_they_are_required() {
        let folder = tempfile::tempdir().unwrap();
        assert!(ImageMounts::read(folder.path(), false).unwrap().0.is_empty());
        let error = ImageMounts::read(folder.path(), true).unwrap_err();
        assert!(matches!(&error, EvalError::NoMount { path } if path == folder.path()), "{error}");
    }

    #[test]
    fn a_row_that_cannot_be_a_mount_is_named() {
        for (text, part) in [
            ("id,x,y,z,roll,pitch\na,0,0,1,0,0\n", "yaw"),
            ("id,x,y,z,roll,pitch,yaw\na,0,0,high,0,0,0\n", "line: 2"),
            ("id,x,y,z,roll,pitch,yaw\na,0,0,-1,0,0,0\n", "image `a`: mount: the camera is -1"),
            ("id,x,y,z,roll,pitch,yaw\na,0,0,1,0,0,0\na,0,0,2,0,0,0\n", "`a` twice"),
        ] {
            let error = read_text(text).unwrap_err().to_string();
            assert!(error.contains("mounts.csv") && error.contains(part), "{error}");
        }
    }
}
