//! Finds the file of a model by its name: an existing path first, then the bundled models.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use nunet_core::graph::model_files;

use crate::error::EngineError;
use crate::installation::installation;
use crate::text::MODELS_VARIABLE;

/// The file of the model `name`: an existing path, or a bundled model with or without its extension.
///
/// # Errors
/// Neither a path nor a bundled model.
pub fn find_model(name: &Path) -> Result<PathBuf, EngineError> {
    if name.exists() { Ok(name.to_owned()) } else { find_in(model_folders(), name) }
}

fn find_in(folders: Vec<PathBuf>, name: &Path) -> Result<PathBuf, EngineError> {
    let is_bare = is_bare_name(name);
    let found = is_bare.then(|| folders.iter().find_map(|folder| model_in(folder, name))).flatten();
    found.ok_or_else(|| EngineError::ModelNotFound {
        name: name.to_owned(),
        is_bare,
        bundled: bundled_names(&folders),
        folders,
    })
}

/// Only a bare name is looked up: `./x.onnx` must not find another file.
fn is_bare_name(name: &Path) -> bool {
    name.components().count() == 1 && !name.starts_with(".")
}

fn model_in(folder: &Path, name: &Path) -> Option<PathBuf> {
    let exact = folder.join(name);
    [exact.clone(), exact.with_added_extension("onnx"), exact.with_added_extension("toml")]
        .into_iter()
        .find(|path| path.is_file())
}

/// The folders in which models are looked up by name, in order.
#[must_use]
pub fn model_folders() -> Vec<PathBuf> {
    match std::env::var_os(MODELS_VARIABLE).filter(|folder| !folder.is_empty()) {
        Some(folder) => vec![PathBuf::from(folder)],
        None => installation().model_folders.clone(),
    }
}

/// All models except the stages of a manifest in the same folder, because a stage alone gives no depth.
fn bundled_names(folders: &[PathBuf]) -> Vec<String> {
    let files = folders.iter().filter_map(|folder| folder.read_dir().ok()).flatten().flatten();
    let is_model =
        |path: &PathBuf| path.extension().is_some_and(|ending| ending == "onnx" || ending == "toml");
    let models: BTreeSet<_> = files.map(|file| file.path()).filter(is_model).collect();
    let manifests = models.iter().filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    let stages: BTreeSet<_> = manifests
        .filter_map(|path| model_files(path).ok())
        .flat_map(|files| files.into_iter().skip(1))
        .collect();
    let names = models.difference(&stages).filter_map(|path| path.file_name());
    names.map(|name| name.to_string_lossy().into_owned()).collect::<BTreeSet<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;
    use crate::error_kind::EngineErrorKind;

    #[test]
    fn an_existing_path_comes_before_a_bundled_model() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(find_model(file.path()).unwrap(), file.path());
    }

    #[test]
    fn a_bundled_model_is_found_with_and_without_its_extension() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("wnet_c.onnx"), "").unwrap();
        for name in ["wnet_c", "wnet_c.onnx"] {
            let found = find_in(vec![folder.path().to_owned()], Path::new(name)).unwrap();
            assert_eq!(found, folder.path().join("wnet_c.onnx"));
        }
    }

    #[test]
    fn a_path_never_falls_back_to_a_bundled_model() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("wnet_c.onnx"), "").unwrap();
        let error = find_in(vec![folder.path().to_owned()], Path::new("./missing/wnet_c.onnx")).unwrap_err();
        let EngineError::ModelNotFound { name, is_bare: false, .. } = &error else { panic!("{error}") };
        assert_eq!(name, Path::new("./missing/wnet_c.onnx"));
        assert_eq!(error.kind(), EngineErrorKind::NotFound);
        assert!(error.hint().is_some());
    }

    #[test]
    fn the_hint_lists_the_folders_where_there_is_no_model_at_all() {
        let folders = [PathBuf::from("/opt/none/models"), PathBuf::from("/opt/share/nunet/models")];
        let error = find_in(folders.to_vec(), Path::new("wnet_c.onnx")).unwrap_err();
        let hint = error.hint().unwrap();
        assert!(folders.iter().all(|folder| hint.contains(&folder.display().to_string())), "{hint}");
        assert!(hint.contains(MODELS_VARIABLE), "{hint}");
    }

    #[test]
    fn an_unknown_name_lists_the_models_but_not_their_stages() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["unet.onnx", "wnet_c.onnx", "wnet_c.segmentation.onnx", "wnet_c.depth.onnx"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let manifest = include_str!("../../../models/wnet_c.toml");
        std::fs::write(folder.path().join("wnet_c.toml"), manifest).unwrap();
        let error = find_in(vec![folder.path().to_owned()], Path::new("unett")).unwrap_err();
        let EngineError::ModelNotFound { bundled, is_bare: true, .. } = error else { panic!("{error}") };
        assert_eq!(bundled, ["unet.onnx", "wnet_c.onnx", "wnet_c.toml"]);
    }
}
