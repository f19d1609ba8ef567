//! `mounts.csv`: the camera's mount for each image.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use nunet_core::camera::{Mount, MountDoubt, MountError};
use nunet_types::Hint as _;
use serde::Deserialize;

use super::table::{by_id, parsed_rows};
use crate::error::{Cause, EvalError};
use crate::event::{Event, OnEvent};
use crate::text_file::read_list;

/// The file in the dataset's folder.
const FILE: &str = "mounts.csv";
/// How to write it.
const COLUMNS_HINT: &str = "write the columns `id,x,y,z,roll,pitch,yaw` (meters, radians), separated by \
     commas, and a row for each image";

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

impl MountRow {
    fn mount(&self) -> Result<Mount, MountError> {
        Mount::new([self.x, self.y, self.z], [self.roll, self.pitch, self.yaw])
    }
}

/// The camera's mounts by the images' ids.
#[derive(Debug, Default)]
pub(crate) struct ImageMounts(BTreeMap<String, Mount>);

impl ImageMounts {
    /// Reads the mounts of the dataset in `root`. Without any it is an error only if they are required.
    pub(crate) fn read(root: &Path, are_required: bool) -> Result<Self, EvalError> {
        let (by_id, path) = (read(root)?, root.join(FILE));
        if !are_required || !by_id.is_empty() {
            return Ok(Self(by_id));
        }
        if !path.exists() {
            return Err(EvalError::NoMount { path: root.to_owned() });
        }
        let reason = "it has no rows, expected one for each image".to_owned();
        Err(EvalError::Mounts { path, reason, hint: Some(COLUMNS_HINT.into()) })
    }

    /// Reports the first mount that is possible, but probably a mistake.
    pub(crate) fn report_doubt(&self, on_event: OnEvent<'_>) {
        let doubt = |(id, mount): (_, &Mount)| Some((id, MountDoubt::of(mount.roll_pitch_yaw_rad())?));
        if let Some((id, doubt)) = self.0.iter().find_map(doubt) {
            let text = format!("`{FILE}`: image `{id}`: {doubt}");
            on_event(Event::WrongMount { text: &text, hint: &doubt.hint().unwrap_or_default() });
        }
    }

    /// The mount for an image; `all` is that of images without a row.
    pub(crate) fn of(&self, id: &str, all: Option<Mount>) -> Result<Mount, EvalError> {
        let mount = self.0.get(id).copied().or(all);
        mount.ok_or_else(|| {
            let other = self.0.keys().next().cloned().unwrap_or_default();
            EvalError::NoMountOfImage { id: id.to_owned(), other }
        })
    }
}

/// The mounts by the images' ids; none if the dataset has no such file.
fn read(root: &Path) -> Result<BTreeMap<String, Mount>, EvalError> {
    let path = root.join(FILE);
    let wrong = |reason: String, hint| EvalError::Mounts { path: path.clone(), reason, hint };
    let no_table = |error: Cause| wrong(error.to_string(), Some(Cow::Borrowed(COLUMNS_HINT)));
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let text = read_list(&path).map_err(|error| wrong(error.to_string(), None))?;
    let table: Vec<MountRow> = parsed_rows(&text).map_err(no_table)?;
    let mount = |row: MountRow| match row.mount() {
        Ok(mount) => Ok((row.id, mount)),
        Err(error) => Err(wrong(format!("image `{:.60}`: {error}", row.id), error.hint())),
    };
    let mounts = table.into_iter().map(mount).collect::<Result<Vec<_>, EvalError>>()?;
    let twice = |error: Cause| wrong(error.to_string(), Some("keep one row for each image".into()));
    by_id(mounts.into_iter().map(Ok)).map_err(twice)
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
        assert!(
            matches!(&error, EvalError::NoMountOfImage { id, other } if id == "b" && other == "a"),
            "{error}"
        );
        assert!(error.hint().is_some());
    }

    #[test]
    fn the_first_row_whose_angles_are_probably_degrees_is_reported() {
        let mut reported = Vec::new();
        for (rows, count) in
            [("a,0,0,1,0,-0.07,0\n", 0), ("a,0,0,1,0,0,0\nb,0,0,1,0,-4,0\nc,0,0,1,4,0,0\n", 1)]
        {
            let mounts = ImageMounts(read_text(&format!("id,x,y,z,roll,pitch,yaw\n{rows}")).unwrap());
            mounts.report_doubt(&mut |event| {
                if let Event::WrongMount { text, hint } = event {
                    reported.push((text.to_owned(), hint.to_owned()));
                }
            });
            assert_eq!(reported.len(), count, "{rows}");
        }
        let (text, hint) = &reported[0];
        assert!(text.contains("image `b`: mount: pitch is -4 rad") && hint.contains("radians"), "{text}");
    }

    #[test]
    fn a_dataset_without_mounts_is_refused_only_if_they_are_required() {
        let folder = tempfile::tempdir().unwrap();
        assert!(ImageMounts::read(folder.path(), false).unwrap().0.is_empty());
        let error = ImageMounts::read(folder.path(), true).unwrap_err();
        assert!(matches!(&error, EvalError::NoMount { path } if path == folder.path()), "{error}");
    }

    #[test]
    fn a_file_without_rows_is_no_missing_file() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "id,x,y,z,roll,pitch,yaw\n"] {
            std::fs::write(folder.path().join(FILE), text).unwrap();
            assert!(ImageMounts::read(folder.path(), false).unwrap().0.is_empty());
            let error = ImageMounts::read(folder.path(), true).unwrap_err();
            assert!(
                matches!(&error, EvalError::Mounts { reason, .. } if reason.contains("no rows")),
                "{error}"
            );
            assert!(error.hint().unwrap().contains("id,x,y,z,roll,pitch,yaw"));
        }
    }

    #[test]
    fn columns_that_are_not_separated_by_commas_are_named() {
        for (separator, name) in [(";", "semicolons"), ("\t", "tabs")] {
            let text = "id,x,y,z,roll,pitch,yaw\na,0,0,1,0,0,0\n".replace(',', separator);
            let error = read_text(&text).unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
            assert!(error.hint().unwrap().contains("commas"), "{error}");
        }
        assert_eq!(read_text("id,\tx,y,z,roll,pitch,yaw,a;b\na,0,0,1,0,0,0,\n").unwrap().len(), 1);
    }

    #[test]
    fn an_angle_in_degrees_has_the_hint_of_mounts() {
        let error = read_text("id,x,y,z,roll,pitch,yaw\na,0,0,1,0,180,0\n").unwrap_err();
        assert!(error.to_string().contains("image `a`"), "{error}");
        assert!(error.hint().unwrap().contains("radians"), "{:?}", error.hint());
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
