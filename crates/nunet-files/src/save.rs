//! The results of one frame as a folder of files.

use std::path::{Path, PathBuf};

use crate::color::depth_image;
use crate::error::FilesError;
use crate::folder::make_folder;
use crate::npy::write_npy;
use crate::ply::write_cloud;
use crate::png::{write_depth_mm, write_gray, write_rgb};
use crate::results::ResultArrays;

/// The names of the files that [`write_results`] writes, all or some of them.
pub const RESULT_FILES: [&str; 6] =
    ["depth.npy", "depth_mm.png", "depth.png", "labels.png", "confidence.png", "cloud.ply"];

/// Writes the results into `folder`, which is created if it is missing, and returns the paths of the files.
///
/// `depth_mm.png` is written only if depth is in meters: other numbers would be mistaken for millimeters.
///
/// # Errors
/// The folder or a file cannot be written.
pub fn write_results(folder: &Path, results: &ResultArrays<'_>) -> Result<Vec<PathBuf>, FilesError> {
    make_folder(folder)?;
    let &ResultArrays { size, depth, metric, labels, confidence, cloud } = results;
    let mut files = Vec::new();
    let mut write = |name: &str, write: &dyn Fn(&Path) -> Result<(), FilesError>| {
        files.push(folder.join(name));
        write(&folder.join(name))
    };
    write("depth.npy", &|path| write_npy(path, depth, size))?;
    if metric {
        write("depth_mm.png", &|path| write_depth_mm(path, depth, size))?;
    }
    write("depth.png", &|path| write_rgb(path, depth_image(results)))?;
    for (name, values) in [("labels.png", labels), ("confidence.png", confidence)] {
        if let Some(values) = values {
            write(name, &|path| write_gray(path, values.to_vec(), size))?;
        }
    }
    if let Some(cloud) = cloud {
        write("cloud.ply", &|path| write_cloud(path, cloud, metric))?;
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use nunet_types::{CloudPoint, ImageSize};

    use super::*;

    fn results<'a>(depth: &'a [f32], metric: bool, cloud: &'a [CloudPoint]) -> ResultArrays<'a> {
        let size = ImageSize::new(2, 1);
        ResultArrays { size, depth, metric, labels: None, confidence: None, cloud: Some(cloud) }
    }

    #[test]
    fn labels_and_confidence_are_gray_images_of_their_values() {
        let root = tempfile::tempdir().unwrap();
        let (labels, confidence) = (Some(&[3, 12][..]), Some(&[0, 255][..]));
        let files = write_results(
            root.path(),
            &ResultArrays { labels, confidence, ..results(&[1.0, 2.0], true, &[]) },
        );
        assert_eq!(files.unwrap().len(), 6);
        for (name, expected) in [("labels.png", [3, 12]), ("confidence.png", [0, 255])] {
            assert_eq!(image::open(root.path().join(name)).unwrap().into_luma8().into_raw(), expected);
        }
    }

    #[test]
    fn the_files_that_are_returned_are_those_that_were_written() {
        let root = tempfile::tempdir().unwrap();
        for (metric, expected) in [(true, 4), (false, 3)] {
            let folder = root.path().join(metric.to_string());
            let files =
                write_results(&folder, &results(&[1.0, 2.0], metric, &[CloudPoint::NONE; 2])).unwrap();
            assert!(files.iter().all(|file| file.is_file()), "{files:?}");
            assert_eq!((files.len(), folder.read_dir().unwrap().count()), (expected, expected));
            assert_eq!(folder.join("depth_mm.png").exists(), metric);
            let is_known = |file: &PathBuf| RESULT_FILES.iter().any(|name| *file == folder.join(name));
            assert!(files.iter().all(is_known), "{files:?}");
        }
    }

    #[test]
    fn depth_of_another_size_is_an_error_that_names_the_file() {
        let root = tempfile::tempdir().unwrap();
        let error = write_results(root.path(), &results(&[1.0], true, &[])).unwrap_err();
        assert!(
            matches!(&error, FilesError::WriteFile { path, .. } if path.ends_with("depth.npy")),
            "{error}"
        );
    }
}
