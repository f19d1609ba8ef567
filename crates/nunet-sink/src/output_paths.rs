//! The output files of a run: checked before anything slow, created after everything else that can fail.

use std::path::{Path, PathBuf};

use nunet_files::{FilesError, check_folder, check_writable, make_folder};

use crate::file_plan::place;

/// The output paths of a run.
#[derive(Debug)]
pub struct OutputPaths {
    /// Those of each camera.
    pub cameras: Vec<CameraPaths>,
    /// The file for the stats of all cameras.
    pub stats_json: Option<PathBuf>,
}

/// The output paths of a camera.
#[derive(Debug)]
pub struct CameraPaths {
    /// Its name.
    pub camera: String,
    /// The folder for results.
    pub folder: Option<PathBuf>,
    /// The file that is recorded into.
    pub record: Option<PathBuf>,
}

impl OutputPaths {
    /// Checks that all of it can be written, as far as possible without creating anything.
    ///
    /// # Errors
    /// A path that cannot be written; `in_camera` adds the name of the camera that it belongs to.
    pub fn check<E: From<FilesError>>(&self, in_camera: impl Fn(FilesError, &str) -> E) -> Result<(), E> {
        let file = |file: &Path| if self.waits_for_folder(file) { Ok(()) } else { check_writable(file) };
        self.each(check_folder, file, in_camera)
    }

    /// Creates the folders and checks that the files can be written.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn make<E: From<FilesError>>(&self, in_camera: impl Fn(FilesError, &str) -> E) -> Result<(), E> {
        self.each(make_folder, check_writable, in_camera)
    }

    /// All folders before all files, which often go into them.
    fn each<E: From<FilesError>>(
        &self,
        folder: impl Fn(&Path) -> Result<(), FilesError>,
        file: impl Fn(&Path) -> Result<(), FilesError>,
        in_camera: impl Fn(FilesError, &str) -> E,
    ) -> Result<(), E> {
        for CameraPaths { camera, folder: path, .. } in &self.cameras {
            path.as_deref().map_or(Ok(()), &folder).map_err(|error| in_camera(error, camera))?;
        }
        for CameraPaths { camera, record, .. } in &self.cameras {
            record.as_deref().map_or(Ok(()), &file).map_err(|error| in_camera(error, camera))?;
        }
        Ok(self.stats_json.as_deref().map_or(Ok(()), &file)?)
    }

    /// Whether a file's folder is missing and will be created with the folders of results.
    fn waits_for_folder(&self, file: &Path) -> bool {
        let missing = file.parent().filter(|parent| !parent.as_os_str().is_empty() && !parent.exists());
        missing.map(place).is_some_and(|missing| {
            let mut folders = self.cameras.iter().filter_map(|camera| camera.folder.as_deref());
            folders.any(|folder| place(folder).starts_with(&missing))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Paths of one camera below `folder`; an error is the name of its camera.
    fn paths(folder: &Path, results: &str, record: &str) -> OutputPaths {
        let (results, record) = (Some(folder.join(results)), Some(folder.join(record)));
        let camera = CameraPaths { camera: "front".to_owned(), folder: results, record };
        OutputPaths { cameras: vec![camera], stats_json: None }
    }

    /// The camera whose path is refused.
    #[derive(Debug, PartialEq)]
    struct Refused(String);

    impl From<FilesError> for Refused {
        fn from(_: FilesError) -> Self {
            Self(String::new())
        }
    }

    fn of_camera(_: FilesError, camera: &str) -> Refused {
        Refused(camera.to_owned())
    }

    #[test]
    fn a_recording_may_go_into_a_folder_that_is_created_for_results_and_into_no_other_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let fine = paths(folder.path(), "new/results", "new/a.mcap");
        assert_eq!(fine.check(of_camera), Ok(()));
        assert!(!folder.path().join("new").exists(), "something was created");
        let wrong = paths(folder.path(), "new/results", "other/a.mcap");
        assert_eq!(wrong.check(of_camera), Err(Refused("front".to_owned())));
        assert_eq!(fine.make(of_camera), Ok(()));
        assert!(folder.path().join("new/results").is_dir());
    }
}
