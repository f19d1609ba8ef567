//! The output files of a run: checked before anything slow, created after everything else that can fail.

use std::path::{Path, PathBuf};

use nunet_files::{check_folder, check_writable, make_folder};
use nunet_sink::file_plan::place;

use super::camera::PreparedCamera;
use crate::exit::in_camera;

/// The output paths of a run.
pub(super) struct OutputPaths {
    cameras: Vec<CameraOutputs>,
    stats_json: Option<PathBuf>,
}

struct CameraOutputs {
    name: String,
    folder: Option<PathBuf>,
    record: Option<PathBuf>,
}

impl OutputPaths {
    pub(super) fn of(cameras: &[PreparedCamera<'_>], stats_json: Option<&Path>) -> Self {
        let camera = |PreparedCamera { plan, .. }: &PreparedCamera<'_>| CameraOutputs {
            name: plan.config.name.to_string(),
            folder: plan.config.out.clone(),
            record: plan.record.clone(),
        };
        Self { cameras: cameras.iter().map(camera).collect(), stats_json: stats_json.map(Path::to_owned) }
    }

    /// Checks that all of it can be written, as far as possible without creating anything.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        self.each(
            |folder| Ok(check_folder(folder)?),
            |file| if self.waits_for_folder(file) { Ok(()) } else { Ok(check_writable(file)?) },
        )
    }

    /// Creates the folders and checks that the files can be written.
    pub(super) fn make(&self) -> anyhow::Result<()> {
        self.each(|folder| Ok(make_folder(folder)?), |file| Ok(check_writable(file)?))
    }

    /// All folders before all files, which often go into them.
    fn each(
        &self,
        folder: impl Fn(&Path) -> anyhow::Result<()>,
        file: impl Fn(&Path) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let several = self.cameras.len() > 1;
        let of_camera =
            |path: &Option<PathBuf>, camera: &CameraOutputs, action: &dyn Fn(&Path) -> anyhow::Result<()>| {
                let done = path.as_deref().map_or(Ok(()), action);
                done.map_err(|error| in_camera(error, &camera.name, several))
            };
        self.cameras.iter().try_for_each(|camera| of_camera(&camera.folder, camera, &folder))?;
        self.cameras.iter().try_for_each(|camera| of_camera(&camera.record, camera, &file))?;
        self.stats_json.as_deref().map_or(Ok(()), file)
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
